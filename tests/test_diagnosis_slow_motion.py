"""Sound rigs in slow motion, and what a contact remembers from before: nothing is missing, and nothing is named."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.fit.case import pose, scales_of
from hystid.diagnosis.fit.hypothesis import Hypothesis
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.baseline import baseline_of
from hystid.diagnosis.model.freerun import error
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take
from hystid.diagnosis.prepare.reduction import Reduction
from hystid.diagnosis.prepare.rest import resting
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.modelica import compile_model
from hystid.recording import Recording
from tests.test_diagnosis_noise import decimated

Array = NDArray[np.float64]
PECORARI, JENKINS = "HystId.Oscillators.PecorariSolodov", "HystId.Oscillators.Jenkins"
RIG = {"m": 2.0, "B": 20.0, "Kl": 5e4}
CONTACT = {"Ks": 4e4, "x0": 1.2e-4, "x1": 6e-5}
CALM = ("consistent", "recalibrated")
N, DT = 5000, 1e-3


def by_hand(seed: int, *, top: float = 1.2, size: float = 5e-5) -> tuple[Array, Array, Array, Array]:
    """Time, and x, v, a of a slow motion that fills its recording: no frequency below it is left, (n,) each."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    omega, phase = 2 * np.pi * rng.uniform(0.2, top, 6), rng.uniform(0, 2 * np.pi, 6)
    x, v, a = (
        size / 2 * np.sum(omega[:, None] ** k * np.cos(omega[:, None] * t + phase[:, None] + k * np.pi / 2), axis=0)
        for k in range(3)
    )
    return t, x, v, a


def pink(rng: np.random.Generator, corner: float, n: int = N) -> Array:
    """Noise whose power is white above the corner frequency [Hz] and 1/f below, (n,), white part of variance 1."""
    frequency = np.maximum(np.fft.rfftfreq(n, DT), 1 / (n * DT))
    return np.asarray(np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * np.sqrt(1 + corner / frequency), n))


def jumping(x: Array, v: Array) -> Array:
    """Pecorari and Solodov (2006), the force that jumps with the sign of the velocity [N]."""
    s, half = np.sign(v), 0.5 * (CONTACT["x0"] - CONTACT["x1"])
    return np.asarray(CONTACT["Ks"] * s * (half - np.maximum(-s * x - CONTACT["x1"], 0.0)))


