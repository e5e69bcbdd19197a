"""Model exchange as importers do it: a variable-step solver of our own that rejects steps and goes back in time, trial
points that must leave no trace, importers that never call completedIntegratorStep, and CVode in FMPy."""

from __future__ import annotations

from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_void_p
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from fmu_models import bouncing, contact, jenkins, linear, memory, sampled, unpacked
from surrogate_harness import smooth_slider

from hystid.fmu import Driver, build, build_model
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Instance
from hystid.networks import onnx as exchange
from hystid.surrogate import oscillator_code

BOTH = pytest.mark.parametrize("version", [2, 3])
LIBRARY = Path(__file__).parents[1] / "modelica" / "HystId"


class Importer:
    """One model exchange instance behind its initialisation; inputs are functions of time, always set with it."""

    def __init__(self, fmu, inputs=None, completes=True, **values):
        self.instance = Instance(fmu, "ModelExchange")
        model = fmu.model
        self.inputs = {name: (model.variable(name), function) for name, function in (inputs or {}).items()}
        given = [(model.variable(name), value) for name, value in values.items()]
        given += [(variable, function(0.0)) for variable, function in self.inputs.values()]
        self.instance.initialise(0.0, given)
        self.completes, self.t = completes, 0.0
        _, self.next_time = self.instance.new_discrete_states()
        self.instance.call("EnterContinuousTimeMode")
        self.n_x, self.n_z = len([v for v in model.variables if v.derivative_of]), fmu.model.n_indicators
        self.x = self._states()
        self.z = self.indicators(0.0, self.x)
        self.restarts = self.events = 0

    def _array(self, name, n):
        values = np.zeros(n)
        self.instance.call(name, c_void_p(values.ctypes.data), c_size_t(n))
        return values

    def _states(self):
        return self._array("GetContinuousStates", self.n_x)

    def place(self, t, x):
        """Set time, inputs and states: a trial point like any other."""
        self.instance.call("SetTime", c_double(t))
        self.instance.set([(variable, function(t)) for variable, function in self.inputs.values()])
        x = np.ascontiguousarray(x)
        self.instance.call("SetContinuousStates", c_void_p(x.ctypes.data), c_size_t(self.n_x))

    def derivatives(self, t, x):
        self.place(t, x)
        derivative = "GetDerivatives" if self.instance.version == 2 else "GetContinuousStateDerivatives"
        return self._array(derivative, self.n_x)

    def indicators(self, t, x):
        self.place(t, x)
        return self._array("GetEventIndicators", self.n_z)

    def accept(self, t, x):
        """The step ends here; event iteration where an indicator changed its sign or a time event is due."""
        self.place(t, x)
        self.t, self.x = t, x
        if self.completes:
            flag = c_int if self.instance.version == 2 else c_bool
            self.instance.call("CompletedIntegratorStep", flag(1), byref(flag()), byref(flag()))
        crossed = np.any((self.z > 0) != (self.indicators(t, x) > 0))
        if crossed or t >= self.next_time:
            self.events += 1
            self.instance.call("EnterEventMode")
            changed, self.next_time = self.instance.new_discrete_states()
            self.instance.call("EnterContinuousTimeMode")
            if changed:
                self.restarts += 1
                self.x = self._states()
        self.z = self.indicators(t, self.x)

    def value(self, name, fmu):
        access = self.instance.access([fmu.model.variable(name)])[0]
        values = np.zeros(1)
        access.get(values.ctypes.data)
        return float(values[0])


