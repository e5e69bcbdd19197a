"""What is wrong with a recording: every problem is collected, then all of them are reported at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Literal

from hystid.errors import RecordingError, sentence

Severity = Literal["error", "warning"]

RULES = {
    "format": "the file can be read as what its suffix says",
    "columns": "columns are named once, with the names and units that hystid knows",
    "cell": "every cell of the table is a number",
    "too_short": "a recording has at least 16 samples",
    "missing_channel": "time and one of x, v, a are needed",
    "missing_force": "a force is needed that is not zero all through, but for a free decay",
    "length": "all channels have the same number of samples",
    "not_finite": "no NaN and no infinity",
    "time_order": "time increases from sample to sample",
    "unequal_steps": "samples are equally spaced in time",
    "gap": "no samples are missing",
    "constant": "a channel that is used changes",
    "held": "no channel stands still while another one shows that it moves",
    "clipped": "no channel is cut off at a limit of its range",
    "wrong_unit": "x, v, a and F have sizes that fit each other",
    "swapped_sign": "v = dx/dt, a = dv/dt, and a passive structure takes energy from F and gives none",
    "swapped_channels": "each column holds the channel that it is called",
    "not_one_motion": "x, v and a are measurements of one motion",
    "wrong_mass": "the mass that was given is the one that F over a shows at high frequency",
    "lag": "all channels share one clock",
    "filtered": "no channel loses a band of the motion that another one shows",
    "drift": "no channel wanders where the others rest",
    "bad_samples": "no sample stands alone, far from its neighbours",
}


@dataclass(frozen=True)
class RecordingProblem:
    """One finding at the door.

    sample counts from 0, line from 1; either is None where the problem has no one place.
    found says what was found, action what to do; both are clauses without a full stop.
    """

    file: str
    rule: str
    found: str
    action: str
    channel: str = ""
    sample: int | None = None
    line: int | None = None
    severity: Severity = "error"

    def __str__(self) -> str:
        place = [self.file]
        if self.line is not None:
            place.append(f"line {self.line}")
        if self.sample is not None:
            place.append(f"sample {self.sample}")
        if self.channel:
            place.append(f"channel {self.channel}")
        return sentence(f"{', '.join(place)}: {self.found}; {self.action} [{self.rule}]")


def report(problems: Iterable[RecordingProblem], accept: Collection[str] = ()) -> tuple[RecordingProblem, ...]:
    """Return the warnings; raise RecordingError with one line per error when there are errors.

    accept: rules whose errors count as warnings here.
    """
    judged = [replace(item, severity="warning") if item.rule in accept else item for item in problems]
    errors = [str(item) for item in judged if item.severity == "error"]
    if errors:
        raise RecordingError(*errors)
    return tuple(judged)
