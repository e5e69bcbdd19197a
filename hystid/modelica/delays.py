"""``delay(expr, delayTime, delayMax)``: the past of an expression, kept at accepted steps and at events.

The points lie in the value block, so that states of an FMU, resets and steps that are taken back need nothing of their
own. Between points a cubic goes through four of them; none reaches over a jump. A jump that was kept is an event when
it comes out at the other end, and a delay by a fixed time makes one at the end of what is kept as well: nothing is ever
read that has not been computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.blocks import Assign, Step
from hystid.modelica.c_expr import Printer, quoted
from hystid.modelica.event_model import Delay
from hystid.modelica.expr import evaluate

_HEAD = 5  # numbers before the points
_FOR_JUMPS = 256  # points beyond those of the steps
_POINTS = 100_000  # points: some megabytes of each copy of an instance's state


def room(delay: Delay, step: float, dependent: Sequence[Step], starts: Mapping[str, float]) -> int:
    """Points of a delay: two for each step of the experiment, and some for jumps. Raises ModelicaError."""
    known = dict(starts)
    for one in dependent:
        value = evaluate(one.value, known) if isinstance(one, Assign) else None
        if value is not None and isinstance(one, Assign):
            known[one.variable] = value
    most = evaluate(delay.most, known)
    if most is None or not math.isfinite(most) or most < 0 or (delay.fixed and most == 0):
        what = "the delay time must be above 0" if most is not None else "the longest delay time must have a value"
        raise ModelicaError(f"{delay.place}: {what} when the model is built: give the parameter a value")
    points = 2 * most / step + _FOR_JUMPS
    if points > _POINTS:
        raise ModelicaError(
            f"{delay.place}: a delay by {most:g} s in steps of {step:g} s keeps {points:.0f} points (limit {_POINTS}): "
            "state a longer Interval in annotation(experiment(...))"
        )
    return math.ceil(points)


def slots(delay: Delay, points: int) -> list[str]:
    """Names of its numbers in the value block; the first is that of the delay."""
    return [delay.name, *(f"{delay.name}.{k}" for k in range(1, _HEAD + 2 * points))]


class DelayPrinter:
    """Statements about one delay for the functions of a model."""

    def __init__(self, delay: Delay, points: int, step: float, printer: Printer) -> None:
        self.delay, self.points, self.step, self.printer = delay, points, step, printer
        self.memory = f"&{printer.name(delay.name)}"
        self.value, self.time = printer.value(delay.value), printer.value(delay.time, 4)
        printer.used.add("hy_delayed")

    def _use(self, name: str) -> str:
        self.printer.used |= {"hy_delayed", name}
        return name

    def _ends(self, condition: str, reason: str) -> list[str]:
        text = quoted(f"{self.delay.place.short}: delay: {reason}")
        return [f"if ({condition}) {{", f"    m->log(m->owner, HY_FAILURE, {text});", "    return HY_ERROR;", "}"]

    def _full(self, call: str) -> list[str]:
        return self._ends(call, f"more than {self.points} points and jumps lie within the delay time")

    def begin(self) -> list[str]:
        """At the start."""
        most, now = self.printer.value(self.delay.most, 5), self.printer.name("time")
        lines = self._ends(f"!({self.time} > 0)", "the delay time must be above 0") if self.delay.fixed else []
        fits = f"!(2 * {most} <= {(self.points - _FOR_JUMPS / 2) * self.step!r})"
        lines += self._ends(fits, "it is longer than it was when the model was built: build it with this delay time")
        return [*lines, f"{self._use('hy_begin_past')}({self.memory}, {self.points}, {now}, {self.value});"]

    def keep(self) -> list[str]:
        """At an accepted step, and when an event begins."""
        most, gap = self.printer.value(self.delay.most), self.step * (1 - 1e-6)
        now = self.printer.name("time")
        call = f"{self._use('hy_keep')}({self.memory}, {now}, {self.value}, {most}, {gap!r})"
        within = f"!({self.time} >= 0 && {self.time} <= {most})"
        wrong = [] if self.delay.fixed else self._ends(within, "the delay time is not between 0 and delayMax")
        return [*wrong, *self._full(call)]

    def before(self) -> list[str]:
        """When an event begins."""
        passed = f"changed |= {self._use('hy_pass_jumps')}({self.memory}, {self.printer.name('time')}, {self.time});"
        return [*self.keep(), passed] if self.delay.fixed else self.keep()

    def after(self) -> list[str]:
        """When everything is computed at an event."""
        call = f"{self._use('hy_keep_jump')}({self.memory}, {self.value}, {int(self.delay.fixed)})"
        return self._full(call)

    def next_event(self) -> list[str]:
        """Where a jump comes out, and where what is kept ends."""
        if not self.delay.fixed:
            return []
        now, d = self.printer.name("time"), f"({self.memory})"
        bound = f"if ({d}[4] < INFINITY && {d}[4] + {self.time} > {now}) next = fmin(next, {d}[4] + {self.time});"
        ends = f"{self._use('hy_last_kept')}({self.memory}) + {self.time}"
        return [bound, f"if ({ends} > {now}) next = fmin(next, {ends});"]


TEXTS = {
    "hy_delayed": """\