# Dormand and Prince (1980), order 5 with an error estimate of order 4
A = [[], [1 / 5], [3 / 40, 9 / 40], [44 / 45, -56 / 15, 32 / 9],
     [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
     [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
     [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]]  # fmt: skip
C = [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1]
LOW = np.array([5179 / 57600, 0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40])


def trial(importer, t, x, h):
    """End of a step and its error."""
    k = []
    for a, c in zip(A, C, strict=True):
        k.append(
            importer.derivatives(t + c * h, x + h * sum((w * s for w, s in zip(a, k, strict=False)), np.zeros(len(x))))
        )
    end = x + h * sum(w * s for w, s in zip(A[6], k, strict=False))
    return end, end - (x + h * (LOW @ np.array(k)))


def solve(importer, times, tolerance, rng=None, longest=5e-3):
    """States at these times. Steps are controlled, cut at time events and at sign changes of the indicators (bisection
    by trial steps); with rng a fifth of the good steps is thrown away and tried again shorter."""
    h, rows, rejected = 1e-4, [importer.x], 0
    for target in times[1:]:
        while importer.t < target - 1e-14:
            start, end = importer.t, min(importer.t + h, target, importer.next_time)
            x, error = trial(importer, start, importer.x, end - start)
            size = max(1e-9, np.max(np.abs(error) / (tolerance * (1 + np.abs(x))), initial=0.0))
            thrown_away = rng is not None and rng.random() < 0.2
            h = min(longest, (end - start) * min(5.0, max(0.2, 0.9 * size**-0.2)))
            if size > 1 or thrown_away:
                h = min(h, 0.6 * (end - start))
                rejected += 1
                continue
            importer.accept(*first_crossing(importer, start, end, x))
        rows.append(importer.x)
    return np.array(rows), rejected


def first_crossing(importer, start, end, x):
    """The accepted end of a step: just behind the first sign change, or the end itself."""

    def crossed(t, states):
        return np.any((importer.z > 0) != (importer.indicators(t, states) > 0))

    low = start
    while crossed(end, x) and end - low > 1e-13:
        middle = 0.5 * (low + end)
        if middle in (low, end):
            break
        between = trial(importer, start, importer.x, middle - start)[0]
        if crossed(middle, between):
            end, x = middle, between
        else:
            low = middle
    return end, x


def names_of(fmu):
    return [v.derivative_of for v in fmu.model.variables if v.derivative_of]


@BOTH
@pytest.mark.parametrize(
    ("make", "inputs", "values", "stop"),
    [
        (linear, {"F": lambda t: 60 * np.sin(2 * np.pi * 20 * t)}, {}, 0.1),
        (bouncing, {}, {"x": 0.5}, 0.9),
        (contact, {"F": lambda t: -20.0}, {}, 0.4),
        (sampled, {"u": lambda t: 1 + t}, {}, 0.55),
    ],
)
def test_a_solver_that_rejects_steps_gets_the_same(make, inputs, values, stop, version):
    fmu = unpacked(make, version)
    importer = Importer(fmu, inputs, **values)
    times = np.linspace(0, stop, 41)
    found, rejected = solve(importer, times, 1e-9, np.random.default_rng(3))
    assert rejected > 20
    table = {name: np.array([function(t) for t in np.linspace(0, stop, 4001)]) for name, function in inputs.items()}
    reference = Driver(fmu.path).simulate(np.linspace(0, stop, 4001), table, start=values, interpolation="cubic")
    for i, name in enumerate(names_of(fmu)):
        expected = reference[name][::100]
        # both integrate to about 1e-8; what an event cut off at 1e-13 s may add is far below
        np.testing.assert_allclose(found[:, i], expected, atol=2e-6 * np.ptp(expected), err_msg=name)


@BOTH
@pytest.mark.parametrize("make", [jenkins, bouncing, contact, sampled])
def test_trial_points_leave_no_trace(make, version):
    """Between accepted steps the model is asked at wild points, later and earlier: bit for bit the same run."""
    fmu = unpacked(make, version)
    values = {"x": 0.05} if make is bouncing else {}
    names = [v.name for v in fmu.model.variables if v.causality == "input"]
    inputs = {name: lambda t: 30 * np.sin(90 * t) for name in names}

    def run(wild):
        rng, importer, rows = np.random.default_rng(1), Importer(fmu, inputs, **values), []
        for k in range(400):
            if wild:
                for _ in range(3):
                    at = max(0.0, importer.t + rng.normal() * 1e-3)
                    x = importer.x + rng.normal(size=importer.n_x) * (1e-3 + np.abs(importer.x))
                    importer.derivatives(at, x)
                    importer.indicators(at, x)
                    importer.value("time", fmu)
            t, x, h = importer.t, importer.x, 1e-3
            x = trial(importer, t, x, h)[0]
            importer.accept((k + 1) * h, x)
            rows.append(importer.x)
        return np.array(rows), importer.events

    (quiet, events), (asked, events_asked) = run(False), run(True)
    np.testing.assert_array_equal(quiet, asked)
    assert events == events_asked and (events > 0) == (make is not jenkins)


@BOTH
def test_sampled_memory_moves_at_its_own_instants_alone(version):
    """A block with a turning-point memory of 1e-4 s: trial points, steps of the solver and calls at their ends leave
    it as it is; it moves at time events, which the FMU announces."""
    fmu = unpacked(memory, version)
    motion = {"x": lambda t: np.sin(50 * t), "v": lambda t: 50 * np.cos(50 * t)}
    t = np.arange(1, 201) * 5e-4
    runs = {}
    for wild, completes, steps in ((False, True, 1), (True, True, 1), (False, False, 1), (False, True, 3)):
        importer, forces = Importer(fmu, motion, completes), []
        for end in t:
            if wild:
                for at in (end + 0.3, end - 0.01, 5.0, end):
                    importer.place(at, np.zeros(0))
                    importer.value("R", fmu)
            while importer.t < end - 1e-12:
                importer.accept(min(importer.next_time, end, importer.t + 1e-4 / steps), np.zeros(0))
            forces.append(importer.value("R", fmu))
        runs[wild, completes, steps] = np.array(forces)
    first = runs[False, True, 1]
    for run in runs.values():
        np.testing.assert_allclose(run, first, rtol=1e-12)  # times are summed up in other steps
    # by hand: the turning point is x at the first sample at which v has changed its sign since the sample before
    grid = np.arange(1, 1002) * 1e-4
    v = 50 * np.cos(50 * np.append(0.0, grid))
    turned = v[1:] * v[:-1] <= 0
    kept = np.array([np.sin(50 * grid[k]) for k in np.flatnonzero(turned)])
    index = np.searchsorted(grid[turned], t + 1e-9) - 1
    expected = 100 * np.sin(50 * t) + 7 * np.where(index >= 0, kept[np.maximum(index, 0)], 0.0)
    np.testing.assert_allclose(first, expected, atol=1e-9)


@BOTH
def test_solvers_agree_on_a_network_with_memory(tmp_path, version):
    """An identified oscillator by a solver with error control at two tolerances, with rejected steps and without, and
    in co-simulation: the memory takes the same samples in all of them."""
    exchange.write(smooth_slider(damping=0.0), tmp_path / "s.onnx")
    path = build(oscillator_code(tmp_path / "s.onnx"), tmp_path / "o.fmu", fmi=version).path
    fmu = open_fmu(path)

    def force(t):
        return 60 * np.sin(2 * np.pi * 12 * t)

    times = np.linspace(0, 0.2, 21)
    found = [
        solve(Importer(fmu, {"F": force}), times, tolerance, rng, longest=1e-3)[0]
        for tolerance, rng in ((1e-6, None), (1e-9, np.random.default_rng(3)))
    ]
    fine = np.linspace(0, 0.2, 2001)
    ours = Driver(path).simulate(fine, {"F": force(fine)}, outputs=["x"])["x"][::100]
    size = np.ptp(ours)
    assert np.max(np.abs(found[0] - found[1])[:, 0]) < 1e-4 * size  # error control at 1e-6, some thousand steps
    assert np.max(np.abs(found[1][:, 0] - ours)) < 1e-4 * size  # Runge-Kutta steps of 1e-4 s, inputs linear in them


@BOTH
@pytest.mark.parametrize("model", ["Jenkins", "Iwan"])
def test_a_slider_at_its_limit_restarts_the_solver(tmp_path, model, version):
    """At each change between stick and slip the FMU asks for a new start of the solver: CVode goes on over a kink with
    the old slope where it is not told, and then meets its limit of steps."""
    path = build_model(f"HystId.Oscillators.{model}", tmp_path / "m.fmu", fmi=version).path
    fmu = open_fmu(path)
    importer = Importer(fmu, {"F": lambda t: 150 * np.sin(2 * np.pi * 12 * t)})
    times = np.linspace(0, 0.3, 31)
    found, _ = solve(importer, times, 1e-8, np.random.default_rng(5))
    assert importer.restarts >= 6  # stick and slip, three periods and more
    table = {"F": 150 * np.sin(2 * np.pi * 12 * np.linspace(0, 0.3, 3001))}
    reference = Driver(path).simulate(np.linspace(0, 0.3, 3001), table, interpolation="cubic")
    for i, name in enumerate(names_of(fmu)):
        if name in ("x", "v"):
            np.testing.assert_allclose(found[:, i], reference[name][::100], atol=1e-5 * np.ptp(reference[name]))


SMOOTH = sorted(p.stem for p in (LIBRARY / "Oscillators").glob("*.mo") if p.stem != "package")


@pytest.mark.parametrize("model", SMOOTH)
def test_cvode_in_fmpy_agrees(tmp_path, model):
    """Every oscillator of the library. The force of PecorariSolodov jumps at rest without an event, and no solver with
    error control gets past that point: its contact turns over a speed here."""
    turn = {"v_turn": 1e-2} if model == "PecorariSolodov" else {}
    path = build_model(f"HystId.Oscillators.{model}", tmp_path / "m.fmu", fmi=2, parameters=turn).path
    t = np.arange(501) * 1e-3
    ours = Driver(path).simulate(t, {"F": np.full(501, 60.0)}, outputs=["x", "v", "R"])
    theirs = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", relative_tolerance=1e-7, start_values={"F": 60.0}, stop_time=0.5,
        output_interval=1e-3, output=["x", "v", "R"], record_events=False,
    )  # fmt: skip
    for name, values in ours.items():
        # error control at 1e-7 per step, several hundred steps
        np.testing.assert_allclose(theirs[name], values, atol=2e-4 * np.ptp(values), err_msg=name)


@BOTH
@pytest.mark.parametrize("model", ["Jenkins", "LuGre", "Iwan"])
def test_default_settings_of_fmpy_are_good_enough(tmp_path, model, version):
    """CVode takes tolerance and nominal values from the FMU. Without them it was off by 1 to 2 % here, in free motion
    (all oscillators: benchmarks/fmu/solver_settings.py, 0.04 % at most)."""
    path = build_model(f"HystId.Oscillators.{model}", tmp_path / "m.fmu", fmi=version).path
    t = np.arange(30_001) * 1e-5
    ours = Driver(path).simulate(t, {"F": np.zeros(len(t))}, parameters={"x_start": 5e-3}, outputs=["x", "v", "R"])
    theirs = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=0.3, output_interval=1e-3, start_values={"x_start": 5e-3},
        output=["x", "v", "R"], record_events=False,
    )  # fmt: skip
    for name, values in ours.items():
        error = theirs[name][:301] - values[::100]
        assert np.sqrt(np.mean(error**2)) < 0.002 * np.std(values), name


@BOTH
def test_a_jump_without_event_is_not_offered_to_solvers(tmp_path, version):
    """PecorariSolodov as published, and a law of one's own like it; a kink or a jump with an event is no obstacle."""
    body = "input Real F; output Real x(start=1, fixed=true); output Real v(start=0, fixed=true); equation der(x) = v; "
    laws = {"Jumps": "sign(v)", "Event": "(if v > 0 then 1 else -1)", "Kink": "sign(v)*abs(v)", "Steep": "tanh(v/1e-5)"}
    for name, law in laws.items():
        (tmp_path / f"{name}.mo").write_text(f"model {name} {body} der(v) = F - 9*x - {law}; end {name};")
    cases = {f"{tmp_path / name}.mo:{name}": name != "Jumps" for name in laws}
    cases["HystId.Oscillators.PecorariSolodov"] = False
    for model, offered in cases.items():
        path = build_model(model, tmp_path / "m.fmu", fmi=version).path
        assert ("ModelExchange" in Driver(path).kinds) == offered, model
        assert validate_fmu(str(path)) == []
