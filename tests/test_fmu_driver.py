"""The driver: what it refuses and in which words, and that all ways of running an FMU agree."""

from __future__ import annotations

import io
import zipfile

import fmpy
import numpy as np
import pytest
from fmu_models import bouncing, built, contact, effect, jenkins, linear, memory, sampled

from hystid.compiled import CompiledModel
from hystid.errors import FmuError, HystidError
from hystid.fmu import Driver, build_model
from hystid.fmu.native import Instance
from hystid.fmu.platforms import PLATFORMS, host

BOTH = pytest.mark.parametrize("version", [2, 3])


def rezipped(source, target, change):
    """A copy of an FMU whose entries went through change(name, data) -> data, or None to leave the entry out."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = change(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
    return target


def in_description(old, new):
    def change(name, data):
        return data.replace(old, new) if name == "modelDescription.xml" else data

    return change


def without(prefix):
    return lambda name, data: None if name.startswith(prefix) else data


REFUSED = {
    "not a zip file": (lambda p: p.write_bytes(b"no zip at all"), "not an FMU, for it is not a zip file"),
    "empty": (lambda p: p.write_bytes(b""), "not a zip file"),
    "cut off": (lambda p: p.write_bytes(built(linear, 2).read_bytes()[:4000]), "not a zip file or it is damaged"),
    "path outside": (
        lambda p: zip_of(p, {"../evil.txt": b"", "modelDescription.xml": b""}),
        "'../evil.txt' would be written",
    ),
    "absolute path": (
        lambda p: zip_of(p, {"/etc/evil": b"", "modelDescription.xml": b""}),
        "'/etc/evil' would be written",
    ),
    "drive letter": (lambda p: zip_of(p, {"C:\\evil": b"", "modelDescription.xml": b""}), "would be written outside"),
    "no description": (lambda p: zip_of(p, {"readme.txt": b"hi"}), "holds no modelDescription.xml"),
    "broken XML": (lambda p: zip_of(p, {"modelDescription.xml": b"<fmi"}), "not well-formed"),
    "FMI 1": (
        lambda p: rezipped(built(linear, 2), p, in_description(b'"2.0"', b'"1.0"')),
        "FMI version 1.0 is not supported",
    ),
    "no version": (lambda p: zip_of(p, {"modelDescription.xml": b"<a/>"}), "FMI version none"),
    "no binary": (
        lambda p: rezipped(built(linear, 2), p, without("binaries")),
        "no binary for this platform .* none at all",
    ),
    "other platform": (
        lambda p: (
            rezipped(built(linear, 3), p, lambda n, d: d if n.endswith(".xml") else None) and add(p, "binaries/x/a.so")
        ),
        "no binary for this platform .* it has binaries for x",
    ),
    "library of another name": (
        lambda p: (
            rezipped(built(linear, 2), p, without("binaries"))
            and add(p, f"binaries/{PLATFORMS[host()].folder}/other.so")
        ),
        "no binary for this platform .* not the library of its modelIdentifier",
    ),
    "two variables of one name": (
        lambda p: rezipped(built(linear, 2), p, in_description(b'ScalarVariable name="v"', b'ScalarVariable name="x"')),
        "two variables of the name 'x'",
    ),
    "not a library": (
        lambda p: rezipped(built(linear, 2), p, lambda n, d: b"junk" if n.startswith("binaries") else d),
        "library cannot be loaded",
    ),
}


def zip_of(path, content):
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def add(path, name):
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, b"")


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_get_one_sentence(tmp_path, case):
    make, sentence = REFUSED[case]
    path = tmp_path / "bad.fmu"
    make(path)
    with pytest.raises(FmuError, match=sentence) as error:
        Driver(path)
    assert "\n" not in str(error.value) and "bad.fmu" in str(error.value)
    assert error.value.exit_code == 2


def test_a_missing_file_gets_one_sentence(tmp_path):
    with pytest.raises(FmuError, match="there is no such file"):
        Driver(tmp_path / "none.fmu")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(t=[0, 1e-3], outputs=["y"]), "no variable 'y'; it has"),
        (dict(t=[0, 1e-3], inputs={"G": [1, 2]}), "no variable 'G'"),
        (dict(t=[0, 1e-3], inputs={"x": [1, 2]}), "'x' is not an input"),
        (dict(t=[0, 1e-3], inputs={"F": [1, 2, 3]}), "shape"),
        (dict(t=[0, 1e-3], inputs={"F": [1, np.inf]}), "not finite at sample 1"),
        (dict(t=[0, 0]), "increasing"),
        (dict(t=[0, 1], parameters={"mass": 1.0}), "no variable 'mass'"),
    ],
)
def test_wrong_use_gets_one_sentence(arguments, sentence):
    with pytest.raises(HystidError, match=sentence) as error:
        Driver(built(linear, 2)).simulate(**arguments)
    assert "\n" not in str(error.value)


def foreign(path, tmp_path, version):
    """The same FMU to the driver as any other: its batch entry renamed in the library's bytes."""

    def change(name, data):
        return data.replace(b"hy_run_table", b"no_run_table") if name.startswith("binaries") else data

    return rezipped(path, tmp_path / f"foreign{version}.fmu", change)