def seen(name: str, t: Array, F: Array, motion: dict[str, Array], level: float, corner: float, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    noisy = {key: u + level * np.std(u) * pink(rng, corner) for key, u in {"F": F, **motion}.items()}
    return Recording(name, t, **noisy)


@pytest.mark.parametrize("channels", ["x", "xva"])
def test_a_jump_whose_side_noise_decides_is_no_mismatch(channels: str) -> None:
    # 34 dB: near each turn of the slow motion the velocity is nothing but noise for tens of samples.
    recordings = []
    for seed in (1, 2):
        t, x, v, a = by_hand(seed)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + jumping(x, v)
        motion = {key: u for key, u in {"x": x, "v": v, "a": a}.items() if key in channels}
        recordings.append(seen(f"hand_{seed}", t, F, motion, 0.02, 0.0, seed))
    found = diagnose(recordings, model=PECORARI, parameters={**RIG, **CONTACT})
    assert found.verdict in CALM and not found.findings
    known = re.search(r"in (\d+) % of the samples; in the others the motion is not known well enough", found.headline)
    assert known and int(known[1]) == round(100 * np.mean(found.problem.reduce.sure()))


def in_lulls(seed: int) -> tuple[Array, Array, Array]:
    """x, v, a of strokes to and fro with rests between them, (n,) each."""
    rng = np.random.default_rng(seed)
    x, v, a, at, here, side = np.zeros(N), np.zeros(N), np.zeros(N), 0, 0.0, 1.0
    while at < N:
        n, rest, top = int(rng.integers(60, 200)), int(rng.integers(40, 250)), side * rng.uniform(5e-4, 1e-3)
        k = np.arange(min(n, N - at))
        x[at:] = here + top * n * DT / 2
        x[at : at + n] = here + top * DT * (k / 2 - n / (4 * np.pi) * np.sin(2 * np.pi * k / n))
        v[at : at + n] = top * np.sin(np.pi * k / n) ** 2
        a[at : at + n] = top * np.pi / (n * DT) * np.sin(2 * np.pi * k / n)
        at, here, side = at + n + rest, here + top * n * DT / 2, -side
    return x, v, a


def test_a_contact_that_rests_holds_any_force_between_its_branches() -> None:
    # A velocity that noise has brought two or three standard errors from zero is one of a contact at rest all the same:
    # any other one in the range of the motion is far less likely. Then the force is off by half of the jump at most.
    x, v, a = in_lulls(1)
    F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x
    part = prepare_part(seen("lulls", np.arange(N) * DT, F, {"x": x, "v": v, "a": a}, 0.02, 0.0, 1))
    law = {"Ks": 4e4, "x0": 4e-4, "x1": 3e-4, "v_turn": 1e-6}  # |x| < x1, so that the jump is Ks (x0 - x1)
    baseline = baseline_of(PECORARI, compile_model(PECORARI), {**RIG, **law})
    problem = Problem([part], baseline, scales_of([part], baseline))
    assert problem.distrust(Hypothesis(dict(baseline.nominal)))
    taken, size = problem.reduce.trusted(0), np.abs(part.v) / part.velocity_error()
    far = (v == 0) & (size > 2) & (size < 3) & (taken > 0)
    half = 0.5 * law["Ks"] * (law["x0"] - law["x1"]) / part.balance_noise(RIG["m"])
    assert np.count_nonzero(far) > 20
    assert np.all(taken[far] * half <= 1)


@pytest.mark.parametrize(("level", "falls"), [(0.02, 0.0), (0.005, 0.8)])
def test_dry_friction_that_holds_a_structure_at_rest_is_named(level: float, falls: float) -> None:
    # At rest the force drifts from that of sliding to any other within the friction: no law of the motion says which.
    recordings, top, slow = [], 8.0, 1e-4
    for seed in (1, 2):
        x, v, a = in_lulls(seed)
        t, still = np.arange(N) * DT, np.flatnonzero(v == 0)
        friction = top * (1 + falls * np.exp(-((v / slow) ** 2))) * np.sign(v)
        for rest in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1):
            last = friction[rest[0] - 1]  # of the sample before; the end of the recording, which slides, at its start
            friction[rest] = np.linspace(last, np.random.default_rng(rest[0]).uniform(-top, top), len(rest))
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + friction
        recordings.append(seen(f"lulls_{seed}", t, F, {"x": x, "v": v, "a": a}, level, 0.0, seed))
    found = diagnose(recordings, model="HystId.Oscillators.Linear", parameters=RIG)
    assert [one.effect for one in found.findings] == ["stribeck_friction" if falls else "coulomb_friction"]
    told = found.findings[0].parameters
    assert told["Fc"].value == pytest.approx(top, rel=0.01)  # a law led by the rests was off by a third
    if falls:
        assert told["Fd"].value == pytest.approx(falls * top, rel=0.02)  # it shows below 1e-4 m/s only


@pytest.mark.parametrize("one_sign", [True, False])
def test_what_errors_of_a_law_leave_in_filtered_rows_is_known(one_sign: bool) -> None:
    # x alone: the balance is whitened, and what a law does not know at 40 samples is spread over their neighbours.
    t, x, v, a = by_hand(7)
    F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x
    part = prepare_part(seen("x", t, F, {"x": x}, 0.02, 0.0, 7))
    reduce, rng = Reduction([part], RIG["m"]), np.random.default_rng(7)
    open_ = np.where((t > 2.0) & (t <= 2.04), 1.0, 0.0)
    assert not reduce.is_local
    draws = [reduce([open_ * rng.standard_normal(1 if one_sign else N)]) for _ in range(400)]
    scatter = np.sqrt(np.mean(np.square(draws), axis=0))
    # 400 draws of a normal variable: its standard deviation is known to 3.5 %, in one of 5,000 rows to 14 %
    assert np.all(scatter <= 1.15 * reduce.spread([open_]) + 1e-6 * np.max(scatter))


def test_first_samples_that_do_not_count_do_not_reach_the_rows() -> None:
    t, x, v, a = by_hand(7)
    F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x
    part = prepare_part(seen("x", t, F, {"x": x}, 0.02, 0.0, 7))
    reduce = Reduction([replace(part, valid=np.arange(N) >= 400)], RIG["m"])
    assert not reduce.is_local  # a filter that sees thousands of samples
    unknown = np.where(np.arange(N) < 400, 1e3, 1.0)  # as the force of a contact whose past nobody knows
    np.testing.assert_array_equal(reduce([unknown]), reduce([np.ones(N)]))


