"""The in-process runner against closed forms: order of convergence, instants of events, sensitivities."""

from __future__ import annotations

import numpy as np
import pytest
from fmu_models import bouncing, contact, effect, jenkins, linear, memory, sampled

from benchmarks.closed_forms import integrated
from hystid.compiled import CompiledModel, slopes_of
from hystid.diagnosis.model.library import load_effects
from hystid.errors import NumericalError, UsageError
from hystid.modelica import compile_model

G, E = 9.81, 0.7
LAWS = ("Linear", "Jenkins", "Iwan", "BoucWen", "Dahl", "MicroSlip")
EFFECTS = sorted({effect.class_name.removeprefix("HystId.") for effect in load_effects([])})


def linear_response(t, m=2.0, b=4.0, k=800.0, x0=0.01):
    """Free decay of m x'' + b x' + k x = 0 from x0 at rest."""
    decay, frequency = b / (2 * m), np.sqrt(k / m - (b / (2 * m)) ** 2)
    return x0 * np.exp(-decay * t) * (np.cos(frequency * t) + decay / frequency * np.sin(frequency * t))


def test_free_decay_converges_with_order_four():
    model = CompiledModel(linear())
    errors = []
    for n in (50, 100, 200):
        t = np.linspace(0, 1, n + 1)
        x = model.simulate({}, 1 / n, rows=n + 1, parameters={"x": 0.01}, outputs=["x"])["x"]
        errors.append(np.max(np.abs(x - linear_response(t))))
    orders = np.diff(np.log2(errors)) * -1
    assert np.all(orders > 3.8), orders  # 4, less what the next term of the error still holds at these steps


def test_substeps_are_steps():
    model, n = CompiledModel(linear()), 100
    coarse = model.simulate({}, 0.01, rows=n + 1, parameters={"x": 0.01}, outputs=["x"], substeps=4)["x"]
    fine = model.simulate({}, 0.0025, rows=4 * n + 1, parameters={"x": 0.01}, outputs=["x"])["x"][::4]
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-16)  # the same steps but for the rounding of time


def test_linear_input_is_followed_within_a_step_and_held_input_is_not():
    """F = t on m a + b v + k x = F: the linear input is exact between samples, the held one half a step late."""
    model, dt = CompiledModel(linear()), 0.01
    t = np.arange(101) * dt
    exact = model.simulate({"F": np.arange(1601) * dt / 16}, dt / 16, outputs=["x"])["x"][::16]
    smooth = model.simulate({"F": t}, dt, outputs=["x"])["x"]
    held = model.simulate({"F": t}, dt, outputs=["x"], interpolation="hold")["x"]
    delayed = np.interp(t - dt / 2, t, exact)
    assert np.max(np.abs(smooth - exact)) < 2e-5 * np.max(
        exact
    )  # Runge-Kutta's own: (w dt)^4 / 120 a radian, w dt = 0.2
    assert np.max(np.abs(held - exact)) > 1e-3 * np.max(exact)
    np.testing.assert_allclose(held[10:], delayed[10:], atol=2e-3 * np.max(exact))  # second order of the delay


def test_cubic_input_is_of_order_four():
    t = np.linspace(0, 1, 101)
    error = np.abs(slopes_of(np.sin(5 * t), 0.01) - 5 * np.cos(5 * t))
    assert np.max(error[2:-2]) < 5**5 * 0.01**4 / 30 * 1.01  # leading term of the central difference of order four


def bounces(count):
    """Instants of the first impacts of a mass dropped from 1 m."""
    first = np.sqrt(2 / G)
    return first + np.concatenate([[0.0], np.cumsum([2 * first * E ** (i + 1) for i in range(count - 1)])])


def bouncing_height(t, impacts):
    heights = np.where(t < impacts[0], 1 - G * t**2 / 2, 0.0)
    for i in range(len(impacts) - 1):
        inside = (t >= impacts[i]) & (t < impacts[i + 1])
        tau = t[inside] - impacts[i]
        heights[inside] = G * impacts[0] * E ** (i + 1) * tau - G * tau**2 / 2
    return heights


def test_bouncing_mass_hits_the_floor_when_it_should():
    t = np.arange(2001) * 1e-3
    result = CompiledModel(bouncing()).simulate({}, 1e-3, rows=2001, outputs=["x", "count"])
    impacts = bounces(8)
    # a parabola is exact for Runge-Kutta; the location of an impact is good to 1e-13 of a step of 1e-3 s
    np.testing.assert_allclose(result["x"], bouncing_height(t, impacts), atol=1e-11)
    np.testing.assert_array_equal(result["count"], np.searchsorted(impacts, t, side="right"))


