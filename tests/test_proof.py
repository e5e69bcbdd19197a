"""The generator of proof cases: its integrator and laws against closed forms, energy, and another solver; its files."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import invariance
from benchmarks import real_answers as real
from benchmarks.proof.cases import KINDS, make, write
from benchmarks.proof.chain import Chain, levels, noise, record, with_own_noise
from benchmarks.proof.effects import PHYSICS, draw
from benchmarks.proof.excitation import FORCES, force
from benchmarks.proof.motion import BASELINE, Term, drive, follow
from benchmarks.proof.rig import MODELS, draw_rig
from benchmarks.proof.score import calibration, grade, wilson
from benchmarks.proof.strangers import STRANGERS

pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None, reason="the generator of proof cases needs a C compiler 'cc'"
)

KL, M, B = 1e4, 1.0, 2.0
LINEAR = (Term("power", (KL, 1, 1, 0, 0), BASELINE), Term("drag", (B, 1, 1, 0), BASELINE))


def half_grid(n: int, h: float) -> np.ndarray:
    return np.arange(2 * n + 1) * h / 2


def swept(t: np.ndarray, level: float) -> np.ndarray:
    return level * np.sin(2 * np.pi * (5 * t + 10 * t**2))


def test_linear_motion_converges_with_order_four() -> None:
    """Against a solver with error control; the error falls by about 16 with half the step."""
    T, errors = 1.0, []
    exact = solve_ivp(lambda t, y: [y[1], (swept(t, 10.0) - KL * y[0] - B * y[1]) / M], (0, T), [0, 0],
                      method="DOP853", rtol=1e-12, atol=1e-15).y[0, -1]  # fmt: skip
    for n in (2000, 4000):
        h = T / n
        errors.append(abs(drive(LINEAR, M, h, swept(half_grid(n, h), 10.0)).x[-1] - exact))
    assert 12 < errors[0] / errors[1] < 20


def test_coulomb_friction_decays_by_the_textbook_step() -> None:
    """Free decay under dry friction alone: each half cycle loses 2 Fc/Kl, then the mass sticks within Fc/Kl."""
    Fc, x0, n, h = 5.0, 4.3e-3, 8000, 1e-4
    friction = Term("friction", (Fc, 0, 1, 0, 0, 0, 0, 0, 0))
    motion = drive((LINEAR[0], friction), M, h, np.zeros(2 * n + 1), (x0, 0.0))
    turns = [x0 - 2 * k * Fc / KL for k in range(5)]
    peaks = np.abs(motion.x[np.r_[0, 1 + np.flatnonzero(np.diff(np.sign(np.diff(motion.x))))]])
    # The peak falls between two samples: there x differs from it by less than w^2 x h^2/8 = 1e-9.
    assert np.allclose(np.sort(peaks)[::-1][:4], turns[:4], atol=2e-8)
    assert motion.v[-1] == 0
    assert abs(motion.x[-1]) <= Fc / KL


@pytest.mark.parametrize("name", [*PHYSICS, *STRANGERS])
def test_half_the_step_gives_the_same_motion(name: str) -> None:
    """Each law on a rig, at the step of the decks and at half of it: less than 1e-3 of the motion's rms apart.

    The smallest noise of a deck with noise is 1e-5, but its laws have corners: there the error is that of the step in
    which a corner lies, and what matters is that the recording obeys its law, which holds at every stored sample.
    """
    rng = np.random.default_rng(11)
    rig = draw_rig("Jenkins", rng)
    scale = rig.scale(30 / rig.f0, 3 * rig.f0)
    law = STRANGERS[name](scale, rng) if name in STRANGERS else draw(name, scale, rng)
    n, h = 30 * 80 * 8, 1 / (80 * rig.f0 * 8)
    wave = force("chirp", half_grid(2 * n, h / 2), rig.f0, 3 * rig.f0, rng) * 0.1 * rig.parameters["Kl"] * rig.X
    big = 0.03 * (
        1 if law.most == 1.0 or name in ("added_mass", "hidden_mode", "lever", "energy_sink") else rig.parameters["Kl"]
    )
    if name in ("preload", "cogging", "late_friction") or "friction" in name:
        big *= rig.X
    if name == "quadratic_damping" or name in ("displacement_dependent_damping", "suction"):
        big = 0.3 * rig.parameters["B"]
    motions = []
    for steps, dt, grid in ((n, h, wave[::2]), (2 * n, h / 2, wave)):
        t = half_grid(steps, dt)
        motions.append(drive((*rig.terms(), *law.at(big, t, 0)), rig.mass, dt, grid))
    assert np.sqrt(np.mean(motions[0].f ** 2)) > 0
    error = np.sqrt(np.mean((motions[0].x - motions[1].x[::2]) ** 2) / np.mean(motions[1].x ** 2))
    assert error < 1e-3


@pytest.mark.parametrize("model", MODELS)
def test_energy_of_the_baseline_balances(model: str) -> None:
    """Work of the force = stored energy + work of R in a closed account; the hysteretic force never gives energy."""
    rng = np.random.default_rng(5)
    rig = draw_rig(model, rng)
    n, h = 20000, 1 / (800 * rig.f0)
    t = half_grid(n, h)
    w = 2 * np.pi * rig.f0
    motion = follow(
        rig.terms(), rig.mass, h, rig.X * np.sin(w * t), rig.X * w * np.cos(w * t), -rig.X * w**2 * np.sin(w * t)
    )
    work = np.trapezoid(motion.F * motion.v, motion.t)
    kinetic = 0.5 * rig.mass * (motion.v[-1] ** 2 - motion.v[0] ** 2)
    taken = np.trapezoid(motion.R * motion.v, motion.t)
    # The trapezoidal rule meets jumps of the friction-like force: 2 % of the work at 800 samples a period.
    assert work == pytest.approx(kinetic + taken, rel=0.02)
    if model != "Linear":
        assert np.trapezoid(motion.h * motion.v, motion.t) > 0


LOSSY = (
    "coulomb_friction stribeck_friction asymmetric_friction hysteretic_friction position_dependent_friction "
    "quadratic_damping impact viscoelastic_relaxation displacement_dependent_damping"
)


@pytest.mark.parametrize("effect", LOSSY.split())
def test_dissipative_laws_take_energy_in_closed_cycles(effect: str) -> None:
    """Over the later cycles of a harmonic motion the work of each lossy law is positive, for every drawn form."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        rig = draw_rig("Linear", rng)
        law = draw(effect, rig.scale(10 / rig.f0, 3 * rig.f0), rng)
        t = half_grid(16000, 1 / (1600 * rig.f0))
        w = 2 * np.pi * rig.f0
        x, v, a = rig.X * np.sin(w * t), rig.X * w * np.cos(w * t), -rig.X * w**2 * np.sin(w * t)
        motion = follow(law.at(1.0, t, 0), 0.0, 2 * (t[1] - t[0]), x, v, a)
        last = slice(5 * 1600, 9 * 1600 + 1)
        assert np.trapezoid(motion.f[last] * motion.v[last], motion.t[last]) > 0, (seed, law.form)


