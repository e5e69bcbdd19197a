"""What the slips of a recording are judged by, and the one that explains it best."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hystid.consistency.force import EXPLAINED, Force
from hystid.consistency.kinematics import Pair, motion
from hystid.consistency.slips import SURE, Explanation, Situation, explain, with_alike
from hystid.consistency.unstated import several_units
from hystid.recording import Recording

CLEAR = math.log(1e3)  # odds of the reversed force over the force as it is
_SOUND = 0.005**2  # share of the power of the force that sensors leave which match to 0.5 %: less tells no sign
_LEAD = math.sin(math.radians(5)) ** 2  # the same of a motion that leads by 5 degrees, as of an AC-coupled sensor ten
# times above its corner: below a resonance that is a damping which gives out energy


def situation_of(recording: Recording, compared: Sequence[Pair], force: Force | None, mass: float | None) -> Situation:
    """What the channels of a recording say of each other, and its force of the mass."""
    names = motion(recording)
    ratio = None
    # a force that no law explains, as the noise of a free decay, says nothing about the mass
    seen = force is not None and force.free_share > EXPLAINED
    # nor does one that no passive structure explains, whichever its sign: an exciter's own law in a decay
    seen = seen and force is not None and max(force.share, force.reversed_share) > EXPLAINED
    # nor does a mass whose sign is not that of the force: a spring and an inertia of one frequency are alike
    seen = seen and force is not None and (force.mass > 0) == (force.share >= force.reversed_share)
    if force is not None and force.mass < 0:
        seen = seen and sign_odds(force, force.share, force.reversed_share) < -CLEAR
    if mass and force is not None and seen and math.isfinite(force.mass_ratio_error):
        ratio = force.mass / mass, force.mass_ratio_error
    written = {name: unit for name, unit in recording.units.items() if unit}
    rms = {name: float(np.std(values)) for name, values in names.items()}
    if recording.F is not None:
        rms["F"] = float(np.std(recording.F))
    kept = [p for p in compared if p.is_one_motion]
    last = "a" if force is None else force.source
    bare = frozenset(name for name, unit in recording.units.items() if not unit and name in ("t", *rms))
    return Situation(kept, written, rms, recording.sample_rate, recording.rotational, mass, ratio, last, bare=bare)


def explanation_of(situation: Situation) -> Explanation:
    """The most probable explanation; one without a slip, unless another is surely better."""
    ordered = explain(situation)
    sound = next(item for item in ordered if item.sound)
    best = several_units(situation, ordered) or with_alike(ordered)
    return best if best.score - sound.score > SURE else sound


def sign_odds(force: Force, share: float, other: float) -> float:
    """Logarithm of the odds for the sign of a force, from shares that a passive structure explains of it, and of the
    reversed one."""
    sound = _LEAD if force.correlation > 0 else _SOUND
    return 0.5 * force.samples * math.log(max(1 - other, sound) / max(1 - share, sound))