def test_zeno_has_a_name_and_a_time():
    with pytest.raises(NumericalError, match=r"Zeno: events accumulate at t = 2\.5585") as error:
        CompiledModel(bouncing()).simulate({}, 1e-3, rows=3001, outputs=["x"])
    end = np.sqrt(2 / G) * (1 + 2 * E / (1 - E))  # sum of the geometric series
    assert f"{end:.3f}"[:4] in str(error.value)


def contact_period(v=10.0, k=100.0, ks=1e4, gap=0.5):
    """Period of the mass between spring and stop, m = 1: free arc, then an arc on both springs."""
    w, W = np.sqrt(k), np.sqrt(k + ks)
    free = 2 * np.arcsin(gap * w / v) / w + np.pi / w  # from contact left through the far side, to contact, and back
    speed = np.sqrt(v**2 - k * gap**2)
    shift = gap - ks * gap / (k + ks)  # contact begins this far from the stiff spring's centre
    stiff = 2 * (np.pi / 2 - np.arctan(shift * W / speed)) / W
    return free + stiff


def test_stop_contact_has_the_analytic_period():
    dt, n = 1e-4, 20001
    x = CompiledModel(contact()).simulate({}, dt, rows=n, outputs=["x"])["x"]
    upward = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = (upward + x[upward] / (x[upward] - x[upward + 1])) * dt
    # linear interpolation at a zero crossing is of third order there; Runge-Kutta's error is (W dt)^4 / 120 per radian
    np.testing.assert_allclose(np.diff(crossings), contact_period(), rtol=2e-8)


def test_a_stop_that_is_located_does_not_lose_energy():
    y = CompiledModel(contact()).simulate({}, 1e-3, rows=2001, outputs=["x", "v"])
    stop = np.maximum(y["x"] - 0.5, 0.0)
    energy = 0.5 * y["v"] ** 2 + 50 * y["x"] ** 2 + 5000 * stop**2
    np.testing.assert_allclose(energy, 50.0, rtol=2e-6)  # (W dt)^5 / 144 per step in contact, W = 100 rad/s


def test_samples_are_taken_at_their_instants():
    n = 1001
    t = np.arange(n) * 1e-3
    result = CompiledModel(sampled()).simulate({"u": t}, 1e-3, outputs=["count", "u_s"])
    expected = np.floor(t / 0.1 + 1e-9)
    np.testing.assert_array_equal(result["count"], expected + 1)
    np.testing.assert_allclose(result["u_s"], expected * 0.1, atol=1e-12)  # the input at the instant, not at the row


def test_sampled_memory_advances_once_per_row():
    x = np.array([0.0, 1.0, 2.0, 1.0, 0.0, 1.0])
    v = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    R = CompiledModel(memory()).simulate({"x": x, "v": v}, 1.0, outputs=["R"])["R"]
    held = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])  # x at the last reversal; the first sample counts as one
    np.testing.assert_allclose(R, 100 * x + 7 * held, rtol=1e-15)


def test_a_block_is_evaluated_sample_by_sample():
    rng = np.random.default_rng(5)
    x, v = rng.normal(size=(2, 1000))
    result = CompiledModel(effect()).clamp({}, {"x": x, "v": v}, 1e-4, outputs=["f"], sensitivities=["k3", "b2"])
    np.testing.assert_allclose(result["f"], 1e6 * x**3 + 3 * v * np.abs(v), rtol=1e-14)
    np.testing.assert_allclose(result["d f/d k3"], x**3, rtol=1e-14)
    np.testing.assert_allclose(result["d f/d b2"], v * np.abs(v), rtol=1e-14)


@pytest.fixture(scope="module")
def motion():
    """A free run of the Jenkins oscillator: with the measured x and v its force must come back."""
    t = np.arange(5001) * 1e-4
    F = 60 * np.sin(2 * np.pi * 20 * t)
    return F, CompiledModel(jenkins()).simulate({"F": F}, 1e-4, outputs=["x", "v", "z", "R"])


def test_clamped_motion_gives_back_the_inner_state(motion):
    F, run = motion
    clamped = CompiledModel(jenkins()).clamp(
        {"x": run["x"], "v": run["v"]}, {"F": F}, 1e-4, outputs=["x", "v", "z", "R"]
    )
    np.testing.assert_array_equal(clamped["x"], run["x"])
    # z switches between samples; a stage on the other side of the switch costs part of Ks v dt = 2e4 * 0.35 * 1e-4 N
    np.testing.assert_allclose(clamped["z"], run["z"], atol=1e-3)


