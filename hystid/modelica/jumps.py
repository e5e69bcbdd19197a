"""Derivatives that jump without an event: what a solver with error control cannot get past.

``noEvent(sign(v))`` times a force is such a jump, and the structure comes to rest on it. It is looked for numerically,
at the sign changes of the states: relations that make events stand still there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hystid.modelica.blocks import Assign, Step, sources
from hystid.modelica.event_model import der
from hystid.modelica.expr import Op, evaluate, nodes
from hystid.modelica.hybrid import HybridModel

_DRAWS = 4  # of everything else: a jump that depends on it is there in most of them
_NEAR_ZERO = (1e-9, 1e-12)  # distances from 0, in units of a state: a slope shrinks with them, a jump stays
_JUMP = 1e-9  # least, as part of the derivative away from 0: a thousand roundings and more
_LARGEST = 400  # steps of evaluation: the models that this is about are small


_Needs = tuple[Assign, frozenset[str]]


def jumps_without_event(model: HybridModel) -> bool:
    """Whether a derivative jumps where a state changes its sign, parameters as they stand."""
    steps = (*model.start.dependent, *model.derivatives)
    if len(steps) > _LARGEST or not any(_has_sign(step) for step in steps):
        return False
    rng = np.random.default_rng(0)
    named = {name for step in steps for name in sources(step)}
    assigns = [(step, sources(step)) for step in steps if isinstance(step, Assign)]
    after = {state: _behind(assigns, state) for state in model.states}
    for _ in range(_DRAWS):
        point = {name: model.start.starts.get(name, float(rng.integers(2))) for name in named}
        point |= {name: float(rng.uniform(-1e-3, 1e-3)) for name in (*model.states, *model.inputs)}
        _evaluate(assigns, point)
        usual = _slopes(model, point)
        for state in model.states:
            far, near = (_changes(model, after[state], point, state, distance) for distance in _NEAR_ZERO)
            if any(abs(near[n]) > max(0.5 * abs(far[n]), _JUMP * abs(usual.get(n, 0.0)), 1e-300) for n in near):
                return True
    return False


def _has_sign(step: Step) -> bool:
    return isinstance(step, Assign) and any(isinstance(n, Op) and n.name == "sign" for n in nodes(step.value))


def _behind(assigns: Sequence[_Needs], state: str) -> list[_Needs]:
    """The steps that a state acts upon, the others stay as they are."""
    changed, found = {state}, []
    for step, needs in assigns:
        if needs & changed:
            changed.add(step.variable)
            found.append((step, needs))
    return found


def _changes(
    model: HybridModel, steps: Sequence[_Needs], point: Mapping[str, float], state: str, distance: float
) -> dict[str, float]:
    """What each derivative changes by where the state changes its sign."""
    sides = []
    for side in (1, -1):
        values = {**point, state: side * distance}
        _evaluate(steps, values)
        sides.append(_slopes(model, values))
    high, low = sides
    return {name: high[name] - low[name] for name in model.states if name in high and name in low}


def _evaluate(steps: Sequence[_Needs], values: dict[str, float]) -> None:
    """Adds what can be computed."""
    for step, needs in steps:
        if needs <= values.keys() and (found := evaluate(step.value, values)) is not None:
            values[step.variable] = found


def _slopes(model: HybridModel, values: Mapping[str, float]) -> dict[str, float]:
    slopes = {name: values[der(name)] for name in model.states if der(name) in values}
    return {name: value for name, value in slopes.items() if math.isfinite(value)}
