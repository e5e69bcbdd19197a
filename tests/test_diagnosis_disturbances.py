"""Disturbances of the test and faults of the force channel: told as such, and never as physics of the structure.

The motion is made of tones, and the force follows from it by the balance, so that nothing is integrated.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.fit.knocks import Knock, _come_with_motion, _knocks, without_knocks
from hystid.diagnosis.fit.problem import standing
from hystid.diagnosis.prepare.segments import band, prepare_part
from hystid.recording import Recording
from hystid.smoothing.noise import louder_for_a_while
from tests.test_diagnosis_windows import posed, rig

Array = np.ndarray
DT, N = 1e-3, 5000
M, B, K = 1.0, 10.0, 8000.0
CALM = ("consistent", "recalibrated")


def tones(seed: int) -> dict[str, Array]:
    """x, v and a of thirty tones of 4 to 30 Hz."""
    rng = np.random.default_rng(seed)
    omega, phase = 2 * np.pi * rng.uniform(4, 30, 30), rng.uniform(0, 2 * np.pi, 30)
    size = 1e-3 / (1 + (omega / 90) ** 2)
    turn = np.outer(np.arange(N) * DT, omega) + phase
    return {name: np.sin(turn + k * np.pi / 2) @ (size * omega**k) for k, name in enumerate("xva")}


def recorded(motion: dict[str, Array], force: Array, seed: int, snr: float = 50.0, name: str = "test") -> Recording:
    """The channels with white noise."""
    rng = np.random.default_rng(seed)
    share = 10 ** (-snr / 20)
    noisy = {key: u + share * np.std(u) * rng.standard_normal(N) for key, u in {**motion, "F": force}.items()}
    return Recording(name, np.arange(N) * DT, **noisy)


def balance(motion: dict[str, Array]) -> Array:
    return M * motion["a"] + B * motion["v"] + K * motion["x"]


def asked(*recordings: Recording) -> Diagnosis:
    return diagnose(recordings, model="HystId.Oscillators.Linear", parameters={"m": M, "B": 8.0, "Kl": 7000.0})


def test_a_force_channel_that_stops_before_the_noise_is_told_with_its_level() -> None:
    motion = tones(1)
    force = balance(motion)
    level = 0.6 * float(np.max(np.abs(force)))
    noise = 0.02 * float(np.std(force))
    clipped = np.clip(force, -level, level) + noise * np.random.default_rng(2).standard_normal(N)
    found = asked(replace(recorded(motion, force, 3), F=clipped))
    assert found.verdict == "sensor_fault"
    (finding,) = found.findings
    assert finding.effect == "sensor_saturation"
    # The level is a median over the samples beyond it, of which there are dozens: a fifth of the noise.
    assert finding.parameters["level"].value == pytest.approx(level, abs=0.5 * noise)


def test_a_force_that_a_law_holds_is_no_fault_of_the_channel() -> None:
    """A spring that yields holds its own force, and the inertia changes that of the sensor."""
    motion = tones(4)
    spring = K * motion["x"]
    held = 0.5 * float(np.max(np.abs(spring)))
    force = balance(motion) - spring + np.clip(spring, -held, held)
    found = asked(recorded(motion, force, 5))
    assert found.verdict in ("missing_physics", "unknown_physics")
    assert "sensor_saturation" not in {finding.effect for finding in found.findings}


def knocked(force: Array, at: tuple[int, ...], width: int = 12) -> Array:
    """A measured force that lacks short pulses which act on the structure."""
    pulse = np.hanning(width) * 0.5 * float(np.max(np.abs(force)))
    seen = force.copy()
    for first in at:
        seen[first : first + width] -= pulse
    return seen


def test_knocks_that_nobody_measured_are_told_and_left_out() -> None:
    motion = tones(6)
    found = asked(recorded(motion, knocked(balance(motion), (1203, 3017)), 7))
    assert found.verdict in CALM
    (told,) = [note for note in found.notes if "knocks" in note]
    assert "2 knocks" in told


def test_knocks_in_a_motion_that_dies_away_are_left_out() -> None:
    """They lead the refit astray, which is seen in the loud beginning alone: it stands beyond the noise of the quiet
    end for longer than a knock lasts."""
    rng = np.random.default_rng(12)
    rates = 2j * np.pi * rng.uniform(9, 20, 6) - 1.8
    waves = np.exp(np.outer(np.arange(N) * DT, rates) + 2j * np.pi * rng.random(6))
    motion = {name: 1e-3 * (waves @ rates**k).real for k, name in enumerate("xva")}
    found = asked(recorded(motion, knocked(balance(motion), (1503, 2440, 3520)), 7, snr=100.0))
    assert found.verdict in CALM
    assert any("3 knocks" in note for note in found.notes)


def test_knocks_whose_flanks_meet_are_several() -> None:
    """From an acceleration alone slow motion is not known: the filter that leaves it out spreads a knock over periods,
    and two that are two periods apart look like one force that lasts."""
    motion = tones(6)
    force = knocked(balance(motion), (1203, 1283, 3017), width=8)
    found = asked(replace(recorded(motion, force, 7, snr=100.0), x=None, v=None))
    assert found.verdict in CALM
    assert any("3 knocks" in note for note in found.notes)


def test_knocks_that_follow_each_other_are_no_four_witnesses() -> None:
    """A hammer that bounces strikes four times while the swings of a motion are large, or small. Where the time knows
    nothing of the motion, chance takes these for a law in one case of twenty at most: 300 draws of 5 % have more than
    27 of them once in 1,000 times."""
    part = prepare_part(recorded(tones(6), balance(tones(6)), 7))
    rng = np.random.default_rng(11)
    said = 0
    for _ in range(300):
        omega, phase = 2 * np.pi * rng.uniform(19, 22, 12), rng.uniform(0, 2 * np.pi, 12)
        moved = replace(part, x=np.sin(np.outer(part.t, omega) + phase).sum(axis=1))
        begun = int(rng.integers(100, N - 400))
        said += _come_with_motion([(moved, [Knock(at, at + 25) for at in range(begun, begun + 200, 50)])])
    assert said <= 27


def test_a_force_that_lasts_for_some_periods_is_no_row_of_knocks() -> None:
    motion = tones(6)
    part = prepare_part(recorded(motion, balance(motion), 7))
    residual, quick = np.random.default_rng(1).standard_normal(N), band(part)[1]
    for periods in (5, 8, 12):
        lasting = np.arange(int(periods / (quick * DT)))
        residual[1000 : 1000 + len(lasting)] += 100.0 * np.sin(2 * np.pi * 0.5 * quick * DT * lasting)
        assert not _knocks(part, residual, np.ones(N, dtype=bool))


def test_a_few_knocks_stand_out_of_what_a_refit_that_they_mislead_leaves() -> None:
    motion = tones(6)
    part = prepare_part(recorded(motion, balance(motion), 7))
    residual = np.random.default_rng(1).standard_normal(N)
    for first in range(300, 4800, 600):  # more than a recording has of knocks
        residual[first : first + 8] += 20.0
    assert not _knocks(part, residual, np.ones(N, dtype=bool))
    residual[[1000, 1001, 3400, 3401]] += 400.0
    found = _knocks(part, residual, np.ones(N, dtype=bool))
    assert [round(k.first, -2) for k in found] == [1000, 3400]


@pytest.mark.parametrize(("seed", "either"), [(8, False), (26, True)])
def test_a_stop_that_is_met_three_times_is_no_knock(seed: int, either: bool) -> None:
    """It comes with the largest displacements, on one side or on either, and with all of them."""
    motion = tones(seed)
    x = motion["x"]
    way = np.abs(x) if either else x
    tops = np.sort([float(np.max(part)) for part in np.array_split(way, 100)])
    gap = 0.5 * (tops[-4] + tops[-3])
    force = balance(motion) + 60 * K * np.sign(x) * np.maximum(way - gap, 0.0)
    found = asked(recorded(motion, force, 9, snr=60.0))
    assert not [note for note in found.notes if "knock" in note]
    assert found.verdict not in CALM


def test_a_stop_that_is_there_for_a_second_is_no_knock() -> None:
    """All that goes so far in that second meets it, and the motion goes further at other times."""
    motion, t = tones(18), np.arange(N) * DT
    window = (t > 2.0) & (t < 3.0)
    x = motion["x"]
    tops = np.sort([np.max(part) for part in np.split(x[window], np.flatnonzero(np.diff(np.sign(x[window]))) + 1)])
    gap = 0.5 * (tops[-5] + tops[-4])
    assert np.count_nonzero(np.diff((x > gap).astype(int)) > 0) > 10  # of which four are met
    force = balance(motion) + window * 20 * K * np.maximum(x - gap, 0.0)
    found = asked(recorded(motion, force, 19, snr=60.0))
    assert not [note for note in found.notes if "knock" in note]
    assert found.verdict not in CALM


def by_hand(seed: int) -> dict[str, Array]:
    """x, v and a of twelve tones of 0.3 to 1.6 Hz."""
    rng = np.random.default_rng(seed)
    omega, phase = 2 * np.pi * rng.uniform(0.3, 1.6, 12), rng.uniform(0, 2 * np.pi, 12)
    turn = np.outer(np.arange(N) * DT, omega) + phase
    return {name: 1e-3 * np.sum(np.sin(turn + k * np.pi / 2) * omega**k, axis=1) for k, name in enumerate("xva")}


def test_a_play_that_is_there_for_a_second_is_no_knock() -> None:
    """In slow motion its force is short beside the recording, and strikes once; it is no knock as long as a law
    explains all of it."""
    motions, t = [by_hand(seed) for seed in (7, 57, 107)], np.arange(N) * DT
    forces = [balance(motion) for motion in motions]
    gap = 0.3 * float(np.std(motions[0]["x"]))
    forces[0] -= 0.7 * K * np.clip(motions[0]["x"], -gap, gap) * ((t > 2.3) & (t < 3.9))
    tests = [
        replace(recorded(motion, force, seed, snr=34.0, name=f"test_{seed}"), a=None)
        for seed, (motion, force) in enumerate(zip(motions, forces, strict=True), 4)
    ]
    found = asked(*tests)
    assert [finding.effect for finding in found.findings] == ["backlash"]
    assert not [note for note in found.notes if "knock" in note]


def gust(seed: int, share: float) -> Array:
    """White noise that is there for a third of the time."""
    place = np.linspace(0, 1, N)
    return share * np.exp(-(((place - 0.6) / 0.15) ** 2)) * np.random.default_rng(seed).standard_normal(N)


def test_noise_that_is_louder_for_a_while_is_no_physics() -> None:
    motion = tones(10)
    quiet = recorded(motion, balance(motion), 11, snr=70.0)
    columns = {name: np.asarray(getattr(quiet, name)) for name in "Fxva"}
    loud = {name: u + np.std(u) * gust(12 + k, 0.03) for k, (name, u) in enumerate(columns.items())}
    assert asked(replace(quiet, **loud)).verdict in CALM


def test_louder_noise_is_found_with_its_size_and_nothing_else_is_taken_for_it() -> None:
    rng = np.random.default_rng(13)
    x = tones(14)["x"]
    even = 1e-4 * float(np.std(x)) * rng.standard_normal((40, N))
    assert all(louder_for_a_while(x + noise) is None for noise in even)
    found = louder_for_a_while(x + even[0] + float(np.std(x)) * gust(15, 0.01))
    assert found is not None
    level, factor = found
    assert level == pytest.approx(1e-4 * np.std(x), rel=0.15)  # the median of a dozen sections of 15 % each
    assert factor[3000] == pytest.approx(100, rel=0.4)  # a section of 200 samples, in which the level changes
    assert np.all(factor[:1000] == 1.0)
    # friction snaps where the velocity turns, more so where it is fast: shocks, and no noise
    t = np.arange(N) * DT
    envelope = np.exp(-(((t / t[-1] - 0.5) / 0.2) ** 2))
    snaps = envelope * np.sign(np.sin(2 * np.pi * 11 * t)) + 1e-4 * rng.standard_normal(N)
    assert louder_for_a_while(snaps) is None


def test_hum_of_the_force_channel_alone_is_taken_out_with_a_note() -> None:
    motion = tones(16)
    force = balance(motion)
    hum = 0.05 * float(np.std(force)) * np.sin(2 * np.pi * 50 * np.arange(N) * DT + 1)
    found = asked(recorded(motion, force + hum, 17))
    assert found.verdict in CALM
    assert [note for note in found.notes if "mains" in note]


def test_hum_below_half_the_sample_rate_is_taken_out_with_a_note() -> None:
    """50 Hz at 120 samples a second; noise is far below."""
    slow = 1e3 / 120  # times slower than the tones, which reach 3.6 Hz then
    motion = {name: u / slow**k for k, (name, u) in enumerate(tones(16).items())}
    force = M * motion["a"] + B * motion["v"] + K * motion["x"]
    hum = 0.01 * float(np.std(force)) * np.sin(2 * np.pi * 50 * np.arange(N) / 120 + 1)
    test = recorded(motion, force + hum, 17, snr=80.0)
    found = asked(replace(test, t=np.arange(N) / 120))
    assert found.verdict in CALM
    assert [note for note in found.notes if "50 Hz" in note]


def test_a_recording_of_which_no_sample_is_left_has_no_knocks() -> None:
    """It came to rest before the filters had settled."""
    case, _ = posed([rig((0.0, 0.0), 0.0, seed, 1.0) for seed in (1, 2)])
    driven, released = case.problem.parts
    problem = case.problem.of([driven, replace(released, valid=np.zeros(len(released), dtype=bool))])
    assert without_knocks(problem, standing(problem, case.refit.hypothesis)) is None


def dragged_against_stops(seed: int, level: float) -> Recording:
    """A quadratic damper, and two stops that the motion meets a few times in twenty seconds."""
    rng, n, dt = np.random.default_rng(seed), 5000, 4e-3
    mass, damper, spring, gap, drag = 40.0, 10.0, 6317.0, 0.025, 240.0
    t, omega = np.arange(n) * dt, 2 * np.pi * np.linspace(0.8, 4.0, 40)
    phase = rng.uniform(0, 2 * np.pi, 40)

    def force(t: float) -> float:
        return level * float(np.sum(np.cos(omega * t + phase))) * min(t, 1.0)

    def law(x: float, v: float) -> float:
        return damper * v + spring * (x + 5 * (max(x - gap, 0.0) - max(-x - gap, 0.0))) + drag * v * abs(v)

    made = solve_ivp(
        lambda t, y: (y[1], (force(t) - law(*y)) / mass), (0, t[-1]), (0.0, 0.0), t_eval=t,
        rtol=1e-8, atol=1e-9, max_step=0.01,
    )  # fmt: skip
    F = np.array([force(one) for one in t])
    x, v = made.y
    a = (F - np.array([law(*one) for one in made.y.T])) / mass
    channels = {"F": F, "x": x, "v": v, "a": a}
    noisy = {key: u + 10 ** (-44 / 20) * np.std(u) * rng.standard_normal(n) for key, u in channels.items()}
    return Recording(f"rig_{seed}", t, **noisy, origin=dict.fromkeys(noisy, "measured"))


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_a_stop_that_is_met_a_few_times_is_no_knock_beside_another_law(seed: int) -> None:
    """The damper has a name without it, and two or three strikes say little of where they come."""
    recordings = [dragged_against_stops(11, 3.0), dragged_against_stops(seed, 6.0)]
    found = diagnose(recordings, model="HystId.Oscillators.Linear", parameters={"m": 40.0})
    drag, stop = sorted(found.findings, key=lambda finding: "quadratic_damping" not in finding.alike)
    assert drag.effect == "quadratic_damping" and {stop.effect} <= {"two_sided_stop", "backlash"}
    assert not [note for note in found.notes if "knock" in note]