def test_sensitivities_of_a_smooth_inner_state_match_differences():
    """Linear oscillator with only x given: v is an inner state that follows from F, and forward propagation counts."""
    t = np.arange(2001) * 1e-3
    F = np.sin(20 * t)
    model = CompiledModel(linear())
    x = model.simulate({"F": F}, 1e-3, outputs=["x"])["x"]
    result = model.clamp({"x": x}, {"F": F}, 1e-3, outputs=["R", "v"], sensitivities=["b", "k", "m"])
    for name, value in (("b", 4.0), ("k", 800.0), ("m", 2.0)):
        h = 1e-4 * value
        high, low = (
            model.clamp({"x": x}, {"F": F}, 1e-3, parameters={name: moved}, outputs=["R", "v"])
            for moved in (value + h, value - h)
        )
        for output in ("R", "v"):
            difference = (high[output] - low[output]) / (2 * h)
            scale = np.max(np.abs(difference))
            np.testing.assert_allclose(
                result[f"d {output}/d {name}"], difference, atol=1e-6 * scale
            )  # h^2 of the difference


def test_sensitivities_where_the_state_switches_fall_back_to_whole_runs(motion):
    F, run = motion
    result = CompiledModel(jenkins()).clamp(
        {"x": run["x"], "v": run["v"]}, {"F": F}, 1e-4, outputs=["R"], sensitivities=["fc", "Kl"]
    )
    slips = np.abs(run["z"]) > 20.0
    np.testing.assert_allclose(result["d R/d Kl"], run["x"], atol=1e-9)
    assert np.mean(np.abs(np.abs(result["d R/d fc"][slips]) - 1) < 1e-6) > 0.99  # while it slips R moves with fc


MOTIONS = [(400, 1e-3, 1), (900, 5e-4, 3), (2, 1e-3, 1), (650, 1e-3, 1), (1, 1e-3, 2), (300, 2e-3, 0), (500, 1e-3, 4)]


@pytest.mark.parametrize("law", ["Jenkins", "Iwan", "BoucWen", "LuGre", "Linear"])
def test_several_motions_at_once_are_each_alone_to_the_bit(law: str) -> None:
    """Lanes share nothing: lengths, steps and events of one are nothing to the others."""
    model, motions, alone = CompiledModel(compile_model(f"HystId.Oscillators.{law}")), [], []
    for i, (n, dt, substeps) in enumerate(MOTIONS):
        t = np.arange(n) * dt
        fast = 600 if i == 3 else 71 + i  # rad/s; the third turns every fifth sample, with an event each time
        x = 2e-3 * np.sin(30 * t + i) + 1e-3 * np.sin(fast * t)
        states = {"x": x, "v": 6e-2 * np.cos(30 * t + i) + 1e-3 * fast * np.cos(fast * t)}
        motions.append(model.motion(states, {}, dt, substeps=substeps))
        alone.append(model.clamp(states, {}, dt, outputs=["R", "f_h"], substeps=substeps))
    together = model.follow(motions, {}, ["R", "f_h"])
    for one, other in zip(alone, together, strict=True):
        for name in ("R", "f_h"):
            np.testing.assert_array_equal(other[name], one[name])


@pytest.mark.parametrize("block", [*(f"Oscillators.{law}" for law in LAWS), *EFFECTS])
def test_outputs_of_a_strip_are_those_of_each_row_to_the_bit(block: str) -> None:
    """Outputs alone are computed strip by strip; beside a parameter, which no strip shows, row by row. 300 rows: two
    whole strips and a part of one."""
    model = CompiledModel(compile_model(f"HystId.{block}"))
    t = 2e-3 * np.arange(300)
    given = {
        "x": 3e-3 * np.sin(40 * t) * (1 + t),
        "v": 0.12 * np.cos(40 * t),
        "F": 5 * np.sin(31 * t),
        "a": -5 * np.sin(40 * t),
        "h": 8 * np.sin(40 * t - 0.4),
    }
    code = model.code
    states = {name: given[name] for name in ("x", "v") if name in code.states}
    inputs = {v.name: given[v.name] for v in code.variables if v.causality == "input"}
    outputs = [v.name for v in code.variables if v.causality == "output"]
    parameter = next(v.name for v in code.variables if v.causality == "parameter")
    motion = model.motion(states, inputs, 2e-3)
    (strips,) = model.follow([motion], {}, outputs)
    (rows,) = model.follow([motion], {}, [*outputs, parameter])
    for name in outputs:
        np.testing.assert_array_equal(strips[name], rows[name])


