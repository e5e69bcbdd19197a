#include "hy_stops.h"

#include <math.h>

enum { MOST_REVERSALS = 3, MOST_LOOKS = 100 };

int hy_only_stops_are_free(const hy_engine *e)
{
    const hy_model *m = e->model;
    return m->n_stops && !e->n_seeds && m->n_x - e->n_clamped == m->n_stops;
}

static const double *polynomial_of(const hy_engine *e, int slot)
{
    for (int i = 0; i < e->status->n_driven; i++)
        if (e->driven[i].slot == slot) return e->driven[i].c;
    return NULL;
}

static double stiffness_of(const hy_engine *e, const hy_stop *s) { return s->stiffness < 0 ? 1 : e->data.v[s->stiffness]; }

int hy_stops_follow(const hy_engine *e)
{
    const double *const v = e->data.v;
    if (!hy_only_stops_are_free(e)) return 0;
    for (int i = 0; i < e->model->n_stops; i++) {
        const hy_stop *s = &e->model->stops[i];
        if (!polynomial_of(e, s->speed) || !(stiffness_of(e, s) >= 0) || !(v[s->limit] >= 0)) return 0;
    }
    return 1;
}

static double value(const double *c, double s) { return c[0] + s * (c[1] + s * (c[2] + s * c[3])); }
static double integral(const double *c, double s) { return s * (c[0] + s * (c[1] / 2 + s * (c[2] / 3 + s * c[3] / 4))); }

/* Whether the polynomial keeps its sign over [0, h]: its Bernstein coefficients do. */
static int keeps_sign(const double *c, double h)
{
    const double b1 = c[0] + c[1] * h / 3, b2 = c[0] + h * (2 * c[1] + c[2] * h) / 3, b3 = value(c, h);
    return (c[0] >= 0 && b1 >= 0 && b2 >= 0 && b3 >= 0) || (c[0] <= 0 && b1 <= 0 && b2 <= 0 && b3 <= 0);
}

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

/* Where the polynomial, monotone over [low, high] with ends of different sign, is 0. */
static double zero(const double *c, double low, double high)
{
    const int rising = value(c, high) > value(c, low);
    double at = 0.5 * (low + high);
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
        if (fabs(next - at) <= 1e-16 * fabs(at) || next == low || next == high) return next;
        at = next;
    }
    return at;
}

/* Ways between the reversals within h; returns how many. */
static int ways_of(const double *c, double h, double *ways)
{
    double edges[4], before = 0;
    int n = 0, inner;
    if (keeps_sign(c, h)) {
        ways[0] = integral(c, h);
        return 1;
    }
    inner = extremes(c, h, edges + 1);
    edges[0] = 0;
    edges[inner + 1] = h;
    for (int i = 0; i <= inner; i++) {
        double reached;
        if (!(value(c, edges[i]) * value(c, edges[i + 1]) < 0)) continue;
        reached = integral(c, zero(c, edges[i], edges[i + 1]));
        ways[n++] = reached - before;
        before = reached;
    }
    ways[n++] = integral(c, h) - before;
    return n;
}

/* A force beyond its limit, where a start value put it, rests until the motion turns. */
static double moved(double force, double by, double limit)
{
    if (by > 0) return force >= limit ? force : fmin(force + by, limit);
    if (by < 0) return force <= -limit ? force : fmax(force + by, -limit);
    return force + by; /* no motion, or not a number */
}

void hy_move_stops(hy_engine *e, double h)
{
    double *const v = e->data.v, ways[MOST_REVERSALS + 1];
    int n = 0, speed = -1;
    for (int i = 0; i < e->model->n_stops; i++) {
        const hy_stop *s = &e->model->stops[i];
        if (s->speed != speed) n = ways_of(polynomial_of(e, s->speed), h, ways);
        speed = s->speed;
        for (int k = 0; k < n; k++) v[s->force] = moved(v[s->force], stiffness_of(e, s) * ways[k], v[s->limit]);
    }
    e->status->stale = 1;
}

void hy_mark_stops(hy_engine *e)
{
    double *const v = e->data.v;
    for (int i = 0; i < e->model->n_stops; i++) {
        const hy_stop *s = &e->model->stops[i];
        const double force = v[s->force], limit = v[s->limit], speed = v[s->speed];
        v[s->above] = force >= limit;
        v[s->below] = force <= -limit;
        v[s->forward] = speed > 0;
        v[s->backward] = speed < 0;
        v[s->slips] = (force >= limit && speed > 0) || (force <= -limit && speed < 0);
        v[e->model->pre + s->slips - e->model->d] = v[s->slips];
    }
    e->status->stale = 1;
}
