/* Springs in series with dry sliders (stop operators) on a given motion, in closed form: between reversals of the motion
 * the force of such a spring moves with the displacement until it meets its limit (Visintin, Differential Models of
 * Hysteresis, 1994, III.2). No event has to be located: the speed is a cubic polynomial within a row, and so are its
 * reversals and the travel between them known. */
#include <stdlib.h>

#include "hy_engine.h"
#include "hy_paths.h"

static int alone(const hy_engine *e)
{
    const hy_model *m = e->model;
    return m->n_stops && !e->n_seeds && m->n_x - e->n_clamped == m->n_stops;
}

/* Forces, stiffnesses and limits of all stops one after another, as the loop over them reads them. */
static double *forces_of(const hy_engine *e) { return e->stops; }
static double *stiffnesses_of(const hy_engine *e) { return e->stops + e->model->n_stops; }
static double *limits_of(const hy_engine *e) { return e->stops + 2 * e->model->n_stops; }

static int open_stops(hy_engine *e)
{
    const int n = e->model->n_stops;
    const double *const v = e->data.v;
    double *const room = alone(e) ? malloc(3 * sizeof *room * (size_t)n) : NULL;
    if (!room) return 0;
    e->stops = room;
    for (int i = 0; i < n; i++) {
        const hy_stop *s = &e->model->stops[i];
        forces_of(e)[i] = v[s->force];
        stiffnesses_of(e)[i] = s->stiffness < 0 ? 1 : v[s->stiffness];
        limits_of(e)[i] = v[s->limit];
        if (!(stiffnesses_of(e)[i] >= 0) || !(limits_of(e)[i] >= 0) || hy_follow(e, s->speed)) return 0;
    }
    return 1;
}

static double smaller(double a, double b) { return a < b ? a : b; }
static double larger(double a, double b) { return a > b ? a : b; }

/* Without a branch on the force: where a slider slips is hard to foresee, for a processor too. A force beyond its limit,
 * where a start value put it, rests until the motion turns. */
static void move(double *restrict force, const double *restrict stiffness, const double *restrict limit, int n, double travel)
{
    if (travel > 0)
        for (int i = 0; i < n; i++) force[i] = smaller(force[i] + stiffness[i] * travel, larger(force[i], limit[i]));
    else if (travel < 0)
        for (int i = 0; i < n; i++) force[i] = larger(force[i] + stiffness[i] * travel, smaller(force[i], -limit[i]));
    else
        for (int i = 0; i < n; i++) force[i] += stiffness[i] * travel; /* no motion, or not a number */
}

/* Stops that one speed moves: those from first on, up to the last. */
static void run_along(hy_engine *e, int first, int last, int n, double *const *rows)
{
    const hy_model *const m = e->model;
    const hy_path *const path = hy_driven_at(e, m->stops[first].speed)->path;
    const double *travel = path->travels;
    double *const force = forces_of(e);
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < path->n[i]; k++, travel++)
            move(force + first, stiffnesses_of(e) + first, limits_of(e) + first, last - first, *travel);
        for (int k = first; rows && k < last; k++) rows[m->stops[k].force - m->x][i] = force[k];
    }
}

static int move_stops(hy_engine *e, int n, double *const *rows)
{
    const hy_stop *const stops = e->model->stops;
    const int count = e->model->n_stops;
    for (int i = 0, next; i < count; i = next) {
        for (next = i + 1; next < count && stops[next].speed == stops[i].speed; next++) continue;
        run_along(e, i, next, n, rows);
    }
    for (int i = 0; i < count; i++) e->data.v[stops[i].force] = forces_of(e)[i];
    e->status->stale = 1;
    return n;
}

static void mark_stops(hy_engine *e)
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

const struct hy_stop_methods hy_stop_methods = {alone, open_stops, move_stops, mark_stops};
