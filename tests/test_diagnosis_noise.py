"""What noise is taken for: its level, the floor of a fit, colour, and channels that do not show the whole motion."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import convolve1d
from scipy.signal import butter, lfilter, savgol_coeffs, savgol_filter, sosfiltfilt

from hystid.compiled import CompiledModel
from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.fit.case import pose
from hystid.diagnosis.fit.problem import standing
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take
from hystid.diagnosis.prepare.segments import prepare_part, prepare_parts
from hystid.modelica import compile_model
from hystid.recording import Recording, read_all
from hystid.smoothing.noise import filtered_beyond, noise_error, noise_level
from hystid.smoothing.smoother import smooth
from tests.test_diagnosis import JENKINS, LINEAR, case, run, spec
from tests.test_diagnosis_windows import DAMPING, FS, MASS, STIFFNESS, posed

CONTACT = "HystId.Oscillators.Jenkins"


@pytest.mark.parametrize("n", [2000, 8000])
def test_noise_level_has_no_bias(n: int) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(n) * 1e-3
    signal = np.sin(40 * t) + 0.3 * np.sin(170 * t + 1)
    found = [noise_level(signal + 0.02 * rng.standard_normal(n)) ** 2 for _ in range(60)]
    # One estimate of the variance scatters by 4 % (8,000 samples) to 9 % (2,000); the mean of 60 by an eighth of that.
    assert np.mean(found) == pytest.approx(0.02**2, rel=0.03)


@pytest.mark.parametrize("n", [250, 800, 2500])
def test_the_level_of_short_noise_is_known_as_well_as_it_is_said(n: int) -> None:
    rng, t = np.random.default_rng(2), np.arange(n)
    signal = np.sin(2 * np.pi * t / 60 + 1) + 0.3 * np.sin(2 * np.pi * t / 35)
    found = np.array([noise_level(signal + 0.02 * rng.standard_normal(n)) ** 2 for _ in range(400)]) / 0.02**2
    # 0.2: 400 estimates tell their scatter to 4 %, and two motions differ. The mean is off by a third of it at most.
    assert np.std(found) == pytest.approx(noise_error(n), rel=0.2)
    assert abs(np.mean(found) - 1) < noise_error(n) / 3


def decimated(values: np.ndarray, corner: float) -> np.ndarray:
    """What a digital filter of a recorder leaves of white noise; corner in cycles per sample."""
    return np.asarray(sosfiltfilt(butter(5, 2 * corner, output="sos"), values))


@pytest.mark.parametrize(("corner", "n"), [(0.12, 16000), (0.2, 12000), (0.33, 4000), (0.38, 4000), (0.43, 4000)])
@pytest.mark.parametrize("step", [0.0, 5e-4])
def test_noise_is_read_before_the_filter_that_ends_it(corner: float, n: int, step: float) -> None:
    rng, t = np.random.default_rng(1), np.arange(n) * 1e-3
    found = []
    for _ in range(20):
        channel = np.sin(40 * t) + 0.3 * np.sin(170 * t + 1) + 0.02 * decimated(rng.standard_normal(len(t)), corner)
        found.append(noise_level(np.round(channel / step) * step if step else channel, [np.zeros(len(t))]))
    # The corner may take a tenth of the power of the last band of three, and chance a tenth in 300 lines.
    assert np.median(found) == pytest.approx(0.02, rel=0.1) and np.min(found) > 0.8 * 0.02


@pytest.mark.parametrize(("corner", "n"), [(0.4, 200), (0.4, 324), (0.3, 324)])
def test_noise_of_a_short_recording_is_read_before_its_filter(corner: float, n: int) -> None:
    rng, t = np.random.default_rng(0), np.arange(n)
    motion = np.sin(2 * np.pi * t / 60 + 1) + 0.3 * np.sin(2 * np.pi * t / 35)
    noise = [0.01 * decimated(rng.standard_normal(n + 200), corner)[100:-100] for _ in range(30)]
    found = [noise_level(motion + one) for one in noise]
    # 0.3: ten lines of a spectrum tell a power to 30 %; three bands are compared, and a filter takes from the last.
    assert np.median(found) == pytest.approx(0.01, rel=0.3)
    assert np.mean([filtered_beyond(motion + 0.01 * rng.standard_normal(n)).end < 0.5 for _ in range(30)]) < 0.05


def test_noise_that_is_loud_beside_a_motion_is_read_before_the_filter_as_well() -> None:
    """As of a test at a low level: 9 dB below the motion, and not shared with the force, which is as loud as ever."""
    rng, t = np.random.default_rng(3), np.arange(6000) * 1e-3
    motion, band = np.sin(2 * np.pi * 27 * t), decimated(rng.standard_normal(len(t)), 0.34)
    channel, force = motion + 0.25 * band, motion + 0.01 * decimated(rng.standard_normal(len(t)), 0.34)
    assert noise_level(channel, [force]) == pytest.approx(0.25, rel=0.1)  # as above
    # A force that is as loud at all frequencies may be one: nothing else shows it where noise hides what it moves.
    assert noise_level(channel, [force], drives=True) < 0.01
    assert noise_level(channel, []) < 0.01


def test_loud_noise_of_a_force_is_read_before_a_filter_that_another_recording_shows() -> None:
    """A test at a tenth of the level: its force has 11 dB of noise, which alone may be a force that is loud at all
    frequencies. Behind the filter it was read 500 times too small."""
    rng, t = np.random.default_rng(6), np.arange(6000) * 1e-3
    motion, runs = np.sin(2 * np.pi * 5 * t), []
    for name, size in (("loud", 1.0), ("low", 0.1)):
        noise = [decimated(rng.standard_normal(len(t)), 0.37) for _ in range(2)]
        runs.append(Recording(name, t, F=size * motion + 0.02 * noise[0], x=size * motion + 0.002 * noise[1]))
    for part in prepare_parts(runs):
        assert part.noise["F"] == pytest.approx(0.02, rel=0.1)  # as above


@pytest.mark.parametrize("hidden_by", ["tail", "burst"])
def test_noise_is_read_before_a_filter_that_another_recording_shows(hidden_by: str) -> None:
    """One recorder filters a channel in all recordings; in the second one the motion hides where its noise ends."""
    rng, t = np.random.default_rng(4), np.arange(6000) * 1e-3
    slow, white = np.sin(2 * np.pi * 5 * t), rng.standard_normal(len(t))
    hiding = lfilter(*butter(4, 0.25), white) if hidden_by == "tail" else 0.2 * white * ((t > 2.0) & (t < 4.0))
    runs = []
    for name, motion in (("shows", slow), ("hides", slow + hiding)):
        noise = [decimated(rng.standard_normal(len(t)), 0.37) for _ in range(2)]
        runs.append(Recording(name, t, F=3.0 * motion + 0.06 * noise[0], x=motion + 0.02 * noise[1]))
    shown, hidden = prepare_parts(runs)
    alone = prepare_part(runs[1])
    levels = {"F": 0.06, "x": 0.02}
    assert min(alone.noise[name] / level for name, level in levels.items()) < 0.5  # what is left behind the filter
    for name, level in levels.items():
        assert shown.noise[name] == pytest.approx(level, rel=0.1)  # as above
        assert 0.8 * level < hidden.noise[name] < 2.5 * level  # some of the motion counts as noise
    assert hidden.noise_ends == shown.noise_ends < 0.4


@pytest.mark.parametrize("what", ["shaker", "knocks", "friction", "resonance"])
@pytest.mark.parametrize("corner", [0.12, 0.38])
def test_a_motion_that_ends_steeply_is_no_noise_before_a_filter(what: str, corner: float) -> None:
    rng, t = np.random.default_rng(2), np.arange(6000) * 1e-3
    band = decimated(rng.standard_normal(len(t)), corner)
    slow = np.sin(2 * np.pi * 5 * t)
    channel = {
        "shaker": band,
        "knocks": slow + 0.3 * decimated(np.where(rng.random(len(t)) < 0.01, 1.0, 0.0), corner),
        "friction": slow + decimated(0.3 * np.sign(np.cos(2 * np.pi * 4.7 * t)), corner),
        "resonance": lfilter([1.0], np.poly(0.995 * np.exp([0.3j, -0.3j])).real, band),
    }[what]
    found = noise_level(channel + 1e-3 * rng.standard_normal(len(t)), [band])
    assert found == pytest.approx(1e-3, rel=0.2)


KERNELS = [
    np.ones(3) / 3,
    np.ones(16) / 16,
    np.hanning(9)[1:-1] / 4,
    savgol_coeffs(7, 2),
    savgol_coeffs(21, 3),
    savgol_coeffs(15, 4),
]


@pytest.mark.parametrize("kernel", KERNELS, ids=["mean of 3", "mean of 16", "Hann of 7", "7, 2", "21, 3", "15, 4"])
def test_noise_is_read_before_what_a_user_smoothed(kernel: np.ndarray) -> None:
    """A moving mean, or a filter of Savitzky and Golay: its noise has no edge, but nulls."""
    rng, t, levels = np.random.default_rng(7), np.arange(5000) * 1e-3, []
    for _ in range(40):
        channel = np.sin(40 * t) + 0.3 * np.sin(170 * t + 1) + 0.02 * rng.standard_normal(len(t))
        smoothed = convolve1d(channel, kernel)
        if (found := filtered_beyond(smoothed).kernel) is None:
            continue
        assert found == pytest.approx(kernel, abs=1e-12)
        levels.append(noise_level(smoothed))
    # Noise is not as loud all the time by chance in one case of a hundred; three of forty are one in ten tests of one.
    assert len(levels) >= 37
    # A thousand lines that a window makes alike in pairs: 3 % of one level, and half of a percent of the mean.
    assert np.mean(levels) == pytest.approx(0.02, rel=0.02)


def test_what_nobody_smoothed_has_no_kernel() -> None:
    rng, t = np.random.default_rng(8), np.arange(5000) * 1e-3
    slow, white = np.sin(2 * np.pi * 5 * t), [rng.standard_normal(len(t)) for _ in range(40)]
    for noise in white:
        assert filtered_beyond(slow + 0.02 * noise).kernel is None
        assert filtered_beyond(slow + 0.02 * decimated(noise, 0.3)).kernel is None
        assert (
            filtered_beyond(np.cumsum(np.cumsum(noise)) + 1e-3 * noise).kernel is None
        )  # what a mass makes of a force
    # A force that was smoothed, and is nothing but that, is one: noise is a small part of a channel.
    assert filtered_beyond(convolve1d(white[0], np.ones(5) / 5), drives=True).kernel is None
    assert filtered_beyond(slow).kernel is None
    assert filtered_beyond(np.zeros(5000)).kernel is None


@pytest.mark.parametrize(
    ("name", "kernel"), [("Linear", savgol_coeffs(21, 3)), ("Jenkins", np.ones(5) / 5)], ids=["linear", "contact"]
)
def test_what_a_user_smoothed_is_compared_with_a_force_that_is_smoothed_alike(name: str, kernel: np.ndarray) -> None:
    """A sound rig by a smoothed displacement: blows hold more above what is left of the motion than noise does."""
    model, rng = CompiledModel(compile_model(f"HystId.Oscillators.{name}")), np.random.default_rng(0)
    values = {"m": 1.0, "B": 5.0, "Kl": 2e4, **({} if name == "Linear" else {"Ks": 2e4, "fc": 3.0})}
    t, tests = np.arange(5000) * 1e-3, []
    for place in ("one", "other"):
        blows = zip(rng.uniform(13, 25, 6), rng.uniform(0.2, 4.7, 6), strict=True)
        F = np.sum([size * np.exp(-(((t - at) / 0.006) ** 2)) for size, at in blows], axis=0)
        x = model.simulate({"F": F}, 1e-3, parameters=values, outputs=("x",), interpolation="cubic")["x"]
        noisy = [u + share * np.std(u) * rng.standard_normal(5000) for u, share in ((F, 0.003), (x, 0.02))]
        tests.append(Recording(place, t, F=noisy[0], x=convolve1d(noisy[1], kernel)))
    found = diagnose(tests, model=f"HystId.Oscillators.{name}", parameters={**values, "B": 4.5})
    assert found.verdict in ("consistent", "recalibrated")
    assert any(f"x was smoothed over {len(kernel)} samples" in n and "so F is smoothed alike" in n for n in found.notes)
    assert found.choice is not None
    # Some 600 to 2,000 rows: 4 to 6 % of what noise leaves, and the level of either channel is known to 3 %.
    assert found.choice.before.chi2 == pytest.approx(found.choice.floor_before, rel=0.25)


@pytest.mark.parametrize(("family", "variant", "seed"), [(LINEAR, "standard", 71), (JENKINS, "x_and_F", 72)])
def test_the_floor_is_what_a_healthy_refit_leaves(tmp_path: Path, family: str, variant: str, seed: int) -> None:
    place, _ = case(tmp_path, spec("null", (), family, variant), seed)
    choice = run(place).choice
    assert choice is not None
    # 0.06: three standard deviations of the noise levels that both sides of the comparison rest on.
    assert choice.before.chi2 == pytest.approx(choice.floor_before, abs=0.06)


@pytest.mark.parametrize("names", ["x", "xv"])
@pytest.mark.parametrize(
    ("motion", "force", "tones"), [(34, 60, (17.0, 26.3)), (40, 80, (8.0, 16.0)), (30, 46, (12.0, 40.0))]
)
def test_noise_of_the_displacement_is_no_physics_however_quiet_the_force(
    names: str, motion: float, force: float, tones: tuple[float, float]
) -> None:
    """The stiffness turns noise of the displacement into a force, far above the noise of a good load cell."""
    t, rng = np.arange(6000) * 1e-3, np.random.default_rng(9)
    omega = 2 * np.pi * np.array(tones)[:, None]
    swings = 1e-3 * np.array([[1.0], [0.6]]) * np.exp(1j * (omega * t + [[0.0], [1.0]]))
    x, v, a = (np.sum((1j * omega) ** order * swings, axis=0).imag for order in range(3))
    exact = {"F": 2.0 * a + 20.0 * v + 5e4 * x, "x": x, "v": v}
    level = {"F": 10 ** (-force / 20), "x": 10 ** (-motion / 20), "v": 10 ** (-motion / 20)}
    noisy = {n: exact[n] + level[n] * np.std(exact[n]) * rng.standard_normal(len(t)) for n in ["F", *names]}
    given = {"m": 2.0, "B": 15.0, "Kl": 4.8e4}
    found = diagnose([Recording("two tones", t, **noisy)], model="HystId.Oscillators.Linear", parameters=given)
    assert found.findings == () and found.verdict == "recalibrated"
    # What is told as noise is what a sound rig leaves; three draws of noise in a narrow band scatter by a tenth.
    assert found.noise_floor == pytest.approx(found.force_nrmse[1], rel=0.3)
    assert found.noise_floor <= found.force_nrmse[1]  # no noise is louder than what is left


@pytest.mark.parametrize("seed", [3, 12, 15, 55])
def test_noise_of_the_displacement_in_a_slow_test_is_no_mass(seed: int) -> None:
    """A spring and a damper, nothing of which has a mass: smoothed noise of x is in the force, and in its own second
    derivative, with opposite signs."""
    rng, t = np.random.default_rng(seed), np.arange(600) * 0.02
    x = 1e-3 * np.sin(2 * np.pi * t / 1.4) * (0.3 + 0.7 * t / t[-1])
    force = 5e4 * x + 1500 * np.gradient(x, t)
    force += 10 ** (-67 / 20) * np.std(force) * rng.standard_normal(len(t))
    slow = Recording("slow", t, F=force, x=x + 10 ** (-38 / 20) * np.std(x) * rng.standard_normal(len(t)))
    answer = diagnose(slow, model="HystId.Oscillators.Linear", parameters={"m": 0.0, "B": 1400.0, "Kl": 5.2e4})
    assert answer.verdict in ("consistent", "recalibrated")


def test_coloured_noise_is_no_mismatch(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("decoy", ("coloured_noise",), LINEAR), 73)
    found = run(place)
    assert found.verdict in ("consistent", "recalibrated")
    assert found.choice is not None and found.choice.before.chi2 > 5  # far above the level that white noise would have


def test_a_gain_of_the_force_channel_is_in_the_free_run(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("single", ("force_gain",), LINEAR), 74)
    found = run(place)
    assert [finding.effect for finding in found.findings] == ["force_gain"]
    before, after = found.holdout[0].free_run
    assert before is not None and after is not None and after < before


def test_without_x_the_displacement_does_not_drift_away() -> None:
    rng = np.random.default_rng(2)
    dt = 1e-3
    t = np.arange(8000) * dt
    x, v = np.sin(60 * t), 60 * np.cos(60 * t)
    noise = 0.02 * float(np.std(v))
    found = smooth({"v": v + noise * rng.standard_normal(len(v))}, {"v": noise}, dt)
    # Integrated noise would walk by noise sqrt(dt T) = 0.08 of the amplitude, and more by its start. At either end the
    # displacement needs a second to be known.
    assert float(np.std((found.x - x)[1500:-1500])) < 0.02


def test_contact_loss_is_found_from_velocity_alone(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("single", ("contact_loss",), LINEAR), 75)
    found = only(place, "v")
    assert "contact_loss" in {name for finding in found.findings for name in finding.alike}


def test_slow_motion_that_the_acceleration_hides_is_said(tmp_path: Path) -> None:
    t = np.arange(6000) * 1e-3
    rng = np.random.default_rng(3)
    x = 1e-3 * np.sin(2 * np.pi * 0.5 * t) + 1e-6 * np.sin(2 * np.pi * 40 * t)
    a = -((2 * np.pi * 0.5) ** 2) * 1e-3 * np.sin(2 * np.pi * 0.5 * t) - (80 * np.pi) ** 2 * 1e-6 * np.sin(
        80 * np.pi * t
    )
    force = a + 1e4 * x + 1e-2 * rng.standard_normal(len(t))
    hidden = Recording("slow", t, F=force, a=a + 0.02 * rng.standard_normal(len(t)))
    found = diagnose([hidden], model="HystId.Oscillators.Jenkins", parameters={"m": 1.0})
    assert found.verdict == "not_applicable"
    assert "hides the motion" in found.headline and "record x or v" in found.headline


def without(recording: Recording, channels: set[str]) -> Recording:
    return replace(recording, **dict.fromkeys(channels))  # type: ignore[arg-type]  # the keys are channels


def only(place: Path, channel: str) -> Diagnosis:
    handed = json.loads((place / "case.json").read_text())
    recordings, holdout = (
        [without(r, {"x", "v", "a"} - {channel}) for r in read_all([place / n for n in handed[kind]])]
        for kind in ("recordings", "holdout")
    )
    return diagnose(recordings, model=handed["model"], parameters=place / handed["parameters"], holdout=holdout)


def test_an_acceleration_without_noise_knows_slow_motion_no_better_than_integration() -> None:
    # Bursts of a sine, exact to rounding. Integration leaves 5e-4 of the channel; without that limit a sound rig
    # with hysteresis in such a test was off by 300 times the "noise".
    t = np.arange(4000) * 1e-3
    a = np.sin(2 * np.pi * 40 * t) * np.sin(np.pi * 2 * t) ** 8
    for motion in ({"a": a}, {"v": np.cumsum(a) * 1e-3}):
        part = prepare_part(Recording("bursts", t, 2.0 * a, **motion))
        name, values = next(iter(motion.items()))
        assert part.noise[name] >= 4.9e-4 * np.std(values)


@pytest.mark.parametrize("seed", range(3))
def test_noise_shows_no_delay(seed: int) -> None:
    """In a motion of 1 Hz at 1 kHz, a delay of half a sample is 3 mrad, which the velocity's force shows by a share of
    its noise. The sum of squares is then a parabola of the delay. Noise of the force that is moved against that of the
    acceleration would correlate with it by chance, and raise and lower the sum by the square root of twice the number
    of samples, 90."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / FS
    w = 2 * np.pi
    x, v, a = 1e-3 * np.sin(w * t), 1e-3 * w * np.cos(w * t), -1e-3 * w**2 * np.sin(w * t)
    F = MASS * a + DAMPING * v + STIFFNESS * x
    level = 0.05 * np.std(F)
    sizes = {"F": level, "x": level / STIFFNESS, "a": level / MASS}
    channels = {k: u + sizes[k] * rng.standard_normal(len(t)) for k, u in {"F": F, "x": x, "a": a}.items()}
    tests = [Recording("slow", t, **channels)]
    case, _ = posed(tests)
    problem, hypothesis = case.problem, case.refit.hypothesis
    delays = np.linspace(-0.5, 0.5, 9)
    sums = [float(np.sum(standing(problem, replace(hypothesis, delay=d)).residual ** 2)) for d in delays]
    beside = np.array(sums) - np.polynomial.Polynomial.fit(delays, sums, 2)(delays)
    assert np.max(np.abs(beside)) < 0.5  # less than any choice turns on