def test_rows_of_which_a_law_is_not_sure_say_nothing_until_they_hold_more() -> None:
    t, x, v, a = by_hand(8)
    F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x
    reduce = Reduction([prepare_part(seen("x", t, F, {"x": x, "v": v, "a": a}, 0.02, 0.0, 8))], RIG["m"])
    rows = np.random.default_rng(8).standard_normal(len(reduce.sure()))
    doubt = np.where(np.arange(len(rows)) < len(rows) // 2, 30.0, 0.0)
    reduce.distrust([np.zeros(len(rows))], np.zeros(1), doubt)
    sure = reduce.sure()
    left = [np.mean(u**2) - reduce.left_open(u) for u in (np.where(sure, rows, k * rows) for k in (0.3, 0.9, 3.0))]
    assert left[0] == pytest.approx(left[1], rel=1e-12)
    assert left[2] > left[1] + 3.0  # half of the rows hold 9 where 1 is open


def test_noise_of_a_motion_that_fills_its_recording_is_told_by_what_is_above_it() -> None:
    recordings = []
    for seed in (3, 4):
        t, x, v, a = by_hand(seed)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + jumping(x, v)
        recordings.append(seen(f"hand_{seed}", t, F, {"x": x, "v": v, "a": a}, 0.01, 100.0, seed))
    found = diagnose(recordings, model=PECORARI, parameters={**RIG, **CONTACT})
    assert found.verdict in CALM and not found.findings


def test_a_contact_that_slips_later_than_was_believed_remembers_longer() -> None:
    # Jenkins' element: its force follows x with Ks, within fc. It is 1.2 times the believed force, and half as stiff,
    # so it slips after 2.4 times the believed way; until then the force depends on what was before.
    Ks, fc = 2e4, 1.2
    recordings = []
    for seed in (5, 6):
        t, x, v, a = by_hand(seed, size=1e-4)
        x, v, a = x[N // 3 :], v[N // 3 :], a[N // 3 :]
        held, f = np.empty(len(x)), 0.9 * fc
        for i, step in enumerate(np.diff(x, prepend=x[0])):
            held[i] = f = min(max(f + Ks * step, -fc), fc)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + held
        rng = np.random.default_rng(seed)
        noisy = {
            key: u + 1e-3 * np.std(u) * rng.standard_normal(len(u)) for key, u in zip("Fxva", (F, x, v, a), strict=True)
        }
        recordings.append(Recording(f"begun_{seed}", t[: len(x)], **noisy))
    found = diagnose(recordings, model=JENKINS, parameters={**RIG, "Ks": 4e4, "fc": 1.0})
    assert found.verdict in CALM and not found.findings


STIFFENED = """model Stiffened
  extends HystId.Oscillators.Jenkins(f_effects = k3*x^3);
  parameter Real k3(unit = "N/m3") = 0;
end Stiffened;
"""


def accelerometer(rig: CompiledModel, level: float, cubic: float, seed: int, wander: float = 0.0) -> Recording:
    """A slider that yields under a broad random force is pushed from place to place; F and a alone, 34 dB of noise.

    wander: size of noise of the amplifier below 5 Hz, over the acceleration.
    """
    dt, rng = 1 / 1600, np.random.default_rng(seed)
    t = dt * np.arange(6000)
    tones = zip(rng.uniform(2, 60, 80), rng.uniform(0, 6, 80), strict=True)
    F = np.sum([np.sin(2 * np.pi * f * t + phase) for f, phase in tones], axis=0)
    F *= level / np.std(F) * np.sin(np.pi * t / t[-1]) ** 2
    given = {"m": 20.0, "B": 146.0, "Kl": 2.7e5, "Ks": 3.15e5, "fc": 207.0, "k3": cubic}
    a = rig.simulate({"F": F}, dt, parameters=given, outputs=("a",), interpolation="cubic")["a"]
    F, a = (u + 0.02 * np.std(u) * rng.standard_normal(len(t)) for u in (F, a))
    slow = lfilter([1.0], [1.0, -np.exp(-2 * np.pi * 2.0 * dt)], rng.standard_normal(len(t)))
    return Recording(f"quake_{seed}", t, F=F, a=a + wander * np.std(a) / np.std(slow) * slow)


@pytest.mark.parametrize(
    ("level", "cubic", "wander"), [(150.0, 0.0, 0.0), (400.0, 0.0, 0.0), (150.0, 0.0, 0.02), (900.0, 8e10, 0.0)]
)
def test_an_accelerometer_alone_knows_where_a_slider_stands_by_the_force(
    tmp_path: Path, level: float, cubic: float, wander: float
) -> None:
    """Permanent sets are slow, and twice integrated noise of an amplifier drowns them; the measured force tells them by
    the law.

    Without them the law missed by more than its noise, and a sound rig was alarmed. 3 %: a few standard errors of the
    limit force and of the slider's stiffness at 34 dB."""
    (tmp_path / "rig.mo").write_text(STIFFENED)
    rig = CompiledModel(compile_model(f"{tmp_path / 'rig.mo'}:Stiffened"))
    given = {"m": 20.0, "B": 120.0, "Kl": 2.4e5, "Ks": 3.6e5, "fc": 240.0}
    recordings = [accelerometer(rig, level, cubic, seed, wander) for seed in (1, 2)]
    found = diagnose(recordings, model=JENKINS, parameters=given)
    values = found.final_values()
    if cubic:
        assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]
    else:
        told = any("is what the model does under the measured force" in note for note in found.notes)
        assert told == (wander > 0)  # white noise of 34 dB does not hide them
        assert found.findings == ()
        assert found.verdict == "recalibrated"
    assert values["fc"].value == pytest.approx(207.0, rel=0.03)
    assert values["Ks"].value == pytest.approx(3.15e5, rel=0.03)


def test_the_named_law_says_where_a_slider_stands(tmp_path: Path) -> None:
    """With motion from the channels alone the spring comes out 5 % off and a tenth of the motion is missed. 2 %: some
    standard errors of spring and slider; 3 %: the noise of 34 dB, and what it moves over a free run."""
    (tmp_path / "rig.mo").write_text(STIFFENED)
    rig = CompiledModel(compile_model(f"{tmp_path / 'rig.mo'}:Stiffened"))
    given = {"m": 20.0, "B": 120.0, "Kl": 2.4e5, "Ks": 3.6e5, "fc": 240.0}
    tests = [accelerometer(rig, 400.0, 1e11, seed) for seed in (1, 2, 7)]
    found = diagnose(tests[:2], model=JENKINS, parameters=given, holdout=tests[2:])
    assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]
    values = found.final_values()
    assert values["cubic_stiffness.k3"].value == pytest.approx(1e11, rel=0.02)
    assert values["fc"].value == pytest.approx(207.0, rel=0.02)
    (held,) = found.holdout
    assert held.free_run[1] is not None and held.free_run[1] < 0.03
    assert held.force[1] < 0.03


