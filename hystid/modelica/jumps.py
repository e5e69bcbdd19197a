"""Derivatives that jump without an event: what a solver with error control cannot get past.

``noEvent(sign(v))`` times a force is such a jump, and the structure comes to rest on it. It is looked for numerically,
at the sign changes of the states: relations that make events stand still there.
"""

from __future__ import annotations

import math

import numpy as np

from hystid.modelica.blocks import Assign, Step, sources
from hystid.modelica.events import der
from hystid.modelica.expr import Op, evaluate, nodes
from hystid.modelica.hybrid import HybridModel

_DRAWS = 4  # of everything else: a jump that depends on it is there in most of them
_NEAR = (1e-9, 1e-12)  # distances from 0, in units of a state: a slope shrinks with them, a jump stays
_JUMP = 1e-9  # least, as part of the derivative away from 0: a thousand roundings and more
_LARGEST = 400  # steps of evaluation: the models that this is about are small


def jumps_without_event(model: HybridModel) -> bool:
    """Whether a derivative jumps where a state changes its sign, parameters as they stand."""
    steps = (*model.dependent, *model.derivatives)
    if len(steps) > _LARGEST or not any(_has_sign(step) for step in steps):
        return False
    rng = np.random.default_rng(0)
    named = {name for step in steps for name in sources(step)}
    for _ in range(_DRAWS):
        point = {name: model.starts.get(name, float(rng.integers(2))) for name in named}
        point |= {name: float(rng.uniform(-1e-3, 1e-3)) for name in (*model.states, *model.inputs)}
        usual = _derivatives(model, steps, dict(point))
        for state in model.states:
            far, near = (_changes(model, steps, point, state, distance) for distance in _NEAR)
            if any(abs(near[n]) > max(0.5 * abs(far[n]), _JUMP * abs(usual.get(n, 0.0)), 1e-300) for n in near):
                return True
    return False


def _has_sign(step: Step) -> bool:
    return isinstance(step, Assign) and any(isinstance(n, Op) and n.name == "sign" for n in nodes(step.value))


def _changes(
    model: HybridModel, steps: tuple[Step, ...], point: dict[str, float], state: str, distance: float
) -> dict[str, float]:
    """What each derivative changes by where the state changes its sign."""
    high, low = (_derivatives(model, steps, {**point, state: side * distance}) for side in (1, -1))
    return {name: high[name] - low[name] for name in model.states if name in high and name in low}


def _derivatives(model: HybridModel, steps: tuple[Step, ...], values: dict[str, float]) -> dict[str, float]:
    """State -> its derivative, where it can be computed."""
    for step in steps:
        if isinstance(step, Assign) and sources(step) <= values.keys():
            found = evaluate(step.value, values)
            if found is not None:
                values[step.variable] = found
    slopes = {name: values[der(name)] for name in model.states if der(name) in values}
    return {name: value for name, value in slopes.items() if math.isfinite(value)}
