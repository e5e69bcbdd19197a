"""Faults of the channels: lags, zeros, gains, clipping, dead channels; found in what the sections agree on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, cont2discrete, lfilter, sosfiltfilt

from hystid.compiled import CompiledModel
from hystid.diagnosis.prepare.bandwidth import where_white
from hystid.diagnosis.prepare.chain import DEAD, DELAY, GAIN, SATURATION, ZERO, examined, stopped
from hystid.diagnosis.prepare.differences import advanced
from hystid.diagnosis.prepare.faults import COUPLED
from hystid.diagnosis.prepare.independence import measured_alike
from hystid.diagnosis.prepare.pairs import agreed, pairs
from hystid.modelica import compile_model
from hystid.recording import Recording

Array = np.ndarray
DT, N = 1e-3, 6000


def motion(seed: int, noise: float = 0.01, late: float = 0.0, channel: str = "", n: int = N) -> Recording:
    """Thirty tones of 2 to 40 Hz: x, v and a exactly, one of them late [s]; white noise of a share of each channel."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    omega, phase = 2 * np.pi * rng.uniform(2, 40, 30), rng.uniform(0, 2 * np.pi, 30)
    size = 1e-3 * rng.uniform(0.5, 1.0, 30) / (1 + (omega / 60) ** 2)
    made = {}
    for order, name in enumerate("xva"):
        turn = np.outer(t - (late if name == channel else 0.0), omega) + phase + order * np.pi / 2
        values = np.sin(turn) @ (size * omega**order)
        made[name] = values + noise * np.std(values) * rng.standard_normal(n)
    return Recording("test", t, F=rng.standard_normal(n), **made)


@pytest.mark.parametrize("late", [-0.05, 0.0003, 0.005, 0.05, 0.4])
@pytest.mark.parametrize("channel", ["x", "v", "a"])
def test_a_late_channel_is_found_whatever_its_lag(late: float, channel: str) -> None:
    found = examined([motion(1, late=late, channel=channel)], [])
    (fault,) = found.repaired
    assert (fault.id, fault.channel) == (DELAY, channel)
    assert fault.seconds == pytest.approx(late, abs=1e-5)  # a hundredth of a sample at 40 dB
    assert abs(fault.seconds - late) < 5 * fault.stderr * DT
    sound, moved = motion(1), found.tests[0]
    inner = slice(500, -500)  # what a shift leaves at the ends is not known
    assert np.std((getattr(moved, channel) - getattr(sound, channel))[inner]) < 0.03 * np.std(getattr(sound, channel))


def test_a_quiet_recording_hides_no_lag_that_others_show() -> None:
    """Noise of a third of x, derived twice, is all that the first one shows between x and a."""
    tests = [replace(motion(k, noise, late=0.0003, channel="a"), v=None) for k, noise in ((1, 0.3), (2, 0.01))]
    assert not pairs(tests[:1])[0].seen
    (fault,) = examined(tests, []).repaired
    assert (fault.id, fault.channel) == (DELAY, "a")
    assert fault.seconds == pytest.approx(0.0003, abs=1e-5)  # a hundredth of a sample at 40 dB, as above


def under_a_held_force() -> Recording:
    """A linear oscillator whose force is constant over each sample: exact, with the force in the same row."""
    rows, dynamics = np.empty((N, 2)), (np.array([[0.0, 1.0], [-1e4, -7.5]]), np.array([[0.0], [0.5]]))
    step, push, *_ = cont2discrete((*dynamics, np.eye(2), np.zeros((2, 1))), DT)
    rng = np.random.default_rng(6)
    force = sosfiltfilt(butter(4, [2, 60], "band", fs=1 / DT, output="sos"), rng.standard_normal(N))
    state = np.zeros(2)
    for k in range(N):
        rows[k] = state
        state = step @ state + push[:, 0] * force[k]
    x, v = rows.T
    found = {"F": force, "x": x, "v": v, "a": 0.5 * force - 1e4 * x - 7.5 * v}
    noisy = {name: u + 1e-3 * np.std(u) * rng.standard_normal(N) for name, u in found.items()}
    return Recording("held", DT * np.arange(N), **noisy)


