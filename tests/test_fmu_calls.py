"""Every function of the standards' headers in every mode of both kinds: legal calls succeed, others return an error and
say why, none ends the process."""

from __future__ import annotations

import ctypes
import re
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_uint64, c_void_p
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from fmu_models import effect, linear, sampled, tuned, unpacked

import hystid.fmu
from hystid.errors import FmuError
from hystid.fmu import build_model
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Instance

HEADERS = Path(hystid.fmu.__file__).parent / "shell" / "fmi"
BOTH = pytest.mark.parametrize("version", [2, 3])
KINDS = pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
NULL, ZERO, TWO = c_void_p(), c_size_t(0), c_size_t(2)

# Modes: I instantiated, N initialization, E event, C continuous-time, S step, D step discarded, T terminated.
# A call: (arguments, modes in model exchange, modes in co-simulation). FMI 2.0.4: tables of 3.2.3 and 4.2.4; FMI 3.0.2:
# the "allowed function calls" of 2.3, 3.2 and 4.2. In FMI 3 a discarded step leaves step mode as it was.
ANY_ME, ANY_CS = "INECT", "INSDT"
TWO_REALS = (byref((c_double * 2)()), TWO)
NONE_2 = (NULL, ZERO, NULL)
STATUS = (c_int(0), byref(c_int()))
CALLS_2 = {
    "SetDebugLogging": ((1, ZERO, NULL), ANY_ME, ANY_CS),
    "SetupExperiment": ((0, c_double(0), c_double(0), 0, c_double(0)), "I", "I"),
    "EnterInitializationMode": ((), "I", "I"),
    "ExitInitializationMode": ((), "N", "N"),
    "Terminate": ((), "EC", "SD"),
    "Reset": ((), ANY_ME, ANY_CS),
    "GetReal": (NONE_2, "NECT", "NSDT"),
    "GetInteger": (NONE_2, "NECT", "NSDT"),
    "GetBoolean": (NONE_2, "NECT", "NSDT"),
    "GetString": (NONE_2, "NECT", "NSDT"),
    "SetReal": (NONE_2, "INEC", "INS"),
    "SetInteger": (NONE_2, "INEC", "INS"),
    "SetBoolean": (NONE_2, "INEC", "INS"),
    "SetString": (NONE_2, "INEC", "INS"),
    "GetFMUstate": ((byref(c_void_p()),), ANY_ME, ANY_CS),
    "FreeFMUstate": ((byref(c_void_p()),), ANY_ME, ANY_CS),
    "GetDirectionalDerivative": ((NULL, ZERO, NULL, ZERO, NULL, NULL), "NECT", "NSDT"),
    "EnterEventMode": ((), "EC", ""),
    "NewDiscreteStates": ((ctypes.create_string_buffer(64),), "E", ""),
    "EnterContinuousTimeMode": ((), "E", ""),
    "CompletedIntegratorStep": ((1, byref(c_int()), byref(c_int())), "C", ""),
    "SetTime": ((c_double(0),), "EC", ""),
    "SetContinuousStates": (TWO_REALS, "C", ""),
    "GetContinuousStates": (TWO_REALS, "NECT", ""),
    "GetDerivatives": (TWO_REALS, "NECT", ""),
    "GetEventIndicators": ((NULL, ZERO), "NECT", ""),
    "GetNominalsOfContinuousStates": (TWO_REALS, "INECT", ""),
    "SetRealInputDerivatives": ((NULL, ZERO, NULL, NULL), "", "INS"),
    "GetRealOutputDerivatives": ((NULL, ZERO, NULL, NULL), "", "SDT"),
    "DoStep": ((c_double(0), c_double(1e-3), 1), "", "S"),
    "CancelStep": ((), "", ""),
    "GetStatus": (STATUS, "", "SDT"),
    "GetRealStatus": ((2, byref(c_double())), "", "SDT"),
    "GetBooleanStatus": ((3, byref(c_int())), "", "SDT"),
    "GetStringStatus": ((1, byref(c_char_p())), "", "SDT"),
}
NONE_3 = (NULL, ZERO, NULL, ZERO)
FLAGS = tuple(byref(c_bool()) for _ in range(5))
CALLS_3 = {
    "SetDebugLogging": ((c_bool(True), ZERO, NULL), ANY_ME, ANY_CS),
    "EnterInitializationMode": ((c_bool(False), c_double(0), c_double(0), c_bool(False), c_double(0)), "I", "I"),
    "ExitInitializationMode": ((), "N", "N"),
    "EnterEventMode": ((), "C", ""),
    "Terminate": ((), "EC", "SD"),
    "Reset": ((), ANY_ME, ANY_CS),
    "GetFMUState": ((byref(c_void_p()),), ANY_ME, ANY_CS),
    "FreeFMUState": ((byref(c_void_p()),), ANY_ME, ANY_CS),
    "GetDirectionalDerivative": ((NULL, ZERO, NULL, ZERO, NULL, ZERO, NULL, ZERO), "NECT", "NSDT"),
    "GetAdjointDerivative": ((NULL, ZERO, NULL, ZERO, NULL, ZERO, NULL, ZERO), "NECT", "NSDT"),
    "EnterConfigurationMode": ((), "", ""),
    "ExitConfigurationMode": ((), "", ""),
    "EvaluateDiscreteStates": ((), "E", ""),
    "UpdateDiscreteStates": ((*FLAGS, byref(c_double())), "E", ""),
    "EnterContinuousTimeMode": ((), "E", ""),
    "CompletedIntegratorStep": ((c_bool(True), *FLAGS[:2]), "C", ""),
    "SetTime": ((c_double(0),), "EC", ""),
    "SetContinuousStates": (TWO_REALS, "C", ""),
    "GetContinuousStates": (TWO_REALS, "NECT", ""),
    "GetContinuousStateDerivatives": (TWO_REALS, "NECT", ""),
    "GetEventIndicators": ((NULL, ZERO), "NECT", ""),
    "GetNominalsOfContinuousStates": (TWO_REALS, "INECT", ""),
    "GetNumberOfContinuousStates": ((byref(c_size_t()),), "INECT", ""),
    "GetNumberOfEventIndicators": ((byref(c_size_t()),), "INECT", ""),
    "EnterStepMode": ((), "", ""),
    "GetOutputDerivatives": ((NULL, ZERO, NULL, NULL, ZERO), "", "SDT"),
    "DoStep": ((c_double(0), c_double(1e-3), c_bool(True), *FLAGS[:3], byref(c_double())), "", "SD"),
    "ActivateModelPartition": ((c_uint(0), c_double(0)), "", ""),
    "GetNumberOfVariableDependencies": ((c_uint(1), byref(c_size_t())), "", ""),
    "GetVariableDependencies": ((c_uint(1), NULL, NULL, NULL, NULL, ZERO), "", ""),
}
for _name in ("Float64", "Float32", "Boolean", "String", *(f"{s}Int{n}" for s in ("", "U") for n in (8, 16, 32, 64))):
    CALLS_3[f"Get{_name}"] = (NONE_3, "INECT", "INSDT")  # start values can be read before the start
    CALLS_3[f"Set{_name}"] = (NONE_3, "INEC", "INSD")
