"""The FMU shell, call by call: modes, refusals, states, derivatives, events and steps in FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
import threading
from ctypes import byref, c_bool, c_double, c_size_t, c_void_p
from pathlib import Path

import numpy as np
import pytest
from fmu_models import bouncing, contact, effect, jenkins, linear, memory, sampled, unpacked

from hystid.errors import FmuError
from hystid.fmu.native import Instance, Stepper

G, E = 9.81, 0.7
BOTH = pytest.mark.parametrize("version", [2, 3])
KINDS = pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])


def start(make, version, kind="CoSimulation", **values):
    """An initialised instance."""
    fmu = unpacked(make, version)
    instance = Instance(fmu, kind)
    instance.initialise(0.0, [(fmu.model.variable(name), value) for name, value in values.items()])
    return instance


def references(make, *names):
    variables = {v.name: v for v in make().variables}
    return np.array([variables[name].slot for name in names], np.uint32)


def read(instance, make, *names):
    vr, values = references(make, *names), np.zeros(len(names))
    last = (c_size_t(len(names)),) if instance.version == 3 else ()
    name = "GetReal" if instance.version == 2 else "GetFloat64"
    instance.call(name, c_void_p(vr.ctypes.data), c_size_t(len(names)), c_void_p(values.ctypes.data), *last)
    return values


def write(instance, make, **values):
    return raw_write(instance, references(make, *values), np.array(list(values.values()), float))


def raw_write(instance, vr, values):
    """Status of setting reals."""
    last = (c_size_t(len(vr)),) if instance.version == 3 else ()
    function = instance.function("SetReal" if instance.version == 2 else "SetFloat64")
    return function(
        instance.component, c_void_p(vr.ctypes.data), c_size_t(len(vr)), c_void_p(values.ctypes.data), *last
    )


NULL = c_void_p()


# ---- refusals ----


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused_and_change_nothing(version, value):
    with start(linear, version) as instance:
        write(instance, linear, F=3.0)
        assert write(instance, linear, F=value) == 3
        assert "F must be a finite number" in instance.last_message
        assert read(instance, linear, "F") == 3.0


@BOTH
def test_unknown_references_null_arrays_and_computed_variables_are_refused(version):
    with start(linear, version) as instance:
        for slot in (1000, 2**32 - 1):
            assert raw_write(instance, np.array([slot], np.uint32), np.zeros(1)) == 3
            assert f"value reference {slot}" in instance.last_message
        assert write(instance, linear, R=1.0) == 3 and "R cannot be set" in instance.last_message
        assert (
            write(instance, linear, k=1.0) == 3 and "step mode" in instance.last_message
        )  # fixed after initialization
        name = "GetReal" if version == 2 else "GetFloat64"
        last = (c_size_t(1),) if version == 3 else ()
        assert instance.function(name)(instance.component, NULL, c_size_t(1), NULL, *last) == 3
        assert "NULL" in instance.last_message


@BOTH
def test_a_refused_set_changes_nothing(version):
    with start(linear, version) as instance:
        write(instance, linear, F=1.0)
        vr = np.append(references(linear, "F"), np.uint32(999)).astype(np.uint32)
        assert raw_write(instance, vr, np.array([5.0, 5.0])) == 3
        assert read(instance, linear, "F") == 1.0


@BOTH
def test_a_wrong_token_or_name_gives_no_instance(version):
    from dataclasses import replace

    fmu = unpacked(linear, version)
    with pytest.raises(FmuError, match="token"):
        Instance(replace(fmu, model=replace(fmu.model, token="other")), "CoSimulation")
    with pytest.raises(FmuError, match="name"):
        Instance(replace(fmu, model=replace(fmu.model, name="")), "CoSimulation")


@BOTH
@pytest.mark.parametrize(
    ("t", "h", "sentence"),
    [
        (0.0, 0.0, "positive length"),
        (0.0, -1e-3, "positive length"),
        (0.0, np.nan, "positive length"),
        (0.5, 1e-3, "stands at 0"),
    ],
)
def test_impossible_steps_are_refused(version, t, h, sentence):
    with start(linear, version) as instance, pytest.raises(FmuError, match=sentence):
        Stepper(instance).step(t, h)


def test_a_step_beyond_the_stop_time_is_refused():
    with Instance(unpacked(linear, 2), "CoSimulation") as instance:
        instance.call("SetupExperiment", 0, c_double(0), c_double(0), 1, c_double(0.01))
        instance.call("EnterInitializationMode")
        instance.call("ExitInitializationMode")
        stepper = Stepper(instance)
        stepper.step(0.0, 0.01)
        with pytest.raises(FmuError, match="beyond the stop time"):
            stepper.step(0.01, 1e-3)


@BOTH
def test_a_model_without_answer_at_the_start_fails_there(version):
    with pytest.raises(FmuError, match="ExitInitializationMode"):
        start(effect, version, k3=-1.0)


@BOTH
def test_an_output_that_is_not_a_number_discards_the_step(version):
    with start(effect, version, x=0.1) as instance:
        stepper = Stepper(instance)
        stepper.step(0.0, 1e-3)
        write(instance, effect, a=77.0)
        with pytest.raises(FmuError, match=r"f is not finite at t = 0\.002"):
            stepper.step(1e-3, 1e-3)


@BOTH
def test_a_state_that_overflows_discards_the_step(version):
    with start(linear, version, b=-1e9, x=1.0) as instance:
        before = read(instance, linear, "x", "v")
        with pytest.raises(FmuError, match="no finite solution beyond"):
            Stepper(instance).step(0.0, 1e3)
        if version == 2:  # the last successful time is that before the step
            time = c_double(-1)
            instance.call("GetRealStatus", 2, byref(time))
            assert time.value == 0.0
        np.testing.assert_array_equal(read(instance, linear, "x", "v"), before)


# ---- steps ----


@BOTH
@pytest.mark.parametrize("make", [linear, jenkins, contact])
def test_many_small_steps_are_one_large_step(version, make):
    """The internal step divides both: the trajectory is the same but for the rounding of time."""
    h = make().experiment.step
    results = []
    for pieces in (1, 10):
        with start(make, version, **({"F": 10.0} if make is not contact else {})) as instance:
            stepper = Stepper(instance)
            for k in range(10 * pieces):
                stepper.step(k * 10 * h / pieces, 10 * h / pieces)
            results.append(read(instance, make, "x", "v"))
    np.testing.assert_allclose(results[0], results[1], rtol=1e-12)


@BOTH
def test_reset_makes_the_instance_new(version):
    def run(instance):
        stepper = Stepper(instance)
        for k in range(100):
            stepper.step(k * 1e-3, 1e-3)
        return read(instance, linear, "x", "v")

    with start(linear, version, x=0.01, k=500.0) as instance:
        run(instance)
        instance.call("Reset")
        instance.initialise(0.0, [(unpacked(linear, version).model.variable("x"), 0.01)])
        again = run(instance)
    with start(linear, version, x=0.01) as instance:
        np.testing.assert_array_equal(again, run(instance))


def test_input_derivatives_make_a_polynomial_input_exact():
    """F = t^3: with derivatives to order three, steps of 10 ms follow the same input as steps of 1 ms."""
    vr = references(linear, "F")
    values = {}
    for name, h, order in (("held", 1e-2, 0), ("smooth", 1e-2, 3), ("fine", 1e-3, 3)):
        with start(linear, 2) as instance:
            stepper = Stepper(instance)
            for k in range(round(0.5 / h)):
                t = k * h
                write(instance, linear, F=t**3)
                for n, slope in ((1, 3 * t**2), (2, 6 * t), (3, 6.0)):
                    if n <= order:
                        n_, slope_ = np.array([n], np.intc), np.array([slope])
                        instance.call(
                            "SetRealInputDerivatives",
                            c_void_p(vr.ctypes.data),
                            c_size_t(1),
                            c_void_p(n_.ctypes.data),
                            c_void_p(slope_.ctypes.data),
                        )
                stepper.step(t, h)
            values[name] = read(instance, linear, "x")[0]
    assert abs(values["smooth"] / values["fine"] - 1) < 1e-12
    assert abs(values["held"] / values["fine"] - 1) > 1e-2


# ---- states of the FMU ----


def get_state(instance):
    state = c_void_p()
    instance.call("GetFMUstate" if instance.version == 2 else "GetFMUState", byref(state))
    return state


def as_bytes(instance, state):
    size = c_size_t()
    suffix = "FMUstate" if instance.version == 2 else "FMUState"
    instance.call(f"Serialized{suffix}Size", state, byref(size))
    data = ctypes.create_string_buffer(size.value)
    instance.call(f"Serialize{suffix}", state, data, size)
    return data.raw


def set_bytes(instance, data):
    state = c_void_p()
    name = "DeSerializeFMUstate" if instance.version == 2 else "DeserializeFMUState"
    instance.call(name, data, c_size_t(len(data)), byref(state))
    suffix = "FMUstate" if instance.version == 2 else "FMUState"
    instance.call(f"Set{suffix}", state)
    instance.call(f"Free{suffix}", byref(state))


def steps(instance, make, first, n, h=1e-3):
    stepper = Stepper(instance)
    rows = []
    for k in range(first, first + n):
        if make in (jenkins, linear):
            write(instance, make, F=40 * np.sin(0.13 * k))
        stepper.step(k * h, h)
        rows.append(read(instance, make, *STATES[make]))
    return np.array(rows)


STATES = {jenkins: ("x", "v", "z"), bouncing: ("x", "v", "count"), contact: ("x", "v"), sampled: ("y", "count")}


@BOTH
@pytest.mark.parametrize("make", list(STATES))
def test_a_restored_state_replays_bit_for_bit(version, make):
    with start(make, version) as instance:
        steps(instance, make, 0, 300)
        state = get_state(instance)
        first = steps(instance, make, 300, 300)
        suffix = "FMUstate" if version == 2 else "FMUState"
        instance.call(f"Set{suffix}", state)
        np.testing.assert_array_equal(steps(instance, make, 300, 300), first)
        instance.call(f"Free{suffix}", byref(state))
        assert not state.value


REPLAY = """
import json, sys
sys.path.insert(0, sys.argv[1])
import test_fmu_shell as t
make, version = getattr(t, sys.argv[2]), int(sys.argv[3])
with t.Instance(t.unpacked(make, version), "CoSimulation") as instance:
    t.set_bytes(instance, bytes.fromhex(sys.stdin.read()))
    print(json.dumps(t.steps(instance, make, 300, 50).tolist()))
