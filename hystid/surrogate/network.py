"""Any ONNX network as a block with inputs and outputs; pairs of ports that carry memory become its state.

The memory moves on once per sample: where the sample rate is known, at instants of its own (within steps of
co-simulation, at time events of model exchange); else at the end of each doStep, with the inputs of that step. The
outputs of an accepted sample stay until an input changes; then the network answers for the new input and the memory as
it stands, as often as it is asked, without the memory moving.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hystid.errors import NetworkError
from hystid.modelcode import Experiment, ModelCode, Variable
from hystid.networks import onnx_reading
from hystid.surrogate import block, reader
from hystid.surrogate.block import Block
from hystid.surrogate.emit import functions
from hystid.surrogate.identifiers import Names, identifier, readable
from hystid.surrogate.program import Port, Program

OUTSIDE = "outside_training_range"
_TYPES: dict[str, Literal["Real", "Integer", "Boolean"]] = {"float": "Real", "int": "Integer", "bool": "Boolean"}


@dataclass(frozen=True)
class Ports:
    """What the ports of a network mean. All mappings are by port name and may be empty.

    memory: input -> output that holds its next value. initial: start values of the memory, flat. names: a name for each
    element of a port. units: Modelica unit strings. training_range: least and greatest value that the network was
    trained on; where there is one, the block has an output that tells when an input leaves it. sample_rate [Hz].
    """

    memory: Mapping[str, str] = field(default_factory=dict)
    initial: Mapping[str, Sequence[float]] = field(default_factory=dict)
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    training_range: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sample_rate: float | None = None

    @property
    def sample(self) -> float | None:
        """Time between two samples [s], where it is known."""
        return 1.0 / self.sample_rate if self.sample_rate else None


def network_code(
    path: Path,
    *,
    sizes: Mapping[str, int] | None = None,
    memory: Mapping[str, str] | None = None,
) -> ModelCode:
    """Compile any ONNX network of supported operators into a block for the shell.

    Every element of an input or output becomes a scalar variable: ``x`` where there is one, else ``x[1]``, ``x[2]``
    ... (``x[1,1]`` ... for two axes; axes of length 1 are left out). Inputs are 0 at the start.

    sizes: length of named axes that the file leaves open; 1 otherwise.
    memory: input name -> output name of state that is carried from sample to sample. By default these are pairs called
    ``s`` and ``s_next``, or ``s_in`` and ``s_out``; it starts at the metadata entry ``initial_state`` or 0.
    Metadata of the file that are used where they are there: ``units``, ``training_range``, ``names`` (JSON, by port
    name), ``sample_rate``.
    Raises NetworkError naming file, node and operator.
    """
    path = Path(path)
    proto = onnx_reading.load(path)
    title = path.stem
    try:
        program = reader.program(proto, identifier(title), sizes)
        given = {entry.key: entry.value for entry in proto.metadata_props}
        return block_code(program, interface_of(program, given, memory), title)
    except NetworkError as error:
        raise NetworkError(f"{path}: {error}") from error


def block_code(program: Program, interface: Ports, title: str, description: str = "") -> ModelCode:
    """A compiled network as a ``ModelCode``: inputs -> outputs, with memory where the interface says so."""
    layout = PortLayout.of(program, interface)
    text = functions(program, "network")
    frame = replace(layout.block, n_w=layout.recorded + text.work)
    c_text = _Frame(program, layout, frame, interface).text(block.text_of(text), title)
    known = _variables(layout, interface)
    inputs = tuple(v.name for v in known if v.causality == "input")
    step = interface.sample or Experiment().step
    return block.signed(
        ModelCode(
            name=identifier(title),
            description=description or f"Network '{readable(title)}', compiled from ONNX",
            variables=tuple(known),
            sources={"model.c": c_text},
            n_values=frame.size,
            dependencies={v.name: inputs for v in known if v.causality == "output"},
            has_forward=True,
            has_adjoint=True,
            has_memory=bool(layout.states),
            sample=interface.sample if layout.states else None,
            steps_are_samples=bool(layout.states) and interface.sample is None,
            experiment=Experiment(step=step, stop=round(1000 * step, 12)),
        )
    )


def interface_of(program: Program, given: Mapping[str, str], memory: Mapping[str, str] | None = None) -> Ports:
    """What the ports of any network mean, from its metadata ``given`` and their names; memory: see ``network_code``."""
    pairs = dict(memory) if memory is not None else memory_pairs(program)
    _check_pairs(program, pairs)
    initial = _json(given, "initial_state")
    if isinstance(initial, list) and len(pairs) == 1:
        initial = {next(iter(pairs)): initial}
    rate = _json(given, "sample_rate")
    ranges = {key: _finite("training_range", key, value, 2) for key, value in _mapping(_json(given, "training_range"))}
    return Ports(
        pairs,
        {key: _finite("initial_state", key, value) for key, value in _mapping(initial)},
        {
            key: [str(name) for name in value]
            for key, value in _mapping(_json(given, "names"))
            if isinstance(value, list)
        },
        {key: str(value) for key, value in _mapping(_json(given, "units"))},
        {key: (low, high) for key, (low, high) in ranges.items()},
        float(rate) if isinstance(rate, int | float) and 0 < rate < np.inf else None,
    )


def _json(given: Mapping[str, str], key: str) -> Any:
    try:
        return json.loads(given[key])
    except (KeyError, ValueError, RecursionError):  # a foreign file may use the same key for something else
        return None


def _mapping(value: Any) -> list[tuple[str, Any]]:
    return [(str(key), item) for key, item in value.items()] if isinstance(value, dict) else []


def _finite(entry: str, port: str, values: Any, count: int | None = None) -> list[float]:
    numbers = values if isinstance(values, list) else []
    if not numbers or not all(isinstance(v, int | float) and abs(v) < np.inf for v in numbers):
        raise NetworkError(f"the metadata entry '{entry}' must give a list of finite numbers for '{readable(port)}'")
    if count is not None and len(numbers) != count:
        raise NetworkError(f"the metadata entry '{entry}' must give {count} numbers for '{readable(port)}'")
    if entry == "training_range" and values[0] > values[1]:
        raise NetworkError(f"the metadata entry '{entry}' must give the least number first for '{readable(port)}'")
    return [float(v) for v in numbers]


def memory_pairs(program: Program) -> dict[str, str]:
    """Inputs and outputs that carry memory by their names: ``s`` and ``s_next``, or ``s_in`` and ``s_out``."""
    outputs, pairs = {port.name for port in program.outputs}, {}
    for port in program.inputs:
        partner = port.name.removesuffix("_in") + "_out" if port.name.endswith("_in") else port.name + "_next"
        if partner in outputs:
            pairs[port.name] = partner
    return pairs


def _check_pairs(program: Program, pairs: Mapping[str, str]) -> None:
    inputs = {port.name: port.view for port in program.inputs}
    outputs = {port.name: port.view for port in program.outputs}
    if len(set(pairs.values())) < len(pairs):
        raise NetworkError("memory: two inputs cannot take their next value from the same output")
    for source, target in pairs.items():
        if source not in inputs or target not in outputs:
            raise NetworkError(f"memory '{source}' -> '{target}': there is no such input or output")
        if inputs[source].size != outputs[target].size:
            raise NetworkError(
                f"memory '{source}' has {inputs[source].size} elements but '{target}' has {outputs[target].size}"
            )


@dataclass(frozen=True)
class PortLayout:
    """Ports by their part in the block, and their first slots there."""

    inputs: tuple[Port, ...]
    states: tuple[Port, ...]
    outputs: tuple[Port, ...]
    nexts: tuple[Port, ...]
    block: Block
    outside: bool

    @staticmethod
    def of(program: Program, interface: Ports) -> PortLayout:
        """Sort the ports of a program."""
        by_name = {port.name: port for port in program.outputs}
        inputs = tuple(port for port in program.inputs if port.name not in interface.memory)
        states = tuple(port for port in program.inputs if port.name in interface.memory)
        nexts = tuple(by_name[interface.memory[port.name]] for port in states)
        outputs = tuple(port for port in program.outputs if port not in nexts)
        if not outputs:
            raise NetworkError("the network has no output besides its memory")
        outside = any(port.name in interface.training_range for port in inputs)
        n_u, n_d, n_y = (sum(port.view.size for port in ports) for ports in (inputs, states, outputs))
        return PortLayout(inputs, states, outputs, nexts, Block(n_u=n_u, n_d=n_d, n_y=n_y + outside), outside)

    @property
    def recorded(self) -> int:
        """Private memory for the latest sample: a mark, a note of the warning, the inputs, the next memory."""
        return 2 + self.block.n_u + self.block.n_d

    def starts(self, interface: Ports) -> dict[int, float]:
        """Start values that are not 0."""
        places = block.offsets(self.states, self.block.d) | block.offsets(self.inputs, self.block.u)
        values: dict[int, float] = {}
        for port in (*self.states, *self.inputs):
            given = list(interface.initial.get(port.name, []))
            if given and len(given) != port.view.size:
                raise NetworkError(f"initial_state of '{port.name}' has {len(given)} numbers, not {port.view.size}")
            values.update({places[port.name] + i: value for i, value in enumerate(given) if value})
        return values


def element_names(port: Port, names: Names, given: Sequence[str] = ()) -> list[str]:
    """A name per element of a port: ``x``, or ``x[1]`` ..., or the given ones where there is one for each."""
    if len(given) == port.view.size:
        return [names.unique(name) for name in given]
    base = names.unique(port.name)
    shape = [n for n in port.view.shape if n > 1]
    if not shape:
        return [base]
    return [f"{base}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*shape)]


def _variables(layout: PortLayout, interface: Ports) -> list[Variable]:
    names, b = Names({"time"}), layout.block
    starts = layout.starts(interface)
    found: list[Variable] = []

    def add(ports: Sequence[Port], first: int, **common: Any) -> None:
        for port in ports:
            labels = element_names(port, names, interface.names.get(port.name, ()))
            for i, label in enumerate(labels):
                found.append(_variable(port, i, label, first + i, interface, common, starts))
            first += port.view.size

    add(layout.inputs, b.u, causality="input", variability="continuous", start=0.0)
    add(layout.outputs, b.y, causality="output", variability="continuous", initial="calculated")
    add(layout.states, b.d, causality="local", variability="discrete", initial="exact", start=0.0)
    if layout.outside:
        found.append(outside_variable(b.y + b.n_y - 1, names.unique(OUTSIDE)))
    return found


def outside_variable(slot: int, name: str = OUTSIDE) -> Variable:
    """The output that tells when the network is asked about something that it was not trained on."""
    return Variable(
        name, slot, "output", "continuous", initial="calculated", min=0.0, max=1.0,
        description="1 where an input lies outside the range of the training data, else 0",
    )  # fmt: skip


def usual(trained: tuple[float, float] | None) -> float | None:
    """Nominal value of a signal: half its greatest magnitude in the training data; None where that is not known."""
    return (0.5 * max(abs(trained[0]), abs(trained[1])) or None) if trained else None


def described(text: str, trained: tuple[float, float] | None) -> str:
    """Description of an input with the range that it was trained on."""
    return f"{text}; trained from {trained[0]:.6g} to {trained[1]:.6g}" if trained else text


def _variable(
    port: Port,
    i: int,
    label: str,
    slot: int,
    interface: Ports,
    common: Mapping[str, Any],
    starts: Mapping[int, float],
) -> Variable:
    trained = interface.training_range.get(port.name)
    size = port.view.size
    role = {"input": "input", "output": "output", "local": "memory"}[common["causality"]]
    text = f"{role} '{readable(port.name)}' of the network" + (f", element {i + 1} of {size}" if size > 1 else "")
    if common["causality"] == "input":
        text = described(text, trained)
    settings = {**common, "nominal": usual(trained)} if port.view.kind == "float" else dict(common)
    if "start" in settings:
        settings["start"] = starts.get(slot, 0.0)
    if port.view.kind != "float":
        settings["variability"] = "discrete"
    unit = str(interface.units.get(port.name, ""))
    kind = _TYPES[port.view.kind]
    return Variable(label, slot, type=kind, unit=unit if kind == "Real" else "", description=text, **settings)


@dataclass(frozen=True)
class _Frame:
    """C text around a memory network: evaluation with a record of the latest sample, and derivatives."""

    program: Program
    layout: PortLayout
    block: Block
    interface: Ports

    def text(self, network: str, title: str) -> str:
        """The whole of ``model.c``."""
        members = ["evaluate", "forward", "adjoint", *(["completed_step"] if self.layout.states else [])]
        step = self.interface.sample or Experiment().step
        parts = [
            f"/* Network '{readable(title)}' in double precision, compiled from ONNX. */",
            block.INCLUDES,
            self.block.defines(),
            network,
            self._values(),
            self._derivative("forward"),
            self._derivative("adjoint"),
            self.block.model(
                title,
                step,
                self.layout.starts(self.interface),
                members,
                self.interface.sample or -1.0 if self.layout.states else 0.0,
            ),
        ]
        return "\n".join(parts)

    def _pointers(self, ports: Sequence[Port], base: str) -> dict[str, str]:
        return {name: f"{base} + {at}" for name, at in block.offsets(ports, 0).items()}

    @property
    def _work(self) -> str:
        return f"v + W + {self.layout.recorded}"

    def _values(self) -> str:
        inputs = self._pointers(self.layout.inputs, "v + U") | self._pointers(self.layout.states, "v + D")
        outputs = self._pointers(self.layout.outputs, "v + Y") | self._pointers(self.layout.nexts, "v + W + 2 + N_U")
        run = block.call(self.program, "", inputs, outputs, work=self._work)
        return f"""\
