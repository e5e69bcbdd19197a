"""Pass 1: scalar variables and equations; constants and structural parameters are numbers, functions are inlined."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, replace

from hystid.errors import ModelicaError, listed
from hystid.modelica.algorithms import run_section
from hystid.modelica.expand import Expander, NeededNow, elements
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, refs
from hystid.modelica.flat import (
    Action,
    Assertion,
    Branch,
    Equation,
    FlatModel,
    FlatVariable,
    Function,
    Place,
    Section,
    When,
)
from hystid.modelica.inlining import Call, assigned
from hystid.modelica.sources import near
from hystid.modelica.values import Value, flattened


@dataclass(frozen=True)
class ScalarVariable:
    """A scalar of the model; kind says what decides its value.

    kind: "constant" (a number), "parameter" (settable), "dependent" (parameter with a binding to others),
    "free" (parameter with fixed=false), "input" (from outside), "unknown" (everything that equations determine).
    """

    name: str
    kind: str
    flat: FlatVariable
    start: Expr | None
    binding: Expr | None
    min: float | None
    max: float | None
    nominal: float | None

    @property
    def fixed(self) -> bool:
        """Whether the start value is an initial equation."""
        return bool(self.flat.fixed)

    @property
    def place(self) -> Place:
        """Where it is declared."""
        return self.flat.place


@dataclass(frozen=True)
class ScalarEquation:
    """left = right."""

    left: Expr
    right: Expr
    place: Place


@dataclass(frozen=True)
class ScalarModel:
    """Postcondition: every Ref names a scalar variable or "time"; no arrays, no calls, no constants by name."""

    flat: FlatModel
    variables: dict[str, ScalarVariable]
    equations: tuple[ScalarEquation, ...]
    initial: tuple[ScalarEquation, ...]
    whens: tuple[When, ...]
    assertions: tuple[Assertion, ...]
    held: tuple[ScalarEquation, ...] = ()  # of variables that algorithm sections assign in when-clauses


def scalarise(flat: FlatModel, parameters: Mapping[str, float], built_in: Set[str] = frozenset()) -> ScalarModel:
    """The scalar model with ``parameters`` in place of the declared values.

    built_in: parameters that become constants. Raises ModelicaError for an unknown, final or constant parameter, or one
    outside min..max.
    """
    flat = replace(flat, variables=tuple(_overridden(flat, parameters)))
    flat = _with_structure(flat, built_in) if built_in else flat
    while True:
        try:
            return _scalarise(flat)
        except NeededNow as needed:
            flat = _with_structure(flat, needed.names)


def _with_structure(flat: FlatModel, names: Set[str]) -> FlatModel:
    """The model in which these parameters are built in."""
    for v in flat.variables:
        if v.name in names and (v.structural or v.binding is None):
            raise ModelicaError(f"{v.place}: '{v.name}' decides a size or a loop and has no value")
    marked = (replace(v, structural=v.structural or v.name in names) for v in flat.variables)
    return replace(flat, variables=tuple(marked))


def _scalarise(flat: FlatModel) -> ScalarModel:
    dims = {v.name: v.dims for v in flat.variables if v.dims}
    constants = _constants(flat, dims)
    open_parameters = frozenset(v.name for v in flat.variables if v.variability == "parameter" and not v.structural)
    expander = Expander(dims, constants, {f.name: f for f in flat.functions}, open_parameters)
    variables = {s.name: s for v in flat.variables for s in _scalars(v, expander, constants, flat)}
    _refuse_moving(variables)
    bound = [e for v in flat.variables for e in _binding_equations(v, expander)]
    initial = [
        *(s for e in flat.initial for s in _equations(e, expander)),
        *(e for section in flat.sections for e in _initial_values(section, flat, expander)),
    ]
    starts, others = _starts_before(initial, variables)
    variables |= {name: replace(variables[name], start=value) for name, value in starts.items()}
    outcomes = [(section.place, run_section(section, flat, expander)) for section in flat.algorithms]
    stated = [
        (ScalarEquation(Ref(n), value, place), n in o.held) for place, o in outcomes for n, value in o.values.items()
    ]
    return ScalarModel(
        flat,
        variables,
        tuple(
            [
                *(s for e in flat.equations for s in _equations(e, expander)),
                *(e for e, held in stated if not held),
                *bound,
            ]
        ),
        tuple(others),
        (*(_when(w, expander) for w in flat.whens), *(w for _, o in outcomes for w in o.whens)),
        tuple(_assertion(a, expander) for a in [*flat.assertions, *(a for _, o in outcomes for a in o.assertions)]),
        tuple(e for e, held in stated if held),
    )


# -- values that the user gives


def _overridden(flat: FlatModel, parameters: Mapping[str, float]) -> Iterator[FlatVariable]:
    names = {e: v for v in flat.variables if v.variability == "parameter" for e in elements(v.name, v.dims)}
    told = f"; it has {listed(sorted(names), _MOST_NAMES) or 'none'}"
    for name in parameters:
        if name not in names:
            raise ModelicaError(f"{flat.name} has no parameter '{name}'{near(name, names) or told}")
        if names[name].final:
            raise ModelicaError(f"{names[name].place}: parameter '{name}' of {flat.name} is final and cannot be set")
    for v in flat.variables:
        given = {e: parameters[e] for e in elements(v.name, v.dims) if e in parameters}
        yield replace(v, binding=_patched(v, given)) if given else v


_MOST_NAMES = 20  # of parameters in a message: more than any model of the library has, and still one sentence


def _patched(v: FlatVariable, given: Mapping[str, float]) -> Expr:
    if not v.dims:
        return Num(float(given[v.name]))
    if len(v.dims) > 1 or v.binding is None:
        raise ModelicaError(f"{v.place}: set the array parameter '{v.name}' in Modelica text, it has no simple binding")
    items = [
        Num(float(given[e])) if e in given else Op("[]", (v.binding, Num(float(k + 1))))
        for k, e in enumerate(elements(v.name, v.dims))
    ]
    return Op("{}", tuple(items))


# -- constants


def _constants(flat: FlatModel, dims: Mapping[str, tuple[int, ...]]) -> dict[str, float]:
    """Values of constants and structural parameters, by name of the scalar."""
    wanted = [v for v in flat.variables if v.binding is not None and (v.variability == "constant" or v.structural)]
    functions = {f.name: f for f in flat.functions}
    parameters = {v.name: v for v in flat.variables if v.variability == "parameter" and v.binding is not None}
    known: dict[str, float] = {}
    while wanted:
        expander = Expander(dims, known, functions, frozenset(parameters) - frozenset(known))
        left = [v for v in wanted if not _evaluated(v, expander, known)]
        if len(left) == len(wanted):
            wanted = _with_what_they_need(left, parameters, known)
            if len(wanted) == len(left):
                v = left[0]
                raise ModelicaError(f"{v.place}: the value of '{v.name}' must be known when the model is built")
            continue
        wanted = left
    return known


def _evaluated(v: FlatVariable, expander: Expander, known: dict[str, float]) -> bool:
    assert v.binding is not None
    expander.place = v.place
    try:
        values = expander.flat(v.binding)
    except NeededNow:
        return False  # what it needs becomes known later
    numbers = [x.value for x in values if isinstance(x, Num)]
    if len(numbers) != len(values):
        return False
    names = elements(v.name, v.dims)
    known.update(zip(names, numbers * (len(names) if len(numbers) == 1 else 1), strict=False))
    return True


def _with_what_they_need(
    left: list[FlatVariable], parameters: Mapping[str, FlatVariable], known: Mapping[str, float]
) -> list[FlatVariable]:
    """A structural parameter bound to others makes these structural too."""
    have = {v.name for v in left}
    needed = [n for v in left if v.binding is not None for n in sorted(refs(v.binding)) if n in parameters]
    return left + [parameters[n] for n in dict.fromkeys(needed) if n not in have and n not in known]


# -- variables


def _scalars(
    v: FlatVariable, expander: Expander, constants: Mapping[str, float], flat: FlatModel
) -> Iterator[ScalarVariable]:
    expander.place = v.place
    names = elements(v.name, v.dims)
    start, binding = _spread(v.start, v, expander), _spread(v.binding, v, expander)
    limits = [_spread(a, v, expander) for a in (v.min, v.max, v.nominal)]
    for k, name in enumerate(names):
        kind = "constant" if name in constants else _kind(v, binding[k])
        bound = Num(constants[name]) if name in constants else binding[k]
        scalar = ScalarVariable(name, kind, v, start[k], bound, *(_number(limit[k]) for limit in limits))
        if kind == "parameter":
            scalar = _settled(scalar, flat)
        yield scalar


def _refuse_moving(variables: Mapping[str, ScalarVariable]) -> None:
    """Raise ModelicaError for a parameter that follows a variable: the front end misses inputs and modifiers."""
    for v in variables.values():
        for name in sorted(refs(v.binding)) if v.kind == "dependent" and v.binding is not None else ():
            if name == "time" or variables[name].kind in ("unknown", "input"):
                raise ModelicaError(
                    f"{v.place}: parameter '{v.name}' cannot depend on '{name}', which changes during the simulation: "
                    "give it a value of parameters, or declare it without 'parameter'"
                )


def _settled(s: ScalarVariable, flat: FlatModel) -> ScalarVariable:
    """A parameter's value in its binding; without one, the start value; inside min..max."""
    value = s.binding if s.binding is not None else s.start if s.start is not None else ZERO
    if not isinstance(value, Num):
        raise ModelicaError(f"{s.place}: parameter '{s.name}' has no value that is known when the model is built")
    low = s.min if s.min is not None else float("-inf")
    high = s.max if s.max is not None else float("inf")
    if not low <= value.value <= high:
        raise ModelicaError(
            f"{s.place}: parameter '{s.name}' of {flat.name} is {value.value:g}, outside its range {low:g}..{high:g}"
        )
    return replace(s, binding=value)


