"""Further inputs and lags end to end: recordings, networks, ONNX Runtime, FMPy, validation; what an unused one says."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import fmpy
import numpy as np
import onnxruntime
import pytest

from benchmarks import attainable
from benchmarks.lm import numpy_networks
from hystid.compiled import CompiledModel
from hystid.errors import RecordingError, UsageError
from hystid.fmu import build
from hystid.identification import identify
from hystid.identification.leftout import LeftOut
from hystid.identification.levels import apart_between_levels, levels_of, with_curves
from hystid.networks import FurtherInput, Lag, Member, Network, Polyline, TwoNetworkModel, evaluation
from hystid.networks import onnx as exchange
from hystid.networks.level import Level
from hystid.networks.trust import Spread, Tail
from hystid.recording import Recording, read, with_column, with_columns, write_csv
from hystid.simulation import simulate
from hystid.surrogate import oscillator_code, surrogate_code
from hystid.validation import validate

RATE = 1000.0
PORTS = (
    FurtherInput("u", "V", "u", Polyline((0.0, 0.5, 2.0), (0.0, 1.4, 2.0))),
    FurtherInput("p", "Pa", "line pressure"),
)
LAGS = (Lag("u", 8e-3), Lag("v", 3e-3))


def network(rng: np.random.Generator, width: int) -> Network:
    sizes = (width, 5, 4, 1)
    layers = tuple((rng.normal(0, 0.6, (o, i)), rng.normal(0, 0.6, o)) for i, o in pairwise(sizes))
    return Network(layers, rng.normal(0, 0.2, width), rng.uniform(0.5, 1.5, width), 0.2, 1.7)


@pytest.fixture(scope="module")
def model() -> TwoNetworkModel:
    rng = np.random.default_rng(4)
    members = tuple(Member(network(rng, 7), network(rng, 7)) for _ in range(3))
    limits = {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "R": (-2.0, 2.0), "u": (0.0, 2.0), "p": (-1.0, 1.0)}
    level = Level(0.3, (0.2, 0.5, -0.1, 0.2, 0.1), 1.0, (0.4, 0.1, 0.2, -0.1), 0.05)
    trust = {"tail": Tail(0.7, 0.2), "spread": Spread(0.1, 1.3, (Polyline((0.0, 1.0, 2.0), (1.0, 3.0, 1.0)), None))}
    return TwoNetworkModel(members, 1.5, RATE, limits, inputs=PORTS, lags=LAGS, level=level, **trust)


@pytest.fixture(scope="module")
def signals() -> dict[str, np.ndarray]:
    t = np.arange(600) / RATE
    v = 0.8 * np.cos(40 * t) + 0.4 * np.sin(110 * t)  # up to 1.2: beyond the range of the training data
    x = np.cumsum(v) / RATE
    return {"x": x, "v": v, "u": np.where(np.sin(25 * t) > 0, 2.0, 0.3), "p": 0.5 * np.sin(9 * t)}


@pytest.fixture(scope="module")
def saved(model: TwoNetworkModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("further")
    exchange.write(model, folder / "surrogate.onnx")
    return folder


def test_numpy_and_the_kernel_agree(model, signals, monkeypatch):
    force = 3 * np.sin(30 * np.arange(600) / RATE)
    inputs = {name: signals[name] for name in ("u", "p")}

    def answers() -> list[np.ndarray]:
        run = model.free_run(force, 1 / RATE, inputs=inputs)
        return [*model.members_response(signals["x"], signals["v"], None, inputs), *run.values()]

    compiled = answers()
    for name in ("response", "free_run"):
        monkeypatch.setattr(evaluation, name, getattr(numpy_networks, name))
    for ours, plain in zip(compiled, answers(), strict=True):  # rounding only, little grown over 600 steps
        np.testing.assert_allclose(ours, plain, rtol=0, atol=1e-9)


def test_chunk_by_chunk_is_the_whole(model, signals):
    inputs = {name: signals[name] for name in ("u", "p")}
    whole, end = model.response(signals["x"], signals["v"], None, inputs)
    state, parts = None, []
    for part in (slice(0, 1), slice(1, 250), slice(250, 600)):
        piece = {name: values[part] for name, values in inputs.items()}
        R, state = model.response(signals["x"][part], signals["v"][part], state, piece)
        parts.append(R)
    assert np.array_equal(np.concatenate(parts), whole) and np.array_equal(state, end)


def test_a_lag_is_the_first_order_law():
    """A step of the source: 1 - exp(-t / time) at the samples, exactly."""
    t = np.arange(50) * 1e-3
    late = Lag("u", 0.01).follow(np.where(t > 0, 1.0, 0.0), 1e-3)
    np.testing.assert_allclose(late[1:], 1 - np.exp(-(t[1:] - 1e-3) / 0.01), atol=1e-14)


def test_onnx_runtime_and_fmpy_give_the_same_force(model, signals, saved):
    inputs = {name: signals[name] for name in ("u", "p")}
    expected, each, _ = model.members_response(signals["x"], signals["v"], None, inputs)
    session = onnxruntime.InferenceSession(str(saved / "surrogate.onnx"))
    assert [port.name for port in session.get_inputs()] == ["x", "v", "u", "p", "state"]
    state, force, spread = model.initial_state()[None], np.empty(600), np.empty(600)
    for k in range(600):
        feed = {name: values[k : k + 1] for name, values in signals.items()} | {"state": state}
        R, width, state = session.run(["R", "R_spread", "state_next"], feed)
        force[k], spread[k] = R[0], width[0]
    expected_spread = model.spread.of(each, list(inputs.values()))
    np.testing.assert_allclose(spread, expected_spread, rtol=0, atol=1e-10)
    at_level = replace(model.spread, between=()).of(each)
    np.testing.assert_allclose(expected_spread / at_level, np.where(signals["u"] == 2.0, 1.0, 1.6), rtol=1e-12)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-10)
    build(surrogate_code(saved / "surrogate.onnx"), saved / "surrogate.fmu")
    described = {v.name: v for v in fmpy.read_model_description(str(saved / "surrogate.fmu")).modelVariables}
    assert described["u"].unit == "V" and "trained from 0 to 2" in described["u"].description
    assert described["u"].causality == "input" and float(described["u"].start) == 1.0
    columns = [("time", float), *((name, float) for name in signals)]
    table = np.array(list(zip(np.arange(600) / RATE, *signals.values(), strict=True)), dtype=columns)
    result = fmpy.simulate_fmu(
        str(saved / "surrogate.fmu"),
        input=table,
        output=["R", "R_spread"],
        output_interval=1 / RATE,
        stop_time=599 / RATE,
    )
    np.testing.assert_allclose(result["R"][1:], expected[: len(result) - 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["R_spread"][1:], spread[: len(result) - 1], rtol=0, atol=1e-9)


def test_the_oscillator_runs_as_the_library_does(model, signals, saved):
    """Both integrate by RK4 with the lags held within a step; differences are rounding."""
    force = 3 * np.sin(30 * np.arange(600) / RATE)
    inputs = {name: signals[name] for name in ("u", "p")}
    start = model.initial_state(0.0, {"v": 0.0, "u": signals["u"][0]})
    expected = model.free_run(force, 1 / RATE, state=start, inputs=inputs)
    block = CompiledModel(oscillator_code(saved / "surrogate.onnx"))
    found = block.simulate({"F": force, **inputs}, 1 / RATE, outputs=("x", "R", "R_spread"))
    for name in ("x", "R"):
        np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-9)
    _, each, _ = model.members_response(expected["x"], expected["v"], start, inputs)
    np.testing.assert_allclose(found["R_spread"], model.spread.of(each, list(inputs.values())), rtol=0, atol=1e-9)


def test_derivatives_of_the_oscillator_to_a_further_input_are_exact(saved):
    """Importers ask for d a / d u: central differences with a step of 1e-6 are good to about 1e-8."""
    described = fmpy.read_model_description
    build(oscillator_code(saved / "surrogate.onnx"), saved / "oscillator.fmu")
    unpacked = fmpy.extract(str(saved / "oscillator.fmu"))
    about = described(unpacked)
    names = {v.name: v.valueReference for v in about.modelVariables}
    fmu = fmpy.fmi2.FMU2Slave(
        guid=about.guid, unzipDirectory=unpacked, modelIdentifier=about.coSimulation.modelIdentifier, instanceName="i"
    )
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([names["v_start"]], [0.3])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    for k in range(3):
        fmu.setReal([names["F"], names["u"]], [1.0, 0.7])
        fmu.doStep(k / RATE, 1 / RATE)

    def acceleration(u: float) -> float:
        fmu.setReal([names["u"]], [u])
        return float(fmu.getReal([names["a"]])[0])

    numeric = (acceleration(0.7 + 1e-6) - acceleration(0.7 - 1e-6)) / 2e-6
    acceleration(0.7)
    exact = fmu.getDirectionalDerivative([names["a"]], [names["u"]], [1.0])[0]
    fmu.terminate()
    fmu.freeInstance()
    assert abs(exact) > 1e-3
    assert exact == pytest.approx(numeric, rel=1e-5, abs=1e-8)


def friction(level: float, seed: int, name: str) -> Recording:
    """Slider with a spring: friction of a given level, regularised, noise of 1 N; F is the restoring force."""
    rng, t = np.random.default_rng(seed), np.arange(3000) * 1e-3
    x = 0.01 * np.sin(2 * np.pi * (2 + 0.3 * seed) * t) + 0.004 * np.sin(2 * np.pi * 5.3 * t)
    v = np.gradient(x, t)
    R = 2e3 * x + level * np.tanh(v / 0.02) + rng.normal(0, 1.0, t.size)
    return Recording(name, t, F=R, x=x, v=v)


@pytest.fixture(scope="module")
def tensions() -> tuple[list[Recording], Recording]:
    """Friction of half the tension: trained at 40 and 120 N, held out at 80 N."""
    made = [with_column(friction(0.5 * n, k, f"{n} N"), "tension", n, "N") for k, n in enumerate((40, 120, 80))]
    return made[:2], made[2]


def test_an_input_carries_to_a_level_between_the_trained_ones(tensions, tmp_path):
    """Without it the friction level is unknown: 20 and 60 N were seen, 40 N is to be predicted (rms of R: 40 N)."""
    used, held = tensions
    common = dict(mass=0.0, layers=(5,), ensemble=4, holdout=[held], seed=2)
    blind, told = identify(used, **common), identify(used, **common, inputs=["tension"], out=tmp_path)
    assert told.comparisons[-1].network.force_nrmse < 0.06 < 0.15 < blind.comparisons[-1].network.force_nrmse
    assert any("--input tension" in note for note in blind.notes)
    assert not any("--input" in note for note in told.notes)
    summary = json.loads((tmp_path / "identification.json").read_text())
    assert summary["inputs"] == [{"name": "tension", "unit": "N", "column": "tension"}]
    assert summary["training_range"]["tension"] == [40.0, 120.0]
    checked = validate(tmp_path / "surrogate.fmu", [held])
    # the FMU is the model: the door derives nothing here, so only rounding lies between
    assert checked.cases[0].force_nrmse == pytest.approx(told.comparisons[-1].network.force_nrmse, rel=0.02)
    far = with_column(replace(held, extra={}, units={}), "tension", 200, "N")
    assert validate(tmp_path / "surrogate.onnx", [far]).cases[0].outside == 1.0
    with pytest.raises(RecordingError, match="needs the input tension"):
        validate(tmp_path / "surrogate.onnx", [replace(held, extra={}, units={})])
    with pytest.raises(RecordingError, match="is in V, but"):
        validate(tmp_path / "surrogate.onnx", [replace(held, units={"tension": "V"})])


def test_the_band_is_as_wide_as_recordings_with_zeros_of_their_own_ask_for():
    """Tests at 40, 80 and 120 N whose force has a zero of its own, +-5 N: at 80 N it is known, between it is not.

    One band for both would be four times too wide at 80 N. Noise: 1 N.
    """

    def test(tension: float, seed: int, zero: float) -> Recording:
        made = with_column(friction(0.5 * tension, seed, f"{tension} N"), "tension", tension, "N")
        return replace(made, F=made.F + zero)

    used = [test(*values) for values in ((40, 0, 5.0), (80, 1, -5.0), (120, 2, 5.0))]
    held = [test(80, 3, -5.0), test(60, 4, 4.0), test(100, 5, -3.0)]
    found = identify(used, mass=0.0, layers=(5,), ensemble=4, holdout=held, inputs=["tension"])
    known, *between = found.comparisons[3:]
    known_spread = np.mean(known.network.spread)
    assert known_spread < 1.64 * np.sqrt(np.mean((known.network.R - known.recording.channel("R")) ** 2))
    for each in (known, *between):
        assert each.network.within(each.recording.channel("R")) > 0.8
    for each in between:
        assert np.mean(each.network.spread) > 2 * known_spread
    (curve,) = found.model.spread.between
    assert curve.at == (40.0, 60.0, 80.0, 100.0, 120.0) and curve.to[::2] == (1.0, 1.0, 1.0)


def test_what_recordings_share_is_told_from_what_is_their_own():
    """A zero of 3 N at 80 N of tension, off the line of 40 and 120 N, and 20 % more friction at 80 N another time.

    Noise is 1 N and friction 40 N; the motions differ, so that a mean loop is only near the force.
    """

    def test(tension: float, seed: int, friction_of: float, zero: float = 0.0) -> Recording:
        made = with_column(friction(friction_of, seed, f"{tension} N"), "tension", tension, "N")
        return replace(made, F=made.F + zero, R=made.F + zero)

    train = [test(40, 0, 20), test(120, 0, 60)]
    assert attainable.zero_gap(train, test(80, 0, 40, 3.0), ["tension"]) == pytest.approx(3.0, abs=0.5)
    known = test(80, 0, 40)
    assert attainable.pass_gap([known], known, ["tension"]) < 2.0
    assert attainable.pass_gap([known], test(80, 0, 48), ["tension"]) == pytest.approx(8.0, abs=2.0)


def test_an_input_that_moves_within_recordings_has_no_gaps_between_levels():
    """Three values, but the tension passes through all of them in every recording."""
    n = 40.0 * (1 + np.arange(3000) // 1000)
    made = [friction(20, k, f"{k}") for k in range(2)]
    made = [replace(r, R=r.F + n * np.tanh(r.v / 0.02), extra={"T": n}, units={"T": "N"}) for r in made]
    judge = LeftOut(made, [FurtherInput("T", "N", "T")], 0)
    assert judge.inflation(())[1] == (None,) and judge.two_levels() == ()


def test_two_levels_of_an_input_say_nothing_of_errors_between_them():
    made = [with_column(friction(20, k, f"{n} N"), "T", n, "N") for k, n in enumerate((40, 120, 80))]
    made = [replace(each, R=each.F) for each in made]
    (told,) = LeftOut(made[:2], [FurtherInput("T", "N", "T")], 0).two_levels()
    assert told.startswith("T stands at two levels, 40 and 120 N: no recording says")
    assert LeftOut(made, [FurtherInput("T", "N", "T")], 0).two_levels() == ()


def test_three_levels_say_how_the_force_goes_on_between_them():
    """Friction of 20, 55 and 60 N at tensions of 40, 60 and 120 N: 60 N stands at 35/40 of the way from 40 to 120 N."""
    made = [
        with_column(friction(f, k, f"{f} N"), "T", n, "N") for k, (n, f) in enumerate(((40, 20), (60, 55), (120, 60)))
    ]
    made = [replace(each, R=each.F) for each in made]
    (port,) = with_curves(made, [FurtherInput("T", "N", "T")])
    assert port.curve is not None and port.curve.at == (40.0, 60.0, 120.0)
    # the width is that of force less a spring; noise of 1 N and the shape near v = 0 move it by a few percent
    assert port.curve.to == pytest.approx((40.0, 40 + 80 * 35 / 40, 120.0), abs=4.0)
    assert port.seen(np.array([0.0, 50.0, 200.0])) == pytest.approx([40.0, (40 + port.curve.to[1]) / 2, 120.0])
    assert with_curves(made[::2], [FurtherInput("T", "N", "T")])[0].curve is None  # two levels: a straight line


def test_a_stiffness_that_grows_with_the_level_is_no_common_spring():
    """Of a spring of 2 kN/m and a joint of 100 / m times the level, the centre has the spring alone.

    Scaled, the joint is then the same at 20 and 60 N. Friction goes with the velocity, which is not quite
    uncorrelated with x in 3 s: a tenth of the joint's stiffness.
    """
    made = [friction(n, k, f"{n} N") for k, n in enumerate((20, 60))]
    x, v = (np.concatenate([getattr(r, name) for r in made]) for name in "xv")
    n = np.repeat([20.0, 60.0], 3000)
    level = Level.of(x, n[None], 2e3 * x + n * (np.tanh(v / 0.02) + 100 * x))
    assert level.slopes[0] == pytest.approx(2e3, abs=400)
    plain = Level.of(x, n[None], 2e3 * x + n * np.tanh(v / 0.02))
    assert plain.slopes[0] == pytest.approx(2e3, abs=400)


def test_levels_are_told_from_a_continuous_input():
    rng = np.random.default_rng(0)
    found = levels_of(np.repeat([1.0, 5.0, 7.0], 50) + rng.normal(0, 0.01, 150))
    assert (
        found is not None
        and np.allclose(found[0], [1, 5, 7], atol=0.01)
        and (found[1] == np.repeat([0, 1, 2], 50)).all()
    )
    assert levels_of(rng.uniform(0, 1, 2000)) is None and levels_of(np.ones(9)) is None


def test_members_that_differ_between_levels_are_told(model):
    """Of three members, the one whose restoring force is another one is the farthest from the median of all."""
    odd = model.members[0]
    other = replace(odd.restoring, output_offset=odd.restoring.output_offset + 1.0)
    ensemble = replace(model, members=(odd, odd, replace(odd, restoring=other)), lags=model.lags)
    made = []
    for k, u in enumerate((0.0, 2.0)):
        base = friction(1.0, k, f"{u} V")
        base = with_column(with_column(replace(base, R=base.F), "u", u, "V"), "line pressure", 0.1, "Pa")
        made.append(base)
    apart = apart_between_levels(ensemble, made)
    assert apart is not None and apart[2] > 0.1 and apart[0] == apart[1] == 0.0


def test_a_late_input_is_found(tensions):
    """The level follows its command with 30 ms; motion and force are otherwise those of a slider."""
    made = []
    for seed in (1, 2):
        base, rng = friction(0.0, seed, f"record {seed}"), np.random.default_rng(seed)
        u = np.repeat(rng.integers(0, 2, 30), 100).astype(float)
        R = base.F + 40 * Lag("u", 0.03).follow(u, base.dt) * np.tanh(base.v / 0.02)
        made.append(replace(base, F=R, extra={"u": u}, units={"u": "V"}))
    result = identify(made[:1], mass=0.0, layers=(6,), ensemble=4, holdout=made[1:], inputs=["u"])
    assert [lag.source for lag in result.model.lags] == ["u"]
    # candidates stand a factor of three apart, so the nearest one lies within a factor of two
    assert 0.015 < result.model.lags[0].time < 0.06
    prompt = identify(made[:1], mass=0.0, layers=(6,), ensemble=4, holdout=made[1:], inputs=["u"], lags=())
    assert result.comparisons[-1].network.force_nrmse < 0.7 * prompt.comparisons[-1].network.force_nrmse


def test_the_force_in_other_units_is_no_cause():
    """A motor's voltage that is the force over a constant would explain all of it, and is not proposed."""
    base = friction(30.0, 1, "rig")
    same = replace(base, extra={"u": base.F / 35.0}, units={"u": "V"})
    result = identify([same], mass=0.0, layers=(2,), ensemble=2, samples=1000)
    assert not any("--input" in note for note in result.notes)


