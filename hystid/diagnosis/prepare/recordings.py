"""Recordings as they are taken: read, apart from each other, of bounded size, with a known force and a known noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.consistency.bad_samples import without_bad_samples
from hystid.diagnosis.prepare.bandwidth import where_white
from hystid.diagnosis.prepare.clipping import stopped
from hystid.diagnosis.prepare.decay import is_free, released, with_noise
from hystid.diagnosis.prepare.faults import Fault
from hystid.diagnosis.prepare.given import Given
from hystid.diagnosis.prepare.independence import measured_alike
from hystid.diagnosis.prepare.interpolated import where_measured
from hystid.diagnosis.prepare.levelled import with_lines_told
from hystid.diagnosis.prepare.readings import consistent
from hystid.diagnosis.prepare.refused import SHORTEST, NotDiagnosable
from hystid.diagnosis.prepare.tapered import between_tapers
from hystid.diagnosis.prepare.user_smoothing import smoothed_alike
from hystid.errors import RecordingError
from hystid.processing import prepare
from hystid.recording import Recording, Sources, check_together, loaded
from hystid.recording.checks import is_constant
from hystid.smoothing.noise import is_noise_free

# faults that the diagnosis names instead of refusing them
TOLERATED = ("clipped", "missing_force", "not_one_motion")
_MOST_SAMPLES = 1_200_000  # samples of all recordings together: memory stays below 1 GB


@dataclass(frozen=True)
class Taken:
    """Recordings for the fit, those that are held out, what the user knows, and faults of channels found by then.

    clipped: channels that stop at a level, which only the recordings as they were read show. misread: sentences on
    labels that were read in another way than the files state; doubts: on filters, drift and clocks of channels.
    read: those for the fit as they are after the door, before anything is prepared for it. integrated: x of each has
    next to no noise beside an acceleration, as an integral of it. low_passed: channels that lose fast motion.
    """

    tests: list[Recording]
    unseen: list[Recording]
    given: Given
    faults: tuple[Fault, ...] = ()
    clipped: tuple[Fault, ...] | None = None
    misread: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    read: tuple[Recording, ...] = ()
    integrated: bool = False
    low_passed: tuple[str, ...] = ()

    def without(self, channels: str) -> Taken:
        """The same without some channels of the motion, where another one shows it."""
        tests, unseen = (
            [
                test.with_channels(dict.fromkeys(channels)) if set(test.channels("xva")) - set(channels) else test
                for test in group
            ]
            for group in (self.tests, self.unseen)
        )
        return replace(self, tests=tests, unseen=unseen)


def take(recordings: Sources, holdout: Sources, given: Given) -> Taken:
    """Recordings ready for smoothing. Raises UsageError, RecordingError, and NotDiagnosable where that is a verdict."""
    try:
        tests, unseen = loaded(recordings, TOLERATED), loaded(holdout, TOLERATED)
    except RecordingError as missing:
        if inputs_missing(missing):
            raise NotDiagnosable(str(missing)) from missing
        raise
    check_together(tests, unseen)
    _check_content([*tests, *unseen])
    tests, unseen = ([_as_recorded(test) for test in group] for group in (tests, unseen))
    read = consistent(tests, unseen, given.mass if "m" not in given.free else None)
    measured = _measured_only([*read.tests, *read.unseen], len(read.tests))
    tests, unseen, given = _with_decays(measured[: len(read.tests)], measured[len(read.tests) :], given)
    clipped = stopped(tests, slow=given.mass == 0 or all(test.quasi_static for test in tests))
    integrated = all(t.a is not None and t.x is not None and is_noise_free(t.x) for t in tests)
    if not clipped:  # a level is not seen behind a filter
        tests, unseen = smoothed_alike(tests), smoothed_alike(unseen)
    bounded = _bounded([*tests, *unseen])
    largest = max((float(np.std(test.F)) for test in bounded if test.F is not None), default=0.0)
    tests, unseen = (
        [_with_noise(test, i, largest) for i, test in enumerate(where_white(group))]
        for group in (bounded[: len(tests)], bounded[len(tests) :])
    )
    return Taken(
        tests, unseen, given, read.faults, clipped, read.misread, read.doubts, tuple(read.tests), integrated,
        read.low_passed,
    )  # fmt: skip


def _as_recorded(test: Recording) -> Recording:
    """The samples of a recording that a sensor gave, as far as those that a user changed can be told."""
    within = between_tapers(without_bad_samples(with_lines_told(test)), SHORTEST)
    return where_measured(within, SHORTEST)


def inputs_missing(refusal: RecordingError) -> bool:
    """Whether recordings were refused for nothing but missing channels or too few samples: that is a verdict."""
    rules = [line.rpartition("[")[2].rstrip("]") for line in str(refusal).splitlines()]
    return set(rules) <= {"missing_channel", "too_short"}


def _check_content(tests: Sequence[Recording]) -> None:
    """Raises NotDiagnosable for a recording without motion or with too few samples, RecordingError for a constant F."""
    for test in tests:
        if test.x is None and test.v is None and test.a is None:
            raise NotDiagnosable(f"{test.name} has no channel of the motion: record x, v or a beside F")
        if len(test) < SHORTEST:
            raise NotDiagnosable(
                f"{test.name} has {len(test)} samples: at least {SHORTEST} are needed, better thousands"
            )
        if test.F is not None and is_constant(test.F) and np.any(test.F):
            told = f"{test.name}, channel F: the channel is constant ({test.F[0]:.6g})"
            raise RecordingError(f"{told}; check that the sensor was connected, or leave F out of a free decay")


def _bounded(tests: list[Recording]) -> list[Recording]:
    """Recordings of bounded size: beyond 1.2 million samples all are decimated, without aliasing, and say so."""
    factor = -(-sum(len(test) for test in tests) // _MOST_SAMPLES)
    return [prepare(test, decimate=factor) for test in tests] if factor > 1 else tests


def _measured_only(tests: Sequence[Recording], deciding: int) -> list[Recording]:
    """Recordings without the channels that were computed from others, and notes of what was left out. deciding: number
    of recordings that are not held out."""
    taken = []
    for channels in measured_alike(tests, deciding):
        name = channels.recording.name
        told = [f"{name}: {channel} left out, {why}" for channel, why in channels.computed.items()]
        taken.append(replace(channels.recording, notes=(*channels.recording.notes, *told)))
    return taken


def _with_noise(test: Recording, seed: int, largest: float) -> Recording:
    """A recording; one without any noise gets as much as integration and interpolation leave.

    largest: spread of the force in the recording with most of it [N]; in a free decay the force has none of its own.
    """
    quiet = test.F is None or is_noise_free(test.F, largest)
    return with_noise(test, seed) if quiet and all(map(is_noise_free, test.channels("xva").values())) else test


def _with_decays(
    tests: Sequence[Recording], unseen: Sequence[Recording], given: Given
) -> tuple[list[Recording], list[Recording], Given]:
    """Recordings whose force is known, free decays too; a mass of 1 where nothing gives a scale. Raises NoDecay."""
    given = replace(given, unforced=all(is_free(test) for test in tests))
    if given.unforced:  # all forces scale with the mass, and none of them is known
        given = replace(given, fixed=given.fixed | {"m"}, free=given.free - {"m"})
    used = released(tests, given.mass)
    held = released(unseen, 1.0 if used.unscaled else given.mass, held=True)
    if used.unscaled:
        given = replace(given, values={**given.values, "m": 1.0})
    told = used.notes if used.unscaled else (*used.notes, *held.notes)
    used.tests[0] = replace(used.tests[0], notes=(*told, *used.tests[0].notes))
    return used.tests, held.tests, given