def _kind(v: FlatVariable, binding: Expr | None) -> str:
    if v.variability == "constant":
        raise ModelicaError(f"{v.place}: constant '{v.name}' has no value")
    if v.variability == "parameter":
        if v.fixed is False:
            return "free"
        return "parameter" if binding is None or isinstance(binding, Num) else "dependent"
    return "input" if v.causality == "input" and "." not in v.name else "unknown"


def _spread(expr: Expr | None, v: FlatVariable, expander: Expander) -> list[Expr] | list[None]:
    """Value of an attribute for each element of an array."""
    count = len(elements(v.name, v.dims))
    if expr is None:
        return [None] * count
    values = expander.flat(expr)
    if len(values) == 1:
        return values * count
    if len(values) != count:
        raise ModelicaError(f"{v.place}: '{v.name}' has {count} elements, the value given has {len(values)}")
    return values


def _number(expr: Expr | None) -> float | None:
    return expr.value if isinstance(expr, Num) else None


def _binding_equations(v: FlatVariable, expander: Expander) -> Iterator[ScalarEquation]:
    if v.binding is None or v.variability in ("constant", "parameter"):
        return
    if v.causality == "input" and "." not in v.name:
        return
    yield from _equations(Equation(Op("-", (Ref(v.name), v.binding)), v.place), expander)


