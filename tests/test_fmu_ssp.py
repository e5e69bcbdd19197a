"""Systems of FMUs in one file, run by FMPy's SSP runner and by a master written here: the same answer."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy
import fmu_checker
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.validation import validate_fmu
from fmu_models import built, linear, memory
from lxml import etree
from surrogate_harness import smooth_slider

from hystid.errors import HystidError, UsageError
from hystid.fmu import Connection, Driver, build, build_model, write_rig, write_ssp
from hystid.fmu.door import open_fmu
from hystid.fmu.mass import mass_code
from hystid.fmu.native import Access, Instance, Stepper
from hystid.modelcode import Experiment
from hystid.networks import onnx as exchange
from hystid.surrogate import oscillator_code, surrogate_code

MASS = """model Mass "m a + R = F"
  parameter Real m(unit="kg") = 2 "Mass";
  input Real F(unit="N") "Excitation";
  input Real R(unit="N") "Restoring force, opposes motion";
  output Real x(unit="m", start=0, fixed=true) "Displacement";
  output Real v(unit="m/s", start=0, fixed=true) "Velocity";
equation
  der(x) = v;
  m*der(v) = F - R;
end Mass;
"""
SCHEMA = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureDescription.xsd"
STEP, STOP = 1e-3, 0.3
CONNECTIONS = [
    Connection("F", "mass.F"),
    Connection("F", "reference.F"),
    Connection("mass.x", "force.x"),
    Connection("mass.v", "force.v"),
    Connection("force.R", "mass.R"),
    Connection("mass.x", "x"),
    Connection("reference.x", "x_reference"),
]


@pytest.fixture(scope="module")
def components(tmp_path_factory):
    """Force block with sampled memory, mass, and the linear oscillator as reference."""
    folder = tmp_path_factory.mktemp("ssp")
    (folder / "mass.mo").write_text(MASS)
    mass = build_model(f"{folder / 'mass.mo'}:Mass", folder / "mass.fmu").path
    return {"force": built(memory, 2), "mass": mass, "reference": built(linear, 2)}


def force(t):
    return 5 * np.sin(40 * t)


def own_master(components):
    """The same system, step by step: every component steps with the inputs of the end of the step before."""
    opened = {name: open_fmu(path) for name, path in components.items()}
    instances = {name: Instance(fmu, "CoSimulation") for name, fmu in opened.items()}
    inputs = {"force": ["x", "v"], "mass": ["F", "R"], "reference": ["F"]}
    outputs = {"force": ["R"], "mass": ["x", "v"], "reference": ["x"]}
    values = {f"{c}.{n}": 0.0 for c in opened for n in (*inputs[c], *outputs[c])}
    steppers, x = {}, []
    for name, instance in instances.items():
        instance.initialise(0.0, [])
        steppers[name] = Stepper(instance)
    t, signal = 0.0, 0.0
    while t < STOP:
        for name, instance in instances.items():
            for variable in inputs[name]:
                held = np.array([values[f"{name}.{variable}"]])
                Access(instance, [opened[name].model.variable(variable)]).set(held.ctypes.data)
            steppers[name].step(t, STEP)
            for variable in outputs[name]:
                held = np.zeros(1)
                Access(instance, [opened[name].model.variable(variable)]).get(held.ctypes.data)
                values[f"{name}.{variable}"] = held[0]
        signal = force(t)  # FMPy passes the system's input on after the components' step
        values["mass.F"] = values["reference.F"] = signal
        values["force.x"], values["force.v"], values["mass.R"] = values["mass.x"], values["mass.v"], values["force.R"]
        x.append((values["mass.x"], values["reference.x"]))
        t += STEP
    for instance in instances.values():
        instance.close()
    return np.array(x)


def test_fmpy_runs_the_system_to_the_same_answer(tmp_path, components):
    path = write_ssp(tmp_path / "rig.ssp", components, CONNECTIONS, inputs=["F"], outputs=["x", "x_reference"])
    rows = simulate_ssp(str(path), stop_time=STOP, step_size=STEP, input={"F": force})
    expected = own_master(components)
    assert np.ptp(expected[:, 0]) > 1e-4
    np.testing.assert_allclose(rows["x"], expected[:, 0], rtol=1e-12)
    np.testing.assert_allclose(rows["x_reference"], expected[:, 1], rtol=1e-12)


def test_the_description_is_valid_and_complete(tmp_path, components):
    path = write_ssp(tmp_path / "rig.ssp", components, CONNECTIONS, inputs=["F"], outputs=["x", "x_reference"])
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
        assert {f"resources/{name}.fmu" for name in components} < set(archive.namelist())
        assert archive.read("resources/mass.fmu") == components["mass"].read_bytes()
    schema = etree.XMLSchema(file=str(SCHEMA))
    assert schema.validate(root), schema.error_log
    assert len(root.findall(".//{*}Connection")) == len(CONNECTIONS)
    assert {u.get("name") for u in root.findall(".//{*}Unit")} == {"N", "m", "m/s"}
    (note,) = root.findall("{*}System/{*}Annotations/{*}Annotation")  # OMSimulator takes steps of 0.1 s without it
    master = note.find("{*}Annotations/{*}SimulationInformation/{*}FixedStepMaster")
    assert note.get("type") == "org.openmodelica" and float(master.get("stepSize")) == Experiment().step


@pytest.mark.parametrize(
    ("connections", "sentence"),
    [
        ([Connection("mass.y", "force.x")], "has no output 'y'"),
        ([Connection("mass.x", "force.R")], "has no input 'R'"),
        ([Connection("spring.x", "force.x")], "no component 'spring'"),
        ([Connection("mass.x", "force.v")], "is in m, force.v in m/s"),
        ([Connection("G", "mass.F")], "neither a connector of the system"),
        ([Connection("mass.x", "force.x"), Connection("reference.x", "force.x")], "more than one output"),
        ([Connection("mass.x", "force.x")], "'F' of the system is not connected"),
    ],
)
def test_what_does_not_fit_gets_one_sentence(tmp_path, components, connections, sentence):
    with pytest.raises(HystidError, match=sentence) as error:
        write_ssp(tmp_path / "no.ssp", components, connections, inputs=["F"])
    assert "\n" not in str(error.value) and list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def surrogate(tmp_path_factory):
    """surrogate.fmu of a network with turning points, and a reference oscillator."""
    folder = tmp_path_factory.mktemp("surrogate")
    exchange.write(smooth_slider(), folder / "surrogate.onnx")
    force = build(surrogate_code(folder / "surrogate.onnx"), folder / "surrogate.fmu").path
    return force, build_model("HystId.Oscillators.Jenkins", folder / "jenkins.fmu").path


def test_a_surrogate_on_its_mass_beside_the_reference(tmp_path, surrogate):
    """FMPy's runner, and a loop written here over the same FMUs: the same numbers."""
    force, reference = surrogate
    path = write_rig(tmp_path / "rig.ssp", force, 1.5, reference=reference, apart=True)
    etree.XMLSchema(file=str(SCHEMA)).assertValid(etree.fromstring(zipfile.ZipFile(path).read("SystemStructure.ssd")))
    step, n = 1e-4, 1500

    def excitation(t):
        return 30 * np.sin(2 * np.pi * 20 * t)

    rows = simulate_ssp(str(path), stop_time=n * step, step_size=step, input={"F": excitation})
    with zipfile.ZipFile(path) as archive:
        (tmp_path / "mass.fmu").write_bytes(archive.read("resources/mass.fmu"))
    opened = {"force": open_fmu(force), "mass": open_fmu(tmp_path / "mass.fmu"), "reference": open_fmu(reference)}
    instances = {name: Instance(fmu, "CoSimulation") for name, fmu in opened.items()}
    for instance in instances.values():
        instance.initialise(0.0, [])
    steppers = {name: Stepper(instance) for name, instance in instances.items()}

    def put(component, variable, value):
        held = np.array([value])
        Access(instances[component], [opened[component].model.variable(variable)]).set(held.ctypes.data)

    def get(component, variable):
        held = np.zeros(1)
        Access(instances[component], [opened[component].model.variable(variable)]).get(held.ctypes.data)
        return held[0]

    x, x_reference, t = [], [], 0.0
    for _ in range(n):
        for name in opened:
            steppers[name].step(t, step)
        R = get("force", "R")  # of the sample stepped, before new inputs change it
        put("force", "x", get("mass", "x_ahead"))
        put("force", "v", get("mass", "v_ahead"))
        put("mass", "R", R)
        put("mass", "F", excitation(t))
        put("reference", "F", excitation(t))
        x.append(get("mass", "x"))
        x_reference.append(get("reference", "x"))
        t += step
    for instance in instances.values():
        instance.close()
    count = min(len(x), len(rows["x"]))
    assert count >= n - 1 and np.ptp(x) > 1e-5 and np.ptp(x_reference) > 1e-5
    np.testing.assert_allclose(rows["x"][:count], x[:count], rtol=1e-12)
    np.testing.assert_allclose(rows["x_reference"][:count], x_reference[:count], rtol=1e-12)