def test_a_staircase_is_coarse_or_slow_and_no_force_that_is_switched() -> None:
    t, rng = np.arange(4000) / 1000.0, np.random.default_rng(1)
    sine = np.sin(2 * np.pi * 0.7 * t)
    coarse, slow = np.round(20 * sine) / 20, np.repeat(sine[::20], 20)
    assert noise_level(coarse) == pytest.approx(0.05 / np.sqrt(3), rel=0.05)  # a step over the root of three
    assert noise_level(slow) > 0.01
    for switched in (np.where(sine > 0, 1.0, -1.0), 1.0 * (2 * t % 1 < 0.1), np.repeat(rng.standard_normal(20), 200)):
        assert noise_level(switched) < 1e-6  # as in a simulation: its jumps are no errors


def test_the_floor_is_known_better_than_noise_itself_tells() -> None:
    """A contact by a noisy displacement alone: what the noise adds through its jumps is drawn, not calculated."""
    model, rng = CompiledModel(compile_model(CONTACT)), np.random.default_rng(0)
    values = {"m": 1.0, "B": 5.0, "Kl": 2e4, "Ks": 2e4, "fc": 2.0}
    t, tests = np.arange(4000) * 1e-3, []
    for name in ("one", "other"):
        blows = zip(rng.uniform(13, 25, 6), rng.uniform(0.2, 3.7, 6), strict=True)
        F = np.sum([size * np.exp(-(((t - at) / 0.004) ** 2)) for size, at in blows], axis=0)
        x = model.simulate({"F": F}, 1e-3, parameters=values, outputs=("x",), interpolation="cubic")["x"]
        noisy = {
            k: u + share * np.std(u) * rng.standard_normal(4000) for k, u, share in (("F", F, 0.04), ("x", x, 0.1))
        }
        tests.append(Recording(name, t, **noisy))
    case = pose(take(tests, (), given_parameters(values)), CONTACT)
    floors = []
    for seed in range(0, 80, 10):
        problem = case.problem.of(prepare_parts(tests, seed))
        floors.append(Criterion(problem, standing(problem, case.refit.hypothesis), 1).floor)
    rows = problem.reduce.count
    assert np.std(floors, ddof=1) < 0.8 * np.sqrt(2 / rows)  # half is asked for, eight scatter by 25 %