def test_an_acceleration_that_jumps_with_a_held_force_is_on_no_other_clock() -> None:
    """It leads the motion by up to half a sample, and balances the force as it is; an early clock does not."""
    record = under_a_held_force()
    found = examined([record], [])
    assert DELAY not in {fault.id for fault in found.repaired} and any("held" in note for note in found.notes)
    smooth = examined([replace(record, a=advanced(np.asarray(record.a), -0.355))], [])  # no jump at F's own instants
    assert not any("held" in note for note in smooth.notes)
    motions = motion(1, late=-0.0004, channel="a")
    balanced = replace(motions, F=2 * motion(1).channel("a") + 9e3 * motion(1).channel("x"))
    assert [fault.id for fault in examined([balanced], []).repaired] == [DELAY]


def test_of_two_channels_the_later_one_is_at_fault() -> None:
    record = replace(motion(2, late=0.005, channel="a"), v=None)
    assert [(f.channel, f.id) for f in examined([record], []).faults] == [("a", DELAY)]
    record = replace(motion(2, late=0.005, channel="x"), v=None)
    assert [(f.channel, f.id) for f in examined([record], []).faults] == [("x", DELAY)]


def test_sound_channels_have_no_fault() -> None:
    """One false alarm in a thousand recordings is the rate that was chosen: none is expected in forty."""
    for seed in range(40):
        assert examined([motion(seed, noise=10 ** -(1 + seed % 3))], []).repaired == ()


def test_a_lag_that_the_sections_do_not_agree_on_is_not_believed() -> None:
    """A clock that wanders by a sample over the recording, there and back, has no lag."""
    record = motion(3)
    wander = 3 * np.sin(2 * np.pi * np.arange(N) / N)
    loose = replace(record, a=np.interp(np.arange(N) - wander, np.arange(N), record.a))
    assert all(not pair.lag.agrees for pair in pairs([loose]) if pair.high == "a")
    assert not [fault for fault in examined([loose], []).faults if fault.id == DELAY]


def test_what_a_filter_does_is_no_gain() -> None:
    record = motion(4)
    b, a = butter(1, 8.0, "high", fs=1 / DT)
    coupled = replace(record, a=lfilter(b, a, record.a))
    assert GAIN not in {fault.id for fault in examined([coupled], []).repaired}


@pytest.mark.parametrize(
    ("corner", "without"), [(0.2, ""), (1.0, ""), (8.0, ""), (0.2, "x"), (8.0, "x"), (1.0, "v"), (8.0, "v")]
)
def test_an_ac_coupled_channel_is_told_with_its_corner_and_put_back(corner: float, without: str) -> None:
    """It leads the channels below by an angle that falls with the frequency: none of them is late."""
    sound = motion(6, n=3 * N)
    b, a = butter(1, corner, "high", fs=1 / DT)
    record = replace(sound, a=lfilter(b, a, sound.channel("a")), **{name: None for name in without})
    found = examined([record], [])
    (fault,) = found.repaired
    assert (fault.id, fault.channel) == (COUPLED, "a")
    assert abs(fault.size / (2 * np.pi) - corner) < max(5 * fault.stderr, 0.01 * corner)  # the bilinear transform warps
    assert f"a corner at {fault.size / (2 * np.pi):.3g} (" in fault.sentence()
    left = found.tests[0].channel("a") - sound.channel("a")
    assert np.std(left) < 0.02 * np.std(sound.channel("a"))  # twice the noise that it has


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("corner", [0.2, 1.0])
def test_integrators_with_a_high_pass_are_left_out_beside_the_acceleration(corner: float, order: int) -> None:
    """Amplifiers integrate with a high-pass: their v and x lead, and a alone is right. Their noise is that of a."""
    record = motion(6, n=3 * N)
    b, a = butter(order, corner, "high", fs=1 / DT)
    v = lfilter(b, a, cumulative_trapezoid(record.channel("a"), dx=DT, initial=0.0))
    x = lfilter(b, a, cumulative_trapezoid(v, dx=DT, initial=0.0))
    found = examined([replace(record, x=x, v=v)], [])
    assert {(fault.id, fault.channel) for fault in found.repaired} == {(COUPLED, "v"), (COUPLED, "x")}
    assert all("left out" in fault.sentence() for fault in found.repaired)
    assert found.tests[0].x is None and found.tests[0].v is None
    turns = 1.0 if order == 1 else np.sqrt(2.0)  # a filter of second order turns the phase by as much more
    (size,) = (fault.size / (2 * np.pi) for fault in found.repaired if fault.channel == "v")
    # the bilinear transform warps; of second order, what is not first is left out, and is most where noise wanders
    assert size == pytest.approx(turns * corner, rel=0.01 if order == 1 else 0.05)


