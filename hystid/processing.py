"""Processing of recordings: deriving v and a, zero-phase band-pass, decimation, noise at a given ratio.

Every function returns a new recording whose ``notes`` say what was done and whose ``origin`` says how a channel came
about. All filters run forward and backward, so that no channel is delayed against another, and the stretches at both
ends that a filter cannot know are cut away rather than returned.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from hystid.errors import RecordingError, UsageError
from hystid.limits import check_whole
from hystid.numeric import Array
from hystid.recording.loading import loaded
from hystid.recording.types import Recording

Band = tuple[float | None, float | None]
Kind = Literal["bandpass", "lowpass", "highpass"]

_ORDER = 4  # of the Butterworth filters; forward and backward makes the gain that of order 8
_MOST_DB = 1000.0  # what any number can carry: doubles resolve 313 dB
_STEEP = 8  # order of the low-pass before a derivative: 0.1 % of loss two thirds up to its limit
_MOTION = ("x", "v", "a")
_SIXTH_ORDER = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # Fornberg (1988), table 1, first derivative


def parse_band(text: str) -> Band:
    """``"5-500Hz"`` -> (5.0, 500.0); ``"-500Hz"`` and ``"5-Hz"`` leave one side open. Raises UsageError."""
    numbers = text.strip().removesuffix("Hz").strip().split("-")
    try:
        low, high = (float(part) if part.strip() else None for part in numbers)
    except ValueError:
        raise UsageError(f"--band {text}: write two frequencies in Hz, as 5-500Hz") from None
    return _checked(low, high, text)


def _checked(low: float | None, high: float | None, text: str) -> Band:
    limits = [limit for limit in (low, high) if limit is not None]
    finite = all(math.isfinite(limit) and limit >= 0 for limit in limits)
    if not limits or not finite or limits[-1] == 0 or (len(limits) == 2 and not limits[0] < limits[1]):
        raise UsageError(f"--band {text}: the limits are frequencies in Hz with the lower one first, as 5-500Hz")
    return low or None, high


def _pair(band: Band | None) -> Band:
    if band is None:
        return None, None
    if isinstance(band, str) or not isinstance(band, Sequence) or len(band) != 2:
        raise UsageError(f"band {band!r}: two frequencies in Hz are needed, as (5.0, 500.0); None leaves a side open")
    return band[0], band[1]


def prepare(recording: Recording, *, band: Band | None = None, decimate: int = 1, mass: float = 0.0) -> Recording:
    """Everything between a recording and its restoring force: x, v, a, F and R on one grid, shape (n,).

    band: (low, high) [Hz] of a zero-phase Butterworth band-pass on every channel, None for either side left open;
    decimate: keep every so manyth sample, after an anti-aliasing filter where the band does not already do it;
    mass [kg]: R = F - mass a unless R was recorded; 0 means that F is the restoring force itself.
    Raises UsageError for a band or decimation that the sample rate or the length cannot carry.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> raw = hystid.simulate(fmu, "chirp:1-60Hz@60N,2s", noise_snr=40)
    >>> ready = hystid.prepare(raw, band=(None, 500.0), decimate=4, mass=1.0)
    >>> round(ready.sample_rate), ready.origin["R"]
    (2500, 'F - m a with m = 1 kg')
    """
    if decimate < 1 or int(decimate) != decimate:
        raise UsageError(f"--decimate {decimate}: a whole number of at least 1 is needed")
    if not math.isfinite(mass) or mass < 0:
        raise UsageError(f"--mass {mass:g}: a mass in kg of 0 or more is needed (0: F is the restoring force itself)")
    (recording,) = loaded([recording])
    low, high = _pair(band)
    derived = derive(recording, mass=mass, low=low, high=high)
    if low and any(how.startswith("integral") for how in derived.origin.values()):
        ends = _memory(low, "highpass", derived)
        note = f"{ends} samples cut at each end, where integration had to settle"
        derived = derived.part(slice(ends, -ends), note)
    filtered = band_pass(derived, (low, high)) if band else derived
    return with_restoring_force(_reduced(filtered, int(decimate), high), mass)


def with_restoring_force(recording: Recording, mass: float) -> Recording:
    """Add R = F - mass a [N] where R was not recorded; mass in kg, 0 for F as the restoring force itself."""
    if recording.R is not None:
        return recording
    F = recording.channel("F")
    R = F - mass * recording.channel("a") if mass else F.copy()
    text = f"F - m a with m = {mass:.10g} kg" if mass else "F itself (mass 0)"
    return replace(recording, R=R, origin={**recording.origin, "R": text})


def derive(
    recording: Recording, *, mass: float = 0.0, low: float | None = None, high: float | None = None
) -> Recording:
    """Complete x, v and a from what was recorded.

    Downwards (x -> v -> a): central differences of sixth order, after a zero-phase low-pass at ``high`` [Hz], or where
    that is None, at the frequency above which the channel's spectrum is noise. Upwards (a -> v -> x): trapezoidal
    rule and zero-phase high-pass at ``low`` [Hz], which must then be given because integration drifts.
    mass [kg] is only looked at to refuse inertia on a recording whose time is not measured.
    Edge rule: the first and last three samples of a derivative are one-sided differences of second order.
    Raises RecordingError for such inertia.
    """
    if mass and recording.quasi_static:
        raise RecordingError(
            f"{recording.name}: time only numbers the samples, so there is no acceleration for m a; use mass 0"
        )
    for name, source in (("v", "x"), ("a", "v")):
        if getattr(recording, name) is None and getattr(recording, source) is not None:
            recording = _with_derivative(recording, name, source, high)
    for name, source in (("v", "a"), ("x", "v")):
        if getattr(recording, name) is None and getattr(recording, source) is not None:
            recording = _with_integral(recording, name, source, low)
    return recording


def _with_derivative(recording: Recording, name: str, source: str, high: float | None) -> Recording:
    values = recording.channel(source)
    how = f"d{source}/dt, central differences of sixth order (one-sided of second order at the three end samples)"
    if recording.direct(source):  # what was derived has been smoothed before
        cutoff, why = (_below_nyquist(high, recording), "") if high is not None else _own_cutoff(values, recording.dt)
        if cutoff is not None:
            values = _filtered(values, cutoff, "lowpass", recording.sample_rate, _STEEP)
            how += f" after a zero-phase low-pass at {cutoff:.4g} Hz{why}"
    return _with_channel(recording, name, differentiate(values, recording.dt), how)


def _own_cutoff(values: Array, dt: float) -> tuple[float | None, str]:
    """Limit of the low-pass before a derivative, from the channel itself, and the reason in words."""
    held = float(np.mean(np.diff(values) == 0))
    if held > 0.5:  # a staircase: its slope is nothing and then a jump, so several steps go into one period
        why = f", because the channel holds its value in {100 * held:.0f} % of the samples"
        return (1 - held) / (1.5 * dt) / 4, why
    return noise_cutoff(values, dt), ", above which the spectrum is noise"


def _with_integral(recording: Recording, name: str, source: str, low: float | None) -> Recording:
    if not low:
        raise RecordingError(
            f"{recording.name}: {name} has to be integrated from {source}, which drifts;"
            " state the lower frequency limit of the test with --band, as 5-500Hz"
        )
    values = recording.channel(source)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * recording.dt)])
    trend = np.polynomial.Polynomial.fit(recording.t, total, 1)(recording.t)
    smooth = _filtered(total - trend, low, "highpass", recording.sample_rate)
    how = f"integral of {source}, trapezoidal rule and zero-phase high-pass at {low:g} Hz"
    return _with_channel(recording, name, smooth, how)


def _with_channel(recording: Recording, name: str, values: Array, how: str) -> Recording:
    derived = replace(recording, origin={**recording.origin, name: how})
    return derived.with_channels({name: values}, f"{name} derived: {how}")


def differentiate(values: Array, dt: float) -> Array:
    """d/dt of evenly spaced values, shape (n,), n >= 7: central differences of sixth order.

    Gain error at a tenth of the sample rate: 4e-4. First and last three samples: one-sided, second order.
    """
    if values.size < 7:
        raise RecordingError(f"a derivative needs at least 7 samples; there are {values.size}")
    slope = np.gradient(values, dt, edge_order=2)
    slope[3:-3] = np.correlate(values, _SIXTH_ORDER, mode="valid") / dt
    return slope


def noise_cutoff(values: Array, dt: float) -> float | None:
    """Frequency [Hz] above which the spectrum is flat noise, None where it is signal (or falling) to the end.

    The floor is the median of the highest fifth of a Welch spectrum; signal stands 10 dB above it. Half as much again
    is added so that the filter's own roll-off stays out of the signal.
    """
    from scipy.signal import detrend, welch

    frequency, power = welch(detrend(values), fs=1 / dt, nperseg=min(values.size, 2048))
    floor = float(np.median(power[-max(power.size // 5, 1) :]))
    signal = np.flatnonzero(power > 10 * floor)
    if not signal.size:
        return None
    cutoff = 1.5 * float(frequency[signal[-1]])
    return cutoff if cutoff < 0.4 / dt else None


def band_pass(recording: Recording, band: Band) -> Recording:
    """Zero-phase Butterworth band-pass of order 4 on all of F, x, v, a and R; both ends are cut by the filter's memory.

    Filtering every channel alike keeps m a + R = F and v = dx/dt. Extra columns are cut but not filtered.
    Raises RecordingError where the time is not measured.
    """
    low, high = _checked(*band, f"{band[0]}-{band[1]}")
    high = _below_nyquist(high, recording)
    if recording.quasi_static:
        raise RecordingError(f"{recording.name}: time only numbers the samples, so a band in Hz has no meaning")
    if low is None and high is None:
        return recording
    kind, limits = _filter(low, high)
    samples = _memory(limits, kind, recording)
    text = f"{low or 0:g} to {high:g} Hz" if high else f"from {low:g} Hz"
    note = f"zero-phase Butterworth band-pass of order {_ORDER}, {text}; {samples} samples cut at each end"
    note += " (1 % of the filter's response is left there)"
    return _mapped(recording, lambda y: _filtered(y, limits, kind, recording.sample_rate), samples, note)


def _filter(low: float | None, high: float | None) -> tuple[Kind, float | list[float]]:
    if low and high:
        return "bandpass", [low, high]
    return ("highpass", low) if low else ("lowpass", high or 0.0)


def _reduced(recording: Recording, factor: int, high: float | None) -> Recording:
    if factor == 1:
        return recording
    if len(recording) // factor < 64:
        raise UsageError(f"--decimate {factor}: {recording.name} would keep fewer than 64 samples")
    limit = 0.4 * recording.sample_rate / factor
    note = f"every {factor}th sample kept: {recording.sample_rate / factor:.6g} Hz"
    if high is None or high > limit:
        samples = _memory(limit, "lowpass", recording)
        text = f"zero-phase low-pass at {limit:.4g} Hz against aliasing; {samples} samples cut at each end"
        rate = recording.sample_rate
        recording = _mapped(recording, lambda y: _filtered(y, limit, "lowpass", rate), samples, text)
    return recording.part(slice(None, None, factor), note)


def _mapped(recording: Recording, function: Callable[[Array], Array], ends: int, note: str) -> Recording:
    channels = {name: function(values) for name, values in recording.channels().items()}
    return recording.with_channels(channels).part(slice(ends, len(recording) - ends), note)


def cut(recording: Recording, start: int, stop: int) -> Recording:
    """Samples start to stop - 1 of a recording, noted."""
    return recording.part(slice(start, stop), f"samples {start} to {stop - 1} used")


def add_noise(recording: Recording, snr_db: float, seed: int) -> Recording:
    """Add white Gaussian noise to F, x, v and a: each with its own rms over 10^(snr_db / 20) as standard deviation.

    Deterministic for a seed; each channel has its own stream, so that leaving one out does not change the others.
    R is dropped: it has to be computed from the noisy channels. Raises UsageError for a ratio out of range.
    """
    if not abs(snr_db) <= _MOST_DB:
        raise UsageError(f"--noise-snr {snr_db:g}: a ratio in dB is needed, as 34")
    check_whole("--seed", seed, 0)
    noisy = {}
    for name, values in recording.channels(("F", *_MOTION)).items():
        rms = float(np.sqrt(np.mean((values - values.mean()) ** 2)))
        stream = np.random.default_rng([seed, zlib.crc32(name.encode())])
        noisy[name] = values + stream.normal(0.0, rms / 10 ** (snr_db / 20), values.size)
    note = f"white noise added at {snr_db:g} dB (seed {seed})"
    return replace(recording, R=None).with_channels(noisy, note)


def _below_nyquist(high: float | None, recording: Recording) -> float | None:
    if high is not None and high >= 0.5 * recording.sample_rate:
        raise UsageError(
            f"--band upper limit {high:g} Hz: {recording.name} was sampled at {recording.sample_rate:.6g} Hz"
            f" and holds nothing above {0.5 * recording.sample_rate:.6g} Hz"
        )
    return high


def _filtered(values: Array, limits: float | list[float], kind: Kind, rate: float, order: int = _ORDER) -> Array:
    from scipy.signal import butter, sosfiltfilt

    sections = butter(order, limits, kind, fs=rate, output="sos")
    # Odd reflection over a few periods of the lowest limit keeps value and slope continuous at the ends.
    lowest = limits[0] if isinstance(limits, list) else limits
    pad = int(min(values.size - 1, max(3 * rate / lowest, 64)))
    return np.asarray(sosfiltfilt(sections, values, padtype="odd", padlen=pad), dtype=np.float64)


def _memory(limits: float | list[float], kind: Kind, recording: Recording) -> int:
    """Samples after which 99 % of the filter's impulse response (in amplitude) has gone by."""
    from scipy.signal import butter, sosfilt

    n = len(recording)
    impulse = np.zeros(n)
    impulse[0] = 1.0
    response = sosfilt(butter(_ORDER, limits, kind, fs=recording.sample_rate, output="sos"), impulse)
    remaining = np.sqrt(np.cumsum(response[::-1] ** 2)[::-1] / np.sum(response**2))
    samples = int(np.searchsorted(-remaining, -0.01)) if remaining[-1] < 0.01 else n
    if 4 * samples > n:
        lowest = limits[0] if isinstance(limits, list) else limits
        raise UsageError(
            f"--band lower limit {lowest:g} Hz: {recording.name} lasts {n * recording.dt:.4g} s,"
            " too short for such a filter to settle; raise the limit or leave it open"
        )
    return samples