def test_channels_that_were_computed_count_for_nothing_in_a_free_decay() -> None:
    """A noise-free simulation whose v and a a user took by a filter, which loses the blows. A decay is cut in pieces,
    to which noise is added: that must not hide where the channels come from."""
    m, damping, stiffness, stop, gap, t = 0.3, 0.77, 312.0, 43.0, 2.25e-4, np.arange(3000) / 430
    tests = []
    for name, start, size in (("hammer", 0.0, 1.2), ("decay", 1e-3, 0.0)):

        def force(at: float, size: float = size) -> float:
            return size * sum(np.exp(-(((at - blow) / 0.006) ** 2)) for blow in (0.3, 2.6, 4.4))

        def moved(at: float, state: np.ndarray) -> list[float]:
            x, v = state
            return [v, (force(at) - damping * v - stiffness * x - stop * (x - np.clip(x, -gap, gap))) / m]

        x = solve_ivp(moved, (0, t[-1]), [start, 0], t_eval=t, rtol=1e-9, atol=1e-13, max_step=0.002).y[0]
        v, a = (savgol_filter(x, 11, 3, deriv=order, delta=1 / 430) for order in (1, 2))
        tests.append(Recording(name, t, F=np.array([force(at) for at in t]), x=x, v=v, a=a))
    found = diagnose(tests, model="HystId.Oscillators.Linear", parameters={"m": m, "B": 0.8, "Kl": 300.0})
    (finding,) = found.findings
    assert finding.effect in ("backlash", "two_sided_stop")
    assert finding.parameters["gap"].value == pytest.approx(gap, rel=0.02)  # of the deck's noise-free cases