def test_a_lane_that_fails_is_named_and_hinders_none() -> None:
    """Friction that builds up over a path far below that of a step has no finite answer with one step a sample."""
    model = integrated(compile_model("HystId.Effects.HystereticFriction"))
    v = np.cos(np.arange(3000) * 1e-2)
    calm, wild = (model.motion({}, {"v": size * v}, 1e-3) for size in (1e-3, 10.0))
    parameters = {"Fc": 1.0, "x_c": 1e-5}
    with pytest.raises(NumericalError, match="no finite solution") as alone:
        model.follow([wild], parameters, ["f"])
    with pytest.raises(NumericalError) as among:
        model.follow([calm, wild, calm], parameters, ["f"])
    assert str(among.value) == str(alone.value)
    assert np.all(np.abs(model.follow([calm, calm], parameters, ["f"])[1]["f"]) < 1.01)  # Fc


def test_an_event_behind_a_rest_at_zero_is_located(tmp_path) -> None:
    """An indicator that is exactly 0 up to the event, and one that leaves 0 flat: y counts from the event on."""
    source = tmp_path / "rest.mo"
    source.write_text("""model Rest
  Real x(start = 0, fixed = true);
  output Real y(start = 0, fixed = true);
  output Real z(start = 0, fixed = true);
equation
  der(x) = 1;
  der(y) = if max(0, x - 0.0503) > 0 then 1 else 0;
  der(z) = if (x - 0.0307)^3 > 0 then 1 else 0;
end Rest;
""")
    run = CompiledModel(compile_model(f"{source}:Rest")).simulate({}, 0.02, rows=6, outputs=["y", "z"])
    assert abs(run["y"][-1] - 0.0497) < 1e-12  # the bracket is 1e-11 steps wide
    assert abs(run["z"][-1] - 0.0693) < 1e-12


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda m: m.simulate({"G": [1.0]}, 1e-3, outputs=["x"]), "has no variable 'G'"),
        (lambda m: m.simulate({"x": [1.0]}, 1e-3, outputs=["x"]), "'x' is not an input"),
        (lambda m: m.simulate({"F": [1.0, np.nan]}, 1e-3, outputs=["x"]), "nan at sample 1"),
        (lambda m: m.simulate({"F": [[1.0]]}, 1e-3, outputs=["x"]), "shape"),
        (lambda m: m.simulate({"F": [1.0]}, 0.0, outputs=["x"]), "positive"),
        (lambda m: m.simulate({"F": [1.0]}, 1e-3, outputs=["x"], substeps=-1), "substeps"),
        (lambda m: m.simulate({}, 1e-3, outputs=["x"]), "number of samples"),
        (lambda m: m.simulate({"F": [1.0]}, 1e-3, outputs=["x"], parameters={"R": 1.0}), "computed by the model"),
        (lambda m: m.simulate({"F": [1.0]}, 1e-3, outputs=["x"], parameters={"k": np.inf}), "finite"),
        (lambda m: m.clamp({"R": [1.0]}, {}, 1e-3, outputs=["x"]), "not a continuous state"),
        (lambda m: m.clamp({"x": [1.0, 2.0]}, {"F": [1.0]}, 1e-3, outputs=["x"]), "one common number"),
        (lambda m: m.simulate({"F": [1.0]}, 1e-3, outputs=["x"], interpolation="none"), "interpolation"),
    ],
)
def test_wrong_use_gets_one_sentence(call, sentence):
    with pytest.raises(UsageError, match=sentence) as error:
        call(CompiledModel(linear()))
    assert "\n" not in str(error.value)


def test_a_model_without_answer_says_where():
    with pytest.raises(NumericalError, match=r"Effect: the model found no answer at sample 0 \(t = 0 s\)"):
        CompiledModel(effect()).clamp({}, {"x": [0.0], "v": [0.0]}, 1e-3, outputs=["f"], parameters={"k3": -1.0})


def test_overflow_is_found_where_it_happens():
    with pytest.raises(NumericalError, match="no finite solution beyond"):
        CompiledModel(linear()).simulate({}, 1.0, rows=2000, parameters={"x": 1.0, "b": -50.0}, outputs=["x"])


def test_a_start_that_initial_equations_compute_is_refused_and_the_parameter_named():
    model = CompiledModel(compile_model("HystId.Oscillators.Linear"))
    with pytest.raises(UsageError, match="start of 'x' is computed: set the parameter 'x_start' instead"):
        model.simulate({}, 1e-3, rows=3, parameters={"x": 0.01}, outputs=["x"])
    x = model.simulate({}, 1e-3, rows=3, parameters={"x_start": 0.01}, outputs=["x"])["x"]
    assert x[0] == 0.01


def test_components_that_look_at_one_variable_share_its_relations() -> None:
    """Eight sliders ask for the sign of the same v: two relations for all, and two for the limits of each."""
    assert compile_model("HystId.Oscillators.Iwan").n_indicators == 2 + 2 * 8
