"""Frame around a compiled network: which slot of the value block is what, and the C text that the shell calls."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate

import numpy as np

from hystid.modelcode import ModelCode
from hystid.surrogate.emit import Functions
from hystid.surrogate.identifiers import readable
from hystid.surrogate.loops import number
from hystid.surrogate.program import Port, Program
from hystid.toolchain import digest_of, texts_of

INCLUDES = """\
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "hy_model.h"
"""


@dataclass(frozen=True)
class Block:
    """The value block in the order of ``hy_model.h``: the sizes of its parts and, from them, their first slots.

    p: parameters, u: inputs, x: continuous states, dx: their derivatives, d: memory of the network, y: outputs, pre:
    pre(d), w: private memory, as that of the latest sample. size: of the whole.
    """

    n_p: int = 0
    n_u: int = 0
    n_x: int = 0
    n_d: int = 0
    n_y: int = 0
    n_w: int = 0
    p: int = field(init=False)
    u: int = field(init=False)
    x: int = field(init=False)
    dx: int = field(init=False)
    d: int = field(init=False)
    y: int = field(init=False)
    pre: int = field(init=False)
    w: int = field(init=False)
    size: int = field(init=False)

    def __post_init__(self) -> None:
        sizes = (self.n_p, self.n_u, self.n_x, self.n_x, self.n_d, self.n_y, self.n_d, self.n_w)
        first = accumulate(sizes, initial=1)  # slot 0 is time
        for part, slot in zip(("p", "u", "x", "dx", "d", "y", "pre", "w", "size"), first, strict=True):
            object.__setattr__(self, part, slot)

    def defines(self) -> str:
        """The first slots as C constants."""
        pairs = {"P": self.p, "U": self.u, "X": self.x, "DX": self.dx, "D": self.d, "Y": self.y, "W": self.w}
        counts = {"N_U": self.n_u, "N_D": self.n_d, "N_Y": self.n_y, "N_VALUES": self.size}
        items = ", ".join(f"{name} = {value}" for name, value in (pairs | counts).items())
        return f"enum {{ {items} }};\n"

    def model(
        self, name: str, step: float, start: Mapping[int, float], functions: Sequence[str], sample: float = 0.0
    ) -> str:
        """The definition of ``hy_the_model``. functions: the members of ``hy_model`` that the text defines.

        sample: interval at which the memory moves on [s]; -1 where each step is a sample, 0 without memory.
        """
        values = ", ".join(f"[{slot}] = {number(value)}" for slot, value in sorted(start.items()))
        members = "".join(f"    .{function} = {function},\n" for function in functions)
        return f"""\
static const double start[N_VALUES] = {{ {values or "0.0"} }};

const hy_model hy_the_model = {{
    .name = "{readable(name).replace('"', "'")}",
    .token = TOKEN,
    .n_values = N_VALUES,
    .p = {self.p}, .n_p = {self.n_p}, .u = {self.u}, .n_u = {self.n_u}, .x = {self.x}, .n_x = {self.n_x},
    .dx = {self.dx}, .d = {self.d}, .n_d = {self.n_d}, .y = {self.y}, .n_y = {self.n_y}, .pre = {self.pre},
    .rel = {self.w}, .n_rel = 0, .w = {self.w}, .n_w = {self.n_w}, .n_z = 0,
    .step = {number(step)}, .sample = {number(sample)},
    .start = start,
{members}}};
"""


def signed(code: ModelCode) -> ModelCode:
    """The same model with its token, a hash of all that it consists of."""
    digest = digest_of((code.name, repr(code.variables), repr(code.experiment), *texts_of(code.sources)))
    token = "{" + str(uuid.UUID(bytes=digest.digest()[:16], version=4)) + "}"
    sources = {name: text.replace("TOKEN", f'"{token}"', 1) for name, text in code.sources.items()}
    return replace(code, token=token, sources=sources)


def offsets(ports: Sequence[Port], first: int) -> dict[str, int]:
    """First slot of each port's elements when they lie one after the other."""
    places, at = {}, first
    for port in ports:
        places[port.name] = at
        at += port.view.size
    return places


def text_of(functions: Functions) -> str:
    """All functions of a network, tables first."""
    return "\n".join([functions.tables, functions.value, functions.forward, functions.adjoint])


def call(
    program: Program,
    mode: str,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    d_inputs: Mapping[str, str] | None = None,
    d_outputs: Mapping[str, str] | None = None,
    work: str = "0",
) -> str:
    """A C call of a generated function; the mappings give a pointer expression per port name."""
    arguments = [inputs[port.name] for port in program.inputs]
    if d_inputs is not None:
        arguments += [d_inputs[port.name] for port in program.inputs]
    arguments += [outputs[port.name] for port in program.outputs]
    if d_outputs is not None:
        arguments += [d_outputs[port.name] for port in program.outputs]
    return f"network{mode}({', '.join([*arguments, work])});"


def range_test(expression: str, low: float, high: float) -> str:
    """C condition: outside [low, high]."""
    below = f"{expression} < {number(low)}" if np.isfinite(low) else ""
    above = f"{expression} > {number(high)}" if np.isfinite(high) else ""
    return " || ".join(part for part in (below, above) if part)