CALLS_3["GetBinary"] = ((NULL, ZERO, NULL, NULL, ZERO), "INECT", "INSDT")
CALLS_3["SetBinary"] = ((NULL, ZERO, NULL, NULL, ZERO), "INEC", "INSD")
for _name, _arrays in (("Clock", 1), ("IntervalDecimal", 2), ("IntervalFraction", 3), ("ShiftDecimal", 1),
                       ("ShiftFraction", 2)):  # fmt: skip
    CALLS_3[f"Get{_name}"] = ((NULL, ZERO, *[NULL] * _arrays), "NE", "N")
for _name, _arrays in (("Clock", 1), ("IntervalDecimal", 1), ("IntervalFraction", 2), ("ShiftDecimal", 1),
                       ("ShiftFraction", 2)):  # fmt: skip
    CALLS_3[f"Set{_name}"] = ((NULL, ZERO, *[NULL] * _arrays), "NE", "N")
CALLS = {2: CALLS_2, 3: CALLS_3}
# legal or not by what they are given rather than by the mode: tested apart
OTHERS = {
    2: {"GetTypesPlatform", "GetVersion", "Instantiate", "FreeInstance", "SetFMUstate", "SerializedFMUstateSize",
        "SerializeFMUstate", "DeSerializeFMUstate", "GetIntegerStatus"},
    3: {"GetVersion", "InstantiateModelExchange", "InstantiateCoSimulation", "InstantiateScheduledExecution",
        "FreeInstance", "SetFMUState", "SerializedFMUStateSize", "SerializeFMUState", "DeserializeFMUState"},
}  # fmt: skip


