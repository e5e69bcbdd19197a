"""Signs, units and clock of the channels: what has one consistent reading is read that way and told, all else refused.

A name that comes of a reversed force or of an acceleration in g is worse than none. Power, stiffness, mass and the
cross spectra of the motion (``hystid.consistency``) say all of this before any physics is looked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.consistency import Examination, Mismatch, examine
from hystid.diagnosis.prepare.faults import DELAY, Fault
from hystid.diagnosis.prepare.independence import measurements
from hystid.diagnosis.prepare.pairs import agreed
from hystid.errors import RecordingError
from hystid.recording import Recording

_READ = frozenset({"swapped_sign", "wrong_unit"})  # slips with one other reading
_NEVER = frozenset({"wrong_mass", "swapped_channels", *_READ})  # with these left, any name would be a wrong one
_ROUNDS = 3  # slips of one recording that are read in another way, one after the other


class Contradiction(RecordingError):
    """Channels that no reading brings together; the message says which."""


class _NoMass(Contradiction):
    """A force that does not show the mass, while all channels read as they should."""


@dataclass(frozen=True)
class Readings:
    """Recordings whose channels fit together, with what was read in another way in their notes, and a late force.

    misread: sentences on labels that were read in another way than the file states; doubts: on filters, drift and
    clocks of channels, which no other reading mends. low_passed: channels of the motion that lose fast motion.
    """

    tests: list[Recording]
    unseen: list[Recording]
    faults: tuple[Fault, ...]
    misread: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    low_passed: tuple[str, ...] = ()


def consistent(tests: Sequence[Recording], unseen: Sequence[Recording], mass: float | None) -> Readings:
    """Read the channels so that force and motion fit together.

    A force on another clock is moved by whole samples where every recording says so, by the same time; the rest is a
    delay below a sample, which is fitted. A force that is far off its motion in some recordings only, or in the only
    one, belongs to no law: it is refused. A held-out recording that alone denies the mass is left out: it says nothing
    of the structure that the others show. mass [kg]: as given, None where it is not known. Raises Contradiction.
    """
    used = [_read(test, mass) for test in tests]
    held, unfit = [], {}
    for test in unseen:
        try:
            held.append(_read(test, mass))
        except _NoMass as denied:
            unfit[test.name] = f"held-out recording left out: {denied}"
    unseen = [test for test in unseen if test.name not in unfit]
    if left_out := _left_out((*tests, *unseen), (*used, *held)):
        used, held = ([_coupled_alike(read, left_out, mass) for read in group] for group in (used, held))
    misread = tuple(
        note
        for test, read in zip((*tests, *unseen), (*used, *held), strict=True)
        for note in read.recording.notes[len(test.notes) :]
    )
    doubts = (*unfit.values(), *(str(note) for read in (*used, *held) for note in read.found.notes))
    low_passed = _low_passed([read.found for read in used])
    late = _late_force([read.lag for read in used]) if len(used) > 1 else None  # one test may be a law that looks late
    groups = [[read.recording for read in group] for group in (used, held)]
    if late is None:
        if apart := [str(read.severe) for read in (*used, *held) if read.severe is not None]:
            raise Contradiction("; ".join(apart))
        return Readings(groups[0], groups[1], (), misread, doubts, low_passed)
    seconds, error = late
    dt = groups[0][0].dt
    groups = [[_aligned(test, seconds) for test in group] for group in groups]
    fault = Fault(DELAY, "F", seconds / dt, error / dt, seconds=seconds)
    return Readings(groups[0], groups[1], (fault,), misread, doubts, low_passed)


@dataclass(frozen=True)
class _Read:
    """A recording in its consistent reading. found: what its examination says. lag: delay of its force [s] and
    standard error, None where it is not late. severe: the finding on a force that is too late to be used."""

    recording: Recording
    found: Examination
    lag: tuple[float, float] | None
    severe: Mismatch | None


def _read(test: Recording, mass: float | None) -> _Read:
    """The one consistent reading of a recording. Raises Contradiction where there is none."""
    here = test
    for _ in range(_ROUNDS):
        found = examine([here], mass)
        wrong = [item for item in found.refusals if item.slip in _NEVER - here.accepted]
        if not wrong:
            here, coupled = _without_coupled(here, found)
            found = examine([here], mass) if coupled else found
            return _Read(here, found, *_late(here, found))
        if any(not _has_one_reading(item) for item in wrong):
            break
        for item in wrong:
            here = _mended(here, item)
    kind = _NoMass if all(item.slip == "wrong_mass" for item in wrong) else Contradiction
    raise kind("; ".join(str(item) for item in wrong))


def _late(here: Recording, found: Examination) -> tuple[tuple[float, float] | None, Mismatch | None]:
    lags = {item.channel: item for item in found.findings if item.slip == "lag"}
    slowed = any("lost above" in item.seen for item in found.findings)  # a low-pass is late as well
    if set(lags) != {"F"} or slowed:  # with motion late, a force looks early against it
        return None, None
    force = lags["F"]
    severe = force.severity == "refuse" and "lag" not in here.accepted
    return (force.seen["lag"], force.seen["lag_error"]), force if severe else None


def _without_coupled(test: Recording, found: Examination) -> tuple[Recording, bool]:
    """The recording without channels that lose slow motion, where another one shows the motion.

    Their turned phase is damping, or a resonance, that no structure has.
    """
    lossy = [item for item in found.findings if item.slip == "filtered" and "lost below" in item.seen]
    here = test
    for item in lossy:
        whole = set(here.channels("xva")) - {item.channel for item in lossy}
        left = _without(here, item.channel, f"as {item.sentence} [filtered]") if whole else None
        here = left or here
    return here, here is not test


def _without(test: Recording, channel: str, why: str) -> Recording | None:
    """The recording without one channel of the motion, and without a velocity that was computed from it; None where no
    other one shows the motion, or where the channel was accepted as it is."""
    others = set(test.channels("xva")) - {channel}
    if getattr(test, channel) is None or not others or "filtered" in test.accepted:
        return None
    gone = [channel]
    if len(others) > 1 and f"from {channel}" in measurements(test).computed.get("v", ""):
        gone.append("v")
    listed = f"channel {channel} is" if len(gone) == 1 else f"channel {channel}, and v that was computed from it, are"
    return test.with_channels(dict.fromkeys(gone), f"{test.name}: {listed} left out, {why}")


def _low_passed(found: Sequence[Examination]) -> tuple[str, ...]:
    """Channels of the motion that lose fast motion in some recording."""
    lossy = (item for one in found for item in one.findings if item.slip == "filtered" and "lost above" in item.seen)
    return tuple(dict.fromkeys(item.channel for item in lossy if item.channel in "xva"))


def _left_out(tests: Sequence[Recording], read: Sequence[_Read]) -> dict[str, str]:
    """Channels that were left out as they lose slow motion, and the first recording in which they were."""
    pairs = [(test, one.recording) for test, one in zip(tests, read, strict=True)]
    found = {name: [t.name for t, r in pairs if name in t.channels() and name not in r.channels()] for name in "xva"}
    return {name: names[0] for name, names in found.items() if names}


def _coupled_alike(read: _Read, left_out: Mapping[str, str], mass: float | None) -> _Read:
    """The same without channels whose sensors lose slow motion in other recordings: where the motion is quick their
    phase is turned as well, only by less than shows."""
    for channel, elsewhere in left_out.items():
        left = _without(read.recording, channel, f"as its sensor loses slow motion in {elsewhere} [filtered]")
        if left is not None:
            found = examine([left], mass)
            read = _Read(left, found, *_late(left, found))
    return read


def _has_one_reading(item: Mismatch) -> bool:
    """Whether one repair is the only one: where the force does not fit the mass, either of the two may be wrong."""
    return item.slip in _READ and bool(item.repair) and not (item.slip == "wrong_unit" and item.channel == "F")


def _mended(test: Recording, slip: Mismatch) -> Recording:
    """The recording with one slip read in the other way, which its notes tell."""
    name = slip.repair.get("reverse", slip.repair.get("unit", "").partition("=")[0])
    if slip.slip == "swapped_sign":
        factor, told = -1.0, f"{test.name}: channel {name} is read with the other sign, as {slip.sentence}"
    else:
        factor = slip.seen["times too large"]
        told = f"{test.name}: {slip.repair['unit'].replace('=', ' is read in ')}, as {slip.sentence}"
    return test.with_channels({name: np.asarray(getattr(test, name)) / factor}, told)


def _late_force(lags: Sequence[tuple[float, float] | None]) -> tuple[float, float] | None:
    """How late the force is in all recordings [s], with the error; None where they do not agree."""
    known = [lag for lag in lags if lag is not None]
    if not lags or len(known) < len(lags):
        return None
    values, errors = (np.array(column) for column in zip(*known, strict=True))
    if len(known) == 1:
        return float(values[0]), float(errors[0])
    found = agreed(values, 1 / np.maximum(errors, 1e-12) ** 2)
    return (found.value, found.stderr) if found.agrees else None


def _aligned(test: Recording, seconds: float) -> Recording:
    """The recording with its force moved earlier by whole samples; what that leaves without a partner is cut."""
    shift = round(seconds / test.dt)
    n = len(test) - abs(shift)
    motion, force = (slice(0, n), slice(shift, None)) if shift >= 0 else (slice(-shift, None), slice(0, n))
    return test if test.F is None else replace(test.part(motion), F=test.F[force])