INPUTS = {
    jenkins: {"F": lambda t: 60 * np.sin(125 * t)},
    linear: {"F": lambda t: 5 * np.sin(30 * t)},
    contact: {"F": lambda t: 20 * np.sin(30 * t)},
    bouncing: {},
    sampled: {"u": lambda t: np.sin(9 * t)},
    effect: {"x": np.sin, "v": np.cos},
}


@BOTH
@pytest.mark.parametrize("make", INPUTS)
def test_batch_entry_runner_and_foreign_steps_agree(tmp_path, make, version):
    """Three ways through the same C: in this process, by the FMU's batch entry, by one call per step."""
    code = make()
    h = code.experiment.step
    t = np.arange(1001) * h
    inputs = {name: f(t) for name, f in INPUTS[make].items()}
    names = [v.name for v in code.variables if v.causality == "output"]
    own, other = Driver(built(make, version)), Driver(foreign(built(make, version), tmp_path, version))
    assert own.is_own and not other.is_own
    interpolation = "linear" if version == 2 else "hold"
    batch = own.simulate(t, inputs, interpolation=interpolation)
    here = CompiledModel(code).simulate(inputs, h, outputs=names, interpolation=interpolation, rows=len(t))
    single = other.simulate(t, inputs)
    for name in names:
        np.testing.assert_array_equal(batch[name], here[name])
        shown = slice(None)
        if version == 3 or make in (sampled, effect):
            # a held input is the last step's at the end of a step and the new one in the table's row; the same holds
            # for what depends on an input directly
            dependent = set(code.dependencies.get(name, ())) & set(inputs)
            if dependent or name == "u_s":
                continue
        scale = np.max(np.abs(batch[name])) + 1e-300
        np.testing.assert_allclose(single[name][shown], batch[name][shown], rtol=0, atol=1e-9 * scale)


def test_times_need_not_be_uniform(tmp_path):
    t = np.cumsum(np.random.default_rng(3).uniform(0.5e-3, 1.5e-3, 400))
    F = np.sin(30 * t)
    own = Driver(built(linear, 2)).simulate(t, {"F": F}, outputs=["x"])["x"]
    fine = np.linspace(t[0], t[-1], 20001)
    reference = CompiledModel(linear()).simulate(
        {"F": np.interp(fine, t, F)}, fine[1] - fine[0], outputs=["x"], start_time=fine[0]
    )["x"]
    np.testing.assert_allclose(own, np.interp(t, fine, reference), atol=1e-6 * np.max(np.abs(reference)))