def test_the_mass_is_a_valid_fmu_with_exact_derivatives(tmp_path):
    path = build(mass_code(2.0, step=1e-3), tmp_path / "mass.fmu", fmi=3).path
    assert validate_fmu(str(path)) == [] and fmu_checker.problems(path) == []
    t = np.linspace(0, 1, 1001)
    rows = Driver(path).simulate(t, {"F": np.full(1001, 6.0), "R": np.full(1001, 2.0)}, start={"v_start": 1.0})
    np.testing.assert_allclose(rows["x"], t + t**2, rtol=1e-12)  # a = (6 - 2)/2
    ahead = Driver(path).simulate(
        t, {"F": np.full(1001, 4.0)}, parameters={"lead": 0.1}, outputs=["x_ahead", "v_ahead"]
    )
    np.testing.assert_allclose(ahead["x_ahead"], (t + 0.1) ** 2, rtol=1e-12)  # a = 2 is known from the start on
    np.testing.assert_allclose(ahead["v_ahead"], 2 * (t + 0.1), rtol=1e-12)
    with pytest.raises(UsageError, match="must be positive"):
        mass_code(0.0)


def free_motion(path, step, n, push):
    """v of the system after a force F = push during the first step, by FMPy's runner."""
    rows = simulate_ssp(str(path), stop_time=n * step, step_size=step, input={"F": lambda t: push * (t < step / 2)})
    return rows["v"]


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("mass", [0.5, 1.0, 5.0])
def test_a_surrogate_on_its_mass_comes_to_rest(tmp_path, mass, apart):
    """Hysteresis alone, no viscous damping, at the step that its own samples have: nothing but loss is left to act."""
    step = 4e-4
    model = smooth_slider(dt=step, damping=0.0)
    exchange.write(model, tmp_path / "surrogate.onnx")
    force = build(surrogate_code(tmp_path / "surrogate.onnx"), tmp_path / "surrogate.fmu").path
    path = write_rig(tmp_path / "rig.ssp", force, mass, apart=apart)
    v = np.abs(free_motion(path, step, 4000, 0.3 * mass / step))
    energy = np.maximum.accumulate(v[::-1])[::-1]  # the largest speed that is still to come never grows
    assert v[:10].max() == pytest.approx(0.3, rel=0.05)  # the push
    assert energy[2000] < 0.6 * v.max() and v[-500:].max() <= energy[2000]
    if not apart:
        code = oscillator_code(tmp_path / "surrogate.onnx", mass=mass)
        t = step * np.arange(4000)
        F = np.where(t < step / 2, 0.3 * mass / step, 0.0)
        alone = Driver(build(code, tmp_path / "oscillator.fmu").path).simulate(t, {"F": F}, interpolation="hold")
        # FMPy's rows are ends of steps, but it hands the first step no input: together the rows agree
        np.testing.assert_allclose(free_motion(path, step, 3999, F[0])[:3999], alone["v"][:3999], atol=1e-9)