# -- equations


def _equations(e: Equation, expander: Expander) -> Iterator[ScalarEquation]:
    expander.place = e.place
    for left, right in _sides(e.residual, expander):
        yield ScalarEquation(left, right, e.place)


def _initial_values(section: Section, flat: FlatModel, expander: Expander) -> Iterator[ScalarEquation]:
    """What an initial algorithm assigns, as equations; before its first assignment a variable has its start value."""
    expander.place = section.place
    names = dict.fromkeys(assigned(section.statements))
    before: dict[str, Value] = {}
    for v in (v for v in flat.variables if v.name in names):
        start = v.start if v.start is not None else ZERO
        before[v.name] = expander.value(Op("fill", (start, *(Num(float(n)) for n in v.dims))) if v.dims else start, {})
    function = Function("initial algorithm", (), (), (), section.statements, section.place)
    after = Call(expander, function, []).section(before)
    for v in (v for v in flat.variables if v.name in names):
        values = flattened(after[v.name])
        yield from (
            ScalarEquation(Ref(name), value, section.place)
            for name, value in zip(elements(v.name, v.dims), values, strict=True)
        )


def _starts_before(
    initial: Iterable[ScalarEquation], variables: Mapping[str, ScalarVariable]
) -> tuple[dict[str, Expr], list[ScalarEquation]]:
    """``pre(y) = value`` of parameters as an initial equation is the start value of y; and what else there is."""
    starts: dict[str, Expr] = {}
    others: list[ScalarEquation] = []
    for e in initial:
        left, right = (e.left, e.right) if isinstance(e.left, Op) and e.left.name == "pre" else (e.right, e.left)
        settled = all(
            n in variables and variables[n].kind in ("parameter", "dependent", "constant") for n in refs(right)
        )
        if isinstance(left, Op) and left.name == "pre" and isinstance(left.args[0], Ref) and settled:
            starts[left.args[0].name] = right
        else:
            others.append(e)
    return starts, others