@pytest.mark.parametrize(("force", "place"), [(0.05, 1e-5), (0.02, 2e-5)])
def test_what_is_far_louder_than_a_channel_shows_is_no_noise(force: float, place: float) -> None:
    """A force that turns with the place, finer than any table of the motion: it knows neither x nor v as far as a table
    tells, and is 60 % of the force."""
    rng, t = np.random.default_rng(5), np.arange(6000) * 1e-3
    omega = 2 * np.pi * np.array([[2.1], [5.3]])
    swings = np.array([[4e-3], [1.5e-3]]) * np.exp(1j * (omega * t + np.array([[0.0], [1.0]])))
    x, v = np.sum(swings, axis=0).imag, np.sum(1j * omega * swings, axis=0).imag
    F = 3000 * v + 1e4 * x + 40 * np.tanh(v / 1e-3) + 200 * np.sin(1e4 * x)
    test = Recording("r", t, F=F + force * rng.standard_normal(6000), x=x + place * rng.standard_normal(6000))
    found = diagnose(test, model="HystId.Oscillators.Linear", parameters={"m": 0.0, "B": 2500.0, "Kl": 9000.0})
    assert found.verdict == "unknown_physics"


def test_what_stands_still_at_its_limit_is_no_quiet_noise() -> None:
    """An accelerometer that is cut off for most of the time while a resonance is passed."""
    rate, n, sigma, most = 1000.0, 6000, 0.1, 10.0
    t, rng = np.arange(n) / rate, np.random.default_rng(0)
    omega = 2 * np.pi * 8.0
    waves = np.exp(1j * omega * t) * (5 + 145 * np.exp(-((t - 3.0) ** 2)))
    a, v, x = (np.real(waves / (1j * omega) ** k) for k in range(3))
    noisy = {name: u + s * rng.standard_normal(n) for name, u, s in (("x", x, 1e-4), ("v", v, 1e-3), ("a", a, sigma))}
    recording = Recording("cut", t, F=2 * a + 1e4 * x, **{**noisy, "a": np.clip(noisy["a"], -most, most)})
    part = prepare_part(recording, stopped={"a": most})
    assert part.noise["a"] == pytest.approx(sigma, rel=0.1)  # four standard errors of the median of 1,000 differences
    assert "a" not in part.louder
