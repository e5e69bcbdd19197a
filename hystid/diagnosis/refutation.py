"""Do the free run, and recordings that nothing was fitted to, bear out what was named?

Physics that was left out makes the free run better, and explains the force of an unseen recording as well as that of
those it was fitted to. A wrong law that explains the force of the recordings used gives itself away in three ways:
their displacement is not reproduced any better, that of an unseen recording far worse, or the force of an unseen
recording is missed by several times as much as that of the others, and hardly less than without the law.
The force comes first: where that of unseen recordings is met to the same noise, the free run refutes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.diagnosis.answer import Answer
from hystid.diagnosis.runs import Run, Runs
from hystid.diagnosis.sensors import DRIFT
from hystid.diagnosis.windows import has_windows

_NO_BETTER = 1.05  # error of the free run over that without what was named, mean of all recordings, that refutes it
_WORSE = 1.35  # error of the free run of an unseen recording, over that without what was named, that refutes it
_APART = 3.0  # error of the force of an unseen recording over that of the others, from which the two contradict
_ALIKE = 1.15  # the same, up to which the force is met
_CLEARLY = 0.8  # error of the force over that without what was named, below which the law helps
_IN_A_STATE = frozenset({"cyclic_degradation", "stiffness_drift"})  # an unseen recording may begin in another state
Pairs = Sequence[tuple[float, float]]


def contradiction(
    runs: Runs,
    used: Sequence[str],
    unseen: Sequence[str],
    force_used: Pairs,
    force_unseen: Pairs,
    *,
    instead: bool = False,
) -> str:
    """How the recordings contradict what was named; "" where they do not.

    used, unseen: names of the recordings; force_used, force_unseen: NRMSE of their force balance before and after.
    instead: whether it takes the place of what was contradicted: then a window of time must hold for unseen recordings.
    Beside a drift of the force channel only what is far worse counts: the drift of an unseen recording is not known.
    """
    answer = runs.answer
    if not answer.names():
        return ""
    told = " and ".join(answer.names()) + " would explain the force of the recordings used, but "
    whole = answer.is_model()
    if (whole or answer.is_beside_a_drift()) and not _is_met(force_used, force_unseen):
        near, far = (_changes(*group) for group in zip((used, unseen), runs.before, runs.after, strict=True))
        if whole and near and float(np.mean([*near.values(), *far.values()])) > np.log(_NO_BETTER):
            return told + "with it the free run comes no closer to the measured displacement"
        worst = max(far, key=lambda name: far[name], default="")
        if worst and far[worst] > np.log(_WORSE):
            worse = f"{np.exp(far[worst]):.2g} times as far off"
            return told + f"with it the free run of {worst}, which was held out, is {worse}"
    windows = has_windows(answer.choice.after.hypothesis)
    if windows and instead and not _is_met(force_used, force_unseen):
        return told + "its window of time does not hold for what was held out"
    if not windows and _has_one_state(answer):
        least = _APART * max(after for _, after in force_used)
        for name, (before, after) in zip(unseen, force_unseen, strict=True):
            if after > max(least, _CLEARLY * before):
                missed = f"{100 * after:.2g} % (without: {100 * before:.2g} %)"
                return told + f"that of {name}, which was held out, is missed by {missed}"
    return ""


def _is_met(used: Pairs, unseen: Pairs) -> bool:
    """Whether the force of unseen recordings is explained as well as that of the others: the law holds, and a free run
    that is no better shows that near a resonance a trace of stiffness or mass is worth more than what was found."""
    reach = _ALIKE * max(after for _, after in used)
    return bool(unseen) and all(after < min(reach, _CLEARLY * before) for before, after in unseen)


def _has_one_state(answer: Answer) -> bool:
    """Whether what was named acts in every recording alike, so that it holds for an unseen one as it stands."""
    return not answer.faults and DRIFT not in answer.choice.named and not _IN_A_STATE & {*answer.names()}


def _changes(names: Sequence[str], before: Run, after: Run) -> dict[str, float]:
    """Logarithm of the error of the free run after, over that before, where both ran."""
    pairs = [(name, b[1], a[1]) for name, b, a in zip(names, before, after, strict=True)]
    return {name: float(np.log(a / b)) for name, b, a in pairs if a is not None and b is not None and min(a, b) > 0}