@BOTH
def test_a_foreign_model_exchange_fmu_is_clamped(tmp_path, version):
    t = np.arange(2001) * 1e-4
    F = 60 * np.sin(125 * t)
    own, other = Driver(built(jenkins, version)), Driver(foreign(built(jenkins, version), tmp_path, version))
    run = own.simulate(t, {"F": F}, outputs=["x", "v"])
    ours = own.clamp(run, {"F": F}, 1e-4, outputs=["R", "z"], sensitivities=["Kl"])
    theirs = other.clamp(run, {"F": F}, 1e-4, outputs=["R", "z"], sensitivities=["Kl"])
    for name in ("R", "z"):
        np.testing.assert_allclose(theirs[name], ours[name], atol=1e-10 * np.max(np.abs(ours[name])))
    # central differences over a step of 1e-5 of Kl
    np.testing.assert_allclose(theirs["d R/d Kl"], ours["d R/d Kl"], atol=1e-6 * np.max(np.abs(run["x"])))


def test_a_clamped_event_model_follows_its_relation(tmp_path):
    x = 0.6 * np.sin(np.linspace(0, 12, 1201))
    v = np.gradient(x, 1e-2)
    for path in (built(contact, 2), foreign(built(contact, 2), tmp_path, 2)):
        R = Driver(path).clamp({"x": x, "v": v}, {}, 1e-2, outputs=["R"])["R"]
        np.testing.assert_allclose(R, 100 * x + 1e4 * np.maximum(x - 0.5, 0), atol=1e-9)


def test_co_simulation_alone_cannot_be_clamped(tmp_path):
    def change(name, data):
        if name == "modelDescription.xml":
            start, end = data.index(b"<ModelExchange"), data.index(b"</ModelExchange>") + len(b"</ModelExchange>")
            return data[:start] + data[end:]
        return data.replace(b"hy_run_table", b"no_run_table") if name.startswith("binaries") else data

    driver = Driver(rezipped(built(jenkins, 2), tmp_path / "cs.fmu", change))
    assert driver.kinds == ("CoSimulation",)
    with pytest.raises(FmuError, match="offers co-simulation only"):
        driver.clamp({"x": [0.0], "v": [0.0]}, {"F": [0.0]}, 1e-3, outputs=["R"])


def test_model_exchange_alone_is_solved(tmp_path):
    """By FMPy's variable-step solver, asked for 1e-8: the free decay in closed form."""

    def change(name, data):
        if name == "modelDescription.xml":
            start, end = data.index(b"<CoSimulation"), data.index(b"</CoSimulation>") + len(b"</CoSimulation>")
            return data[:start] + data[end:]
        return data.replace(b"hy_run_table", b"no_run_table") if name.startswith("binaries") else data

    driver = Driver(rezipped(built(linear, 2), tmp_path / "me.fmu", change))
    t = np.linspace(0, 1, 201)
    x = driver.simulate(t, start={"x": 0.01}, outputs=["x"])["x"]
    frequency = np.sqrt(400 - 1)
    exact = 0.01 * np.exp(-t) * (np.cos(frequency * t) + np.sin(frequency * t) / frequency)
    np.testing.assert_allclose(x, exact, atol=1e-5 * 0.01)


@BOTH
def test_fmpy_takes_the_same_trajectory(version):
    """The usual importer, one call per step with held input, against our batch entry with held input."""
    t = np.arange(501) * 1e-3
    F = np.sin(30 * t)
    signal = np.zeros(501, dtype=[("time", "f8"), ("F", "f8")])
    signal["time"], signal["F"] = t, F
    rows = fmpy.simulate_fmu(
        str(built(linear, version)),
        fmi_type="CoSimulation",
        stop_time=0.5,
        output_interval=1e-3,
        input=signal,
        output=["x", "v"],
    )
    held = Driver(built(linear, version)).simulate(t, {"F": F}, outputs=["x", "v"], interpolation="hold")
    for name in ("x", "v"):
        scale = np.max(np.abs(held[name]))
        np.testing.assert_allclose(rows[name], held[name], atol=1e-9 * scale)  # FMPy sums its steps up


