"""A restoring force in closed loop with a mass, and a reference oscillator beside it, as one system (SSP)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from hystid.errors import FmuError, UsageError, first_line
from hystid.files import scratch
from hystid.fmu.build import build
from hystid.fmu.door import OpenedFmu, open_fmu
from hystid.fmu.from_network import network_of
from hystid.fmu.mass import mass_code
from hystid.fmu.ssp import Connection, write_ssp
from hystid.modelcode import Experiment
from hystid.surrogate import oscillator_code

_TOGETHER = (Connection("F", "rig.F"), *(Connection(f"rig.{name}", name) for name in ("x", "v", "R")))
_APART = (
    Connection("F", "mass.F"),
    Connection("mass.x_ahead", "force.x"),
    Connection("mass.v_ahead", "force.v"),
    Connection("force.R", "mass.R"),
    Connection("mass.x", "x"),
    Connection("mass.v", "v"),
    Connection("force.R", "R"),
)
# The trial of a rig that is apart: free motion after pushes to these parts of the usual speed. A rig without any loss
# keeps its speed; 1 % of growth in 3000 steps is a damping ratio of -1e-4 at 30 steps a period.
_STEPS, _SPEEDS, _GROWTH = 3000, (0.01, 0.1, 1.0), 1.01
_FINER = 6  # halvings of the step that are tried for the advice


def write_rig(
    out: Path,
    force: Path,
    mass: float,
    *,
    reference: Path | None = None,
    step: float | None = None,
    apart: bool = False,
) -> Path:
    """Write an ``.ssp`` file: a restoring force in closed loop with a mass, F of the system on the mass.

    force: FMU of FMI 2.0 with inputs x and v and an output R, such as ``surrogate.fmu``. mass [kg]. reference: FMU of
    an oscillator with the input F and the output x, excited alike. Connectors of the system: F; x, v, R and, with a
    reference, x_reference.

    An identified restoring force and the mass become one FMU, "rig", in which R acts without delay. With apart, and for
    other forces, they are two FMUs, "mass" and "force". Importers then exchange R once per step [s] (by default that of
    the force) and late, which would feed energy in: the force is given the motion ahead of time (``mass_code``).
    Whether the motion then dies out is tried with FMPy's runner before the file is written.
    Raises FmuError, UsageError where an FMU lacks these variables, or where the rig feeds energy in at this step.
    """
    block = open_fmu(force)
    experiment = block.model.experiment if step is None else replace(block.model.experiment, step=float(step))
    with scratch() as folder:
        network = None if apart else network_of(Path(force), folder)
        if network is not None:
            code = replace(oscillator_code(network, mass=mass), experiment=experiment)
            components, connections = {"rig": build(code, folder / "rig.fmu").path}, list(_TOGETHER)
        else:
            components, connections = _two(block, mass, experiment, folder), list(_APART)
        outputs = ["x", "v", "R"]
        if reference is not None:
            components["reference"] = Path(reference)
            connections += [Connection("F", "reference.F"), Connection("reference.x", "x_reference")]
            outputs.append("x_reference")
        return write_ssp(out, components, connections, inputs=["F"], outputs=outputs, experiment=experiment)


def _two(block: OpenedFmu, mass: float, experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Mass and force apart. Raises UsageError where they feed energy in."""

    def made(step: float) -> dict[str, Path]:
        code = mass_code(mass, step=step, stop=experiment.stop)
        return {"mass": build(code, folder / f"mass{step!r}.fmu").path, "force": block.path}

    def dies_out(step: float) -> bool:
        components = made(step)
        return all(_dies_out(components, mass, step, part * usual, folder) for part in _SPEEDS)

    usual = next((v.nominal for v in block.model.variables if v.name == "v" and v.nominal), 0.1)
    if dies_out(experiment.step):
        return made(experiment.step)
    steps = [experiment.step / 2**k for k in range(1, _FINER + 1)]
    finer = next((step for step in steps if dies_out(step)), None)
    advice = f"with step={finer:g} it does not" if finer else f"at {steps[-1]:g} s it still does"
    raise UsageError(
        f"{block.name}: on a mass of {mass:g} kg it feeds energy in at steps of {experiment.step:g} s; {advice}"
    )


def _dies_out(components: Mapping[str, Path], mass: float, step: float, speed: float, folder: Path) -> bool:
    """Whether the motion after a push to this speed [m/s] does not grow, in the importer with the longest delay."""
    from fmpy.ssp.simulation import simulate_ssp

    trial = write_ssp(folder / "trial.ssp", components, _APART, inputs=["F"], outputs=["x", "v", "R"])
    push = {"F": lambda t: mass * speed / step if t < 0.5 * step else 0.0}
    try:
        v = np.abs(simulate_ssp(str(trial), stop_time=_STEPS * step, step_size=step, input=push)["v"])
    except Exception as error:  # FMPy raises bare exceptions
        raise FmuError(f"the rig cannot be run by FMPy: {first_line(error)}") from None
    first, last = np.max(v[: _STEPS // 3]), np.max(v[-_STEPS // 3 :])
    return bool(np.isfinite(last) and last <= _GROWTH * first)
