"""C text of a mass on a network: m a = F - R(x, v, memory).

Parameters m, x_start, v_start and, with turning points, R_start; input F; states x, v; outputs R and the range flag.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hystid.surrogate import block
from hystid.surrogate.program import Program

_FIXED = 9  # what stands in the private memory before the next memory


def recorded(n_d: int) -> int:
    """Length of the private memory before the network's own, for a memory of n_d numbers."""
    return _FIXED + n_d


@dataclass(frozen=True)
class OscillatorText:
    """program: inputs x, v, state; outputs R, state_next. n_d: length of the state.

    turning: whether state[0] is v_last and the memory is renewed where v_last v <= 0; then it can be held still between
    samples. force_slots: elements of the state that start at R_start.
    """

    program: Program
    n_d: int
    turning: bool
    force_slots: tuple[int, ...]
    training_range: Mapping[str, tuple[float, float]]

    def text(self) -> str:
        """Everything that the shell calls."""
        return "\n".join(
            [self._records(), self._at_sample(), self._between(), self._evaluate(), self._start(), self._derivatives()]
        )

    def _run(self, mode: str, state: str, ends: Mapping[str, str] | None = None) -> str:
        inputs = {"x": "&x", "v": "&speed", "state": state}
        results, work = {"R": "&R", "state_next": "next"}, f"v + W + {recorded(self.n_d)}"
        slopes = {"R": "&d_R", "state_next": "d_next"} if ends else None
        return block.call(self.program, mode, inputs, results, ends, slopes, work)

    def _records(self) -> str:
        ranges = [block.range_test(f"v[X + {i}]", *self.training_range[name]) for i, name in enumerate(("x", "v"))]
        return f"""\
enum {{
    WARNED = W,                                       /* 1 after the warning */
    AT_SAMPLE, AT_X, AT_V, AT_R,                      /* 1 where there is an accepted sample; what it was */
    LATEST, LATEST_X, LATEST_V, LATEST_R, LATEST_NEXT /* 1 where there is an answer since that sample; the latest */
}};

static void outputs(double *v, double R)
{{
    v[Y] = R;
    v[Y + 1] = {" || ".join(test for test in ranges if test) or "0"};
    v[DX] = v[X + 1];
    v[DX + 1] = (v[U] - R) / v[P];
}}
"""

    def _at_sample(self) -> str:
        reuse = """\
    if (v[LATEST] != 0.0 && v[LATEST_X] == x && v[LATEST_V] == speed && v[D] * speed > 0.0) {
        memcpy(next, v + LATEST_NEXT, N_D * sizeof *next); /* no turning point: the memory stays */
        if (next[0] != speed) next[0] = v[D];
        return v[LATEST_R];
    }
"""
        return f"""\
/* R at a new sample, and the memory that follows it. */
static double at_sample(hy_data *m, double *next)
{{
    double *v = m->v, x = v[X], speed = v[X + 1], R = 0.0;
{reuse if self.turning else ""}    {self._run("", "v + D")}
    return R;
}}
"""

    def _held(self) -> str:
        """Declarations that hold the memory still, as if the motion had gone its present way all along."""
        still = """\
    frozen[0] = copysign(1e300, speed);
    if (speed == 0.0) speed = copysign(1e-300, speed);
"""
        return f"""\
    double *v = m->v, x = v[X], speed = v[X + 1], R = 0.0, next[N_D], frozen[N_D];
    memcpy(frozen, v + D, sizeof frozen);
{still if self.turning else ""}"""

    def _between(self) -> str:
        return f"""\
/* R between samples: with the memory as it stands, so that there are no turning points. */
static double between(hy_data *m)
{{
{self._held()}    {self._run("", "frozen")}
    v[LATEST] = 1.0;
    v[LATEST_X] = v[X];
    v[LATEST_V] = v[X + 1];
    v[LATEST_R] = R;
    memcpy(v + LATEST_NEXT, next, sizeof next);
    return R;
}}
"""

    def _evaluate(self) -> str:
        return """\
static int evaluate(hy_data *m)
{
    double *v = m->v, next[N_D];
    if (v[AT_SAMPLE] == 0.0)
        outputs(v, at_sample(m, next)); /* the start, which is about to become the first sample */
    else
        outputs(v, v[AT_X] == v[X] && v[AT_V] == v[X + 1] ? v[AT_R] : between(m));
    if (isfinite(v[DX + 1])) return HY_OK;
    m->log(m->owner, HY_FAILURE, "the restoring force of the network is not finite");
    return HY_RETRY;
}

/* The present motion becomes a sample: the memory moves on. */
static int completed_step(hy_data *m)
{
    double *v = m->v, next[N_D];
    const double R = at_sample(m, next);
    memcpy(v + D, next, sizeof next);
    v[AT_SAMPLE] = 1.0;
    v[AT_X] = v[X];
    v[AT_V] = v[X + 1];
    v[AT_R] = R;
    v[LATEST] = 0.0;
    outputs(v, R);
    if (v[Y + 1] != 0.0 && v[WARNED] == 0.0) {
        m->log(m->owner, HY_WARNING, "the motion has left the range of the training data: R is an extrapolation");
        v[WARNED] = 1.0;
    }
    return isfinite(R) ? HY_OK : HY_ERROR;
}
"""

    def _start(self) -> str:
        forces = "".join(f"    m->v[D + {slot}] = m->v[P + 3];\n" for slot in self.force_slots if self.turning)
        return f"""\
static int parameters(hy_data *m)
{{
    if (m->v[P] > 0.0) return HY_OK;
    m->log(m->owner, HY_FAILURE, "the mass m must be above 0 kg");
    return HY_ERROR;
}}

static int initialise(hy_data *m)
{{
    m->v[X] = m->v[P + 1];
    m->v[X + 1] = m->v[P + 2];
    m->v[AT_SAMPLE] = m->v[LATEST] = 0.0;
{forces}    return HY_OK;
}}
"""

    def _derivatives(self) -> str:
        forward = {"x": "seed + X", "v": "seed + X + 1", "state": "seed + D"}
        adjoint = {"x": "sens + X", "v": "sens + X + 1", "state": "sens + D"}
        return f"""\
static int forward(hy_data *m, const double *seed, double *sens)
{{
    double d_R = 0.0, d_next[N_D] = {{0}};
{self._held()}    {self._run("_forward", "frozen", forward)}
    memset(sens, 0, N_VALUES * sizeof *sens);
    sens[Y] = d_R;
    sens[DX] = seed[X + 1];
    sens[DX + 1] = (seed[U] - d_R - seed[P] * v[DX + 1]) / v[P];
    return HY_OK;
}}

static int adjoint(hy_data *m, const double *seed, double *sens)
{{
    double d_R = seed[Y] - seed[DX + 1] / m->v[P], d_next[N_D] = {{0}};
{self._held()}    {self._run("_adjoint", "frozen", adjoint)}
    sens[X + 1] += seed[DX];
    sens[U] += seed[DX + 1] / v[P];
    sens[P] -= seed[DX + 1] * v[DX + 1] / v[P];
    return HY_OK;
}}
"""