def instance_in(mode, version, kind):
    """A fresh instance of the linear oscillator brought into a mode, or None where the kind has no such mode."""
    if mode in ("EC" if kind == "CoSimulation" else "SD"):
        return None
    fmu = unpacked(linear, version)
    instance = Instance(fmu, kind)
    if mode == "I":
        return instance
    if mode == "D":  # a damper that drives, so that the state overflows within the step
        instance.set([(fmu.model.variable("b"), -1e9), (fmu.model.variable("x"), 1.0)])
    if version == 2:
        instance.call("SetupExperiment", 0, c_double(0), c_double(0), 0, c_double(0))
        instance.call("EnterInitializationMode")
    else:
        nothing = (c_bool(False), c_double(0))
        instance.call("EnterInitializationMode", *nothing, c_double(0), *nothing)
    if mode == "N":
        return instance
    instance.call("ExitInitializationMode")
    if mode == "C":
        instance.new_discrete_states()
        instance.call("EnterContinuousTimeMode")
    if mode == "D":
        first, last = CALLS[version]["DoStep"][0], c_double(1e3)
        assert instance.function("DoStep")(instance.component, first[0], last, *first[2:]) == 2
    if mode == "T":
        instance.call("Terminate")
    return instance


@BOTH
def test_the_tables_hold_every_function_of_the_header(version):
    text = (HEADERS / f"fmi{version}Functions.h").read_text()
    declared = set(re.findall(rf"_Export\s+fmi{version}\w+TYPE\s+fmi{version}(\w+)\s*;", text))
    assert len(declared) > 40
    assert declared == set(CALLS[version]) | OTHERS[version]
    library = Instance(unpacked(linear, version), "CoSimulation")._library
    assert all(hasattr(library, f"fmi{version}{name}") for name in declared)


@BOTH
@KINDS
def test_every_call_is_answered_in_every_mode(version, kind):
    for (name, (arguments, *legal)), mode in product(CALLS[version].items(), "INECSDT"):
        instance = instance_in(mode, version, kind)
        if instance is None:
            continue
        with instance:
            instance.last_message = ""
            status = instance.function(name)(instance.component, *arguments)
            if mode in legal[kind == "CoSimulation"]:
                # after the discarded step the same step is short enough
                assert status == 0, (name, mode, instance.last_message)
            else:
                assert status == 3, (name, mode)
                assert instance.last_message


@BOTH
def test_a_call_says_what_it_is_and_where_it_was_made(version):
    with instance_in("S", version, "CoSimulation") as instance:
        assert instance.function("SetTime")(instance.component, c_double(0)) == 3
        assert instance.last_message == f"fmi{version}SetTime is not allowed here: it is a function of model exchange"
        assert instance.function("ExitInitializationMode")(instance.component) == 3
        assert instance.last_message.endswith("not allowed here: the instance is in step mode")


@BOTH
def test_null_instances_are_refused(version):
    with instance_in("S", version, "CoSimulation") as instance:
        for name, (arguments, *_) in CALLS[version].items():
            assert instance.function(name)(NULL, *arguments) == 3, name
        free = getattr(instance._library, f"fmi{version}FreeInstance")
        free(NULL)


@BOTH
def test_a_failed_instance_shows_its_values_and_can_be_reset(version):
    fmu = unpacked(effect, version)
    with Instance(fmu, "CoSimulation") as instance:
        with pytest.raises(FmuError, match="ExitInitializationMode"):
            instance.initialise(0.0, [(fmu.model.variable("k3"), -1.0)])
        assert get(instance, [1]) == (0, np.array([-1.0]))  # for debugging only
        assert put(instance, [1], [1.0]) == 3
        assert instance.function("Terminate")(instance.component) == 3
        instance.call("Reset")
        instance.initialise(0.0, [])