@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_an_ac_coupled_velocity_beside_a_displacement_alone_is_put_back(noise: float) -> None:
    sound = replace(motion(8, noise=noise, n=3 * N), a=None)
    b, a = butter(1, 0.5, "high", fs=1 / DT)
    found = examined([replace(sound, v=lfilter(b, a, sound.channel("v")))], [])
    (fault,) = found.repaired
    assert (fault.id, fault.channel, fault.left_out) == (COUPLED, "v", False)
    assert abs(fault.size / (2 * np.pi) - 0.5) < max(5 * fault.stderr, 0.005)
    assert np.std(found.tests[0].channel("v") - sound.channel("v")) < 2 * noise * np.std(sound.channel("v"))


@pytest.mark.parametrize(("channel", "gain"), [("x", 1.05), ("v", 0.9), ("a", 1.2)])
def test_the_gain_of_one_of_three_channels_is_told_with_its_error(channel: str, gain: float) -> None:
    record = motion(5)
    scaled = replace(record, **{channel: gain * getattr(record, channel)})
    (fault,) = examined([scaled], []).repaired
    assert (fault.id, fault.channel) == (GAIN, channel)
    assert abs(fault.size - gain) < 5 * fault.stderr < 0.02
    assert f"channel {channel} reads" in fault.sentence()


def test_clipping_is_found_although_the_channel_is_late() -> None:
    record = motion(6, late=0.004, channel="v")
    level = 1.5 * float(np.std(record.x))
    clipped = replace(record, x=np.clip(record.x, -level, level))
    found = examined([clipped], [])
    assert found.stopped == {"x": pytest.approx(level)}
    assert {fault.channel for fault in found.faults if fault.id == DELAY} <= {"v", "a"}


@pytest.mark.parametrize(("channel", "noise"), [("x", 0.003), ("v", 0.03), ("a", 0.003), ("a", 0.05)])
def test_a_level_in_front_of_the_noise_is_found(channel: str, noise: float) -> None:
    """No value comes twice then: what the other channels say goes on, and the channel stays."""
    clean, noisy = motion(11, noise=0.0), motion(11, noise=noise)
    values = getattr(clean, channel)
    level = 0.65 * float(np.max(np.abs(values)))
    clipped = np.clip(values, -level, level) + getattr(noisy, channel) - values
    (fault,) = examined([replace(noisy, **{channel: clipped})], []).faults
    assert (fault.id, fault.channel) == (SATURATION, channel)
    # the median of some hundred samples scatters by an eighth of their noise, and begins a little below the level
    assert fault.size == pytest.approx(level, abs=0.5 * noise * float(np.std(values)) + 0.01 * level)


def test_a_channel_that_reads_too_little_or_rounds_its_peaks_does_not_stop() -> None:
    record = motion(12, noise=0.01)
    slow = sosfiltfilt(butter(2, 45, fs=1 / DT, output="sos"), record.a)
    for changed in (replace(record, a=0.97 * record.a), replace(record, a=slow)):
        assert SATURATION not in {fault.id for fault in examined([changed], []).faults}


def test_the_zero_of_velocity_and_acceleration_is_taken_out() -> None:
    record = motion(7)
    off = replace(record, v=record.v + 0.1 * np.std(record.v), a=record.a - 0.03 * np.std(record.a))
    found = examined([off], [])
    assert {(fault.id, fault.channel) for fault in found.repaired} == {(ZERO, "v"), (ZERO, "a")}
    assert found.faults == ()  # taken out, and no finding
    for name in "va":
        left = np.mean(getattr(found.tests[0], name) - getattr(record, name))
        assert abs(left) < 2e-3 * np.std(getattr(record, name))


