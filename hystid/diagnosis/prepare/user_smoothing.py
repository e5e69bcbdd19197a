"""Channels that a user smoothed, and the others smoothed alike: a law then sees one motion and one force."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import convolve1d

from hystid.diagnosis.prepare.segments import measured_motion, noise_before
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.kernels import corner

_TOLD = (
    "{0} was smoothed over {1} samples, as its noise shows; so {2} smoothed alike. Motion above {3:.3g} Hz is "
    "weakened: give {0} as it was recorded, if you have it"
)


def smoothed_alike(tests: Sequence[Recording]) -> list[Recording]:
    """Recordings with all channels smoothed, and a note, where some channels of half of them were: by the kernel that
    is found most often."""
    found = [
        {name: tuple(one.kernel) for name, one in noise_before(_shown(test), {}).items() if one.kernel is not None}
        for test in tests
    ]
    kernels = Counter(kernel for each in found for kernel in each.values())
    if not kernels or 2 * sum(map(bool, found)) < len(tests):
        return list(tests)
    kernel, smoothed = np.array(kernels.most_common(1)[0][0]), {name for each in found for name in each}
    return [_with_all_smoothed(test, smoothed, kernel) for test in tests]


def _shown(test: Recording) -> dict[str, Array]:
    return {**test.channels("F"), **measured_motion(test)}


def _with_all_smoothed(test: Recording, smoothed: set[str], kernel: Array) -> Recording:
    raw = {name: y for name, y in _shown(test).items() if name not in smoothed}
    if not raw:
        return test
    note = _TOLD.format(
        " and ".join(sorted(smoothed)),
        len(kernel),
        f"{' and '.join(raw)} {'is' if len(raw) == 1 else 'are'}",
        corner(kernel) / test.dt,
    )
    return test.with_channels({name: convolve1d(y, kernel, mode="reflect") for name, y in raw.items()}, note)