def test_sliders_remember_their_turning_points() -> None:
    """Return-point memory: a small inner loop leaves the force as it was when the motion passes its start again."""
    x = np.concatenate([np.linspace(0, 3, 301), np.linspace(3, 1.5, 151)[1:], np.linspace(1.5, 3, 151)[1:]])
    table = tuple((1.0, limit) for limit in (0.2, 0.5, 1.0, 2.0))
    fine = np.interp(np.arange(2 * 600 + 1) / 2, np.arange(601), x)
    motion = follow((Term("sliders", (1.0,), table=table),), 0.0, 1.0, fine, np.gradient(fine), np.zeros_like(fine))
    assert motion.f[600] == pytest.approx(motion.f[300], rel=1e-12)  # the same sums of the same numbers
    assert motion.f[450] < motion.f[300]


@pytest.mark.parametrize("kind", FORCES)
def test_excitation_has_peak_one_and_ends_in_its_band(kind: str) -> None:
    """Little power above the band: at three times its top less than 1 % of the power (a hammer's pulse rings on)."""
    t = np.arange(40000) / 4000.0
    wave = force(kind, t, 20.0, 60.0, np.random.default_rng(2))
    assert np.max(np.abs(wave)) == pytest.approx(1.0)
    power = np.abs(np.fft.rfft(wave)) ** 2
    f = np.fft.rfftfreq(len(t), 1 / 4000.0)
    assert power[f > 180].sum() < 0.01 * power.sum()


def test_noise_has_its_level_and_colour() -> None:
    """White has rms 1 and a flat spectrum; pink holds more power in its lowest tenth than in the highest half."""
    rng = np.random.default_rng(0)
    white, pink = noise(200_000, 0.0, rng), noise(200_000, 1.0, rng)
    assert np.std(white) == pytest.approx(1, abs=0.01)  # 1/sqrt(2 n) = 0.0016, six times that
    assert np.std(pink) == pytest.approx(1, abs=0.01)
    power = np.abs(np.fft.rfft(pink)) ** 2
    assert power[:10_000].sum() > power[50_000:].sum()
    filtered = np.abs(np.fft.rfft(noise(200_000, 0.0, rng, decimated=0.3))) ** 2
    assert filtered[:50_000].mean() > 1e4 * filtered[90_000:].mean()