/* The past of a delayed expression: d[0] room for n points, d[1] how many there are, d[2] place of the oldest, d[3]
   instant of the last jump that has come out, d[4] of the next one that has not (INFINITY: none), n instants, n values.
   A jump is two points of one instant. */
static const double *hy_point(const double *d, int i)
{
    return d + 5 + ((int)d[2] + i) % (int)d[0];
}

static int hy_points_up_to(const double *d, double s, int with_s) /* how many lie before s, or not after it */
{
    int low = 0, high = (int)d[1];
    while (low < high) {
        const int middle = (low + high) / 2;
        if (with_s ? *hy_point(d, middle) <= s : *hy_point(d, middle) < s) low = middle + 1;
        else high = middle;
    }
    return low;
}

static double hy_delayed(const double *d, double s)
{
    const int n = (int)d[0], jumps = s >= d[4];
    int last = (int)d[1] - 1, i, from, to;
    double sum = 0;
    if (last < 0) return 0;
    s = jumps ? d[4] : fmax(s, d[3]);
    i = hy_points_up_to(d, s, !jumps) - 1;
    if (i < 0) return hy_point(d, 0)[n];
    if (jumps) last = i + 1;
    from = i > 0 && *hy_point(d, i - 1) < *hy_point(d, i) ? i - 1 : i;
    to = i < last ? i + 1 : i;
    if (to > i && to < last && *hy_point(d, to + 1) > *hy_point(d, to)) to++;
    for (int j = from; j <= to; j++) {
        double part = hy_point(d, j)[n];
        for (int k = from; k <= to; k++)
            if (k != j) part *= (s - *hy_point(d, k)) / (*hy_point(d, j) - *hy_point(d, k));
        sum += part;
    }
    return sum;
}""",
    "hy_begin_past": """\
static void hy_begin_past(double *d, int n, double t, double u)
{
    d[0] = n, d[1] = 1, d[2] = 0, d[3] = -INFINITY, d[4] = INFINITY;
    d[5] = t, d[5 + n] = u;
}""",
    "hy_keep": """\
/* A point; in place of the last one where that stands closer than gap to both sides. 1: there is no room. */
static int hy_keep(double *d, double t, double u, double span, double gap)
{
    const int n = (int)d[0], count = (int)d[1];
    double *last = (double *)hy_point(d, count - 1);
    const double before = count > 1 ? *hy_point(d, count - 2) : *last;
    if (t - *last <= 1e-6 * gap) return 0; /* the same instant, to rounding: a slope between both would be noise */
    if (before == *last || t - before > gap) {
        while (d[1] > 4 && *hy_point(d, 3) < t - span) d[2] = ((int)d[2] + 1) % n, d[1]--;
        if (d[1] == n) return 1;
        last = (double *)hy_point(d, (int)d[1]++);
    }
    last[0] = t, last[n] = u;
    return 0;
}""",
    "hy_pass_jumps": """\
/* Jumps that have come out by now. 1: there was one. */
static int hy_pass_jumps(double *d, double now, double delay)
{
    const int passes = d[4] + delay <= now;
    while (d[4] + delay <= now) {
        double next = INFINITY;
        for (int i = (int)d[1] - 1; i > 0 && *hy_point(d, i) > d[4]; i--)
            if (*hy_point(d, i) == *hy_point(d, i - 1)) next = *hy_point(d, i);
        d[3] = d[4], d[4] = next;
    }
    return passes;
}""",
    "hy_keep_jump": """\
/* What an expression is after the event at its latest point. 1: there is no room. */
static int hy_keep_jump(double *d, double u, int fixed)
{
    const int n = (int)d[0], count = (int)d[1];
    double *last = (double *)hy_point(d, count - 1);
    const double t = *last, size = fabs(u) + fabs(last[n]);
    const int jumped = count > 1 && *hy_point(d, count - 2) == t;
    if (!jumped && fabs(u - last[n]) <= 1e-10 * size) return 0; /* rounding */
    if (!jumped && count == n) return 1;
    if (!jumped) last = (double *)hy_point(d, (int)d[1]++);
    last[0] = t, last[n] = u;
    if (fixed && !(d[4] < INFINITY)) d[4] = t;
    return 0;
}""",
    "hy_last_kept": """\
static double hy_last_kept(const double *d)
{
    return *hy_point(d, (int)d[1] - 1);
}""",
}
