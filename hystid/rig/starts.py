"""Start values of a law, from the recordings, for parameters that nobody gave.

The defaults of a class of the library stand for a rig of the authors' size. What they say about each other (which
spring is the softer one, that fast friction is the lower one) is kept; their sizes follow from the recordings by unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from hystid.modelcode import ModelCode, Variable
from hystid.numeric import Array
from hystid.rig.terms import real_parameters

_LIBRARY = "HystId."
_ROWS = 20_000  # rows for a coarse fit
_LIGHT = 0.02  # share of the force below which inertia is not seen
_ONE_TONE = 0.99  # correlation of x and -a beyond which inertia cannot be told from stiffness
_CLEAR_MASS = 0.5  # a motion of one frequency shows a mass only if it leaves less than this share of the residual
_ROUNDED = 0.01  # share of the largest speed over which a jump that the default has sharp is rounded, as a start
_STICK = 0.2  # share of the largest displacement over which a contact sticks, as a start
_SELDOM = 9  # such shares, evenly spaced, of contacts that slip seldom
_OF_ALL = (0.25, 1.0)  # their stiffness over that of the structure


@dataclass(frozen=True)
class Sizes:
    """Coarse fit of F = m a + B v + k x + c sign(v) + constant, no coefficient negative; sizes of the motion.

    mass [kg]: 0 where inertia is below 2 % of the force, or the motion has one frequency and the mass explains little.
    damping [N s/m], stiffness [N/m], friction [N]; length [m] and speed [m/s]: largest absolute values. stick [N/m]:
    stiffness of a contact that sticks, over a share ``sticks`` of that length.
    """

    mass: float
    damping: float
    stiffness: float
    friction: float
    length: float
    speed: float
    stick: float
    sticks: float = _STICK

    def seldom_slipping(self) -> list[Sizes]:
        """The same for contacts that slip seldom: the coarse fit takes most of their force for that of a spring."""
        shares = [(k + 1) / (_SELDOM + 1) for k in range(_SELDOM)]
        stiff = [part * self.stiffness for part in _OF_ALL]
        return [
            replace(self, friction=share * stick * self.length, stick=stick, sticks=share)
            for stick in stiff
            for share in shares
        ]


def sizes_of(motion: Sequence[Array], force: Array, mass: float | None, *, inertial: bool) -> Sizes:
    """Sizes from recordings. motion: x, v, a, each of shape (n,), as the force. mass [kg]: as given, None where it is
    sought. inertial: whether time is a measured one."""
    x, v, a = motion
    step = max(1, len(x) // _ROWS)
    x, v, a, force = x[::step], v[::step], a[::step], force[::step]
    force = force - (mass or 0.0) * a
    columns = np.stack([a, v, x, np.sign(v), np.ones_like(x), -np.ones_like(x)], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    still, rest = nnls(columns[:, 1:] / scale[1:], force)
    found = np.concatenate([[0.0], still]) / scale
    if mass is None and inertial:
        moving, left = nnls(columns / scale, force)
        if abs(_correlation(x, a)) < _ONE_TONE or left < _CLEAR_MASS * rest:
            found = moving / scale
    spread = float(np.std(force)) or 1.0
    heavy = found[0] * float(np.std(a)) > _LIGHT * spread
    length, speed = float(np.max(np.abs(x))) or 1.0, float(np.max(np.abs(v))) or 1.0
    stiffness, friction = float(found[2]) or 0.1 * spread / length, max(float(found[3]), 0.05 * spread)
    return Sizes(
        mass if mass is not None else float(found[0]) if heavy else 0.0,
        float(found[1]) or 0.05 * spread / speed,
        stiffness,
        friction,
        length,
        speed,
        stiffness + friction / (_STICK * length),
    )


def _correlation(one: Array, other: Array) -> float:
    spread = float(np.std(one) * np.std(other))
    return float(np.mean((one - np.mean(one)) * (other - np.mean(other)))) / spread if spread > 0 else 0.0


def is_of_the_library(model: str) -> bool:
    """Whether a class is one of ours, whose defaults say nothing about a rig; a user's are what the user believes."""
    return model.startswith(_LIBRARY)


def turning(variables: Sequence[Variable]) -> list[str]:
    """Speeds over which a law turns with the direction of motion, where its default is to turn at once.

    variables: the real parameters of a class of the library.
    """
    return [v.name for v in variables if v.unit == "m/s" and v.min == 0 and not v.start]


def scaled(code: ModelCode, given: Mapping[str, float], sizes: Sizes) -> dict[str, float]:
    """Values for the parameters of a class that were not given: the defaults, brought to the size of the recordings by
    unit. Springs of a class whose force remembers are contacts that stick."""
    variables = real_parameters(code)
    hysteretic = "f_h" in {v.name for v in code.variables} and len(code.states) > 2
    target = {
        "kg": sizes.mass,
        "N/m": sizes.stick if hysteretic else sizes.stiffness,
        "N.s/m": sizes.damping,
        "N": sizes.friction,
        "m": 1.2 * sizes.length,
        "1/m": 1.0 / (sizes.sticks * sizes.length),
        "m/s": 0.1 * sizes.speed,
    }
    largest: dict[str, float] = {}
    for variable in variables:
        largest[variable.unit] = max(largest.get(variable.unit, 0.0), abs(variable.start or 0.0))
    sharp = {name: _ROUNDED * sizes.speed for name in turning(variables)}
    known = [v for v in variables if v.start and v.unit in target]
    sized = {v.name: float(v.start or 0.0) * target[v.unit] / largest[v.unit] for v in known}
    return {name: value for name, value in {**sharp, **sized}.items() if name not in given}