def test_each_sensor_may_have_a_noise_of_its_own() -> None:
    n, h = 4000, 1e-4
    motion = drive(LINEAR, M, h, swept(half_grid(n, h), 10.0))
    chain = with_own_noise(Chain("laboratory", 34.0), np.random.default_rng(3))
    columns, clean = record(motion, 2, chain, levels([motion]), np.random.default_rng(0))
    for c in chain.channels:
        expected = 10 ** (-(34.0 + chain.quieter[c]) / 20) * np.sqrt(np.mean(getattr(motion, c) ** 2))
        assert np.std(columns[c] - clean[c]) == pytest.approx(expected, rel=0.1)  # 1/sqrt(2 n) = 0.016


def test_recorder_without_faults_gives_the_samples_back() -> None:
    """No noise, no bits, no filter: the file holds the motion itself."""
    n, h = 4000, 1e-4
    motion = drive(LINEAR, M, h, swept(half_grid(n, h), 10.0))
    columns, clean = record(motion, 8, Chain("bench", None), levels([motion]), np.random.default_rng(0))
    for c in "Fxva":
        assert np.array_equal(columns[c], getattr(motion, c)[::8])
        assert np.array_equal(clean[c], columns[c])


@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_the_same_twice_and_its_truth_stays_apart(kind: str, tmp_path: Path) -> None:
    """Deterministic by seed; the files of the user do not hold the answer."""
    first = make(kind, 90, 1)
    if kind == "null":  # a case of this kind is quick to draw
        second = make(kind, 90, 1)
        assert first.truth == second.truth
        assert all(np.array_equal(a[c], b[c]) for a, b in zip(first.training, second.training, strict=True) for c in a)
    at = write(first, tmp_path)
    told = json.loads((at / "question.json").read_text())
    assert set(told) == {"model", "parameters"}
    assert len(list(at.glob("train_*.csv"))) == len(first.training)
    for fact in first.truth["concealed"]:
        assert 0.01 <= fact["share_after_refit"] <= fact["share_of_R"] * 1.01 or kind == "sensor_and_physics"
    if kind == "single":
        assert len(first.truth["expect"]["names"]) == 1


def answer(verdict: str, *findings: tuple[str, list[str], float]) -> dict[str, object]:
    return {"case": "c", "answer": {"verdict": verdict, "findings": [
        {"effect": e, "class": c, "confidence": p, "parameters": {}} for e, c, p in findings]}}  # fmt: skip


def truth(kind: str, verdicts: list[str], *names: tuple[str, list[str]]) -> dict[str, object]:
    named = [{"effect": e, "class": c, "parameters": {}} for e, c in names]
    return {
        "case": "c",
        "kind": kind,
        "expect": {"verdicts": verdicts, "names": named, "allowed": ["preload"]},
        "oracle": [],
    }


def test_grades() -> None:
    """Right by name, right by class, a wrong name, an allowed one, an alarm on a null, and friction plus offset."""
    stop = truth("single", ["missing_physics"], ("two_sided_stop", ["two_sided_stop", "backlash"]))
    exact = grade(stop, answer("missing_physics", ("two_sided_stop", [], 0.9)))
    assert exact.right_class and exact.right_name and exact.rated == ((0.9, True),)
    near = grade(stop, answer("missing_physics", ("backlash", ["backlash"], 0.9), ("preload", [], 0.8)))
    assert near.right_class and not near.right_name and not near.wrong
    wrong = grade(stop, answer("missing_physics", ("cubic_stiffness", ["cubic_stiffness"], 0.7)))
    assert not wrong.right_class and wrong.wrong == ("cubic_stiffness",) and wrong.rated == ((0.7, False),)
    null = truth("null", ["consistent", "recalibrated"])
    assert not grade(null, answer("recalibrated")).alarm
    assert grade(null, answer("unknown_physics")).alarm
    both = truth(
        "single", ["missing_physics"], ("asymmetric_friction", ["asymmetric_friction", "coulomb_friction+preload"])
    )
    pair = grade(both, answer("missing_physics", ("coulomb_friction", [], 0.9), ("preload", [], 0.9)))
    assert pair.right_class and not pair.right_name


