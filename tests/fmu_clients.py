"""Importers that nobody here wrote, each driving a co-simulation FMU through one call: fmpy, ecos, libcosim.

Run as a program it drives FMUs in one client and prints the outputs of each as a line of JSON: libcosim ends the
process on files that it cannot take, so that a client gets a process of its own.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

CLIENTS = ("fmpy", "ecos", "libcosim")


def run_fmpy(path: Path, inputs: Mapping[str, float], outputs: Sequence[str], step: float, n: int) -> dict[str, float]:
    """FMPy's own loop; constant inputs are start values."""
    import fmpy

    rows = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", stop_time=step * n, step_size=step, output_interval=step,
        start_values=dict(inputs), output=list(outputs),
    )  # fmt: skip
    return {name: float(rows[name][-1]) for name in outputs}


def run_ecos(path: Path, inputs: Mapping[str, float], outputs: Sequence[str], step: float, n: int) -> dict[str, float]:
    """ecos with its fixed-step algorithm; inputs are initial values."""
    from ecospy import EcosSimulation, EcosSimulationStructure
    from ecospy.EcosParameterSet import EcosParameterSet

    with EcosSimulationStructure() as structure:
        structure.add_model("fmu", str(path))
        with EcosParameterSet() as parameters:
            for name, value in inputs.items():
                parameters.add_real(f"fmu::{name}", value)
            structure.add_parameter_set("initial", parameters)
        with EcosSimulation(structure=structure, step_size=step) as simulation:
            simulation.init(parameter_set="initial")
            simulation.step(n)
            found = {name: float(simulation.get_real(f"fmu::{name}")) for name in outputs}
            simulation.terminate()
    return found


def run_libcosim(
    path: Path, inputs: Mapping[str, float], outputs: Sequence[str], step: float, n: int
) -> dict[str, float]:
    """libcosim with its fixed-step algorithm; inputs are initial values."""
    import fmpy
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    references = {v.name: v.valueReference for v in fmpy.read_model_description(str(path)).modelVariables}
    execution = CosimExecution.from_step_size(round(step * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="fmu"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for name, value in inputs.items():
        execution.real_initial_value(slave, references[name], value)
    execution.step(step_count=n)
    values = observer.last_real_values(slave, [references[name] for name in outputs])
    return {name: float(value) for name, value in zip(outputs, values, strict=True)}


_RUN = {"fmpy": run_fmpy, "ecos": run_ecos, "libcosim": run_libcosim}

if __name__ == "__main__":
    for request in json.loads(sys.stdin.read()):
        path = Path(request["path"])
        answer = _RUN[sys.argv[1]](path, request["inputs"], request["outputs"], request["step"], request["n"])
        print(f"\nANSWER {json.dumps({'name': path.name, **answer})}", flush=True)