/* v[W]: 0, or 1 when the outputs belong to the recorded inputs, or 2 when that sample has been accepted as well.
 * v[W + 1]: 1 after the warning. Then the inputs of the sample and the memory that follows it. */
static int same_inputs(const double *v)
{{
    int same = v[W] != 0.0;
    for (int i = 0; i < N_U; ++i) same &= v[U + i] == v[W + 2 + i];
    return same;
}}

static int sample(hy_data *m)
{{
    double *v = m->v, sum = 0.0;
    {run}
{self._outside()}    for (int i = 0; i < N_U; ++i) v[W + 2 + i] = v[U + i];
    for (int i = 0; i < N_Y; ++i) sum += 0.0 * v[Y + i]; /* NaN where one is not finite */
    v[W] = sum == 0.0;
    if (sum == 0.0) return HY_OK;
    m->log(m->owner, HY_FAILURE, "an output of the network is not finite");
    return HY_ERROR;
}}

static int evaluate(hy_data *m) {{ return same_inputs(m->v) ? HY_OK : sample(m); }}
{self._completed()}"""

    def _outside(self) -> str:
        places = block.offsets(self.layout.inputs, 0)
        tests = []
        for port in self.layout.inputs:
            low, high = self.interface.training_range.get(port.name, (-np.inf, np.inf))
            for i in range(port.view.size):
                tests.append(block.range_test(f"v[U + {places[port.name] + i}]", low, high))
        condition = " || ".join(test for test in tests if test)
        return f"    v[Y + N_Y - 1] = {condition};\n" if self.layout.outside else ""

    def _completed(self) -> str:
        if not self.layout.states:
            return ""
        warning = """\
    if (v[Y + N_Y - 1] != 0.0 && v[W + 1] == 0.0) {
        m->log(m->owner, HY_WARNING, "an input has left the range of the training data: this is an extrapolation");
        v[W + 1] = 1.0;
    }
