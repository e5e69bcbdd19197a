"""Reversed and mis-united channels: read in the one way that fits, with a note, or refused with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import StateSpace, butter, lfilter, lsim

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.prepare.readings import Contradiction, consistent
from hystid.modelica import compile_model
from hystid.recording import Recording

Array = np.ndarray
LINEAR = "HystId.Oscillators.Linear"
DT, N, M, B, K = 1e-3, 4000, 2.5, 20.0, 3e4


def record(seed: int) -> Recording:
    """A linear oscillator: noise of 2 to 60 Hz as the motion, and the force that belongs to it exactly; 40 dB."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    omega, phase = 2 * np.pi * rng.uniform(2, 60, 40), rng.uniform(0, 2 * np.pi, 40)
    size = 1e-3 / (1 + (omega / 110.0) ** 2)
    x, v, a = (np.sin(np.outer(t, omega) + phase + k * np.pi / 2) @ (size * omega**k) for k in range(3))
    held = {name: u + 0.01 * np.std(u) * rng.standard_normal(N) for name, u in (("x", x), ("v", v), ("a", a))}
    F = M * a + B * v + K * x
    return Recording(f"test{seed}", t, F=F + 0.01 * np.std(F) * rng.standard_normal(N), **held)


def delayed(force: Array, late: float) -> Array:
    """The force, late by a time [s], without a jump at the ends."""
    spectrum = np.fft.rfft(np.concatenate([force, force[::-1]]))
    return np.fft.irfft(spectrum * np.exp(-2j * np.pi * np.fft.rfftfreq(2 * N, DT) * late))[:N]


def slipped(change: dict[str, float], channels: str) -> Recording:
    """A recording with channels multiplied by factors, and only some of them recorded."""
    test = record(1)
    moved = {name: factor * np.asarray(getattr(test, name)) for name, factor in change.items()}
    return replace(test, **{**moved, **{name: None for name in "xva" if name not in channels}})


@pytest.mark.parametrize(
    ("change", "channels"),
    [
        ({"F": -1.0}, "x"), ({"F": -1.0}, "xva"), ({"a": -1.0}, "xva"), ({"v": -1.0}, "xv"),
        ({"a": 1 / 9.80665}, "xa"), ({"x": 1e3}, "xva"), ({"F": 1e-3}, "xva"),
    ],
)  # fmt: skip
def test_a_slip_is_read_in_the_one_way_that_fits_or_refused(change: dict[str, float], channels: str) -> None:
    try:
        (found,) = consistent([slipped(change, channels)], [], M).tests
    except Contradiction as refusal:
        assert "give" in str(refusal) or "check" in str(refusal)
        return
    (note,) = found.notes
    assert "read with the other sign" in note or "is read in" in note
    sound = record(1)
    for name in ("F", *channels):
        told = np.abs(np.asarray(getattr(found, name)) - getattr(sound, name))
        # of two channels of the motion either may be the reversed one: the mirrored motion of the mirrored force
        other = np.abs(np.asarray(getattr(found, name)) + getattr(sound, name))
        assert min(np.max(told), np.max(other)) < 1e-3 * np.max(np.abs(getattr(sound, name)))


def test_a_diagnosis_tells_how_it_read_the_channels() -> None:
    found = diagnose([slipped({"F": -1.0, "a": -1.0}, "xva")], model=LINEAR, parameters={"m": M})
    assert found.verdict in ("consistent", "recalibrated") and found.findings == ()
    assert sum("read with the other sign" in text for text in found.misread) == 2
    assert found.summary().splitlines()[1] == f"to be mended: {found.misread[0]}"  # and the command ends with 1
    assert found.refit["Kl"].value == pytest.approx(K, rel=0.02)  # 40 dB, and 1 % by the mass


def test_sound_recordings_are_left_as_they_are() -> None:
    test = record(1)
    found = consistent([test], [], M)
    assert found.tests[0] is test and found.faults == ()


@pytest.mark.parametrize("late", [0.005, -0.05])
def test_a_force_on_another_clock_is_moved(late: float) -> None:
    test = record(3)
    moved = [replace(t, F=np.roll(t.F, round(late / DT))) for t in (test, replace(record(4), name="other"))]
    found = consistent(moved, [], M)
    (fault,) = found.faults
    assert fault.channel == "F" and fault.seconds == pytest.approx(late, abs=5e-4)
    noise = butter(2, 200.0, fs=1 / DT)
    moved, sound = found.tests[0], record(3)
    left = moved.F - (M * moved.a + B * moved.v + K * moved.x)
    assert np.std(lfilter(*noise, left)) < 0.05 * np.std(sound.F)