def test_columns_keep_their_unit_in_a_file(tmp_path):
    base = with_column(friction(1.0, 1, "rig"), "p", 3, "bar")
    assert base.units["p"] == "Pa" and base.extra["p"][0] == pytest.approx(3e5)
    write_csv(base, tmp_path / "rig.csv")
    again = read(tmp_path / "rig.csv")
    assert again.units["p"] == "Pa" and np.array_equal(again.extra["p"], base.extra["p"])


def test_values_by_option():
    records = [friction(1.0, k, f"test{k}_20lb" if k < 2 else "test2_80lb") for k in range(3)]
    names, found = with_columns(records, ["T=*20lb:20 lbf", "T=*80lb:80 lbf", "q=1,2.5,3"])
    assert names == ("T", "q")
    assert [r.extra["T"][0] for r in found] == pytest.approx([20 * 4.4482216152605] * 2 + [80 * 4.4482216152605])
    assert [r.extra["q"][0] for r in found] == [1, 2.5, 3] and found[0].units == {"T": "N", "q": "1"}


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["=3"], "write NAME"),
        (["T=fast"], "'fast' is no number with a unit"),
        (["T=1,2"], "2 values for 1 recordings"),
        (["T=*other*:3"], "no recording is called"),
        (["T=3 parsec2x"], "parsec2x"),
        (["T=1", "T=test*:2"], "is in the file already"),
    ],
)
def test_bad_options_get_a_sentence(texts, sentence):
    with pytest.raises(UsageError, match=sentence):
        with_columns([friction(1.0, 1, "test")], texts)