@BOTH
def test_fmpy_solves_model_exchange_with_events(version):
    rows = fmpy.simulate_fmu(
        str(built(bouncing, version)),
        fmi_type="ModelExchange",
        stop_time=1.0,
        output_interval=1e-2,
        relative_tolerance=1e-10,
        output=["x", "count"],
        record_events=False,
    )
    t = rows["time"]
    first = np.sqrt(2 / 9.81)
    tau = t - first
    exact = np.where(t < first, 1 - 9.81 * t**2 / 2, 0.7 * 9.81 * first * tau - 9.81 * tau**2 / 2)
    inside = np.abs(tau) > 1e-6
    np.testing.assert_allclose(
        rows["x"][inside], exact[inside], atol=1e-5
    )  # CVode's absolute tolerance and event location
    assert rows["count"][-1] == 1


@pytest.mark.parametrize("make", [bouncing, sampled, contact])
def test_fmpy_handles_events_itself_where_it_wants_to(make):
    """FMI 3 co-simulation with event mode and early return ends where the steps that handle their own events end."""
    ends = [
        fmpy.simulate_fmu(
            str(built(make, 3)),
            fmi_type="CoSimulation",
            stop_time=1.2,
            output_interval=0.01,
            early_return_allowed=own,
            use_event_mode=own,
        )[-1]
        for own in (False, True)
    ]
    # the steps are cut at the events in one run and at events and communication points in the other
    np.testing.assert_allclose(list(ends[0]), list(ends[1]), rtol=1e-6)


def test_sampled_memory_by_batch_and_by_steps_agree(tmp_path):
    rng = np.random.default_rng(11)
    x, v = np.cumsum(rng.normal(size=(2, 300)), axis=1)
    t = np.arange(300) * 1e-4
    batch = Driver(built(memory, 2)).simulate(t, {"x": x, "v": v})["R"]
    fmu = Driver(foreign(built(memory, 2), tmp_path, 2))
    # the step made with sample k shows the force of sample k at its end: one row later than in the table
    steps = fmu.simulate(t, {"x": x, "v": v}, interpolation="hold")["R"]
    np.testing.assert_allclose(steps[1:], batch[:-1], rtol=1e-14)


@BOTH
def test_a_boolean_input_triggers_a_when_clause(tmp_path, version):
    """Four rising edges count four, by the batch entry and step by step; there is no indicator and no time event."""
    source = tmp_path / "edges.mo"
    lines = "input Boolean b; output Real n(start=0); equation when b then n = pre(n) + 1; end when;"
    source.write_text(f"model Edges {lines} end Edges;")
    path = build_model(f"{source}:Edges", tmp_path / "edges.fmu", fmi=version).path
    t, b = np.arange(16) * 0.1, np.tile([0.0, 0.0, 1.0, 1.0], 4)
    expected = np.repeat(np.arange(5), [2, 4, 4, 4, 2])
    np.testing.assert_array_equal(Driver(path).simulate(t, {"b": b})["n"], expected)
    # a step made with sample k shows it at its end, one row later
    steps = Driver(foreign(path, tmp_path, version)).simulate(t, {"b": b})["n"]
    np.testing.assert_array_equal(steps[1:], expected[:-1])


def test_the_folder_goes_with_the_driver():
    driver = Driver(built(linear, 2))
    folder = driver._fmu.folder
    assert folder.is_dir()
    del driver
    assert not folder.exists()


def test_an_instance_without_function_says_which():
    instance = Instance(Driver(built(linear, 2))._fmu, "CoSimulation")
    with instance, pytest.raises(FmuError, match="lacks the function fmi2Nonsense"):
        instance.call("Nonsense")


def test_bytes_in_memory_are_a_zip(tmp_path):
    """An FMU with a comment at its end, as some archivers write, opens like any other."""
    data = io.BytesIO(built(linear, 2).read_bytes())
    with zipfile.ZipFile(data, "a") as archive:
        archive.comment = b"packed elsewhere"
    path = tmp_path / "commented.fmu"
    path.write_bytes(data.getvalue())
    assert Driver(path).is_own