def test_what_moves_slowly_beside_its_noise_is_not_at_rest() -> None:
    t = np.arange(8000) * 0.01
    x = 1e-3 * np.sin(2 * np.pi * 0.11 * t) * np.sin(2 * np.pi * 0.04 * t)
    rng = np.random.default_rng(5)
    still = np.where(t > 40.0, 0.0, x)  # 34 dB: within 32 samples the motion is less than the noise
    parts = [
        prepare_part(Recording("slow", t, F=5e4 * u, x=u + 2e-5 * rng.standard_normal(len(t)))) for u in (x, still)
    ]
    assert np.mean(resting(parts[0])) < 0.05
    assert np.mean(resting(parts[1])[t > 41.0]) > 0.9


@pytest.mark.parametrize(
    ("corner", "decibel"), [(0.32, {"F": 54, "x": 34}), (0.36, {"F": 40, "x": 40}), (0.40, {"F": 30, "x": 57})]
)
def test_noise_that_a_recorder_filters_is_no_physics(corner: float, decibel: dict[str, float]) -> None:
    """Jenkins' element moved by hand. Read behind the filter, the noise would be that of 16 bit, far below."""
    recordings = []
    for seed in (1, 2):
        t, x, v, a = by_hand(seed, size=1e-4)
        held, f = np.empty(len(x)), 0.0
        for i, step in enumerate(np.diff(x, prepend=x[0])):
            held[i] = f = min(max(f + 2e4 * step, -0.6), 0.6)
        exact = {"F": RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + held, "x": x}
        rng, measured = np.random.default_rng(seed), {}
        for name, u in exact.items():
            noise = 10 ** (-decibel[name] / 20) * np.std(u) * decimated(rng.standard_normal(len(u)), corner)
            bit = 2.5 * np.max(np.abs(u)) / 2**16
            measured[name] = np.round((u + noise) / bit) * bit
        recordings.append(Recording(f"hand_{seed}", t, **measured))
    found = diagnose(recordings, model=JENKINS, parameters={**RIG, "Ks": 2.2e4, "fc": 0.55})
    assert found.verdict in CALM and not found.findings