def test_calibration_error_and_interval() -> None:
    """Nine of ten right at 0.9 is no error; all right at 0.9 is 0.1. Wilson's interval of 10 of 10 begins at 0.72."""
    assert calibration([(0.9, k > 0) for k in range(10)])[0] == pytest.approx(0, abs=1e-12)
    assert calibration([(0.9, True)] * 10)[0] == pytest.approx(0.1)
    assert wilson(10, 10)[0] == pytest.approx(0.722, abs=0.001)


DATA = Path(__file__).parents[2] / "shared" / "data"


def test_real_cases_name_ids_of_the_library_and_judge_as_said() -> None:
    """Each name in an answer key is an id; the judgement follows the text of the module."""
    ids = {*PHYSICS, "channel_delay", "force_gain", "force_drift", "sensor_saturation"}
    known = list(real.cases())
    assert len({case.name for case in known}) == len(known)
    for case in known:
        assert {*case.known.near, *case.known.open, *(e for group in case.known.effects for e in group)} <= ids
    key = real.Known((("hysteretic_friction",), ("pinching",)), near=("coulomb_friction",), open=("preload",))

    def judged(verdict: str, *names: str) -> str:
        return real.judge(key, answer(verdict, *((name, [name], 0.5) for name in names)))[0]

    assert judged("missing_physics", "hysteretic_friction", "pinching", "preload") == "right"
    assert judged("missing_physics", "coulomb_friction") == "right class"
    assert judged("missing_physics", "hysteretic_friction", "cubic_stiffness") == "wrong"
    assert judged("unknown_physics") == "abstained"
    assert judged("consistent") == "missed"


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of other laboratories are not beside this checkout")
def test_real_cases_lay_out_their_files(tmp_path: Path) -> None:
    """Halves, reversed and renamed columns as asked; what the user does not hand in is not there."""
    named = {case.name: case for case in real.cases()}
    real.lay_out(named["emps, second half"], DATA, tmp_path / "half")
    real.lay_out(named["emps, F reversed"], DATA, tmp_path / "reversed")
    half, whole = (
        np.genfromtxt(tmp_path / d / "train_1.csv", delimiter=",", skip_header=1) for d in ("half", "reversed")
    )
    assert len(half) == len(whole) - len(whole) // 2
    assert np.allclose(half[:, 1], -whole[len(whole) // 2 :, 1])
    real.lay_out(named["ring-down, F absent"], DATA, tmp_path / "decay")
    assert (tmp_path / "decay" / "train_1.csv").read_text().startswith("t [s],x [m]\n")


@pytest.mark.parametrize(
    "change", ["time times 10", "time over 20", "force times 1000", "length times 0.01", "mirrored"]
)
def test_changes_keep_the_equation_of_motion(change: str) -> None:
    """A linear rig without noise obeys m a + B v + Kl x = F with the changed parameters, to the digits of the sum."""
    case = make("null", 2, 0, model="Linear", snr=None, channels="Fxva")
    exact = dict(case.truth["true_baseline"])
    asked = invariance.CHANGES[change](invariance.Asked(case.training, [], exact), case, np.random.default_rng(0))
    p = asked.parameters
    for data in asked.training:
        error = p["m"] * data["a"] + p["B"] * data["v"] + p["Kl"] * data["x"] - data["F"]
        # A recorder of 24 bits, where there is one, rounds each channel to 1.5e-7 of its range.
        assert np.max(np.abs(error)) < 2e-6 * np.max(np.abs(p["m"] * data["a"]))


def test_every_change_gives_files_of_a_user(tmp_path: Path) -> None:
    """More than 25 changes; each leaves recordings with a force and a motion, and units that the header says."""
    case = make("null", 2, 1, snr=45.0, channels="Fxva", holdout="all")
    assert len(invariance.CHANGES) >= 25
    for name, change in invariance.CHANGES.items():
        given = change(invariance.Asked(case.training[:1], [], dict(case.parameters)), case, np.random.default_rng(0))
        short = [{c: y[:50] for c, y in data.items()} for data in given.training]
        invariance.lay_out(
            replace(given, training=short, holdout=[]), case.model, tmp_path / name.replace("/", " per ")
        )
        header = (tmp_path / name.replace("/", " per ") / "train_1.csv").read_text().splitlines()[0]
        assert "F [" in header and header.startswith("t [s]")
        assert len(given.holdout) == name.startswith("held out")
    assert "x [mm]" in (tmp_path / "mm and kN" / "train_1.csv").read_text()
