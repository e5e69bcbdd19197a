"""What an examination finds: findings, the state of each channel, and the relations between channels."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from hystid.errors import RecordingError
from hystid.files import plain
from hystid.recording import Recording
from hystid.results import Result

Severity = Literal["refuse", "note"]
SHORTEST = 64  # samples below which spectra say nothing


@dataclass(frozen=True)
class Mismatch:
    """One slip of one recording.

    slip: rule that ``--accept`` knows: "wrong_unit", "swapped_sign", "swapped_channels", "not_one_motion", "lag",
    "filtered", "drift", "wrong_mass", "bad_samples". seen: what was measured, as numbers. sentence: what was found;
    mend: what to do, both clauses without a full stop. repair: the option that mends it, as {"reverse": "F"} or
    {"unit": "a=g"}.
    """

    recording: str
    channel: str
    slip: str
    sentence: str
    mend: str
    severity: Severity = "refuse"
    seen: Mapping[str, float] = field(default_factory=dict)
    repair: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        place = f"{self.recording}, channel {self.channel}" if self.channel else self.recording
        return f"{place}: {self.sentence}; {self.mend} [{self.slip}]"


@dataclass(frozen=True)
class Channel:
    """State of one channel.

    unit: SI. rms about the mean, smallest and largest value, SI. noise: standard deviation of its white noise, and its
    level noise_db below the rms [dB]. white: whether that noise shows; else these are limits, for the motion hides it.
    band: frequencies [Hz] in which the channel counts: above its noise, and where another channel shows the same
    motion, in accord with that. measured: whether it holds information of its own; origin says how it came about.
    """

    name: str
    unit: str
    rms: float
    low: float
    high: float
    noise: float
    noise_db: float
    band: tuple[float, float]
    measured: bool
    origin: str
    white: bool = True


@dataclass(frozen=True)
class Agreement:
    """How two channels of the motion agree: ``high`` against the derivative of ``low``.

    gain (1 where all is well) and its standard error, sign, lag of ``high`` [s] and its error from the scatter of
    sections, band [Hz] and mean squared coherence there.
    """

    low: str
    high: str
    gain: float
    gain_error: float
    sign: float
    lag: float
    lag_error: float
    band: tuple[float, float]
    coherence: float


@dataclass(frozen=True)
class Balance:
    """What force and motion say together.

    passive: share of the force's variance that a structure which takes up energy explains, reversed: the same for the
    reversed force. power: mean of F v over the product of the rms. mass: moving mass that F over a shows at high
    frequency, and mass_error (infinite where the test does not show it), of chance; law: relative error of the mass
    from laws that no free curve follows. lag of the force [s] and its error.
    """

    passive: float
    reversed: float
    power: float
    mass: float
    mass_error: float
    lag: float
    lag_error: float
    law: float = 0.0

    @property
    def mass_bounds(self) -> tuple[float, float]:
        """Moving mass that these data allow (three standard errors, of chance and of laws), never negative."""
        if not math.isfinite(self.mass_error):
            return 0.0, math.inf
        error = 3.0 * math.hypot(self.mass_error, self.law * self.mass)
        return max(0.0, self.mass - error), max(self.mass, 0.0) + error


@dataclass(frozen=True)
class Examined:
    """One recording: its channels, relations and force, in the order of the channels.

    undecided: channel -> what about it no other channel can confirm, as a sentence.
    """

    recording: str
    samples: int
    sample_rate: float
    rotational: bool
    channels: Mapping[str, Channel]
    relations: Sequence[Agreement]
    balance: Balance | None
    undecided: Mapping[str, str] = field(default_factory=dict)

    @property
    def unexamined(self) -> str:
        """Why nothing of it was compared, as a sentence; empty where that was done."""
        if self.samples >= SHORTEST:
            return ""
        few = f"{self.recording} was not examined: of {self.samples} samples nothing can be compared"
        return f"{few}; at least {SHORTEST} are needed"


@dataclass(frozen=True)
class Examination(Result, report="examination", json="check.json"):
    """All recordings and all findings."""

    examined: Sequence[Examined]
    findings: Sequence[Mismatch]
    recordings: Sequence[Recording] = field(default=(), repr=False)

    @property
    def refusals(self) -> list[Mismatch]:
        """Findings with which no result would mean anything."""
        return [item for item in self.findings if item.severity == "refuse"]

    @property
    def notes(self) -> list[Mismatch]:
        """Findings that a user should know of."""
        return [item for item in self.findings if item.severity == "note"]

    @property
    def unexamined(self) -> list[str]:
        """Of recordings that were not compared: why, as sentences."""
        return [item.unexamined for item in self.examined if item.unexamined]

    def accepting(self, rules: Mapping[str, Collection[str]]) -> Examination:
        """The same with refusals turned into notes: name of a recording -> slips that are accepted there."""
        judged = [
            replace(item, severity="note") if item.slip in rules.get(item.recording, ()) else item
            for item in self.findings
        ]
        return replace(self, findings=judged)

    def admit(self) -> None:
        """Raise RecordingError with one line per refusal, if there is any."""
        if self.refusals:
            raise RecordingError(*map(str, self.refusals))

    def undecided(self, channels: Collection[str]) -> list[str]:
        """What these data cannot show about some of these channels, as sentences."""
        return [text for item in self.examined for name, text in item.undecided.items() if name in channels]

    def measured(self, recording: str) -> list[str]:
        """Channels of a recording that hold information of their own."""
        found = next(item for item in self.examined if item.recording == recording)
        return [name for name, channel in found.channels.items() if channel.measured]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; numbers that do not exist are None."""
        return {
            "recordings": [plain(asdict(item)) for item in self.examined],
            "findings": [plain(asdict(item)) for item in self.findings],
        }