def test_bad_inputs_get_a_sentence():
    base = with_column(friction(1.0, 1, "rig"), "T", 3, "N")
    bad = replace(base, extra={"T": np.where(np.arange(3000) == 7, np.nan, 1.0)})
    for record, names, sentence in (
        (base, ["x"], "channel of every recording"),
        (base, ["q"], "rig has no such column"),
        (base, ["T"], "nothing to learn"),
        (base, ["T", "T"], "given twice"),
        (replace(base, units={}), ["T"], "no known unit"),
    ):
        with pytest.raises(UsageError, match=sentence):
            identify([record], mass=0.0, inputs=names)
    with pytest.raises(RecordingError, match="T is not finite at sample 7"):
        identify([bad], mass=0.0, inputs=["T"])
    with pytest.raises(UsageError, match="a lag of w"):
        identify([base], mass=0.0, lags=[Lag("w", 1.0)])


def test_beyond_its_range_friction_stays_friction():
    """Trained at up to 0.3 m/s and asked at twice the velocity: the level is the same, and no damper adds to it."""
    t = np.arange(4000) * 1e-3
    trained = friction(40.0, 1, "slow")
    x = 0.01 * np.sin(2 * np.pi * 9.2 * t)
    v = np.gradient(x, t)
    fast = Recording("fast", t, F=2e3 * x + 40 * np.tanh(v / 0.02), x=x, v=v)
    result = identify([trained], mass=0.0, layers=(5,), ensemble=4, holdout=[fast], lags=())
    assert np.ptp(fast.v) > 1.7 * np.ptp(trained.v)
    # noise of 1 N makes the slope at the edge uncertain by some 5 N.s/m, 1.5 N at 0.3 m/s beyond: 4 % of rms R
    assert result.comparisons[-1].network.force_nrmse < 0.1
    assert result.model.tail is not None and result.model.tail.damping < 20


def test_a_force_alone_is_not_enough_and_inputs_that_stand_at_their_start_are_noted(saved, tmp_path):
    """The refusal named --input, which had been given."""
    rig = build(oscillator_code(saved / "surrogate.onnx"), tmp_path / "rig.fmu").path
    with pytest.raises(UsageError, match=r"further inputs \(u, line pressure\).* by hystid simulate.* --input u=VALUE"):
        validate(saved / "surrogate.onnx", reference=rig, forces=["harmonic:20Hz@1N,0.1s"])
    answer = simulate(rig, "harmonic:20Hz@1N,0.05s", dt=1 / RATE)
    assert "inputs at their start values: u, p" in answer.notes