def _sides(residual: Expr, expander: Expander) -> Iterator[tuple[Expr, Expr]]:
    joined = _joined(residual)
    if not (isinstance(joined, Op) and joined.name == "-"):
        yield from ((value, ZERO) for value in expander.flat(joined))
        return
    left, right = (expander.flat(a) for a in joined.args)
    if isinstance(joined.args[0], Op) and joined.args[0].name == "tuple":
        yield from _outputs(joined.args[0].args, joined.args[1], expander)
        return
    sizes = {len(left), len(right)} - {1}
    if len(sizes) > 1:
        expander.refuse(f"the sides of an equation have {len(left)} and {len(right)} elements")
    if sizes == {0}:
        return
    count = max(len(left), len(right))
    yield from zip(left * (count // len(left)), right * (count // len(right)), strict=True)


def _outputs(targets: tuple[Expr, ...], call: Expr, expander: Expander) -> Iterator[tuple[Expr, Expr]]:
    """(a, , c) = f(...): pairs of wanted outputs, nothing for those left out."""
    if not (isinstance(call, Op) and call.name.startswith("call ")):
        expander.refuse("a list of outputs takes a function call")
    for target, part in zip(targets, expander.outputs(call, {}), strict=False):
        if target == Op("nothing", ()):
            continue
        names = expander.flat(target)
        items = list(part.flat) if hasattr(part, "flat") else [part]
        yield from zip(names, items, strict=True)


def _joined(residual: Expr) -> Expr:
    """if c then (v - a) else (v - b) becomes v - (if c then a else b), so that the equation stays explicit in v."""
    if not (isinstance(residual, Op) and residual.name == "if"):
        return residual
    a, b = _joined(residual.args[1]), _joined(residual.args[2])
    both = isinstance(a, Op) and isinstance(b, Op) and a.name == b.name == "-"
    if both and a.args[0] == b.args[0]:  # type: ignore[union-attr]
        return Op("-", (a.args[0], Op("if", (residual.args[0], a.args[1], b.args[1]))))  # type: ignore[union-attr]
    return Op("if", (residual.args[0], a, b))


# -- when-clauses


def _when(w: When, expander: Expander) -> When:
    return When(tuple(_branch(b, expander) for b in w.branches))


def _branch(b: Branch, expander: Expander) -> Branch:
    expander.place = b.place
    conditions = tuple(c for e in b.conditions for c in expander.flat(e))
    return Branch(conditions, tuple(s for a in b.actions for s in _actions(a, expander)), b.place)


def _actions(a: Action, expander: Expander) -> Iterator[Action]:
    expander.place = a.place
    guard = expander.scalar(a.guard) if a.guard is not None else None
    if guard == ZERO:
        return
    guard = None if guard == ONE else guard
    if a.kind == "assert":
        yield replace(a, value=expander.scalar(a.value), message=_message(a.message, expander), guard=guard)
        return
    targets = elements(a.target, expander.dims.get(a.target, ()))
    values = expander.flat(a.value)
    if len(values) not in (1, len(targets)):
        expander.refuse(f"'{a.target}' has {len(targets)} elements, the value given has {len(values)}")
    for target, value in zip(targets, values * (len(targets) // len(values)), strict=True):
        yield replace(a, target=target, value=value, guard=guard)


def _assertion(a: Assertion, expander: Expander) -> Assertion:
    expander.place = a.place
    return replace(a, condition=expander.scalar(a.condition), message=_message(a.message, expander))


def _message(message: Expr | None, expander: Expander) -> Expr:
    """Texts joined by "+", numbers inside String()."""
    if isinstance(message, Op) and message.name == "+":
        return Op("+", tuple(_message(a, expander) for a in message.args))
    if isinstance(message, Op) and message.name == "String":
        return Op("String", (expander.scalar(message.args[0]),))
    return message if message is not None else ZERO