SPRING = """model Spring "A spring without loss"
  parameter Real k(unit="N/m") = 4e4 "Stiffness";
  input Real x(unit="m"); input Real v(unit="m/s", nominal=0.2);
  output Real R(unit="N");
equation
  R = k*x;
end Spring;
"""


def test_a_force_of_its_own_fmu_meets_its_delay_or_is_refused(tmp_path):
    """Without loss in the force, whatever the exchange adds is seen: with 60 steps a period a damping ratio of 7e-4
    (what the Taylor series leaves out, 0.6 (w h)^3), and at 8 steps a period growth, which is refused."""
    (tmp_path / "Spring.mo").write_text(SPRING)
    force = build_model(f"{tmp_path / 'Spring.mo'}:Spring", tmp_path / "spring.fmu").path
    w = 200.0  # sqrt(4e4 N/m / 1 kg)
    for n in (60, 20):
        step = 2 * np.pi / w / n
        path = write_rig(tmp_path / "rig.ssp", force, 1.0, step=step)
        v = np.abs(free_motion(path, step, 12 * n, 100.0))
        damping = np.log(v[:n].max() / v[10 * n : 11 * n].max()) / (2 * np.pi * 10)
        assert 0.4 < damping / (w * step) ** 3 < 0.8
    with pytest.raises(UsageError, match=r"spring\.fmu: on a mass of 1 kg it feeds energy in .*; with step=0\.00"):
        write_rig(tmp_path / "coarse.ssp", force, 1.0, step=2 * np.pi / w / 8)
    assert not (tmp_path / "coarse.ssp").exists()
