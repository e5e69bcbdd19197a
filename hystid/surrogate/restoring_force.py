"""The identified restoring force as blocks: by itself (x, v -> R) and on a mass (F -> x, v, a, R)."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from hystid.errors import NetworkError, UsageError
from hystid.modelcode import Experiment, ModelCode, Variable
from hystid.networks import onnx_reading
from hystid.networks.onnx_reading import StepDescription
from hystid.rotation import turned_code
from hystid.surrogate import block, reader
from hystid.surrogate.block import Block
from hystid.surrogate.emit import functions
from hystid.surrogate.identifiers import readable
from hystid.surrogate.network import OUTSIDE, Ports, block_code, described, network_code, outside_variable, usual
from hystid.surrogate.oscillator import OscillatorText, recorded
from hystid.surrogate.program import Program

NETWORK = "surrogate.onnx"  # the file itself travels in the resources of the FMU
_UNITS = {"x": "m", "v": "m/s", "R": "N", "R_spread": "N"}
_STATES = ("x", "v")


def model_code(path: Path) -> ModelCode:
    """Whatever an ONNX file holds: ``surrogate_code`` for an identified restoring force, else ``network_code``.

    Raises NetworkError as they do.
    """
    given = {entry.key for entry in onnx_reading.load(Path(path)).metadata_props}
    return surrogate_code(path) if is_surrogate(given) else network_code(path)


def is_surrogate(keys: Collection[str]) -> bool:
    """Whether a file with these metadata holds an identified restoring force."""
    return {"hystid_version", "initial_state"} <= set(keys)


def interface_of_surrogate(about: StepDescription) -> Ports:
    """What the ports of an identified restoring force mean."""
    return Ports(
        memory={"state": "state_next"},
        initial={"state": about.initial_state, **{name: [value] for name, value in middle(about).items()}},
        units=_UNITS | {port.name: port.unit for port in about.inputs},
        training_range=about.training_range,
        sample_rate=about.sample_rate,
    )


def surrogate_code(path: Path) -> ModelCode:
    """The restoring force of a surrogate's ONNX file as a block: inputs x [m], v [m/s] and the further ones of the
    network; outputs R [N] and ``outside_training_range``; the memory is local and moves on once per accepted sample
    (see ``network``).

    Raises NetworkError when the file is no surrogate (``hystid.networks.onnx_reading.read``) or cannot be compiled.
    """
    program, about = _read(path)
    code = block_code(
        program, interface_of_surrogate(about), "surrogate", "Restoring force R of an identified structure with memory"
    )
    return _shown(replace(code, resources={NETWORK: Path(path).read_bytes()}), about)


def _shown(code: ModelCode, about: StepDescription) -> ModelCode:
    return turned_code(code) if about.rotational else code


def middle(about: StepDescription) -> dict[str, float]:
    """A value for each further input: the middle of its training range, 0 where there is none."""
    ranges = {port.name: about.training_range.get(port.name, (0.0, 0.0)) for port in about.inputs}
    return {name: 0.5 * (low + high) for name, (low, high) in ranges.items()}


def oscillator_code(path: Path, *, mass: float | None = None) -> ModelCode:
    """The structure that a surrogate's ONNX file describes: m a = F - R, free to move.

    Inputs F [N] and the further ones of the network; outputs x [m], v [m/s], a [m/s2], R [N],
    ``outside_training_range``; parameters m [kg], x_start [m], v_start [m/s] and, where the memory is that of turning
    points, R_start [N], the restoring force before the start (0: relaxed). mass [kg] replaces that of the file. In
    co-simulation the internal step is that of the training data.

    The memory stays as it is between accepted samples: the turning-point rule is applied at the start and at the end of
    each step, never at the stages of an integrator in between. R and a of an accepted sample are those after the rule.
    Raises UsageError when there is no mass above 0, NetworkError as ``surrogate_code``.
    """
    program, about = _read(path)
    kilograms = about.mass if mass is None else float(mass)
    if not 0 < kilograms < math.inf:
        raise UsageError(
            f"{path}: an oscillator needs a mass above 0 kg, found {kilograms:g}: pass the mass of the moving part"
        )
    sizes, c_text = _oscillator_text(program, about, kilograms)
    code = block.signed(
        ModelCode(
            name="oscillator",
            description="Mass on the restoring force of an identified structure with memory: m a = F - R",
            variables=_variables(sizes, kilograms, about),
            sources={"model.c": c_text},
            states=_STATES,
            n_values=sizes.size,
            dependencies=_dependencies(about),
            has_forward=True,
            has_adjoint=True,
            has_memory=True,
            sample=1.0 / about.sample_rate,
            experiment=Experiment(step=1.0 / about.sample_rate, stop=1.0),
            resources={NETWORK: Path(path).read_bytes()},
        )
    )
    return _shown(code, about)


def _oscillator_text(program: Program, about: StepDescription, mass: float) -> tuple[Block, str]:
    text, n_d = functions(program, "network"), len(about.initial_state)
    sizes = Block(
        n_p=3 + about.turning,
        n_u=1 + len(about.inputs),
        n_x=2,
        n_d=n_d,
        n_y=2 + about.spread,
        n_w=recorded(n_d, len(about.inputs)) + text.work,
    )
    start = {sizes.p: mass} | {sizes.d + i: value for i, value in enumerate(about.initial_state) if value}
    start |= {sizes.u + 1 + i: value for i, value in enumerate(middle(about).values()) if value}
    members = ("parameters", "initialise", "evaluate", "completed_step", "forward", "adjoint")
    parts = (
        "/* Mass on an identified restoring force: m a = F - R(x, v, memory). */",
        block.INCLUDES,
        sizes.defines(),
        block.text_of(text),
        OscillatorText(program, about).text(),
        sizes.model("oscillator", 1.0 / about.sample_rate, start, members, 1.0 / about.sample_rate),
    )
    return sizes, "\n".join(parts)


def _read(path: Path) -> tuple[Program, StepDescription]:
    proto, about = onnx_reading.read(Path(path))
    try:
        return reader.program(proto, "step"), about
    except NetworkError as error:
        raise NetworkError(f"{path}: {error}") from error


def _variables(sizes: Block, mass: float, about: StepDescription) -> tuple[Variable, ...]:
    p, x, dx, y = sizes.p, sizes.x, sizes.dx, sizes.y
    size = {name: usual(trained) for name, trained in about.training_range.items()}
    force = Variable("F", sizes.u, "input", "continuous", start=0.0, unit="N", description="force on the mass")
    memory = (
        Variable(f"state[{i + 1}]", sizes.d + i, "local", "discrete", initial="calculated", description="memory")
        for i in range(sizes.n_d)
    )
    start = (_parameter("R_start", p + 3, 0.0, "N", "restoring force before the start"),) if about.turning else ()
    return (
        replace(_parameter("m", p, mass, "kg", "mass"), min=0.0),
        _parameter("x_start", p + 1, 0.0, "m", "displacement at the start"),
        _parameter("v_start", p + 2, 0.0, "m/s", "velocity at the start"),
        *start,
        replace(force, nominal=size.get("R")),
        *_further(about, sizes.u + 1),
        replace(_output("x", x, "m", "displacement"), nominal=size["x"]),
        replace(_output("v", x + 1, "m/s", "velocity"), nominal=size["v"]),
        replace(_output("der(x)", dx, "m/s", "rate of x"), causality="local", derivative_of="x"),
        replace(_output("a", dx + 1, "m/s2", "acceleration"), derivative_of="v"),
        replace(_output("R", y, "N", "restoring force, opposing the motion as a spring does"), nominal=size.get("R")),
        outside_variable(y + 1),
        *([_output("R_spread", y + 2, "N", "standard deviation of the error of R")] if about.spread else []),
        *memory,
    )


def _dependencies(about: StepDescription) -> dict[str, tuple[str, ...]]:
    force = (*(port.name for port in about.inputs), *_STATES)
    return {
        "x": ("x",),
        "v": ("v",),
        "der(x)": ("v",),
        "R": force,
        "a": ("F", *force),
        OUTSIDE: force,
        **({"R_spread": force} if about.spread else {}),
    }


def _further(about: StepDescription, first: int) -> list[Variable]:
    """The further inputs, each starting in the middle of its training range."""
    found, starts = [], middle(about)
    for slot, port in enumerate(about.inputs, start=first):
        trained = about.training_range.get(port.name)
        found.append(
            Variable(
                port.name, slot, "input", "continuous", start=starts[port.name], unit=port.unit,
                nominal=usual(trained), description=described(f"input '{readable(port.column)}'", trained),
            )
        )  # fmt: skip
    return found


def _parameter(name: str, slot: int, start: float, unit: str, text: str) -> Variable:
    return Variable(name, slot, "parameter", "fixed", initial="exact", start=start, unit=unit, description=text)


def _output(name: str, slot: int, unit: str, text: str) -> Variable:
    return Variable(name, slot, "output", "continuous", initial="calculated", unit=unit, description=text)
