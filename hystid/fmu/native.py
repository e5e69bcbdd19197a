"""One FMU instance through ctypes, with arrays prepared once: what FMPy builds anew at each call is built here never.

Addresses instead of arrays go into the hot calls, so that a row of a table is read or written in place.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from itertools import pairwise
from typing import Any, Literal, NoReturn

import numpy as np

from hystid.errors import FmuError, first_line
from hystid.fmu.door import Kind, OpenedFmu
from hystid.fmu.signals import Signal
from hystid.limits import FMU_UNPACKED
from hystid.modelcode import Variable

KindName = Literal["CoSimulation", "ModelExchange"]

_LOG2 = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)
_LOG3 = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
_DISCARD = 2


class _Callbacks(ctypes.Structure):
    _fields_ = (
        ("logger", _LOG2),
        ("allocate", c_void_p),
        ("free", c_void_p),
        ("finished", c_void_p),
        ("environment", c_void_p),
    )


class _EventInfo(ctypes.Structure):
    _fields_ = (
        *((name, c_int) for name in ("needed", "terminate", "nominals", "values", "defined")),
        ("time", c_double),
    )


class Access:
    """Getting or setting a fixed list of numeric variables of one type, one row of elements at a time."""

    def __init__(self, instance: Instance, variables: Sequence[Variable | Signal]) -> None:
        signals = [instance.signals[v.name] for v in variables]
        self.dtype: np.dtype[Any] = signals[0].dtype
        self.references = np.array([s.reference for s in signals], np.uint32)
        self.names = [s.name for s in signals]
        self.shaped = {s.name: bool(s.shape) for s in signals}
        ends = np.cumsum([0, *(s.size for s in signals)]).tolist()
        self.parts = {s.name: slice(ends[i], ends[i + 1]) for i, s in enumerate(signals)}
        self.count = int(ends[-1])
        self._arguments = (instance.component, c_void_p(self.references.ctypes.data), c_size_t(len(signals)))
        self._last = (c_size_t(self.count),) if instance.version == 3 else ()
        self._get = instance.function(f"Get{signals[0].suffix}")
        self._set = instance.function(f"Set{signals[0].suffix}")
        self._instance = instance

    def get(self, address: int) -> None:
        """Write the present values to the array at this address."""
        if self._get(*self._arguments, c_void_p(address), *self._last) > 1:
            self._instance.fail(f"reading {', '.join(self.names)}")

    def set(self, address: int) -> None:
        """Set the values from the array at this address."""
        if self._set(*self._arguments, c_void_p(address), *self._last) > 1:
            self._instance.fail(f"setting {', '.join(self.names)}")


class TextAccess:
    """Getting or setting a fixed list of texts, or of binary data, which read as hexadecimal digits."""

    def __init__(self, instance: Instance, signals: Sequence[Signal]) -> None:
        self.names = [s.name for s in signals]
        self._sizes_of = [s.size for s in signals]
        self._count = sum(self._sizes_of)
        self._references = np.array([s.reference for s in signals], np.uint32)
        self._suffix = signals[0].suffix
        self._binary = self._suffix == "Binary"
        self._instance = instance
        self._given = (instance.component, c_void_p(self._references.ctypes.data), c_size_t(len(signals)))

    def get(self) -> list[str]:
        """The present texts; elements of an array are joined by spaces."""
        found = (c_void_p * self._count)() if self._binary else (c_char_p * self._count)()
        lengths = (c_size_t * self._count)()
        self._call("Get", found, lengths)
        if self._binary:
            if sum(lengths) > FMU_UNPACKED.value * (1 << 20):
                names = ", ".join(self.names)
                raise FmuError(f"{self._instance.name}: {names} of {sum(lengths)} bytes are more than {FMU_UNPACKED}")
            cells = [ctypes.string_at(p, n).hex() if p else "" for p, n in zip(found, lengths, strict=True)]
        else:
            cells = [bytes(text or b"").decode(errors="replace") for text in found]
        ends = np.cumsum([0, *self._sizes_of])
        return [" ".join(cells[a:b]) for a, b in pairwise(ends)]

    def set(self, texts: Sequence[str]) -> None:
        """Set texts, one per variable; arrays of texts cannot be set."""
        if self._count != len(self.names):
            raise FmuError(f"{self._instance.name}: arrays of texts cannot be set: {', '.join(self.names)}")
        data = [bytes.fromhex(text) if self._binary else text.encode() for text in texts]
        lengths = (c_size_t * len(data))(*map(len, data))
        held = (c_char_p * len(data))(*data)
        self._call("Set", held, lengths)

    def _call(self, verb: str, values: Any, lengths: Any) -> None:
        sizes = (lengths,) if self._binary else ()
        last = (c_size_t(self._count),) if self._instance.version == 3 else ()
        if self._instance.function(verb + self._suffix)(*self._given, *sizes, values, *last) > 1:
            self._instance.fail(f"{'reading' if verb == 'Get' else 'setting'} {', '.join(self.names)}")


class Instance:
    """One instance, FMI 2.0 or 3.0, of one kind. Close it, or use it as a context manager."""

    def __init__(self, fmu: OpenedFmu, kind: KindName) -> None:
        found: Kind | None = fmu.co_simulation if kind == "CoSimulation" else fmu.model_exchange
        if found is None:
            raise FmuError(
                f"{fmu.name}: it offers no {'co-simulation' if kind == 'CoSimulation' else 'model exchange'}"
            )
        self.version = fmu.version
        self.name = fmu.name
        self.signals = fmu.signals
        self.last_message = ""
        self.ended = False  # in model exchange it has asked for the end of the simulation
        self._prefix = f"fmi{fmu.version}"
        self._functions: dict[str, Any] = {}
        self._library = load(fmu, found)
        self._logger: Any = (_LOG2 if self.version == 2 else _LOG3)(self._log)
        self.component = c_void_p(self._instantiate(fmu, kind))
        if not self.component.value:
            raise FmuError(f"{self.name}: it could not be instantiated{self._reason()}")

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the instance."""
        if self.component.value:
            self._found("FreeInstance", None)(self.component)
            self.component = c_void_p()

    def function(self, name: str) -> Any:
        """The FMI function of this name, without its prefix."""
        if name not in self._functions:
            # a status that there is not, below 0 for instance, is a failure
            self._functions[name] = self._found(name, c_uint)
        return self._functions[name]

    def _found(self, name: str, result: Any) -> Any:
        try:
            function = getattr(self._library, self._prefix + name)
        except AttributeError:
            raise FmuError(f"{self.name}: its library lacks the function {self._prefix}{name}") from None
        function.restype = result
        return function

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function of the instance; FmuError with the FMU's own words where it answers discard or worse."""
        if self.function(name)(self.component, *arguments) > 1:
            self.fail(f"{self._prefix}{name}")

    def fail(self, doing: str) -> NoReturn:
        """Raise FmuError."""
        raise FmuError(f"{self.name}: {doing} failed{self._reason()}")

    def access(self, variables: Sequence[Variable | Signal]) -> list[Access]:
        """One Access per type that occurs among the numeric variables."""
        return [Access(self, group) for group in self._by_type(variables)]

    def text_access(self, signals: Sequence[Signal]) -> list[TextAccess]:
        """One TextAccess per type that occurs among these texts and binary data."""
        return [TextAccess(self, [self.signals[s.name] for s in group]) for group in self._by_type(signals)]

    def _by_type(self, variables: Sequence[Variable | Signal]) -> list[list[Variable | Signal]]:
        groups: dict[str, list[Variable | Signal]] = {}
        for v in variables:
            groups.setdefault(self.signals[v.name].suffix, []).append(v)
        return list(groups.values())

    def set(self, values: Sequence[tuple[Variable | Signal, Any]]) -> None:
        """Set values one by one, before the run: numbers, texts, or arrays of numbers."""
        for variable, value in values:
            name, signal = variable.name, self.signals[variable.name]
            if signal.is_text:
                TextAccess(self, [signal]).set([str(value)])
                continue
            try:
                held = np.ascontiguousarray(signal.samples(np.atleast_1d(value)), signal.dtype)
            except ValueError as error:
                raise FmuError(f"{self.name}: '{name}' {error}") from None
            if held.size != signal.size:
                raise FmuError(f"{self.name}: '{name}' has {signal.size} elements, {held.size} were given")
            Access(self, [signal]).set(held.ctypes.data)

    def initialise(
        self,
        start_time: float,
        values: Sequence[tuple[Variable | Signal, Any]],
        inputs: Sequence[tuple[Variable | Signal, Any]] = (),
    ) -> None:
        """From instantiation to the end of initialization mode with these start values, and inputs at the start.

        FMI 2.0 takes inputs from Initialization Mode on, and some FMUs insist.
        """
        if self.version == 2:
            self.call("SetupExperiment", 0, c_double(0), c_double(start_time), 0, c_double(0))
            self.set(values)
            self.call("EnterInitializationMode")
        else:
            self.set(values)
            nothing = (c_bool(False), c_double(0))
            self.call("EnterInitializationMode", *nothing, c_double(start_time), *nothing)
        self.set(inputs)
        self.call("ExitInitializationMode")

    def terminated(self) -> bool:
        """FMI 2.0: whether a discarded step is the end that the FMU asks for."""
        answer = c_int()
        return self.function("GetBooleanStatus")(self.component, 3, ctypes.byref(answer)) == 0 and bool(answer.value)

    def new_discrete_states(self) -> tuple[bool, float]:
        """Event iteration to its end: whether states changed, and the next time event (infinity without one)."""
        changed, next_time = False, np.inf
        for _ in range(100):
            needed, now_changed, next_time = self._update2() if self.version == 2 else self._update3()
            changed |= now_changed
            if not needed:
                return changed, next_time
        self.fail("event iteration (100 passes)")

    def _update2(self) -> tuple[bool, bool, float]:
        info = _EventInfo()
        self.call("NewDiscreteStates", ctypes.byref(info))
        self.ended |= bool(info.terminate)
        return bool(info.needed), bool(info.values), info.time if info.defined else np.inf

    def _update3(self) -> tuple[bool, bool, float]:
        flags = [c_bool() for _ in range(5)]
        time = c_double()
        self.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(time))
        self.ended |= flags[1].value
        return flags[0].value, flags[3].value, time.value if flags[4].value else np.inf

    def _instantiate(self, fmu: OpenedFmu, kind: KindName) -> int | None:
        name, token = fmu.model.name.encode(), fmu.model.token.encode()
        resources = fmu.folder / "resources"
        if self.version == 2:
            self._callbacks = _Callbacks(self._logger, _libc("calloc"), _libc("free"), None, None)
            number = 1 if kind == "CoSimulation" else 0
            given: tuple[Any, ...] = (
                name,
                number,
                token,
                resources.as_uri().encode(),
                ctypes.byref(self._callbacks),
                0,
                0,
            )
        else:
            given = (name, token, f"{resources}/".encode(), c_bool(False), c_bool(False))
            if kind == "CoSimulation":
                given += (c_bool(False), c_bool(False), None, c_size_t(0), None, self._logger, None)
            else:
                given += (None, self._logger)
        address: int | None = self._found("Instantiate" + (kind if self.version == 3 else ""), c_void_p)(*given)
        return address

    def _log(self, *told: Any) -> None:
        """What the FMU says: environment, in FMI 2.0 the instance's name, then status, category, message."""
        *_, status, _category, message = told
        if status > 0 and message:
            self.last_message = message.decode(errors="replace")

    def _reason(self) -> str:
        return f": {self.last_message}" if self.last_message else ", and it gave no reason"