def accelerations(gap: float, stiffness: float, seed: int, corner: float = 0.0) -> Recording:
    """A mass of 1 kg on 10 kN/m that meets a further spring beyond a gap, under 25 lines from 6 to 30 Hz: the force and
    the acceleration alone, with noise of a hundredth, louder as 1/f below a corner [Hz]. The spring pushes the
    structure to its other side, which no acceleration shows. By scipy's DOP853."""
    rng, omega, t = np.random.default_rng(seed), 2 * np.pi * np.linspace(6, 30, 25), np.arange(6000) * DT
    phase = rng.uniform(0, 2 * np.pi, 25)

    def force(time: float | Array) -> Array:
        return np.asarray(12 * np.sum(np.cos(np.multiply.outer(time, omega) + phase), axis=-1))

    def rate(time: float, state: Array) -> list[float]:
        x, v = state
        return [v, float(force(time)) - 6.0 * v - 1e4 * x - stiffness * max(x - gap, 0.0)]

    run = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-8, atol=1e-10, max_step=2e-3)
    F = force(t)
    a = F - 6.0 * run.y[1] - 1e4 * run.y[0] - stiffness * np.maximum(run.y[0] - gap, 0.0)
    noisy = [u + 0.01 * np.std(u) * pink(rng, corner, len(u)) for u in (F, a)]
    return Recording("blind", t, F=noisy[0], a=noisy[1])


@pytest.mark.parametrize(("seed", "corner"), [(1, 100.0), (4, 100.0), (4, 30.0)])
def test_slow_noise_of_an_acceleration_alone_is_no_motion(seed: int, corner: float) -> None:
    """Twice integrated it is larger than the motion, and nearly as quick. Where it was taken for motion, nothing that
    was tried fitted; where it was found, a law that fits shows how loud it is."""
    answer = diagnose(
        accelerations(1.5e-3, 8e3, seed, corner),
        model="HystId.Oscillators.Linear",
        parameters={"m": 1.0, "B": 6.0, "Kl": 1e4},
    )
    (finding,) = answer.findings
    assert finding.effect == "contact_loss"
    assert answer.problem is not None and answer.problem.parts[0].first_Hz == pytest.approx(6.0, rel=0.3)
    assert finding.parameters["gap"].value == pytest.approx(1.5e-3, rel=0.1)
    # The floor was 1.7 to 29 times what a right law left.
    assert answer.force_nrmse[1] == pytest.approx(answer.noise_floor, rel=0.2)


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_the_law_that_is_found_leads_the_motion_that_no_channel_shows(seed: int) -> None:
    """Where the structure stands decides where a spring of one side begins. Without the slow motion that this spring
    itself leads to, the gap was read as 4.5 mm."""
    gap, stiffness = 1.5e-3, 8e3
    answer = diagnose(
        accelerations(gap, stiffness, seed),
        model="HystId.Oscillators.Linear",
        parameters={"m": 1.0, "B": 6.0, "Kl": 1e4},
    )
    (finding,) = answer.findings
    assert finding.effect == "contact_loss"
    assert any("motion below" in note for note in answer.notes)
    for name, truth in (("gap", gap), ("k", stiffness)):
        found = finding.parameters[name]
        assert abs(found.value - truth) < 3 * found.stderr  # one in 400 lies beyond
        assert found.stderr < 0.05 * truth
    # Noise hides no slow motion that the law knows. What is left has a few lines of noise of the motion, each drawn
    # three times. With the noise of slow motion from the acceleration the floor was 1.2 to 2.4 times as high.
    assert answer.force_nrmse[1] == pytest.approx(answer.noise_floor, rel=0.1)


def test_a_free_run_is_judged_by_motion_that_a_channel_shows() -> None:
    """A place that nobody measured is no error of the model, and an error of what was measured still is one."""
    given = given_parameters({"m": 1.0, "B": 6.0, "Kl": 1e4})
    part = pose(take([accelerations(1.5e-3, 8e3, 1)], (), given), "HystId.Oscillators.Linear").problem.parts[0]
    slow = 1e-3 * (1 + np.sin(2 * np.pi * 0.2 * part.t))
    assert part.first_Hz > 0.4
    assert error(part.x + slow, part) == pytest.approx(
        0.0, abs=0.01
    )  # of 1 mm, a hundredth of the motion leaks through
    assert error(1.1 * part.x, part) == pytest.approx(0.1)