def test_a_dead_channel_is_left_out() -> None:
    record = motion(8)
    dead = replace(record, v=np.random.default_rng(0).standard_normal(N))
    found = examined([dead], [dead])
    assert [(fault.id, fault.channel) for fault in found.repaired] == [(DEAD, "v")]
    assert found.tests[0].v is None and found.unseen[0].v is None


def test_a_channel_that_is_stuck_for_a_while_stops_at_a_level() -> None:
    record = motion(9)
    stuck = np.clip(record.F, -1.0, 1.0)
    assert examined([replace(record, F=stuck)], []).stopped == {"F": 1.0}
    assert SATURATION not in {fault.id for fault in examined([record], []).faults}


def test_agreement_is_a_t_test() -> None:
    """Of a thousand draws of noise about one in a thousand agrees by chance; three standard errors of four do not."""
    rng = np.random.default_rng(10)
    alarms = sum(agreed(rng.standard_normal(6), np.ones(6)).agrees for _ in range(2000))
    assert alarms <= 8  # 2 are expected; more than 8 come once in 4000
    assert not agreed(np.array([1.0, 1.1, -0.4, 1.0]), np.ones(4)).agrees
    assert not agreed(np.array([1.0]), np.ones(1)).agrees


def test_a_clipped_channel_that_rests_at_zero_stops_at_a_level() -> None:
    """A sensor at rest repeats its zero more often than a clipped one its last value."""
    record = motion(3, noise=1e-9)
    x = np.round(record.channel("x"), 9)
    level = 0.7 * float(np.max(np.abs(x)))
    rest = np.zeros(2000)
    resting = {name: np.concatenate([rest, getattr(record, name)]) for name in "Fva"}
    t = record.t[1] * np.arange(len(x) + len(rest))
    clipped = replace(record, t=t, x=np.concatenate([rest, np.clip(x, -level, level)]), **resting)
    assert [(f.id, f.channel) for f in stopped([clipped])] == [(SATURATION, "x")]
    assert stopped([replace(clipped, x=np.concatenate([rest, x]))]) == ()


@pytest.mark.parametrize("cut", [None, 0.72])
@pytest.mark.parametrize(("snr", "frequency"), [(80, 18.0), (80, 30.0), (100, 30.0)])
def test_harmonics_of_dry_friction_are_no_noise_that_channels_share(
    snr: int, frequency: float, cut: float | None
) -> None:
    """A steady tone over a contact that slips has lines far up; sensors of their own show all of them alike."""
    n, dt, rng = 7400, 1 / 1800, np.random.default_rng(0)
    t = dt * np.arange(n)
    F = 0.5 * np.sin(2 * np.pi * frequency * t) * np.minimum(4 * t, 1)
    rig, values = CompiledModel(compile_model("HystId.Oscillators.Jenkins")), {"m": 0.3, "B": 2.0, "Kl": 6.4e3}
    y = rig.simulate({"F": F}, dt, parameters={**values, "Ks": 3e3, "fc": 0.3}, outputs=("x", "v", "a"))
    if cut is not None:
        level = cut * float(np.max(np.abs(y["x"])))
        y["x"] = np.clip(y["x"], -level, level)  # noise of the recorder lies on the level
    noisy = {name: u + 10 ** (-snr / 20) * np.std(u) * rng.standard_normal(n) for name, u in {"F": F, **y}.items()}
    assert measured_alike([Recording("test", t, **noisy)])[0].measured == ("x", "v", "a")