def load(fmu: OpenedFmu, kind: Kind) -> ctypes.CDLL:
    """Load a library. Raises FmuError where the system refuses it."""
    try:
        return ctypes.CDLL(str(kind.library))
    except OSError as error:
        reason = first_line(error).replace(f"{fmu.folder}/", "")
        raise FmuError(f"{fmu.name}: its library cannot be loaded: {reason}") from None


def _libc(name: str) -> int | None:
    """Address of calloc or free of this process, which FMI 2.0 wants to be given."""
    return ctypes.cast(getattr(ctypes.CDLL(None), name), c_void_p).value


class Stepper:
    """Co-simulation steps of a fixed length with prepared arguments."""

    def __init__(self, instance: Instance) -> None:
        self._step = instance.function("DoStep")
        self._instance = instance
        self._rest: tuple[Any, ...] = (c_int(1),)
        if instance.version == 3:
            self._flags = (c_bool * 3)()
            self._reached = c_double()
            addresses = [ctypes.byref(self._flags, i) for i in range(3)]
            self._rest = (c_bool(True), *addresses, ctypes.byref(self._reached))

    def step(self, t: float, h: float) -> bool:
        """From t to t + h; whether the FMU then asks for the end of the simulation."""
        status = self._step(self._instance.component, c_double(t), c_double(h), *self._rest)
        if self._instance.version == 3 and status <= 1:
            if self._flags[2]:
                raise FmuError(
                    f"{self._instance.name}: it ended the step from t = {t:.9g} s to {t + h:.9g} s early, which it was "
                    "told not to"
                )
            return bool(self._flags[1])
        if status == _DISCARD and self._instance.version == 2 and self._instance.terminated():
            return True
        if status > 1:
            self._instance.fail(f"the step from t = {t:.9g} s to {t + h:.9g} s")
        return False