"""
        return f"""
static int completed_step(hy_data *m)
{{
    double *v = m->v;
    if (v[W] != 1.0 || !same_inputs(v)) {{
        const int outcome = sample(m);
        if (outcome) return outcome;
    }}
    memcpy(v + D, v + W + 2 + N_U, N_D * sizeof *v);
    v[W] = 2.0;
{warning if self.layout.outside else ""}    return HY_OK;
}}
"""

    def _derivative(self, mode: str) -> str:
        """With respect to inputs and memory, at the present ones."""
        sizes = {port.name: port.view.size for port in self.program.outputs}
        results = {name: f"y{n}" for n, name in enumerate(sizes)}
        slopes = {name: f"d_y{n}" for n, name in enumerate(sizes)}
        declared = ", ".join(f"{results[name]}[{size}]" for name, size in sizes.items())
        zero = ", ".join(f"{slopes[name]}[{size}] = {{0}}" for name, size in sizes.items())
        point = self._pointers(self.layout.inputs, "v + U") | self._pointers(self.layout.states, "v + D")
        places = block.offsets(self.layout.outputs, 0)
        base = "seed" if mode == "forward" else "sens"
        ends = self._pointers(self.layout.inputs, f"{base} + U") | self._pointers(self.layout.states, f"{base} + D")
        run = block.call(self.program, "_" + mode, point, results, ends, slopes, self._work)
        copies = [
            f"    memcpy(sens + Y + {places[port.name]}, {slopes[port.name]}, sizeof {slopes[port.name]});"
            if mode == "forward"
            else f"    memcpy({slopes[port.name]}, seed + Y + {places[port.name]}, sizeof {slopes[port.name]});"
            for port in self.layout.outputs
        ]
        first = "    memset(sens, 0, N_VALUES * sizeof *sens);\n" if mode == "forward" else ""
        body = [f"    {run}", *copies] if mode == "forward" else [*copies, f"    {run}"]
        return f"""\
static int {mode}(hy_data *m, const double *seed, double *sens)
{{
    double *v = m->v, {declared}, {zero};
{first}{chr(10).join(body)}
    return HY_OK;
}}
"""