# ---- what is given ----


def array(values, dtype):
    found = np.array(values, dtype)
    return found, c_void_p(found.ctypes.data)


def get(instance, slots, name="Real"):
    """(status, values)."""
    name = {"Real": "Float64"}.get(name, name) if instance.version == 3 else name
    vr, at = array(slots, np.uint32)
    values, to = array(np.zeros(len(slots)), np.float64)
    last = (c_size_t(len(slots)),) if instance.version == 3 else ()
    return instance.function(f"Get{name}")(instance.component, at, c_size_t(len(vr)), to, *last), values


def put(instance, slots, values, name="Real", dtype=np.float64):
    """Status."""
    name = {"Real": "Float64", "Integer": "Int32"}.get(name, name) if instance.version == 3 else name
    vr, at = array(slots, np.uint32)
    _held, data = array(values, dtype)
    last = (c_size_t(len(values)),) if instance.version == 3 else ()
    return instance.function(f"Set{name}")(instance.component, at, c_size_t(len(vr)), data, *last)


@BOTH
def test_computed_variables_constants_and_time_are_never_set(version):
    slots = {v.name: v.slot for v in linear().variables} | {"time": 0}
    for mode in "INS":
        with instance_in(mode, version, "CoSimulation") as instance:
            for name in ("R", "der(x)", "time"):
                assert put(instance, [slots[name]], [1.0]) == 3, (mode, name)
                assert f"{name} cannot be set" in instance.last_message


@BOTH
def test_parameters_after_the_start_fixed_refused_tunable_taken(version):
    with Instance(unpacked(tuned, version), "CoSimulation") as instance:
        instance.initialise(0.0, [])
        fixed, tunable, product_, output = 1, 2, 3, 5
        assert put(instance, [fixed], [2.0]) == 3 and "cannot be set" in instance.last_message
        assert put(instance, [tunable], [5.0]) == 0
        assert get(instance, [product_, output])[1].tolist() == [10.0, 10.0]  # the dependent parameter follows
    with Instance(unpacked(tuned, version), "ModelExchange") as instance:
        instance.initialise(0.0, [])
        assert put(instance, [tunable], [7.0]) == 0  # in event mode
        instance.new_discrete_states()
        instance.call("EnterContinuousTimeMode")
        assert put(instance, [tunable], [8.0]) == 3 and "continuous-time" in instance.last_message


@BOTH
def test_between_events_a_solver_sets_continuous_inputs_and_states(version):
    slots = {v.name: v.slot for v in linear().variables}
    with instance_in("C", version, "ModelExchange") as instance:
        assert put(instance, [slots["F"], slots["v"]], [2.0, 0.25]) == 0
        status, values = get(instance, [slots["v"], slots["der(x)"]])
        assert status == 0 and values.tolist() == [0.25, 0.25]
        assert put(instance, [slots["k"]], [1.0]) == 3
    with Instance(unpacked(tuned, version), "ModelExchange") as instance:
        instance.initialise(0.0, [])
        instance.new_discrete_states()
        instance.call("EnterContinuousTimeMode")
        level = next(v.slot for v in tuned().variables if v.name == "level")
        assert put(instance, [level], [0], "Integer", np.int32) == 0  # as it stood
        assert put(instance, [level], [1], "Integer", np.int32) == 3
        assert "level cannot be set while the instance is in continuous-time mode" in instance.last_message
        instance.call("EnterEventMode")
        assert put(instance, [level], [1], "Integer", np.int32) == 0


@BOTH
def test_whole_numbers_too_are_taken_all_or_none(version):
    level = next(v.slot for v in tuned().variables if v.name == "level")
    with Instance(unpacked(tuned, version), "CoSimulation") as instance:
        instance.initialise(0.0, [])
        assert put(instance, [level, 999], [4, 4], "Integer", np.int32) == 3
        assert "value reference 999" in instance.last_message
        assert get(instance, [5])[1][0] == 6.0  # gain * rate + level, with level 0


