#include "hy_stops.h"

#include <math.h>

#include "hy_ways.h"

int hy_only_stops_are_free(const hy_engine *e)
{
    const hy_model *m = e->model;
    return m->n_stops && !e->n_seeds && m->n_x - e->n_clamped == m->n_stops;
}

static double stiffness_of(const hy_engine *e, const hy_stop *s) { return s->stiffness < 0 ? 1 : e->data.v[s->stiffness]; }

int hy_open_stops(hy_engine *e)
{
    const double *const v = e->data.v;
    if (!hy_only_stops_are_free(e)) return 0;
    for (int i = 0; i < e->model->n_stops; i++) {
        const hy_stop *s = &e->model->stops[i];
        hy_driven *const speed = hy_driven_at(e, s->speed);
        if (!speed || !(stiffness_of(e, s) >= 0) || !(v[s->limit] >= 0)) return 0;
        speed->followed = 1;
    }
    return 1;
}

static double smaller(double a, double b) { return a < b ? a : b; }
static double larger(double a, double b) { return a > b ? a : b; }

/* Without a branch on the force: where a slider slips is hard to foresee, for a processor too. A force beyond its limit,
 * where a start value put it, rests until the motion turns. */
static double moved(double force, double by, double limit)
{
    if (by > 0) return smaller(force + by, larger(force, limit));
    if (by < 0) return larger(force + by, smaller(force, -limit));
    return force + by; /* no motion, or not a number */
}

void hy_move_stops(hy_engine *e, double h)
{
    double *const v = e->data.v, ways[HY_MOST_WAYS];
    int n = 0, speed = -1;
    for (int i = 0; i < e->model->n_stops; i++) {
        const hy_stop *s = &e->model->stops[i];
        if (s->speed != speed) n = hy_ways(hy_driven_at(e, s->speed), h, ways);
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
        const int above = force >= limit, below = force <= -limit, forward = speed > 0, backward = speed < 0;
        v[s->above] = above;
        v[s->below] = below;
        v[s->forward] = forward;
        v[s->backward] = backward;
        v[s->slips] = (above & forward) | (below & backward);
        v[e->model->pre + s->slips - e->model->d] = v[s->slips];
    }
    e->status->stale = 1;
}