def broadband(snr: float | None, seed: int) -> Recording:
    """A mass on a spring under a force of all frequencies: its motion stands above quiet noise everywhere."""
    rng = np.random.default_rng(seed)
    n, dt = 6000, 1e-3
    omega = 2 * np.pi * np.arange(1, n // 2) / (n * dt)
    line = rng.standard_normal(len(omega)) * np.exp(2j * np.pi * rng.uniform(size=len(omega)))
    line /= 1 + (omega / (2 * np.pi * 350)) ** 16  # anti-aliasing
    spectra = {k: line / (4e4 - 2.5 * omega**2 + 30j * omega) * (1j * omega) ** k for k in range(3)}
    x, v, a = (np.fft.irfft(np.concatenate([[0], spectra[k], [0]])) for k in range(3))
    level = 0.0 if snr is None else 10 ** (-snr / 20)
    held = {name: u + level * np.std(u) * rng.standard_normal(n) for name, u in (("x", x), ("v", v), ("a", a))}
    return Recording(f"blows{seed}", np.arange(n) * dt, F=np.ones(n), **held)


@pytest.mark.parametrize("snr", [60.0, 80.0, 100.0, None])
def test_quiet_sensors_of_a_broad_motion_are_all_measured(snr: float | None) -> None:
    """Motion is coherent at all frequencies, as shared noise would be; it falls with frequency, noise does not."""
    for found in measured_alike([broadband(snr, seed) for seed in (1, 2, 3)]):
        assert found.measured == ("x", "v", "a")


@pytest.mark.parametrize("snr", [40.0, 60.0, 80.0])
def test_what_was_derived_from_a_filtered_channel_is_computed(snr: float) -> None:
    def made(test: Recording) -> Recording:
        x = sosfiltfilt(butter(3, 0.35, output="sos"), test.x)
        v = np.gradient(x, 1e-3)
        return replace(test, v=v, a=np.gradient(v, 1e-3))

    # motion of the lower tenth of the spectrum, as of a shaker: above it lies noise alone
    tests = [motion(seed, noise=10 ** (-snr / 20)) for seed in (1, 2)]
    for found in measured_alike([made(test) for test in tests]):
        assert found.measured == ("x",)


def test_a_filter_that_one_recording_shows_is_in_those_where_the_motion_hides_it() -> None:
    """A low-pass at 0.35 of the Nyquist frequency shows where the motion ends below it, and not where it reaches it:
    read off what is beyond, the noise there would be nothing."""
    low_pass = butter(4, 0.35, output="sos")
    shows, hides = (replace(motion(seed, noise=1e-3), v=None, a=None) for seed in (1, 2))
    broad = np.cumsum(np.random.default_rng(3).standard_normal(N)) * np.hanning(N)
    hides = replace(hides, x=broad)
    tests = [replace(test, x=sosfiltfilt(low_pass, test.x)) for test in (shows, hides)]
    # noise is white up to 0.35 of the Nyquist frequency: one sample in three keeps what lies below
    assert [len(test) // len(kept) for test, kept in zip(tests, where_white(tests), strict=True)] == [3, 3]
    open_end = replace(motion(4, noise=1e-3), v=None, a=None)  # its own noise is the end of its spectrum
    assert [len(kept) for kept in where_white([tests[0], open_end])] == [N, N]


@pytest.mark.parametrize("noise", [1e-3, 0.0])
def test_a_force_that_was_low_passed_with_its_motion_is_no_simulation(noise: float) -> None:
    """Nothing is left above the filter: all channels looked free of noise. In a simulation they are, and the motion
    ends as steeply there; but it does in the force and in the motion alike."""
    low_pass = butter(4, 0.3, output="sos")
    exact, sound = motion(4, noise=0.0), motion(4, noise=noise)
    force = 2 * exact.channel("a") + 400 * exact.channel("x")
    force = force + noise * np.std(force) * np.random.default_rng(5).standard_normal(N)
    columns = {"F": force, "a": sound.channel("a")}
    saved = Recording("saved", sound.t, **{name: sosfiltfilt(low_pass, values) for name, values in columns.items()})
    (kept,) = where_white([saved])
    assert len(kept) == (N // 4 if noise else N)  # run both ways, the filter takes 3 dB at 0.27 of the Nyquist rate


def test_a_sum_of_an_acceleration_is_computed_and_an_integral_measured() -> None:
    test = motion(3, noise=1e-4)
    v = cumulative_trapezoid(test.a, dx=DT, initial=0.0)
    (found,) = measured_alike([replace(test, v=v - np.mean(v), x=None)])
    assert found.measured == ("a",)
    (found,) = measured_alike([replace(test, x=None)])
    assert found.measured == ("v", "a")