def test_fmi3_shows_start_values_before_the_start():
    slots = {v.name: v.slot for v in linear().variables}
    with instance_in("I", 3, "CoSimulation") as instance:
        assert get(instance, [slots["k"], slots["x"]])[1].tolist() == [800.0, 0.0]
        assert put(instance, [slots["k"]], [900.0]) == 0
        assert get(instance, [slots["k"]])[1][0] == 900.0


@BOTH
def test_lengths_that_do_not_match_are_refused(version):
    with instance_in("C", version, "ModelExchange") as instance:
        three = byref((c_double * 3)())
        for name in ("SetContinuousStates", "GetContinuousStates", "GetNominalsOfContinuousStates"):
            for n in (0, 1, 3):
                assert instance.function(name)(instance.component, three, c_size_t(n)) == 3, (name, n)
                assert "an array of 2" in instance.last_message
        assert instance.function("GetEventIndicators")(instance.component, three, c_size_t(1)) == 3
        if version == 3:
            vr, values = (c_uint * 2)(1, 2), (c_double * 3)()
            for n, m in ((2, 3), (2, 1), (0, 1)):
                for name in ("GetFloat64", "SetFloat64"):
                    function = instance.function(name)
                    assert function(instance.component, vr, c_size_t(n), values, c_size_t(m)) == 3, (name, n, m)


@BOTH
def test_log_categories_are_those_of_the_description(version):
    with instance_in("S", version, "CoSimulation") as instance:
        function = instance.function("SetDebugLogging")
        on = 1 if version == 2 else c_bool(True)
        known = (c_char_p * 2)(b"logEvents", b"logStatusError")
        assert function(instance.component, on, TWO, known) == 0
        for bad in ((c_char_p * 2)(b"logEvents", b"logAll"), (c_char_p * 2)(b"logEvents", None)):
            assert function(instance.component, on, TWO, bad) == 3
            assert "there is no category" in instance.last_message
        assert function(instance.component, on, TWO, NULL) == 3


@BOTH
@KINDS
def test_a_wrong_name_token_or_kind_gives_no_instance(version, kind):
    fmu = unpacked(linear, version)
    with pytest.raises(FmuError, match="token"):
        Instance(replace(fmu, model=replace(fmu.model, token="other")), kind)
    with pytest.raises(FmuError, match="name"):
        Instance(replace(fmu, model=replace(fmu.model, name="")), kind)
    library = Instance(fmu, kind)._library
    if version == 2:
        library.fmi2Instantiate.restype = c_void_p
        callbacks = (c_void_p * 5)()  # no logger, no memory functions: all may be missing
        good = (b"name", 1, fmu.model.token.encode(), b"")
        assert library.fmi2Instantiate(*good, NULL, 0, 0) is None
        assert library.fmi2Instantiate(b"name", 2, *good[2:], byref(callbacks), 0, 0) is None
        assert library.fmi2Instantiate(None, *good[1:], byref(callbacks), 0, 0) is None
        assert library.fmi2Instantiate(*good[:2], None, b"", byref(callbacks), 0, 0) is None
        made = library.fmi2Instantiate(*good, byref(callbacks), 0, 1)
        assert made and library.fmi2DoStep(c_void_p(made), c_double(0), c_double(1), 1) == 3  # and nobody is told
        library.fmi2FreeInstance(c_void_p(made))
        return
    make = getattr(library, f"fmi3Instantiate{kind}")
    make.restype = c_void_p
    rest = (None, c_bool(False), c_bool(True))
    extra = (c_bool(False), c_bool(False), None, ZERO) if kind == "CoSimulation" else ()
    update = (None,) if kind == "CoSimulation" else ()
    for name, token in ((None, fmu.model.token.encode()), (b"", fmu.model.token.encode()), (b"name", None)):
        assert make(name, token, *rest, *extra, None, None, *update) is None
    made = make(b"name", fmu.model.token.encode(), *rest, *extra, None, None, *update)
    assert made and library.fmi3ExitInitializationMode(c_void_p(made)) == 3  # and nobody is told
    library.fmi3FreeInstance(c_void_p(made))
    library.fmi3InstantiateScheduledExecution.restype = c_void_p
    assert library.fmi3InstantiateScheduledExecution(*[None] * 10) is None


