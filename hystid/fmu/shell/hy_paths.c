#include "hy_paths.h"

#include <math.h>
#include <stdlib.h>

enum { MOST_LOOKS = 100 };

static const double NEAR = 1e-9; /* step, share of the interval, after which Newton's method is at rounding */

static double value(const double *c, double s) { return c[0] + s * (c[1] + s * (c[2] + s * c[3])); }
static double integral(const double *c, double s) { return s * (c[0] + s * (c[1] / 2 + s * (c[2] / 3 + s * c[3] / 4))); }

/* Offsets in (0, h) at which the polynomial has a slope of 0, in rising order. */
static int extremes(const double *c, double h, double *at)
{
    const double p = 3 * c[3], q = c[2], r = c[1], root = q * q - p * r;
    double first, second;
    int n = 0;
    if (!(root >= 0)) return 0;
    {
        const double w = -(q + copysign(sqrt(root), q)); /* no difference of numbers that are alike */
        first = p != 0 ? w / p : INFINITY;
        second = w != 0 ? r / w : INFINITY;
    }
    if (first > second) {
        const double other = first;
        first = second;
        second = other;
    }
    if (first > 0 && first < h) at[n++] = first;
    if (second > first && second > 0 && second < h) at[n++] = second;
    return n;
}

double hy_zero(const double *c, double low, double high)
{
    const double first = value(c, low), last = value(c, high), near = NEAR * (high - low);
    const int rising = last > first;
    double at = fmin(fmax(low + (high - low) * (first / (first - last)), low), high);
    for (int i = 0; i < MOST_LOOKS; i++) {
        const double f = value(c, at), slope = c[1] + at * (2 * c[2] + at * 3 * c[3]);
        double next;
        if (f == 0) return at;
        if ((f > 0) == rising)
            high = at;
        else
            low = at;
        next = at - f / slope;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (fabs(next - at) <= near) return next;
        at = next;
    }
    return at;
}

/* Over s in [0, h] of a cubic; returns how many travels there are, each of one sign. */
static int travels_of(const double c[4], double h, double travels[HY_MOST_TRAVELS])
{
    double edges[4], before = 0;
    const int inner = extremes(c, h, edges + 1);
    int n = 0;
    edges[0] = 0;
    edges[inner + 1] = h;
    for (int i = 0; i <= inner; i++) {
        double reached;
        if (!(value(c, edges[i]) * value(c, edges[i + 1]) < 0)) continue;
        reached = integral(c, hy_zero(c, edges[i], edges[i + 1]));
        travels[n++] = reached - before;
        before = reached;
    }
    travels[n++] = integral(c, h) - before;
    return n;
}

int hy_follow(hy_engine *e, int slot)
{
    hy_driven *const speed = hy_driven_at(e, slot);
    if (!speed) return HY_ERROR;
    speed->path = e->paths + (speed - e->driven);
    return HY_OK;
}

/* Integral of a column over the interval after a row; NaN where it may change its sign there. */
static double way_after(const hy_table *t, int column, int row)
{
    const double *const u = t->samples[column] + row, h = t->dt;
    double bend = 0, early = u[0], late = u[1]; /* early, late: Bernstein coefficients between the two ends */
    if (t->column_modes[column] == HY_HOLD) return h * u[0];
    if (t->column_modes[column] == HY_HERMITE) {
        const double *const d = t->slopes[column] + row;
        early += h / 3 * d[0];
        late -= h / 3 * d[1];
        bend = h / 12 * (d[0] - d[1]);
    }
    if ((u[0] >= 0 && early >= 0 && late >= 0 && u[1] >= 0) || (u[0] <= 0 && early <= 0 && late <= 0 && u[1] <= 0))
        return h * (0.5 * (u[0] + u[1]) + bend);
    return NAN;
}

/* How a column leads through the n rows after one. */
static void set_path(hy_path *p, const hy_table *t, int column, int row, int n)
{
    double *travel = p->travels, c[4];
    for (int i = 0; i < n; i++) {
        const double simple = way_after(t, column, row + i);
        if (isnan(simple)) {
            hy_interpolate(t, column, row + i, c);
            p->n[i] = travels_of(c, t->dt, travel);
        } else {
            p->n[i] = 1;
            *travel = simple;
        }
        travel += p->n[i];
    }
}

static void set_paths(hy_engine *e, const hy_table *t, int row, int n)
{
    for (int i = 0; i < t->n_columns; i++)
        if (e->driven[i].path) set_path(e->driven[i].path, t, i, row, n);
}

static int open_paths(hy_engine *e)
{
    e->paths = malloc(sizeof *e->paths * (size_t)(e->status->n_driven + 1));
    return e->paths ? HY_OK : HY_ERROR;
}

const struct hy_path_methods hy_path_methods = {open_paths, set_paths};
