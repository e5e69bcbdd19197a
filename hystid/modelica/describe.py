"""The hybrid model in the words of the FMI standard: variables, dependencies, sources -> ``ModelCode``."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from hystid.modelcode import ModelCode, Variable
from hystid.modelica.blocks import Step, sources, targets
from hystid.modelica.c_expr import comment, number, quoted
from hystid.modelica.check import equation_text
from hystid.modelica.delays import slots
from hystid.modelica.duhem import DuhemState, duhem_states
from hystid.modelica.emit_c import Emitter, indented
from hystid.modelica.emit_derivatives import DerivativeEmitter
from hystid.modelica.event_model import der
from hystid.modelica.expr import refs
from hystid.modelica.hybrid import HybridModel, is_output
from hystid.modelica.jumps import jumps_without_event
from hystid.modelica.layout import Layout
from hystid.modelica.scalar import ScalarVariable
from hystid.modelica.shown import Shown, shown_of
from hystid.modelica.stops import Stop, stops_of

_TOKEN = "{token}"  # stands in the text until its hash is known
_MOST_EQUATIONS = 200  # that the documentation of an FMU shows: nobody reads more
_FEW_COUPLES = 16  # pairs of states per state that are worth a table: large models that are dense have none
_SECTIONS = ("p", "u", "x", "dx", "d", "y", "pre", "rel", "w")


def model_code(model: HybridModel) -> ModelCode:
    """The model as C with its description."""
    layout = Layout(model)
    variables = tuple(_variables(model, layout))
    draft = ModelCode(
        name=model.flat.name,
        description=model.flat.description,
        variables=variables,
        sources={},
        states=model.states,
        n_indicators=sum(len(r.indicators) for r in model.relations),
        n_values=layout.size,
        dependencies=_dependencies(model),
        has_forward=not model.delays,  # they would lack what goes through the past
        has_adjoint=not model.delays,
        has_memory=bool(model.assertions or model.delays),
        experiment=model.flat.experiment,
        unread=_unread(model),
        jumps=jumps_without_event(model),
        equations=tuple(equation_text(e.residual) for e in model.flat.equations[:_MOST_EQUATIONS]),
        texts=model.flat.texts,
    )
    named = f"{draft.enumerations}{draft.texts}" if draft.enumerations or draft.texts else ""
    text = _c_text(model, layout, _TOKEN)
    token = hashlib.sha256(f"{text}{draft}{named}".encode()).hexdigest()
    guid = "{" + "-".join((token[:8], token[8:12], token[12:16], token[16:20], token[20:32])) + "}"
    return replace(draft, sources={"model.c": text.replace(_TOKEN, guid)}, token=guid)


# -- C


def _c_text(model: HybridModel, layout: Layout, token: str) -> str:
    emitter = Emitter(model, layout)
    derivatives = DerivativeEmitter(emitter)
    functions = {"parameters": emitter.parameters(), "initialise": emitter.initialise(), "evaluate": emitter.evaluate()}
    stops, duhem, shown = stops_of(model), duhem_states(model), shown_of(model)
    if shown:
        functions["show"] = emitter.show(shown)
    if any(r.indicators for r in model.relations):
        functions["indicators"] = emitter.indicators()
    if model.relations or model.discrete or model.reinits or model.checks or model.delays:
        functions["update"] = emitter.update()
    if model.samplers or model.delays or any(r.deadline is not None for r in model.relations):
        functions["next_time_event"] = emitter.next_time_event()
    if model.assertions or model.delays:
        functions["completed_step"] = emitter.completed_step()
    if not model.delays:
        functions |= {"forward": derivatives.forward(), "adjoint": derivatives.adjoint()}
    body = [line for lines in functions.values() for line in lines]
    head = [
        f"/* {comment(model.flat.name)}: {comment(model.flat.description)}",
        "   Written by hystid from Modelica. The block is laid out as hy_model.h says. */",
        '#include "hy_model.h"',
        "",
        "#include <math.h>",
        *(["#include <stdio.h>"] if any("snprintf" in line for line in [*body, *emitter.preamble()]) else []),
        "",
    ]
    return "\n".join(
        [*head, *emitter.preamble(), *body, *_table(model, layout, functions, token, _Known(stops, duhem, shown)), ""]
    )


@dataclass(frozen=True)
class _Known:
    """What is known of inner states without a step of time."""

    stops: tuple[Stop, ...]
    duhem: tuple[DuhemState, ...]
    shown: Shown | None


def _table(
    model: HybridModel, layout: Layout, functions: Mapping[str, list[str]], token: str, known: _Known
) -> list[str]:
    starts = [0.0] * (layout.size - sum(len(slots(*delay)) for delay in model.delays.items()))  # the rest is 0
    starts[0] = model.flat.experiment.start
    for name, value in model.start.starts.items():
        if name in layout.slots and name not in model.aliases:
            starts[layout.slots[name]] = value
    rows = [", ".join(number(v) for v in starts[k : k + 12]) for k in range(0, len(starts), 12)]
    pairs, stops, duhem, shown = _couples(model), known.stops, known.duhem, known.shown
    fields = [
        f".name = {quoted(model.flat.name)}, .token = {quoted(token)}, .n_values = {layout.size},",
        *(f".{s} = {layout.first(s)}, .n_{s} = {layout.count(s)}," for s in _SECTIONS if s not in ("dx", "pre")),
        f".dx = {layout.first('dx')}, .pre = {layout.first('pre')},",
        f".n_z = {sum(len(r.indicators) for r in model.relations)}, .step = {number(model.flat.experiment.step)},",
        ".start = hy_start_values,",
        *([f".couples = hy_pairs, .n_couples = {len(pairs)},"] if pairs else []),
        *([f".stops = hy_sliders, .n_stops = {len(stops)}, .stop_methods = &hy_stop_methods,"] if stops else []),
        *(
            [f".duhem = hy_rate_independent, .n_duhem = {len(duhem)}, .duhem_methods = &hy_duhem_methods,"]
            if duhem
            else []
        ),
        *([".paths = &hy_path_methods,"] if stops or duhem else []),
        *([f".shown = hy_outputs, .n_shown = {len(shown.variables)}, .strips = &hy_strip_methods,"] if shown else []),
        *(f".{name} = hy_{name}," for name in functions),
    ]
    return [
        f"static const double hy_start_values[{layout.size}] = {{",
        *indented(r + "," for r in rows),
        "};",
        "",
        *(_array("int hy_pairs", [f"{{{i}, {j}}}" for i, j in pairs], 12, "[2]") if pairs else []),
        *(_array("hy_stop hy_sliders", _stop_cells(stops, layout)) if stops else []),
        *(_array("hy_duhem_state hy_rate_independent", _duhem_cells(duhem, layout)) if duhem else []),
        *(_array("int hy_outputs", [str(layout.slots[name]) for name in shown.variables], 12) if shown else []),
        "const hy_model hy_the_model = {",
        *indented(fields),
        "};",
    ]


def _couples(model: HybridModel) -> list[tuple[int, int]]:
    """States (i, j) of which the derivative of one depends on the other between events; none where there are many."""
    known: dict[str, frozenset[int]] = {name: frozenset({k}) for k, name in enumerate(model.states)}
    for step in model.derivatives:
        needs = frozenset(k for name in sources(step) for k in known.get(name, frozenset()))
        for target in targets(step):
            known[target] = needs
    found = [(i, j) for i, name in enumerate(model.states) for j in sorted(known.get(der(name), frozenset()))]
    return found if len(found) <= _FEW_COUPLES * len(model.states) else []


def _array(name: str, cells: Sequence[str], each: int = 1, size: str = "") -> list[str]:
    """A table in C, with so many of its cells in a line. size: of a cell that is an array itself."""
    rows = (", ".join(cells[k : k + each]) for k in range(0, len(cells), each))
    return [f"static const {name}[{len(cells)}]{size} = {{", *indented(f"{row}," for row in rows), "};", ""]


def _stop_cells(stops: Sequence[Stop], layout: Layout) -> list[str]:
    places = ((-1 if name is None else layout.slots[name] for name in stop.names()) for stop in stops)
    return [f"{{{', '.join(map(str, each))}}}" for each in places]


def _duhem_cells(found: Sequence[DuhemState], layout: Layout) -> list[str]:
    names = ((one.state, der(one.state), one.speed) for one in found)
    return [f"{{{', '.join(str(layout.slots[name]) for name in each)}}}" for each in names]


# -- variables


def _variables(model: HybridModel, layout: Layout) -> Iterator[Variable]:
    for name, v in model.variables.items():
        yield _variable(name, v, model, layout)
    for name in model.states:
        v = model.variables[name]
        yield Variable(
            der(name),
            layout.slots[der(name)],
            "local",
            "continuous",
            initial="calculated",
            unit=f"{v.flat.unit}/s" if v.flat.unit and "/" not in v.flat.unit else _per_second(v.flat.unit),
            description=f"derivative of {name}",
            derivative_of=name,
        )


def _per_second(unit: str) -> str:
    """Unit of the derivative of a quantity whose unit is a quotient: "m/s" -> "m/s2", "N/m" -> "N/(m.s)"."""
    if not unit or unit == "1":
        return "1/s" if unit else ""
    above, below = unit.split("/", 1)
    if below == "s":
        return f"{above}/s2"
    if below.startswith("s") and below[1:].isdigit():
        return f"{above}/s{int(below[1:]) + 1}"
    return f"{above}/({below.strip('()')}.s)"


def _variable(name: str, v: ScalarVariable, model: HybridModel, layout: Layout) -> Variable:
    causality, variability, initial = _role(name, v, model)
    start: float | None = None
    if initial in ("exact", "approx") or causality == "input":
        start = model.start.starts.get(name, 0.0)
    return Variable(
        name=name,
        slot=layout.slots[name],
        causality=causality,  # type: ignore[arg-type]  # words of FMI, from _role
        variability=variability,  # type: ignore[arg-type]  # the same
        type=v.flat.type,
        initial=initial,  # type: ignore[arg-type]  # the same
        start=start,
        min=v.min,
        max=v.max,
        nominal=v.nominal,
        unit=v.flat.unit if v.flat.type == "Real" else "",
        shown=v.flat.shown,
        description=v.flat.description,
        enumeration=v.flat.enumeration,
    )


def _role(name: str, v: ScalarVariable, model: HybridModel) -> tuple[str, str, str | None]:
    """Causality, variability and initial."""
    if v.kind == "constant" or (v.kind == "parameter" and v.flat.final):  # Modelica lets nobody set it
        return "local", "constant", "exact"
    if v.kind == "parameter":
        return "parameter", _parameter_variability(name, v, model), "exact"
    if v.kind in ("dependent", "free"):
        late = v.kind == "free" or name in model.start.solved
        needs = refs(v.binding) if v.binding is not None and not late else frozenset()
        fixed = late or any(_parameter_variability(n, model.variables[n], model) == "fixed" for n in needs)
        return "calculatedParameter", "fixed" if fixed else "tunable", "calculated"
    if v.kind == "input":
        return "input", "continuous" if v.flat.type == "Real" else "discrete", None
    causality = "output" if is_output(name, v) else "local"
    if name in model.discrete:
        return causality, "discrete", "calculated"
    if name in model.states:
        exact = name not in model.start.solved
        return causality, "continuous", "exact" if exact else "calculated"
    return causality, "continuous" if v.flat.type == "Real" else "discrete", "calculated"


def _parameter_variability(name: str, v: ScalarVariable, model: HybridModel) -> str:
    """Parameters of the start alone cannot be tuned later."""
    if v.kind in ("dependent", "free", "constant"):
        return "fixed" if v.kind != "dependent" else "tunable"
    running = _running_names(model)
    return "tunable" if v.flat.type == "Real" and name in running else "fixed"


@lru_cache(maxsize=4)
def _running_names(model: HybridModel) -> frozenset[str]:
    """Names read after the start, directly or through dependent parameters."""
    found = {n for s in (*model.derivatives, *model.event) for n in sources(s)}
    found |= {n for r in model.relations for n in refs(r.value)}
    found |= {n for r in model.reinits for n in refs(r.value) | refs(r.active)}
    found |= {n for d in model.delays for e in (d.value, d.time, d.most) for n in refs(e)}
    found |= {n for s in model.samplers for n in refs(s.start) | refs(s.interval)}
    for step in reversed(model.start.dependent):
        if any(t in found for t in targets(step)):
            found |= sources(step)
    return frozenset(found)


# -- dependencies


def _dependencies(model: HybridModel) -> dict[str, tuple[str, ...]]:
    """Which inputs, states, parameters (and whether time) each output and derivative needs, directly or not."""
    order = ["time", *model.settable, *model.computed, *model.inputs, *model.states, *model.discrete]
    known: dict[str, frozenset[str]] = {n: frozenset({n}) for n in order}
    for step in (*model.start.dependent, *model.derivatives, *_discrete_steps(model)):
        needs = frozenset(k for n in sources(step) for k in known.get(n, frozenset()))
        for t in targets(step):
            known[t] = needs
    wanted = [n for n, v in model.variables.items() if is_output(n, v)]
    named = {n: known.get(model.aliases.get(n, n), frozenset()) for n in wanted}
    named |= {der(n): known.get(der(n), frozenset()) for n in model.states}
    return {n: tuple(k for k in order if k in needs) for n, needs in named.items()}


def _unread(model: HybridModel) -> tuple[str, ...]:
    """Inputs that no equation, relation, sampler, reinit or assertion mentions."""
    steps = (*model.start.dependent, *model.derivatives, *model.event, *model.start.steps)
    exprs = [e for r in model.relations for e in (r.value, *r.indicators, *((r.deadline,) if r.deadline else ()))]
    exprs += [e for s in model.samplers for e in (s.start, s.interval)]
    exprs += [e for d in model.delays for e in (d.value, d.time, d.most)]
    exprs += [e for r in model.reinits for e in (r.value, r.active)]
    exprs += [e for a in (*model.assertions, *(a for _, a in model.checks)) for e in (a.condition, a.message)]
    exprs += [condition for condition, _ in model.checks]
    read = frozenset[str]().union(*map(sources, steps), *map(refs, exprs))
    return tuple(name for name in model.inputs if name not in read)


def _discrete_steps(model: HybridModel) -> list[Step]:
    return [s for s in model.event if any(t in model.discrete for t in targets(s))]
