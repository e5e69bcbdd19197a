"""C text of a mass on a network: m a = F - R(x, v, memory).

Parameters m, x_start, v_start and, with turning points, R_start; inputs F and the further ones of the network; states
x, v; outputs R and the range flag.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hystid.networks.onnx_reading import StepDescription
from hystid.surrogate import block
from hystid.surrogate.loops import number
from hystid.surrogate.program import Program

_FIXED = 11  # what stands in the private memory before the next memory


def recorded(n_d: int, further: int) -> int:
    """Length of the private memory before the network's own, for a memory of n_d numbers and further inputs."""
    return _FIXED + n_d + 2 * further


@dataclass(frozen=True)
class OscillatorText:
    """program: inputs x, v, state; outputs R, state_next. about: what the file says of them: elements of the state that
    follow v or a further input late start settled, those that hold the force start at R_start, scaled by its level.
    """

    program: Program
    about: StepDescription

    @property
    def further(self) -> tuple[str, ...]:
        """Names of the further inputs."""
        return tuple(port.name for port in self.about.inputs)

    def text(self) -> str:
        """Everything that the shell calls."""
        return "\n".join(
            [self._records(), self._at_sample(), self._between(), self._evaluate(), self._start(), self._derivatives()]
        )

    def _run(self, mode: str, state: str, ends: Mapping[str, str] | None = None) -> str:
        inputs = {"x": "&x", "v": "&speed", "state": state} | self._places("v + U")
        results = {"R": "&now.R", "state_next": "next"}
        work = f"v + W + {recorded(len(self.about.initial_state), len(self.further))}"
        slopes = {"R": "&d_R", "state_next": "d_next"} if ends else None
        if self.about.spread:
            results |= {"R_spread": "&now.spread"}
            slopes = slopes and slopes | {"R_spread": "&d_spread"}
        return block.call(self.program, mode, inputs, results, ends, slopes, work)

    def _places(self, base: str) -> dict[str, str]:
        """Further inputs in a row that is laid out as the inputs are."""
        return {name: f"{base} + {1 + i}" for i, name in enumerate(self.further)}

    def _records(self) -> str:
        places = {"x": "v[X]", "v": "v[X + 1]"} | {name: f"v[U + {1 + i}]" for i, name in enumerate(self.further)}
        known = {name: place for name, place in places.items() if name in self.about.training_range}
        ranges = [block.range_test(place, *self.about.training_range[name]) for name, place in known.items()]
        return f"""\
enum {{
    WARNED = W,                                       /* 1 after the warning */
    AT_SAMPLE, AT_X, AT_V, AT_R, AT_SPREAD,           /* 1 where there is an accepted sample; what it was */
    LATEST, LATEST_X, LATEST_V, LATEST_R, LATEST_SPREAD, /* 1 where there is an answer since that sample; the latest */
    LATEST_NEXT,
    AT_U = LATEST_NEXT + N_D, LATEST_U = AT_U + N_U - 1 /* the further inputs of both */
}};

/* Whether the further inputs are those of a record; then keep them there. */
static int same_inputs(const double *v, int record)
{{
    int same = 1;
    for (int i = 0; i < N_U - 1; ++i) same &= v[U + 1 + i] == v[record + i];
    return same;
}}

static void keep_inputs(double *v, int record)
{{
    for (int i = 0; i < N_U - 1; ++i) v[record + i] = v[U + 1 + i];
}}

typedef struct {{
    double R, spread;
}} answer;

static void outputs(double *v, answer now)
{{
    v[Y] = now.R;
    v[Y + 1] = {" || ".join(test for test in ranges if test) or "0"};
    v[DX] = v[X + 1];
    v[DX + 1] = (v[U] - now.R) / v[P];
{"    v[Y + 2] = now.spread;" if self.about.spread else ""}
}}
"""

    def _at_sample(self) -> str:
        reuse = """\
    const int same = v[LATEST] != 0.0 && v[LATEST_X] == x && v[LATEST_V] == speed && same_inputs(v, LATEST_U);
    if (same && v[D] * speed > 0.0) {
        memcpy(next, v + LATEST_NEXT, N_D * sizeof *next); /* no turning point: the memory stays */
        if (next[0] != speed) next[0] = v[D];
        return (answer){v[LATEST_R], v[LATEST_SPREAD]};
    }
"""
        return f"""\
/* R at a new sample, and the memory that follows it. */
static answer at_sample(hy_data *m, double *next)
{{
    answer now = {{0.0, 0.0}};
    double *v = m->v, x = v[X], speed = v[X + 1];
{reuse if self.about.turning else ""}    {self._run("", "v + D")}
    return now;
}}
"""

    def _held(self) -> str:
        """Declarations that hold the memory still, as if the motion had gone its present way all along."""
        still = """\
    frozen[0] = copysign(1e300, speed);
    if (speed == 0.0) speed = copysign(1e-300, speed);
"""
        return f"""\
    answer now = {{0.0, 0.0}};
    double *v = m->v, x = v[X], speed = v[X + 1], next[N_D], frozen[N_D];
    memcpy(frozen, v + D, sizeof frozen);
{still if self.about.turning else ""}"""

    def _between(self) -> str:
        return f"""\
/* R between samples: with the memory as it stands, so that there are no turning points. */
static answer between(hy_data *m)
{{
{self._held()}    {self._run("", "frozen")}
    v[LATEST] = 1.0;
    v[LATEST_X] = v[X];
    v[LATEST_V] = v[X + 1];
    v[LATEST_R] = now.R;
    v[LATEST_SPREAD] = now.spread;
    keep_inputs(v, LATEST_U);
    memcpy(v + LATEST_NEXT, next, sizeof next);
    return now;
}}
"""

    def _evaluate(self) -> str:
        return """\
static int evaluate(hy_data *m)
{
    double *v = m->v, next[N_D];
    if (v[AT_SAMPLE] == 0.0)
        outputs(v, at_sample(m, next)); /* the start, which is about to become the first sample */
    else if (v[AT_X] == v[X] && v[AT_V] == v[X + 1] && same_inputs(v, AT_U))
        outputs(v, (answer){v[AT_R], v[AT_SPREAD]});
    else
        outputs(v, between(m));
    if (isfinite(v[DX + 1])) return HY_OK;
    m->log(m->owner, HY_FAILURE, "the restoring force of the network is not finite");
    return HY_RETRY;
}

/* The present motion becomes a sample: the memory moves on. */
static int completed_step(hy_data *m)
{
    double *v = m->v, next[N_D];
    const answer now = at_sample(m, next);
    memcpy(v + D, next, sizeof next);
    v[AT_SAMPLE] = 1.0;
    v[AT_X] = v[X];
    v[AT_V] = v[X + 1];
    v[AT_R] = now.R;
    v[AT_SPREAD] = now.spread;
    keep_inputs(v, AT_U);
    v[LATEST] = 0.0;
    outputs(v, now);
    if (v[Y + 1] != 0.0 && v[WARNED] == 0.0) {
        m->log(m->owner, HY_WARNING,
               "the motion, or a further input, has left the range of the training data: R is an extrapolation");
        v[WARNED] = 1.0;
    }
    return isfinite(now.R) ? HY_OK : HY_ERROR;
}
"""

    def _start(self) -> str:
        places = {"v": "m->v[X + 1]"} | dict(zip(self.further, self._seen(), strict=True))
        forces = "".join(f"    m->v[D + {slot}] = {places[source]};\n" for slot, source in self.about.late.items())
        if self.about.turning:
            forces += f"    const double begin = {self._scaled_start()};\n"
            forces += "".join(f"    m->v[D + {slot}] = begin;\n" for slot in self.about.force_slots)
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

    def _seen(self) -> list[str]:
        """What the networks see of the further inputs: their values, or those of their curves."""
        found = []
        for i, port in enumerate(self.about.inputs, start=1):
            value = f"m->v[U + {i}]"
            if port.curve is not None:
                lines = zip(port.curve.at, port.curve.at[1:], port.curve.slopes, strict=False)
                along = (
                    f"{number(slope)} * (fmax(fmin({value}, {number(end)}), {number(begin)}) - {number(begin)})"
                    for begin, end, slope in lines
                )
                value = f"({' + '.join([number(port.curve.to[0]), *along])})"
            found.append(value)
        return found

    def _scaled_start(self) -> str:
        """R_start as the memory has it."""
        if self.about.level is None:
            return "m->v[P + 3]"
        signals = [*self._seen(), *(f"m->v[D + {slot}]" for slot in self.about.late)]

        def plane(constant: float, slopes: Sequence[float], names: Sequence[str]) -> str:
            terms = (f"{number(slope)} * {name}" for slope, name in zip(slopes, names, strict=True))
            return " + ".join([number(constant), *terms])

        centre = plane(self.about.level.offset, self.about.level.slopes, ["m->v[X]", *signals])
        spread = plane(self.about.level.base, self.about.level.growth, signals)
        return f"(m->v[P + 3] - ({centre})) / fmax({spread}, {number(self.about.level.least)})"

    def _derivatives(self) -> str:
        forward = {"x": "seed + X", "v": "seed + X + 1", "state": "seed + D"} | self._places("seed + U")
        adjoint = {"x": "sens + X", "v": "sens + X + 1", "state": "sens + D"} | self._places("sens + U")
        return f"""\
static int forward(hy_data *m, const double *seed, double *sens)
{{
    double d_R = 0.0, d_spread = 0.0, d_next[N_D] = {{0}};
    (void)d_spread;
{self._held()}    {self._run("_forward", "frozen", forward)}
    memset(sens, 0, N_VALUES * sizeof *sens);
    sens[Y] = d_R;
{"    sens[Y + 2] = d_spread;" if self.about.spread else ""}
    sens[DX] = seed[X + 1];
    sens[DX + 1] = (seed[U] - d_R - seed[P] * v[DX + 1]) / v[P];
    return HY_OK;
}}

static int adjoint(hy_data *m, const double *seed, double *sens)
{{
    double d_R = seed[Y] - seed[DX + 1] / m->v[P], d_next[N_D] = {{0}};
    double d_spread = {"seed[Y + 2]" if self.about.spread else "0.0"};
    (void)d_spread;
{self._held()}    {self._run("_adjoint", "frozen", adjoint)}
    sens[X + 1] += seed[DX];
    sens[U] += seed[DX + 1] / v[P];
    sens[P] -= seed[DX + 1] * v[DX + 1] / v[P];
    return HY_OK;
}}
"""