@BOTH
def test_states_of_the_fmu_where_nothing_is_given(version):
    end = "state" if version == 2 else "State"
    with instance_in("S", version, "CoSimulation") as instance:
        size = byref(c_size_t())
        read = "DeSerializeFMUstate" if version == 2 else "DeserializeFMUState"
        for name, arguments in (
            (f"GetFMU{end}", (NULL,)),
            (f"SetFMU{end}", (NULL,)),
            (f"SerializedFMU{end}Size", (NULL, size)),
            (f"SerializeFMU{end}", (NULL, NULL, ZERO)),
            (read, (NULL, ZERO, NULL)),
            (read, (b"short", c_size_t(5), byref(c_void_p()))),
        ):
            assert instance.function(name)(instance.component, *arguments) == 3, name
            assert instance.last_message
            instance.last_message = ""
        instance.call(f"FreeFMU{end}", NULL)
        kept = c_void_p()
        instance.call(f"GetFMU{end}", byref(kept))
        short = ctypes.create_string_buffer(16)
        assert instance.function(f"SerializeFMU{end}")(instance.component, kept, short, c_size_t(16)) == 3
        with instance_in("C", version, "ModelExchange") as other:
            assert other.function(f"SetFMU{end}")(other.component, kept) == 3
            assert "does not fit" in other.last_message
        instance.call(f"FreeFMU{end}", byref(kept))
        assert not kept.value
        instance.call(f"FreeFMU{end}", byref(kept))


@BOTH
@pytest.mark.parametrize(
    ("start", "stop", "sentence"),
    [(np.nan, None, "start time"), (np.inf, None, "start time"), (0.0, np.nan, "stop time"), (1.0, 0.5, "stop time")],
)
def test_impossible_experiments_are_refused(version, start, stop, sentence):
    with instance_in("I", version, "CoSimulation") as instance:
        has, end = stop is not None, c_double(0.0 if stop is None else stop)
        if version == 2:
            name, arguments = "SetupExperiment", (0, c_double(0), c_double(start), int(has), end)
        else:
            name = "EnterInitializationMode"
            arguments = (c_bool(False), c_double(0), c_double(start), c_bool(has), end)
        assert instance.function(name)(instance.component, *arguments) == 3
        assert sentence in instance.last_message


@pytest.mark.parametrize("h", [1e-12, 1e-9, 0.3, 7.0])
@BOTH
def test_steps_of_any_length_are_taken(version, h):
    """Steps far below and above the model's own, and a clock that an importer adds up itself."""
    fmu = unpacked(sampled, version)
    with Instance(fmu, "CoSimulation") as instance:
        instance.initialise(0.0, [])
        t = 0.0
        for _ in range(20):
            last = (1,) if version == 2 else (c_bool(True), *FLAGS[:3], byref(c_double()))
            instance.call("DoStep", c_double(t), c_double(h), *last)
            t += h
        assert get(instance, [0])[1][0] == pytest.approx(t, rel=1e-15, abs=1e-26)


def test_cancelling_and_the_status_functions_of_fmi2():
    with instance_in("S", 2, "CoSimulation") as instance:
        assert instance.function("CancelStep")(instance.component) == 3
        value, real, text = c_int(7), c_double(7), c_char_p()
        for name, target in (("", value), ("Real", real), ("Integer", value), ("Boolean", value), ("String", text)):
            kinds = {"": 0, "String": 1, "Real": 2, "Boolean": 3}
            for kind in range(4):
                status = instance.function(f"Get{name}Status")(instance.component, kind, byref(target))
                assert status == (0 if kinds.get(name) == kind else 2), (name, kind)
            if name in kinds:
                assert instance.function(f"Get{name}Status")(instance.component, kinds[name], NULL) == 3
    with instance_in("D", 2, "CoSimulation") as instance:
        instance.call("GetStatus", 0, byref(value))
        assert value.value == 2


