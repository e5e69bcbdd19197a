"""A mass as an FMU: m a + R = F, its restoring force an input."""

from __future__ import annotations

import hashlib
from functools import partial

from hystid.errors import UsageError
from hystid.modelcode import Experiment, ModelCode, Variable

DELAY = 1.5  # steps: importers that pass outputs on after all have stepped bring R one step late, then it is held

_TEXT = """\
/* m a + R = F: a mass that takes its restoring force as an input.
 *
 * x_ahead and v_ahead are the motion ahead by the time "lead", by a Taylor series with the acceleration of the last
 * step: a force that is computed from them and arrives late by "lead" arrives on time. What the series leaves out, lead
 * cubed times the third derivative of x (1/6, and 1/2 for the acceleration that is late, too), damps a spring. */
#include "hy_model.h"

enum { T, M, X_START, V_START, LEAD, F, R, X, V, DX, DV, LAST, A, X_AHEAD, V_AHEAD, PRE, N };

static const double start[N] = {[M] = @MASS@, [LEAD] = @LEAD@};

static void look_ahead(double *v)
{
    v[X_AHEAD] = v[X] + v[LEAD] * (v[V] + 0.5 * v[LEAD] * v[LAST]);
    v[V_AHEAD] = v[V] + v[LEAD] * v[LAST];
}

static int initialise(hy_data *m)
{
    m->v[X] = m->v[X_START];
    m->v[V] = m->v[V_START];
    m->v[LAST] = 0;
    return HY_OK;
}

static int evaluate(hy_data *m)
{
    double *const v = m->v;
    v[DX] = v[V];
    v[DV] = v[A] = (v[F] - v[R]) / v[M];
    look_ahead(v);
    return HY_OK;
}

static int completed_step(hy_data *m)
{
    m->v[LAST] = m->v[A];
    look_ahead(m->v);
    return HY_OK;
}

static int forward(hy_data *m, const double *seed, double *sens)
{
    const double *const v = m->v, lead = v[LEAD];
    sens[DX] = seed[V];
    sens[DV] = sens[A] = (seed[F] - seed[R] - v[A] * seed[M]) / v[M];
    sens[V_AHEAD] = seed[V] + lead * seed[LAST] + v[LAST] * seed[LEAD];
    sens[X_AHEAD] = seed[X] + lead * (seed[V] + 0.5 * lead * seed[LAST]) + (v[V] + lead * v[LAST]) * seed[LEAD];
    return HY_OK;
}

static int adjoint(hy_data *m, const double *seed, double *sens)
{
    const double *const v = m->v, lead = v[LEAD];
    const double a = (seed[DV] + seed[A]) / v[M];
    sens[X] += seed[X_AHEAD];
    sens[V] += seed[DX] + seed[V_AHEAD] + lead * seed[X_AHEAD];
    sens[LAST] += lead * (seed[V_AHEAD] + 0.5 * lead * seed[X_AHEAD]);
    sens[LEAD] += v[LAST] * seed[V_AHEAD] + (v[V] + lead * v[LAST]) * seed[X_AHEAD];
    sens[F] += a;
    sens[R] -= a;
    sens[M] -= a * v[A];
    return HY_OK;
}

const hy_model hy_the_model = {
    .name = "Mass", .token = "@TOKEN@", .n_values = N, .p = M, .n_p = 4, .u = F, .n_u = 2, .x = X, .n_x = 2, .dx = DX,
    .d = LAST, .n_d = 1, .y = A, .n_y = 3, .pre = PRE, .rel = N, .w = N, .step = @STEP@, .sample = -1,
    .start = start,
    .initialise = initialise, .evaluate = evaluate, .completed_step = completed_step, .forward = forward,
    .adjoint = adjoint,
};
"""


def mass_code(mass: float, *, step: float = 1e-3, stop: float = 1.0) -> ModelCode:
    """The block m a + R = F: inputs F and R [N], outputs x [m], v [m/s], a [m/s2] and, ahead of time by the parameter
    lead [s], x_ahead and v_ahead; parameters m, x_start, v_start, lead (1.5 steps).

    mass [kg], step and stop of the default experiment [s]. Raises UsageError where they are not positive.
    """
    if not (mass > 0 and step > 0 and stop > 0):
        raise UsageError("a mass, its step and the stop time must be positive")
    text = _TEXT.replace("@MASS@", repr(float(mass))).replace("@STEP@", repr(float(step)))
    text = text.replace("@LEAD@", repr(float(DELAY * step)))
    token = hashlib.sha256(text.encode()).hexdigest()[:32]
    acceleration = ("m", "F", "R")
    return ModelCode(
        "Mass",
        "m a + R = F",
        _variables(float(mass), float(DELAY * step)),
        {"model.c": text.replace("@TOKEN@", token)},
        states=("x", "v"),
        n_values=16,
        dependencies={
            "x": ("x",), "v": ("v",), "der(x)": ("v",), "der(v)": acceleration, "a": acceleration,
            "x_ahead": ("x", "v", "a_last", "lead"), "v_ahead": ("v", "a_last", "lead"),
        },
        has_forward=True,
        has_adjoint=True,
        has_memory=True,
        steps_are_samples=True,
        experiment=Experiment(0.0, stop, step),
        reinit=(),
        token=token,
    )  # fmt: skip


def _variables(mass: float, lead: float) -> tuple[Variable, ...]:
    output = partial(Variable, causality="output", variability="continuous", initial="calculated")
    return (
        Variable("m", 1, "parameter", "tunable", start=mass, min=0.0, unit="kg", description="Mass"),
        Variable("x_start", 2, "parameter", "fixed", start=0.0, unit="m", description="Displacement at the start"),
        Variable("v_start", 3, "parameter", "fixed", start=0.0, unit="m/s", description="Velocity at the start"),
        Variable("lead", 4, "parameter", "tunable", start=lead, min=0.0, unit="s", description="Delay of R"),
        Variable("F", 5, "input", "continuous", start=0.0, unit="N", description="Excitation, in the direction of x"),
        Variable("R", 6, "input", "continuous", start=0.0, unit="N", description="Restoring force, opposes motion"),
        output("x", 7, unit="m", description="Displacement"),
        output("v", 8, unit="m/s", description="Velocity"),
        Variable("der(x)", 9, "local", "continuous", unit="m/s", derivative_of="x"),
        Variable("der(v)", 10, "local", "continuous", unit="m/s2", derivative_of="v"),
        Variable("a_last", 11, "local", "discrete", initial="calculated", unit="m/s2", description="a before"),
        output("a", 12, unit="m/s2", description="Acceleration"),
        output("x_ahead", 13, unit="m", description="Displacement ahead by lead, for the force"),
        output("v_ahead", 14, unit="m/s", description="Velocity ahead by lead, for the force"),
    )
