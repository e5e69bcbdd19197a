"""Parameters that no recording can tell apart: scaling some of them up and others down leaves the law as it is.

In the Bouc-Wen law, for one, only beta gamma and beta delta count. Fitted all three, each takes any value, with a
standard error to match, and every fit pays for a direction that leads nowhere: one of them is held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError
from hystid.numeric import Array

_STEP = 1e-3  # relative step of difference quotients
_NONE = 1e-2  # relative singular value below which a relation is suspected: what differences of that step leave
_NO_PART = 0.02  # share of the largest exponent below which a parameter has no part in a relation
_TEST = 0.1  # logarithmic distance along a suspected relation at which the law is compared with itself
_EQUAL = 1e-7  # relative difference that rounding and integration leave


def without_redundancy(baseline: Baseline, parts: Sequence[Part]) -> tuple[Baseline, list[str]]:
    """The baseline with one parameter of every redundant set held, and a sentence for each.

    A set is redundant where p_j exp(c_j t), for some integers c_j and every t, gives the same R and h. Nothing is held
    where the law is not finite at the nominal values.
    """
    part = max(parts, key=lambda p: float(np.max(np.abs(p.x))))
    told = []
    try:
        while relation := _relation(baseline, part):
            first, *others = relation
            told.append(f"{first} is held: any value would do, with {', '.join(others)} scaled against it")
            baseline = replace(baseline, free=tuple(name for name in baseline.free if name != first))
    except NumericalError:
        return baseline, told
    return baseline, told


def _relation(baseline: Baseline, part: Part) -> tuple[str, ...]:
    """Names of a redundant set, () where there is none."""
    names = [name for name in baseline.shapes if baseline.nominal[name] != 0]
    here = _law(baseline, part, baseline.nominal)
    moved = [_law(baseline, part, _scaled(baseline.nominal, {name: _STEP})) for name in names]
    columns = {name: there - here for name, there in zip(names, moved, strict=True) if np.any(there != here)}
    if len(columns) < 2:
        return ()
    _, sizes, directions = np.linalg.svd(np.stack([*columns.values()], axis=1), full_matrices=False)
    if sizes[-1] > _NONE * sizes[0]:
        return ()
    exponents = directions[-1] / np.max(np.abs(directions[-1]))
    taking_part = np.abs(exponents) > _NO_PART
    whole = np.round(exponents / np.min(np.abs(exponents[taking_part])))
    along = {name: _TEST * c for name, c in zip(columns, whole, strict=True) if c}
    same = np.max(np.abs(_law(baseline, part, _scaled(baseline.nominal, along)) - here))
    return tuple(along) if len(along) > 1 and same < _EQUAL * np.max(np.abs(here)) else ()


def _law(baseline: Baseline, part: Part, values: Mapping[str, float]) -> Array:
    """R and h one after the other."""
    return np.concatenate(baseline.force(part.x, part.v, part.dt, values))


def _scaled(values: Mapping[str, float], logarithms: Mapping[str, float]) -> dict[str, float]:
    return {name: value * float(np.exp(logarithms.get(name, 0.0))) for name, value in values.items()}