def late(test: Recording, seconds: float) -> Recording:
    return replace(test, F=np.roll(np.asarray(test.F), round(seconds / DT)))


@pytest.mark.parametrize("others", [0, 1, 2])
def test_a_force_far_off_its_motion_in_one_recording_is_refused(others: int) -> None:
    """It is no law, which would look late in all of them; alone, only the user knows whether it is."""
    moved = late(record(3), -0.05)
    tests = [moved, *(record(4 + k) for k in range(others))]
    with pytest.raises(Contradiction, match=r"test3.*50 ms earlier.*--align F \[lag\]"):
        consistent(tests, [], M)
    with pytest.raises(Contradiction, match="test3"):
        consistent([record(4)], [moved], M)  # held out
    accepted = consistent([replace(moved, accepted=frozenset({"lag"})), *tests[1:]], [], M)
    assert accepted.faults == () and accepted.tests[0].F is moved.F


def coupled(test: Recording) -> Recording:
    """An acceleration behind a high-pass of first order at 10 Hz, within the band of the test."""
    return replace(test, a=lfilter(*butter(1, 10.0, "high", fs=1 / DT), np.asarray(test.a)))


def test_an_acceleration_that_loses_slow_motion_is_left_out() -> None:
    """Its turned phase would be a resonance, or damping; the mended answer is that of the sound recordings."""
    found = diagnose([coupled(record(1)), coupled(record(2))], model=LINEAR, parameters={"m": M})
    assert found.verdict in ("consistent", "recalibrated") and found.findings == ()
    assert len(found.misread) == 2 and all("a is left out" in text and "[filtered]" in text for text in found.misread)
    assert found.refit["B"].value == pytest.approx(B, rel=0.05)


@pytest.mark.parametrize("accepts", [True, False])
def test_an_acceleration_is_left_out_where_another_channel_shows_the_motion(accepts: bool) -> None:
    test = replace(coupled(record(1)), accepted=frozenset({"filtered"} if accepts else ()))
    assert (consistent([test], [], M).tests[0].a is test.a) == accepts
    alone = replace(test, x=None, v=None)
    assert consistent([alone], [], M).tests[0].a is test.a


def test_what_no_reading_brings_together_is_refused() -> None:
    """A given mass that is four thousand times too large is no unit of the force that a note could repair."""
    with pytest.raises(Contradiction, match="mass"):
        consistent([record(1)], [], 4321.0 * M)


def test_an_acceleration_on_another_clock_makes_no_late_force() -> None:
    test = record(1)
    assert consistent([replace(test, a=np.roll(test.a, 7))], [], M).faults == ()


def test_the_noise_of_a_free_decay_says_nothing_about_units() -> None:
    """F is zero but for its noise: the mass that it seems to move is none, and no unit of F follows from that."""
    t = np.arange(N) * DT
    decay = np.exp(-2.0 * t)
    rng = np.random.default_rng(8)
    channels = {}
    for k, name in enumerate("xva"):
        values = 1e-3 * 100.0**k * decay * np.sin(100.0 * t + k * np.pi / 2)
        channels[name] = values + 1e-4 * np.std(values) * rng.standard_normal(N)
    noise = 1e-6 * rng.standard_normal(N)
    found = consistent([record(1), Recording("decay", t, F=noise, **channels)], [], M)
    assert np.array_equal(found.tests[1].channel("F"), noise)


def decay(drag: float, seed: int) -> Recording:
    """A free decay while the exciter drags along: F = -drag v, measured at 100 dB."""
    t = np.arange(N) * DT
    rate, omega = (B + drag) / (2 * M), np.sqrt(K / M - ((B + drag) / (2 * M)) ** 2)
    swing = 1e-3 * np.exp((1j * omega - rate) * t)
    x, v, a = ((swing * (1j * omega - rate) ** k).real for k in range(3))
    rng = np.random.default_rng(seed)
    held = {
        n: u + 1e-5 * np.std(u) * rng.standard_normal(N) for n, u in (("F", -drag * v), ("x", x), ("v", v), ("a", a))
    }
    return Recording(f"decay{seed}", t, **held)


