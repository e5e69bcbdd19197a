"""Signs, units and clock of the channels: what has one consistent reading is read that way and told, all else refused.

A name that comes of a reversed force or of an acceleration in g is worse than none. Power, stiffness, mass and the
cross spectra of the motion (``hystid.consistency``) say all of this before any physics is looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.consistency import Examination, Finding, examine
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


@dataclass(frozen=True)
class Readings:
    """Recordings whose channels fit together, with what was read in another way in their notes, and a late force.

    misread: sentences on labels that were read in another way than the file states; doubts: on filters, drift and
    clocks of channels, which no other reading mends.
    """

    tests: list[Recording]
    unseen: list[Recording]
    faults: tuple[Fault, ...]
    misread: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def consistent(tests: Sequence[Recording], unseen: Sequence[Recording], mass: float | None) -> Readings:
    """Read the channels so that force and motion fit together.

    A force on another clock is moved by whole samples where every recording says so, by the same time; the rest is a
    delay below a sample, which is fitted. A force that is far off its motion in some recordings only, or in the only
    one, belongs to no law: it is refused. mass [kg]: as given, None where it is not known. Raises Contradiction.
    """
    used, held = ([_read(test, mass) for test in group] for group in (tests, unseen))
    given = zip((*tests, *unseen), (*used, *held), strict=True)
    lossy = [test.name for test, read in given if test.a is not None and read.recording.a is None]
    if lossy:
        used, held = ([_coupled_alike(read, lossy, mass) for read in group] for group in (used, held))
    misread = tuple(
        note
        for test, read in zip((*tests, *unseen), (*used, *held), strict=True)
        for note in read.recording.notes[len(test.notes) :]
    )
    doubts = tuple(str(note) for read in (*used, *held) for note in read.found.notes)
    late = _late_force([read.lag for read in used]) if len(used) > 1 else None  # one test may be a law that looks late
    groups = [[read.recording for read in group] for group in (used, held)]
    if late is None:
        if apart := [str(read.severe) for read in (*used, *held) if read.severe is not None]:
            raise Contradiction("; ".join(apart))
        return Readings(groups[0], groups[1], (), misread, doubts)
    seconds, error = late
    dt = groups[0][0].dt
    groups = [[_aligned(test, seconds) for test in group] for group in groups]
    fault = Fault(DELAY, "F", seconds / dt, error / dt, seconds=seconds)
    first = groups[0][0]
    groups[0][0] = replace(first, notes=(*first.notes, fault.sentence()))
    return Readings(groups[0], groups[1], (fault,), misread, doubts)


@dataclass(frozen=True)
class _Read:
    """A recording in its consistent reading, what the door finds of it, how late its force is [s], with the error (None
    where it is not), and what the door says of a force that is too late to be used as it is."""

    recording: Recording
    found: Examination
    lag: tuple[float, float] | None
    severe: Finding | None


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
    raise Contradiction("; ".join(str(item) for item in wrong))


def _late(here: Recording, found: Examination) -> tuple[tuple[float, float] | None, Finding | None]:
    lags = {item.channel: item for item in found.findings if item.slip == "lag"}
    slowed = any("lost above" in item.seen for item in found.findings)  # a low-pass is late as well
    if set(lags) != {"F"} or slowed:  # with motion late, a force looks early against it
        return None, None
    force = lags["F"]
    severe = force.severity == "refuse" and "lag" not in here.accepted
    return (force.seen["lag"], force.seen["lag_error"]), force if severe else None


def _without_coupled(test: Recording, found: Examination) -> tuple[Recording, bool]:
    """The recording without an acceleration that loses slow motion, where another channel shows the motion.

    Its turned phase is damping, or a resonance, that no structure has.
    """
    for item in found.findings:
        lossy = item.slip == "filtered" and item.channel == "a" and "lost below" in item.seen
        if lossy and "filtered" not in test.accepted and (test.x is not None or test.v is not None):
            return _without_acceleration(test, f"as {item.sentence} [filtered]"), True
    return test, False


def _without_acceleration(test: Recording, why: str) -> Recording:
    """The recording without its acceleration, and without a velocity that was integrated from it."""
    gone, told = {"a": None}, f"channel a is left out, {why}"
    if test.x is not None and "from a" in measurements(test).computed.get("v", ""):
        gone, told = {"a": None, "v": None}, f"channel a, and v that was computed from it, are left out, {why}"
    return test.with_channels(gone, f"{test.name}: {told}")


def _coupled_alike(read: _Read, lossy: Sequence[str], mass: float | None) -> _Read:
    """The same without an acceleration whose sensor loses slow motion in other recordings, of these names: where the
    motion is quick its phase is turned as well, only by less than shows."""
    here = read.recording
    if here.a is None or (here.x is None and here.v is None) or "filtered" in here.accepted:
        return read
    left = _without_acceleration(here, f"as its sensor loses slow motion in {lossy[0]} [filtered]")
    found = examine([left], mass)
    return _Read(left, found, *_late(left, found))


def _has_one_reading(item: Finding) -> bool:
    """Whether one repair is the only one: where the force does not fit the mass, either of the two may be wrong."""
    return item.slip in _READ and bool(item.repair) and not (item.slip == "wrong_unit" and item.channel == "F")


def _mended(test: Recording, slip: Finding) -> Recording:
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
