"""Recordings that are used together: of one kind of rig, none of them twice, and none both used and held out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from hystid.errors import UsageError
from hystid.recording.types import CHANNELS, Recording


def check_together(used: Sequence[Recording], unseen: Sequence[Recording] = ()) -> None:
    """Raise UsageError where a test is there twice, or newtons stand beside N.m."""
    for held, test in product(unseen, used):
        if _same(held, test):
            raise UsageError(f"{held.name} is held out and used ({test.name} has the same samples): leave out one")
    for test, again in combinations(used, 2):
        if np.array_equal(test.t, again.t) and _same(test, again):
            raise UsageError(f"{again.name} has the same samples as {test.name}: name each test once")
    turning = {recording.rotational: recording.name for recording in (*used, *unseen)}
    if len(turning) > 1:
        told = f"the rig turns in {turning[True]} (N.m, rad), and not in {turning[False]} (N, m)"
        raise UsageError(f"{told}: give recordings of one rig, or correct their units")


def _same(one: Recording, other: Recording) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in CHANNELS if name != "R"]
    shared = [(u, w) for u, w in pairs if u is not None and w is not None]
    return bool(shared) and all(np.array_equal(u, w) for u, w in shared)