@pytest.mark.parametrize("channels", ["x", "xa", "xva"])
def test_a_decay_that_gives_out_what_it_had_stored_has_the_right_sign(channels: str) -> None:
    """The mean power of F v is negative by all that it can be, and yet nothing is reversed."""
    sound = decay(40.0, 1)
    test = replace(sound, **{name: None for name in "xva" if name not in channels})
    assert float(np.mean(np.asarray(sound.F) * np.asarray(sound.v))) < 0
    assert consistent([test], [], M).tests[0] is test


@pytest.mark.parametrize("friction", [0.05, 0.5])
def test_a_decay_with_a_slider_dies_away_to_the_end(friction: float) -> None:
    """Without noise no stretch is left in which the motion does not lose energy: the force of an exciter that drags
    along, weak as it is, tells neither a sign nor a mass."""
    rig = CompiledModel(compile_model("HystId.Oscillators.Jenkins"))
    given = {"m": M, "B": 2.0, "Kl": K, "Ks": 0.3 * K, "fc": friction, "x_start": 1e-3}
    run = rig.simulate({"F": np.zeros(N)}, DT, parameters=given, outputs=("x", "v", "a"))
    test = Recording("decay", np.arange(N) * DT, F=-1.0 * run["v"], **run)
    assert consistent([test], [], M).tests[0] is test


def test_a_late_force_is_late_by_a_time_whatever_the_rate() -> None:
    """Two loggers' settings of one rig: 1 kHz and 500 Hz; the force is 1.6 ms late in both."""
    late = 1.6e-3
    tests = []
    for number, step in ((1, 1), (2, 2)):
        test = record(number)
        F = delayed(test.F, late)
        held = {name: np.asarray(getattr(test, name))[::step] for name in "txva"}
        tests.append(replace(test, **held, F=F[::step]))
    found = diagnose(tests, model=LINEAR, parameters={"m": M, "B": B, "Kl": K})
    assert [finding.effect for finding in found.findings] == ["channel_delay"]
    delay = found.findings[0].parameters["delay"]
    assert delay.value == pytest.approx(late, rel=0.03)  # 40 dB; as samples of either rate it would be off by half


def test_a_lag_is_told_once_and_within_its_error() -> None:
    """It is moved by whole samples, and the fit finds the rest: one lag, to the error of the fit."""
    late = 3.4e-3
    tests = [replace(test, F=delayed(test.F, late)) for test in (record(1), record(2))]
    found = diagnose(tests, model=LINEAR, parameters={"m": M, "B": B, "Kl": K})
    assert [finding.effect for finding in found.findings] == ["channel_delay"]
    assert len([note for note in found.notes if " late" in note]) == 1
    told = found.findings[0].parameters["delay"]
    assert abs(told.value - late) < 3 * told.stderr < 0.02 * late


def test_a_displacement_behind_a_slow_low_pass_is_left_out() -> None:
    """A displacement sensor with a filter of 10 Hz lags where the acceleration does not: a resonance, by its phase."""
    rate, finer, law = 500.0, 4, [-3200.0, -2.3]
    rig = StateSpace([[0, 1], law], [[0], [0.45]], [[1, 0], law], [[0], [0.45]])
    tests = []
    for seed, level in ((1, 60.0), (2, 35.0)):
        rng = np.random.default_rng(seed)
        F = level * lfilter(*butter(4, 40.0, fs=finer * rate), rng.standard_normal(18_000))
        moved = lsim(rig, F, np.arange(len(F)) / (finer * rate))[1]
        clean = {"F": F, "x": lfilter(*butter(2, 10.0, fs=finer * rate), moved[:, 0]), "a": moved[:, 1]}
        noisy = {n: u[::finer] + 0.056 * np.std(u) * rng.standard_normal(len(u) // finer) for n, u in clean.items()}
        tests.append(Recording(f"test_{seed}", np.arange(len(F) // finer) / rate, **noisy))
    found = diagnose(tests, model=LINEAR, parameters={"m": 1 / 0.45})
    assert found.verdict in ("consistent", "recalibrated") and found.findings == ()
    assert any("channel x is left out: it loses fast motion" in note for note in found.notes)
