"""Channels that a user smoothed, and the others smoothed alike: a law then sees one motion and one force."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.ndimage import convolve1d

from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.kernels import corner
from hystid.smoothing.noise import smoothing_kernel

_ALIKE = 1.15  # ratio of corners of one filter: two bands further, its noise would be half as loud
_TOLD = (
    "{0} was smoothed over {1} samples, as its noise shows; {2} is smoothed alike. Motion above {3:.3g} Hz is "
    "weakened: give {0} as it was recorded, if you have it"
)


def smoothed_alike(tests: Sequence[Recording]) -> list[Recording]:
    """Recordings with all channels smoothed, and a note, where one kernel is found on some channels of half of them."""
    found: list[dict[str, Array]] = []
    for test in tests:
        shown = _shown(test)
        found.append({name: kernel for name, y in shown.items() if (kernel := _kernel(name, shown)) is not None})
    kernels = sorted((kernel for each in found for kernel in each.values()), key=corner)
    if 2 * sum(map(bool, found)) < len(tests) or not kernels or corner(kernels[-1]) > _ALIKE * corner(kernels[0]):
        return list(tests)
    kernel, smoothed = kernels[len(kernels) // 2], {name for each in found for name in each}
    return [_with_all_smoothed(test, smoothed, kernel) for test in tests]


def _shown(test: Recording) -> dict[str, Array]:
    return {**({} if test.F is None else {"F": test.F}), **measured_motion(test)}


def _kernel(name: str, channels: dict[str, Array]) -> Array | None:
    others = [y for other, y in channels.items() if (other == "F") != (name == "F")]
    return smoothing_kernel(channels[name], others, drives=name == "F")


def _with_all_smoothed(test: Recording, smoothed: set[str], kernel: Array) -> Recording:
    raw = {name: y for name, y in _shown(test).items() if name not in smoothed}
    if not raw:
        return test
    note = _TOLD.format(" and ".join(sorted(smoothed)), len(kernel), " and ".join(raw), corner(kernel) / test.dt)
    return test.with_channels({name: convolve1d(y, kernel, mode="reflect") for name, y in raw.items()}, note)
