"""The functions of ``Modelica.Math.Random`` that draw and start random numbers: their calls become operations."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hystid.modelica.expr import ZERO, Expr, Num, Op, Ref, Text, nodes, op
from hystid.modelica.flat import FlatModel
from hystid.modelica.values import Interpreter, Value, array, flattened
from hystid.modelica.xorshift import GENERATORS, hashed

_FUNCTION = re.compile(
    r"(?:^|\.)(?:Random\.Generators\.(?P<kind>Xorshift\w+)\.(?P<what>random|initialState)"
    r"|(?P<name>Random\.Utilities\.automaticLocalSeed|Utilities\.Strings\.hashString)"
    r"|Random\.Utilities\.(?P<other>initializeImpureRandom|impureRandom|automaticGlobalSeed))$"
)
_ROUNDS = 10  # draws until a state is good, whatever the seeds are
_PRIME = 126247697.0  # stands for two seeds of 0
_HIDDEN = 715827883.0  # what initializeImpureRandom gives back
_UNREPEATABLE = {
    "impureRandom": "keeps a state that no variable shows: draw with Xorshift128plus.random(pre(state))",
    "automaticGlobalSeed": "differs from run to run: set useAutomaticSeed = false and fixedSeed",
}


def is_random_function(name: str) -> bool:
    """Whether a function draws random numbers, or makes a seed."""
    return _FUNCTION.search(name) is not None


def seeds_of_names(flat: FlatModel) -> Iterator[str]:
    """Components whose noise takes its seed from their name, which tools write in different ways."""
    off = {v.name for v in flat.variables if v.binding == ZERO}
    stated = [*(v.binding for v in flat.variables if v.binding is not None), *(e.residual for e in flat.initial)]
    for node in (n for expr in stated for n in nodes(expr)):
        match node:
            case Op("if", (Ref(condition), *_)) if condition in off:
                continue
            case Op("if", (_, Op(function, (Text(name), *_)), *_)) if function.endswith(".automaticLocalSeed"):
                yield name


def drawn(expander: Interpreter, name: str, args: Sequence[Value]) -> list[Value]:
    """Outputs of such a call: the number and the next state, a first state, or a seed."""
    found = _FUNCTION.search(name)
    assert found is not None
    if found["other"] in _UNREPEATABLE:
        expander.refuse(f"{found['other']}() is not supported: it {_UNREPEATABLE[found['other']]}")
    if found["other"]:
        return [Num(_HIDDEN)]
    if found["name"]:
        if len(args) != 1 or not isinstance(args[0], Text):
            expander.refuse(f"{name}() needs a text that is known when the model is built")
        return [Num(float(hashed(args[0].value)))]
    kind = f"hy_{found['kind'].lower()}"
    size = GENERATORS[kind][1]
    given = [e for a in args for e in flattened(a)]
    wanted = 2 if found["what"] == "initialState" else size
    if len(given) != wanted:
        expander.refuse(f"{name}() takes {wanted} Integers, not {len(given)}")
    if found["what"] == "initialState":
        return [array(_first_state(size, *given))]
    return [op(kind, ZERO, *given), array(_next_state(kind, given))]


def _next_state(kind: str, state: Sequence[Expr]) -> list[Expr]:
    return [op(kind, Num(float(k)), *state) for k in range(1, len(state) + 1)]


def _first_state(size: int, local: Expr, globally: Expr) -> list[Expr]:
    """Integers that two seeds make: a generator of 64 bits, whose states follow each other in the longer row."""
    both = op("and", op("==", local, ZERO), op("==", globally, ZERO))
    state = [op("if", both, Num(_PRIME), local), globally]
    for _ in range(_ROUNDS):
        state = _next_state("hy_xorshift64star", state)
    while len(state) < size:
        state += _next_state("hy_xorshift64star", state[-2:])
    return state[:size]
