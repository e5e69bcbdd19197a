"""Checks of the channels at the door: finite, changing, not clipped, and fitting each other in size and sign.

The rules work on what every recording of a moving structure must obey, so that they need no settings: v = dx/dt,
a = dv/dt, sizes that machines can have, and energy that a passive structure takes up and does not give.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hystid.recording.problems import Problem, Severity
from hystid.recording.table import Table
from hystid.recording.types import Array
from hystid.units import STANDARD_GRAVITY

# Largest plausible values: far beyond any structure's vibration, but below what a thousandfold unit error makes of it.
_LARGEST = {"x": 10.0, "v": 100.0, "a": 1e5}
# How much larger numbers get when a length is written in a smaller unit but labelled m
_UNIT_SLIPS = {"mm": 1e3, "µm": 1e6, "cm": 1e2, "inches": 39.3700787}


def channel_problems(table: Table, channels: Mapping[str, Array]) -> list[Problem]:
    """Problems of single channels: wrong length, NaN, constant, clipped."""
    problems: list[Problem] = []
    n = channels["t"].size if "t" in channels else 0
    for name, values in channels.items():
        if name == "t":
            continue
        if n and values.size != n:
            found = f"{values.size} samples where time has {n}"
            problems.append(_problem(table, "length", found, "write all channels with one length", name))
            continue
        problems += _not_finite(table, name, values) or _constant(table, name, values) or _clipped(table, name, values)
    return problems


def _not_finite(table: Table, name: str, values: Array) -> list[Problem]:
    bad = np.flatnonzero(~np.isfinite(values))
    if not bad.size:
        return []
    found = f"{bad.size} of {values.size} samples are NaN or infinite"
    action = "cut these samples, or fill them knowingly"
    return [_problem(table, "not_finite", found, action, name, int(bad[0]))]


def _constant(table: Table, name: str, values: Array) -> list[Problem]:
    spread = float(np.ptp(values))
    if spread > 1e-12 * float(np.max(np.abs(values), initial=0.0)):
        return []
    found = f"the channel is constant ({values[0]:.6g})"
    action = "check that the sensor was connected" + (", or remove the column" if name in ("v", "a", "R") else "")
    return [_problem(table, "constant", found, action, name)]


def _clipped(table: Table, name: str, values: Array) -> list[Problem]:
    for side, found_at in (("top", flat_tops(values)), ("bottom", flat_tops(-values))):
        if len(found_at) >= 2:
            held = sum(length for _, length in found_at)
            limit = values.max() if side == "top" else values.min()
            found = f"cut off at {limit:.6g}: it arrives there in full motion {len(found_at)} times for {held} samples"
            action = "measure again with a larger range, or use the tests below it"
            return [_problem(table, "clipped", found, action, name, found_at[0][0])]
    return []


def flat_tops(values: Array) -> list[tuple[int, int]]:
    """(first sample, length) of each stay of at least 3 samples at the exact maximum that is entered in full motion.

    A smooth signal slows down before its peak: its last step is of the size of one digit of the converter, even if
    it then rests. A clipped one arrives with a step of the size that it makes elsewhere in the same rise.
    """
    steps = np.diff(values)
    moving = np.abs(steps[steps != 0])
    if moving.size < 8:
        return []
    digit = float(moving.min())
    at_top = np.concatenate([[False], values == values.max(), [False]])
    starts = np.flatnonzero(at_top[1:-1] & ~at_top[:-2])
    ends = np.flatnonzero(at_top[1:-1] & ~at_top[2:]) + 1
    tops = []
    for start, end in zip(starts, ends, strict=True):
        if end - start < 3 or start < 4:
            continue
        before = steps[start - 4 : start - 1]  # the last step is cut short by the limit itself
        if (
            before[-1] > 0
            and before.min() > 3 * digit
            and before.min() > 0.25 * np.median(moving)
            and _rises_on(before)
        ):
            tops.append((int(start), int(end - start)))
    return tops


def _rises_on(before: Array) -> bool:
    """Whether a parabola through the last steps would still go on rising for two samples: a peak would not."""
    slowing = (before[0] - before[-1]) / (before.size - 1)
    return bool(before[-1] - 2.5 * slowing > 0.0)


def motion_problems(table: Table, channels: Mapping[str, Array], dt: float, *, timed: bool) -> list[Problem]:
    """Problems of size and sign between the channels, all of shape (n,) on a uniform grid of step dt [s]."""
    problems: list[Problem] = []
    if timed:
        for lower, upper in (("x", "v"), ("v", "a")):
            if lower in channels and upper in channels:
                problems += _rate(table, channels, lower, upper, dt)
    faulty = {item.channel for item in problems}
    problems += [item for item in _sizes(table, channels, dt, timed=timed) if item.channel not in faulty]
    return problems + _power(table, channels, timed=timed)


def _rate(table: Table, channels: Mapping[str, Array], lower: str, upper: str, dt: float) -> list[Problem]:
    ratio, correlation = rate_ratio(channels[lower], channels[upper], dt)
    unit = {"v": "m/s", "a": "m/s2"}[upper]
    if not np.isfinite(ratio) or abs(correlation) < 0.3:
        found = f"{upper} does not follow d{lower}/dt (correlation {correlation:.2f})"
        action = "check that both columns belong to one test and one point"
        return [_problem(table, "not_one_motion", found, action, upper, severity="warning")]
    if correlation < -0.5 and 0.2 < abs(ratio) < 5:
        found = f"{upper} is {ratio:.3g} times d{lower}/dt, so one of both has the wrong sign"
        return [_problem(table, "swapped_sign", found, f"reverse the sign of {upper} or of {lower}", upper)]
    if abs(correlation) > 0.5 and not 0.5 < abs(ratio) < 2:
        found = f"{upper} is {ratio:.4g} times d{lower}/dt{_slip(ratio, lower, upper)}"
        action = f"correct the unit in the header of {lower} or {upper} (values are read as m and {unit})"
        return [_problem(table, "wrong_unit", found, action, upper)]
    return []


def rate_ratio(lower: Array, upper: Array, dt: float) -> tuple[float, float]:
    """(r, correlation) of the fit  upper = r d(lower)/dt,  from increments over a quarter of the dominant period.

    Comparing lower(t + T) - lower(t) with the integral of upper over T needs no derivative of noise, and drift of an
    integrated sensor does not reach beyond T.
    """
    span = max(_dominant_period(lower) // 4, 1)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (upper[1:] + upper[:-1]) * dt)])
    rise = lower[span:] - lower[:-span]
    gain = integral[span:] - integral[:-span]
    rise, gain = rise - rise.mean(), gain - gain.mean()
    power, cross = float(rise @ rise), float(rise @ gain)
    if power == 0.0 or not np.any(gain):
        return float("nan"), 0.0
    correlation = cross / np.sqrt(power * float(gain @ gain))
    return float(np.sign(cross) * np.sqrt(float(gain @ gain) / power)), float(correlation)


def _dominant_period(values: Array) -> int:
    """Period of the strongest spectral line in samples."""
    n = values.size
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(n))) ** 2
    return round(n / max(int(np.argmax(power[1:])) + 1, 1))


def _slip(ratio: float, lower: str, upper: str) -> str:
    for unit, factor in _UNIT_SLIPS.items():
        for size, culprit in ((factor, upper), (1 / factor, lower)):
            if abs(abs(ratio) / size - 1) < 0.2:
                return f", as if {culprit} were in {unit}{'' if culprit == 'x' else ' and s'}"
    if upper == "a" and abs(abs(ratio) * STANDARD_GRAVITY - 1) < 0.2:
        return ", as if a were in g"
    return ""


def _sizes(table: Table, channels: Mapping[str, Array], dt: float, *, timed: bool) -> list[Problem]:
    problems = []
    for name, limit in _LARGEST.items():
        if name in channels and (timed or name == "x"):
            largest = float(np.max(np.abs(channels[name] - np.median(channels[name]))))
            if largest > limit:
                unit = {"x": "m", "v": "m/s", "a": "m/s2"}[name]
                found = f"{name} reaches {largest:.4g} {unit}, which no structure of this kind does"
                problems.append(_problem(table, "wrong_unit", found, f"correct the unit of {name} in the header", name))
    if timed and not problems and "x" in channels and "v" not in channels:
        x = channels["x"] - channels["x"].mean()
        speed = float(np.std(x)) * 2 * np.pi / (_dominant_period(x) * dt)
        if speed > _LARGEST["v"]:
            found = f"x moves at about {speed:.3g} m/s, which no structure of this kind does"
            problems.append(_problem(table, "wrong_unit", found, "correct the unit of x or of t in the header", "x"))
    return problems


def _power(table: Table, channels: Mapping[str, Array], *, timed: bool) -> list[Problem]:
    if "F" not in channels or "x" not in channels:
        return []
    F, x = channels["F"], channels["x"]
    released = energy_released(F, x)
    if released > 1.5:
        found = f"the structure gives out energy throughout the test, {released:.3g} times what it can have stored"
    elif not timed and np.corrcoef(F, x)[0, 1] < -0.8:
        found = f"F falls as x grows (correlation {np.corrcoef(F, x)[0, 1]:.2f}) in a quasi-static test"
    else:
        return []
    action = "reverse the sign of F or of x, or accept an active structure with --accept swapped_sign"
    return [_problem(table, "swapped_sign", found, action, "F")]


def energy_released(F: Array, x: Array) -> float:
    """Energy given out over a test in units of  max|F| max|x| / 2,  0 where it is not given out all the time.

    A passive structure can give out no more than it had stored at the start, and that only once: a test counts only
    if either half has at least 15 % of the release. The mean force is left out, because a preload or a pressure works
    on a drift of the mean position in either direction.
    """
    force, place = F - F.mean(), x - x.mean()
    work = 0.5 * (force[1:] + force[:-1]) * np.diff(x)
    total = float(work.sum())
    first = float(work[: work.size // 2].sum())
    if not (total < 0 and 0.15 < first / total < 0.85):
        return 0.0
    return -total / (0.5 * float(np.max(np.abs(force))) * float(np.max(np.abs(place))))


def _problem(
    table: Table,
    rule: str,
    found: str,
    action: str,
    channel: str,
    sample: int | None = None,
    severity: Severity = "error",
) -> Problem:
    return Problem(table.file, rule, found, action, channel, sample, table.line(sample), severity)