"""


@pytest.mark.parametrize(("version", "make"), [(2, jenkins), (3, bouncing)])
def test_a_serialised_state_is_taken_by_another_process(version, make):
    with start(make, version) as instance:
        steps(instance, make, 0, 300)
        data = as_bytes(instance, get_state(instance))
        expected = steps(instance, make, 300, 50)
    command = [sys.executable, "-c", REPLAY, str(Path(__file__).parent), make.__name__, str(version)]
    answer = subprocess.run(command, input=data.hex(), capture_output=True, text=True, check=True)
    np.testing.assert_array_equal(np.array(json.loads(answer.stdout)), expected)  # JSON keeps all digits of a double


@BOTH
def test_damaged_or_foreign_bytes_are_refused(version):
    with start(linear, version) as instance, start(jenkins, version) as other:
        data = bytearray(as_bytes(instance, get_state(instance)))
        with pytest.raises(FmuError, match=r"not a state|of another model"):
            set_bytes(other, bytes(data))
        with pytest.raises(FmuError, match="not a state"):
            set_bytes(instance, bytes(data[:-8]))
        data[-3] ^= 1
        with pytest.raises(FmuError, match="damaged"):
            set_bytes(instance, bytes(data))


# ---- derivatives ----


@BOTH
def test_a_state_of_another_model_is_refused(version):
    """Its memory may be shorter than what would be copied."""
    suffix = "FMUstate" if version == 2 else "FMUState"
    with start(linear, version) as other, start(jenkins, version) as instance:
        foreign, kept = get_state(other), get_state(instance)
        for name, arguments in (
            (f"Set{suffix}", (foreign,)),
            (f"Get{suffix}", (byref(foreign),)),
            (f"Serialize{suffix}", (foreign, ctypes.create_string_buffer(4096), c_size_t(4096))),
        ):
            assert instance.function(name)(instance.component, *arguments) == 3, name
            assert "no state of this model" in instance.last_message
            instance.last_message = ""
        other.call(f"Set{suffix}", foreign)  # and it is as it was
        instance.call(f"Set{suffix}", kept)
        instance.call(f"Get{suffix}", byref(kept))  # room that the importer gives is taken
        instance.call(f"Free{suffix}", byref(kept))
        other.call(f"Free{suffix}", byref(foreign))


def directional(instance, make, unknowns, knowns, seed):
    u, k = references(make, *unknowns), references(make, *knowns)
    seed, result = np.asarray(seed, float), np.zeros(len(unknowns))
    sizes = (c_size_t(len(seed)),), (c_size_t(len(result)),)
    if instance.version == 2:
        sizes = (), ()
    instance.call(
        "GetDirectionalDerivative",
        c_void_p(u.ctypes.data),
        c_size_t(len(u)),
        c_void_p(k.ctypes.data),
        c_size_t(len(k)),
        c_void_p(seed.ctypes.data),
        *sizes[0],
        c_void_p(result.ctypes.data),
        *sizes[1],
    )
    return result


@BOTH
@KINDS
def test_directional_derivatives_are_exact(version, kind):
    with start(linear, version, kind, x=0.1, v=0.2) as instance:
        result = directional(instance, linear, ["der(x)", "der(v)", "R", "x"], ["x", "v", "F"], [1.0, 2.0, 3.0])
        np.testing.assert_allclose(result, [2.0, (3 - 800 - 8) / 2, 808.0, 1.0], rtol=1e-15)


def test_adjoint_derivatives_are_the_transpose():
    unknowns, knowns = ["der(x)", "der(v)", "R"], ["x", "v", "F", "k", "m"]
    with start(linear, 3, "ModelExchange", x=0.1, v=0.2) as instance:
        jacobian = np.array([directional(instance, linear, unknowns, knowns, row) for row in np.eye(5)]).T
        u, k = references(linear, *unknowns), references(linear, *knowns)
        for i, seed in enumerate(np.eye(3)):
            result = np.zeros(5)
            instance.call(
                "GetAdjointDerivative",
                c_void_p(u.ctypes.data),
                c_size_t(3),
                c_void_p(k.ctypes.data),
                c_size_t(5),
                c_void_p(seed.ctypes.data),
                c_size_t(3),
                c_void_p(result.ctypes.data),
                c_size_t(5),
            )
            np.testing.assert_allclose(result, jacobian[i], rtol=1e-14)


@BOTH
def test_a_model_without_derivatives_says_so(version):
    with start(contact, version) as instance, pytest.raises(FmuError, match="no directional derivatives"):
        directional(instance, contact, ["R"], ["x"], [1.0])


# ---- events ----


def do_step3(instance, t, h):
    """(event, early, reached) of fmi3DoStep."""
    event, terminate, early, reached = c_bool(), c_bool(), c_bool(), c_double()
    instance.call(
        "DoStep", c_double(t), c_double(h), c_bool(True), byref(event), byref(terminate), byref(early), byref(reached)
    )
    return event.value, early.value, reached.value


class EarlyInstance(Instance):
    """FMI 3 co-simulation with event mode and early return, which the driver never asks for."""

    def _instantiate(self, fmu, kind):
        make = self._library.fmi3InstantiateCoSimulation
        make.restype = c_void_p
        return make(
            fmu.model.name.encode(),
            fmu.model.token.encode(),
            b"",
            c_bool(False),
            c_bool(False),
            c_bool(True),
            c_bool(True),
            None,
            c_size_t(0),
            None,
            self._logger,
            None,
        )


def test_fmi3_returns_early_at_events_and_leaves_them_to_event_mode():
    fmu = unpacked(bouncing, 3)
    with EarlyInstance(fmu, "CoSimulation") as instance:
        instance.initialise(0.0, [])
        instance.new_discrete_states()
        instance.call("EnterStepMode")
        t, instants = 0.0, []
        while t < 1.5 - 1e-9:
            event, early, reached = do_step3(instance, t, min(0.1, 1.5 - t))
            assert early == (reached < t + min(0.1, 1.5 - t) - 1e-12)
            t = reached
            if event:
                instance.call("EnterEventMode")
                changed, _ = instance.new_discrete_states()
                instance.call("EnterStepMode")
                if changed:
                    instants.append(t)
        first = np.sqrt(2 / G)
        expected = first + np.concatenate(
            [[0.0], np.cumsum([2 * first * E ** (i + 1) for i in range(len(instants) - 1)])]
        )
        assert len(instants) == 2  # at 0.45 s and 1.08 s; the third would be at 1.53 s
        np.testing.assert_allclose(instants, expected, rtol=1e-12)


UPDATE = ctypes.CFUNCTYPE(
    None, c_void_p, c_double, c_bool, c_bool, c_bool, c_bool, ctypes.POINTER(c_bool), ctypes.POINTER(c_double)
)


class Updated(Instance):
    """FMI 3 co-simulation with early return and an intermediate update: at(t) sets inputs and may say when to end."""

    def __init__(self, make, at):
        self.at, self.calls = at, []
        super().__init__(unpacked(make, 3), "CoSimulation")

    def _update(self, _environment, t, _set, _get, finished, can_stop, stop, stop_time):
        assert finished and can_stop
        self.calls.append(t)
        answer = self.at(t)
        if answer is not None:
            stop[0], stop_time[0] = True, answer

    def _instantiate(self, fmu, kind):
        make = self._library.fmi3InstantiateCoSimulation
        make.restype = c_void_p
        self._keep = UPDATE(self._update)
        no, yes = c_bool(False), c_bool(True)
        name, token = fmu.model.name.encode(), fmu.model.token.encode()
        return make(name, token, b"", no, no, no, yes, None, c_size_t(0), None, self._logger, self._keep)


@pytest.mark.parametrize(("wanted", "ends"), [(0.005, 0.005), (0.0052, 0.0052), (0.5, 0.01), (0.001, 0.004)])
def test_fmi3_intermediate_update_may_set_inputs_and_stop_the_step(wanted, ends):
    """The callback gives F = t at each internal step, and at 4 ms or after asks for an end: there, further on within an
    internal step, beyond the step, or in the past, which is at once."""

    def at(t):
        assert write(instance, linear, F=t) == 0
        return wanted if t >= 0.004 - 1e-9 else None

    with Updated(linear, at) as instance:
        instance.initialise(0.0, [])
        event, early, reached = do_step3(instance, 0.0, 0.01)
        assert (event, early) == (False, ends < 0.01) and reached == pytest.approx(ends, rel=1e-12)
        whole = np.arange(1, 11) * 1e-3
        np.testing.assert_allclose(instance.calls, np.unique([*whole[whole < ends - 1e-9], ends]))
        assert read(instance, linear, "F")[0] == pytest.approx(ends)
        _, early, reached = do_step3(instance, reached, 0.02 - reached)  # and on from there
        assert reached == pytest.approx(0.02) or early


def test_memory_moves_once_a_step_whatever_the_callback_asks():
    """One doStep of a block without states is one sample, with and without intermediate update and early return."""

    def run(at):
        with Updated(memory, at) as instance:
            instance.initialise(0.0, [])
            forces = []
            for k in range(60):
                write(instance, memory, x=np.sin(0.4 * k), v=np.cos(0.4 * k))
                _, early, reached = do_step3(instance, 0.01 * k, 0.01)
                assert not early and reached == pytest.approx(0.01 * (k + 1))
                forces.append(read(instance, memory, "R")[0])
            assert len(instance.calls) == 60
            return np.array(forces)

    with start(memory, 3) as instance:
        stepper, plain = Stepper(instance), []
        for k in range(60):
            write(instance, memory, x=np.sin(0.4 * k), v=np.cos(0.4 * k))
            stepper.step(0.01 * k, 0.01)
            plain.append(read(instance, memory, "R")[0])
    np.testing.assert_array_equal(run(lambda t: None), plain)
    np.testing.assert_array_equal(run(lambda t: t), plain)


@BOTH
def test_model_exchange_shows_indicators_and_time_events(version):
    with start(bouncing, version, "ModelExchange", x=1e-3) as instance:
        _, next_time = instance.new_discrete_states()
        assert next_time == np.inf
        instance.call("EnterContinuousTimeMode")
        z, x = np.zeros(1), np.array([-1e-6, -1.0])
        instance.call("GetEventIndicators", c_void_p(z.ctypes.data), c_size_t(1))
        assert z[0] > 0
        instance.call("SetTime", c_double(0.1))
        instance.call("SetContinuousStates", c_void_p(x.ctypes.data), c_size_t(2))
        instance.call("GetEventIndicators", c_void_p(z.ctypes.data), c_size_t(1))
        assert z[0] < 0
        instance.call("EnterEventMode")
        assert instance.new_discrete_states() == (True, np.inf)
        instance.call("GetContinuousStates", c_void_p(x.ctypes.data), c_size_t(2))
        np.testing.assert_allclose(x, [-1e-6, E])
    with start(sampled, version, "ModelExchange") as instance:
        assert instance.new_discrete_states() == (False, pytest.approx(0.1))


@BOTH
def test_an_indicator_that_starts_at_zero_changes_sign_when_it_leaves(version):
    with start(bouncing, version, "ModelExchange", x=0.0) as instance:
        instance.new_discrete_states()
        instance.call("EnterContinuousTimeMode")
        z = np.zeros(1)
        instance.call("GetEventIndicators", c_void_p(z.ctypes.data), c_size_t(1))
        at_zero = z[0]
        for side in (-1e-9, 1e-9):
            x = np.array([side, 0.0])
            instance.call("SetContinuousStates", c_void_p(x.ctypes.data), c_size_t(2))
            instance.call("GetEventIndicators", c_void_p(z.ctypes.data), c_size_t(1))
            assert (at_zero > 0) != (z[0] > 0)


@BOTH
def test_zeno_ends_the_run_with_its_name_in_the_log(version):
    with start(bouncing, version) as instance:
        stepper = Stepper(instance)
        with pytest.raises(FmuError, match="Zeno"):
            for k in range(400):
                stepper.step(k * 0.01, 0.01)


@BOTH
def test_memory_takes_each_step_once(version):
    """Co-simulation of a block without states: the step made with x[k], v[k] shows the force of sample k."""
    x, v = [0.0, 1.0, 2.0, 1.0, 0.0], [1.0, 1.0, 1.0, -1.0, -1.0]
    with start(memory, version) as instance:
        stepper, forces = Stepper(instance), []
        for k in range(5):
            write(instance, memory, x=x[k], v=v[k])
            stepper.step(k * 1e-4, 1e-4)
            forces.append(read(instance, memory, "R")[0])
    np.testing.assert_allclose(forces, [0.0, 100.0, 200.0, 107.0, 7.0])


# ---- threads ----


@BOTH
def test_instances_in_threads_do_not_see_each_other(version):
    """Each thread runs its own stiffness; the results are those of runs one after the other."""

    def run(k, results):
        with start(linear, version, x=0.01, k=k) as instance:
            stepper = Stepper(instance)
            for i in range(500):
                stepper.step(i * 1e-3, 1e-3)
            results[k] = read(instance, linear, "x", "v")

    unpacked(linear, version)
    alone, together = {}, {}
    stiffnesses = [100.0 * (i + 1) for i in range(8)]
    for k in stiffnesses:
        run(k, alone)
    threads = [threading.Thread(target=run, args=(k, together)) for k in stiffnesses]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in stiffnesses:
        np.testing.assert_array_equal(alone[k], together[k])


@BOTH
def test_a_million_summed_steps_reach_the_stop_time(version):
    """An importer that adds the step to the time is off by a rounding per step: 2e-10 s after 100,000 steps of 1e-4 s
    at 1,000 s, where 1e-6 of a step are 1e-10 s. The stop time is reached, and one whole step more is refused."""
    step, begin, n = 1e-4, 1000.0, 100_000
    with Instance(unpacked(linear, version), "CoSimulation") as instance:
        stop = begin + n * step
        if version == 2:
            instance.call("SetupExperiment", 0, c_double(0), c_double(begin), 1, c_double(stop))
            instance.call("EnterInitializationMode")
        else:
            instance.call(
                "EnterInitializationMode", c_bool(False), c_double(0), c_double(begin), c_bool(True), c_double(stop)
            )
        instance.call("ExitInitializationMode")
        stepper, t = Stepper(instance), begin
        for _ in range(n):
            stepper.step(t, step)
            t += step
        assert abs(t - stop) > 1e-6 * step  # there is something to let pass
        with pytest.raises(FmuError, match="goes beyond the stop time"):
            stepper.step(t, step)
