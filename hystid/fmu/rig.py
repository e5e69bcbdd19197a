"""A force block on a mass, and a reference oscillator beside it, as one system (SSP): the block in closed loop."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

from hystid.errors import UsageError
from hystid.fmu.build import build
from hystid.fmu.door import open_fmu
from hystid.fmu.ssp import Connection, write_ssp
from hystid.modelcode import Experiment, ModelCode, Variable

_MASS_C = """\
/* m a + R = F: a mass that takes its restoring force as an input. */
#include "hy_model.h"

enum { T, M, X_START, V_START, F, R, X, V, DX, DV, A, N };

static const double start[N] = {[M] = @MASS@};

static int initialise(hy_data *m)
{
    m->v[X] = m->v[X_START];
    m->v[V] = m->v[V_START];
    return HY_OK;
}

static int evaluate(hy_data *m)
{
    double *const v = m->v;
    v[DX] = v[V];
    v[DV] = v[A] = (v[F] - v[R]) / v[M];
    return HY_OK;
}

static int forward(hy_data *m, const double *seed, double *sens)
{
    const double *const v = m->v;
    sens[DX] = seed[V];
    sens[DV] = sens[A] = (seed[F] - seed[R] - v[A] * seed[M]) / v[M];
    return HY_OK;
}

static int adjoint(hy_data *m, const double *seed, double *sens)
{
    const double *const v = m->v;
    const double a = (seed[DV] + seed[A]) / v[M];
    sens[V] += seed[DX];
    sens[F] += a;
    sens[R] -= a;
    sens[M] -= a * v[A];
    return HY_OK;
}

const hy_model hy_the_model = {
    .name = "Mass", .token = "@TOKEN@", .n_values = N, .p = M, .n_p = 3, .u = F, .n_u = 2, .x = X, .n_x = 2, .dx = DX,
    .d = N, .y = A, .n_y = 1, .pre = N, .rel = N, .w = N, .step = @STEP@, .start = start,
    .initialise = initialise, .evaluate = evaluate, .forward = forward, .adjoint = adjoint,
};
"""


def mass_code(mass: float, *, step: float = 1e-3, stop: float = 1.0) -> ModelCode:
    """The block m a + R = F: inputs F and R [N], outputs x [m], v [m/s], a [m/s2]; parameters m, x_start, v_start.

    mass [kg], step and stop of the default experiment [s]. Raises UsageError where they are not positive.
    """
    if not (mass > 0 and step > 0 and stop > 0):
        raise UsageError("a mass, its step and the stop time must be positive")
    text = _MASS_C.replace("@MASS@", repr(float(mass))).replace("@STEP@", repr(float(step)))
    token = hashlib.sha256(text.encode()).hexdigest()[:32]
    variables = (
        Variable("m", 1, "parameter", "tunable", start=mass, min=0.0, unit="kg", description="Mass"),
        Variable("x_start", 2, "parameter", "fixed", start=0.0, unit="m", description="Displacement at the start"),
        Variable("v_start", 3, "parameter", "fixed", start=0.0, unit="m/s", description="Velocity at the start"),
        Variable("F", 4, "input", "continuous", unit="N", description="Excitation, in the direction of x"),
        Variable("R", 5, "input", "continuous", unit="N", description="Restoring force, opposes motion"),
        Variable("x", 6, "output", "continuous", initial="calculated", unit="m", description="Displacement"),
        Variable("v", 7, "output", "continuous", initial="calculated", unit="m/s", description="Velocity"),
        Variable("der(x)", 8, "local", "continuous", unit="m/s", derivative_of="x"),
        Variable("der(v)", 9, "local", "continuous", unit="m/s2", derivative_of="v"),
        Variable("a", 10, "output", "continuous", initial="calculated", unit="m/s2", description="Acceleration"),
    )
    acceleration = ("m", "F", "R")
    return ModelCode(
        "Mass",
        "m a + R = F",
        variables,
        {"model.c": text.replace("@TOKEN@", token)},
        states=("x", "v"),
        n_values=11,
        dependencies={"x": ("x",), "v": ("v",), "der(x)": ("v",), "der(v)": acceleration, "a": acceleration},
        has_forward=True,
        has_adjoint=True,
        experiment=Experiment(0.0, stop, step),
        reinit=(),
        token=token,
    )


def write_rig(out: Path, force: Path, mass: float, *, reference: Path | None = None, name: str = "rig") -> Path:
    """Write an ``.ssp`` file: the FMU of a restoring force in closed loop with a mass, F of the system on the mass.

    force: FMU of FMI 2.0 with inputs x and v and an output R, such as ``surrogate.fmu``. mass [kg]. reference: FMU of
    an oscillator with the input F and the output x, excited alike. Connectors of the system: F; x, v, R and, with a
    reference, x_reference. Importers exchange the force once per communication step, so that R acts one step late: step
    at the block's sample rate. Raises FmuError, UsageError where an FMU lacks these variables.
    """
    connections = [
        Connection("F", "mass.F"),
        Connection("mass.x", "force.x"),
        Connection("mass.v", "force.v"),
        Connection("force.R", "mass.R"),
        Connection("mass.x", "x"),
        Connection("mass.v", "v"),
        Connection("force.R", "R"),
    ]
    outputs = ["x", "v", "R"]
    experiment = open_fmu(force).model.experiment
    with tempfile.TemporaryDirectory() as folder:
        code = mass_code(mass, step=experiment.step, stop=experiment.stop)
        components = {"force": Path(force), "mass": build(code, Path(folder) / "mass.fmu").path}
        if reference is not None:
            components["reference"] = Path(reference)
            connections += [Connection("F", "reference.F"), Connection("reference.x", "x_reference")]
            outputs.append("x_reference")
        return write_ssp(out, name, components, connections, inputs=["F"], outputs=outputs, experiment=experiment)