def test_functions_of_types_and_clocks_that_the_model_has_not():
    with instance_in("N", 3, "CoSimulation") as instance:
        vr, eight, one = (c_uint * 1)(1), (c_uint64 * 1)(), c_size_t(1)
        for name in ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "String"):
            for verb in ("Get", "Set"):
                assert instance.function(verb + name)(instance.component, vr, one, eight, one) == 3
                assert re.search("no variables? of this type|there is no String", instance.last_message), name
        assert instance.function("GetClock")(instance.component, vr, one, eight) == 3
        assert "no clocks" in instance.last_message


def test_derivatives_by_time_are_those_of_the_description():
    """Knowns may be inputs, states, parameters and time; unknowns outputs and derivatives."""
    with instance_in("S", 3, "CoSimulation") as instance:
        slots = {v.name: v.slot for v in linear().variables} | {"time": 0}
        unknown, known = (c_uint * 1)(slots["der(v)"]), (c_uint * 1)(0)
        seed, answer = (c_double * 1)(1.0), (c_double * 1)(9.0)
        one = c_size_t(1)
        instance.call("GetDirectionalDerivative", unknown, one, known, one, seed, one, answer, one)
        assert answer[0] == 0.0
        instance.call("GetAdjointDerivative", unknown, one, known, one, seed, one, answer, one)
        assert answer[0] == 0.0
        function = instance.function("GetDirectionalDerivative")
        for names in (("F", "x"), ("der(v)", "R")):
            pair = [(c_uint * 1)(slots[name]) for name in names]
            assert function(instance.component, pair[0], one, pair[1], one, seed, one, answer, one) == 3
        assert function(instance.component, unknown, one, known, one, seed, c_size_t(2), answer, one) == 3


RHEONOMOUS = """
model Rheonomous "outputs of every sort: of time, another name of an input, discrete"
  parameter Real k = 2;
  input Real u;
  output Real y = k*sin(3*time) + u^2;
  output Real again = u;
  output Real x(start = 1, fixed = true);
  discrete output Real held(start = 0, fixed = true);
equation
  der(x) = u - x + held;
  when sample(0, 0.1) then
    held = x;
  end when;
end Rheonomous;
"""


@BOTH
def test_every_real_output_has_a_derivative_by_every_known(tmp_path, version):
    """Importers ask for all outputs at once; a discrete one stands between events."""
    (tmp_path / "Rheonomous.mo").write_text(RHEONOMOUS)
    path = build_model(f"{tmp_path / 'Rheonomous.mo'}:Rheonomous", tmp_path / "m.fmu", fmi=version).path
    fmu = open_fmu(path)
    names, knowns = ["y", "again", "x", "held", "der(x)"], ["time", "u", "x", "k", "held"]
    slots = [[fmu.model.variable(n).slot for n in group] for group in (names, knowns)]
    with Instance(fmu, "CoSimulation") as instance:
        instance.initialise(0.0, [(fmu.model.variable("u"), 0.5)])
        last = (1,) if version == 2 else (c_bool(True), *FLAGS[:3], byref(c_double()))
        instance.call("DoStep", c_double(0), c_double(0.05), *last)
        found, back = np.zeros((5, 5)), np.zeros((5, 5))
        unknown, known = (c_uint * 5)(*slots[0]), (c_uint * 5)(*slots[1])
        for i in range(5):
            seed, answer = (c_double * 5)(*np.eye(5)[i]), (c_double * 5)()
            n = c_size_t(5)
            lengths = (seed, n, answer, n) if version == 3 else (seed, answer)
            instance.call("GetDirectionalDerivative", unknown, n, known, n, *lengths)
            found[:, i] = answer
            if version == 3:
                instance.call("GetAdjointDerivative", unknown, n, known, n, *lengths)
                back[i] = answer
        at = 3 * 0.05
        expected = np.array(
            [
                [6 * np.cos(at), 1.0, 0, np.sin(at), 0],
                [0, 1.0, 0, 0, 0],
                [0, 0, 1.0, 0, 0],
                [0, 0, 0, 0, 1.0],
                [0, 1.0, -1.0, 0, 1.0],
            ]
        )
        np.testing.assert_allclose(found, expected, atol=1e-14)
        if version == 3:
            np.testing.assert_allclose(back, expected, atol=1e-14)
