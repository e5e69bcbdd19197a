/* One step of the classical Runge-Kutta method of order four (Kutta 1901), cut at events.
 *
 * An event is located on the Runge-Kutta solution itself: a trial step of any length from the left end costs four
 * evaluations, so that no interpolation error enters. The bracket is closed by the Illinois form of regula falsi
 * (Dowell and Jarratt 1971) with a bisection every fourth time. */
#include <math.h>
#include <string.h>

#include "hy_engine.h"

enum {
    MOST_CROSSINGS = 12,  /* of one indicator within one step: faster switching is not resolved by the step */
    MOST_EVENTS = 10000,  /* within one step, of all kinds */
    MOST_HALVINGS = 12,
    MOST_TRIALS = 100
};
static const double WIDTH = 1e-13; /* of an event's bracket, as part of the step */
/* After an event the first look is this part of the step further on. A mass that bounces off a stop is still a rounding
 * error inside it; were the next look at the step's end, where it may have come back, both crossings would be missed. */
static const double FIRST_LOOK = 1e-6;

/* Where a step stands: it goes from t by h to exactly t_end; the present left end lies at t + s. */
typedef struct {
    double t, h, t_end, s;
} stretch;

static double time_at(const stretch *w, double s) { return s >= w->h ? w->t_end : w->t + s; }

static int slope(hy_engine *e, double *k)
{
    const hy_model *m = e->model;
    const double *dx = e->data.v + m->dx;
    const int outcome = m->evaluate(&e->data);
    if (outcome) return outcome;
    for (int i = 0; i < e->n_free; i++) k[i] = dx[e->free[i]];
    for (int s = 0; s < e->n_seeds; s++) {
        hy_sensitivity(e, s);
        for (int i = 0; i < e->n_free; i++) k[e->n_free * (1 + s) + i] = e->sens[m->dx + e->free[i]];
    }
    return HY_OK;
}

static void place(hy_engine *e, double time, const double *states)
{
    double *x = e->data.v + e->model->x;
    e->data.v[0] = time;
    for (int i = 0; i < e->n_free; i++) x[e->free[i]] = states[i];
    if (e->status->n_driven) hy_drive(e);
    e->status->stale = 1;
}

/* The sensitivities of a stage belong to the stage's states: hy_sensitivity reads them from X. */
static int stage(hy_engine *e, double time, double a)
{
    double *X = e->X, *trial = e->trial, *K = e->K;
    int outcome;
    for (int i = 0; i < e->n_X; i++) trial[i] = X[i] + a * K[i];
    place(e, time, trial);
    if (e->n_seeds) e->X = trial;
    outcome = slope(e, K);
    e->X = X;
    return outcome;
}

static int left_end(hy_engine *e)
{
    const double *x = e->data.v + e->model->x;
    int outcome = HY_OK;
    for (int i = 0; i < e->n_free; i++) e->X[i] = x[e->free[i]];
    if (!e->n_X && !e->model->n_z) return HY_OK;
    if (e->status->stale || e->n_seeds)
        outcome = slope(e, e->K1);
    else
        for (int i = 0; i < e->n_free; i++) e->K1[i] = e->data.v[e->model->dx + e->free[i]];
    if (!outcome) e->status->stale = 0;
    if (!outcome && e->model->n_z) outcome = e->model->indicators(&e->data, e->z_left);
    return outcome;
}

static int all_finite(const double *x, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += 0 * x[i]; /* 0 * inf and 0 * nan are nan */
    return sum == 0;
}

/* From the left end to offset s; the result stands in trial and in the block. X and K1 stay, for another trial. */
static int reach(hy_engine *e, const stretch *w, double s)
{
    const double h = s - w->s, middle = w->t + w->s + 0.5 * h, end = time_at(w, s);
    const int n = e->n_X;
    double *K = e->K, *sum = e->sum;
    int outcome;
    if (!n) {
        place(e, end, e->X);
        return HY_OK;
    }
    memcpy(K, e->K1, sizeof(double) * (size_t)n);
    memcpy(sum, K, sizeof(double) * (size_t)n);
    outcome = stage(e, middle, 0.5 * h);
    if (outcome) return outcome;
    for (int i = 0; i < n; i++) sum[i] += 2 * K[i];
    outcome = stage(e, middle, 0.5 * h);
    if (outcome) return outcome;
    for (int i = 0; i < n; i++) sum[i] += 2 * K[i];
    outcome = stage(e, end, h);
    if (outcome) return outcome;
    for (int i = 0; i < n; i++) e->trial[i] = e->X[i] + h / 6 * (sum[i] + K[i]);
    place(e, end, e->trial);
    return all_finite(e->trial, e->n_free) ? HY_OK : HY_RETRY;
}

/* As far towards *s as the model gives answers; *s is where it got to. */
static int reach_towards(hy_engine *e, const stretch *w, double *s)
{
    int outcome = reach(e, w, *s);
    for (int i = 0; outcome == HY_RETRY && i < MOST_HALVINGS && e->n_X; i++) {
        *s = w->s + 0.5 * (*s - w->s);
        outcome = reach(e, w, *s);
    }
    if (!outcome) return HY_OK;
    place(e, time_at(w, w->s), e->X);
    hy_report(e, HY_FAILURE, "no finite solution beyond t = %.9g s: a nonlinear equation does not converge or a state overflows",
              e->data.v[0]);
    return outcome;
}

/* Negative before the first of the indicators that have crossed at the right end does so, positive after. */
static double violation(const hy_engine *e, const double *z, const int *which)
{
    double most = -INFINITY;
    for (int i = 0; i < e->model->n_z; i++)
        if (which[i]) most = fmax(most, e->sign[i] != 0 ? -e->sign[i] * z[i] : fabs(z[i]));
    return most;
}

/* The earliest crossing in (w->s, *s]: sets *s and leaves the block just behind it. */
static int locate(hy_engine *e, const stretch *w, const int *which, double *s)
{
    double low = w->s, high = *s, at = high;
    double f_low = violation(e, e->z_left, which), f_high = violation(e, e->z, which);
    int outcome = HY_OK, last_side = 0;
    for (int i = 1; i < MOST_TRIALS && high - low > WIDTH * w->h && !outcome; i++) {
        const double margin = 0.25 * WIDTH * w->h;
        double f;
        at = 0.5 * (low + high);
        if (i % 4 && f_low < 0) at = low + (high - low) * f_low / (f_low - f_high);
        at = fmin(fmax(at, low + margin), high - margin);
        outcome = reach(e, w, at);
        if (!outcome) outcome = hy_settle(e);
        if (!outcome) outcome = e->model->indicators(&e->data, e->z);
        f = violation(e, e->z, which);
        if (f > 0) {
            if (last_side > 0) f_low *= 0.5;
            high = at, f_high = f, last_side = 1;
        } else {
            if (last_side < 0) f_high *= 0.5;
            low = at, f_low = f, last_side = -1;
        }
    }
    if (!outcome && at != high) outcome = reach(e, w, high);
    *s = high;
    return outcome;
}

/* Counts the crossings; *unresolved = 1 when one indicator has crossed too often within this step. */
static void count_crossings(hy_engine *e, const int *which, int *unresolved)
{
    for (int i = 0; i < e->model->n_z; i++)
        if (which[i] && ++e->crossings[i] > MOST_CROSSINGS) *unresolved = 1;
}

static int mark_crossed(hy_engine *e, int *which, int *any)
{
    const int outcome = hy_crossed(e, any);
    for (int i = 0; i < e->model->n_z && *any; i++) {
        const double z = e->z[i];
        which[i] = z != 0 && e->sign[i] != (z > 0 ? 1 : -1);
    }
    return outcome;
}

static int give_up_locating(hy_engine *e, int states_changed)
{
    if (states_changed) {
        hy_report(e, HY_FAILURE,
                  "Zeno: events accumulate at t = %.9g s and each sets states anew; give the model a resting mode", e->data.v[0]);
        return HY_ERROR;
    }
    if (!e->status->chattered)
        hy_report(e, HY_WARNING,
                  "chattering: a relation switches faster than the step from t = %.9g s; there it is held over each step, "
                  "which is accurate to first order only", e->data.v[0]);
    e->status->chattered = 1;
    return HY_OK;
}

static int next_target(const hy_engine *e, const stretch *w, double *target)
{
    const double next = e->model->next_time_event ? e->model->next_time_event(&e->data) : INFINITY;
    *target = w->h;
    if (!(next <= w->t_end + 1e-9 * w->h)) return 0;
    *target = fmin(fmax(next - w->t, w->s), w->h);
    return 1;
}

static int step_with_events(hy_engine *e, stretch w, int stop_at_events)
{
    int *which = e->crossings + e->model->n_z; /* second half */
    int sliding = 0, fresh = 0, outcome = HY_OK;
    memset(e->crossings, 0, sizeof(int) * (size_t)e->model->n_z);
    for (int events = 0;; events++) {
        double target, wanted;
        int any = 0, changed = 0, timed = next_target(e, &w, &target);
        wanted = target;
        if (fresh && !sliding) target = fmin(target, w.s + FIRST_LOOK * w.h);
        outcome = left_end(e);
        if (!outcome && target > w.s) outcome = reach_towards(e, &w, &target);
        if (!outcome) outcome = hy_settle(e);
        if (!outcome) outcome = mark_crossed(e, which, &any);
        if (!outcome && any && !sliding && target > w.s) {
            outcome = locate(e, &w, which, &target);
            if (!outcome) outcome = hy_settle(e);
        }
        if (outcome) return outcome;
        memcpy(e->X, e->trial, target > w.s ? sizeof(double) * (size_t)e->n_X : 0);
        w.s = target;
        timed = timed && target >= wanted;
        fresh = any || timed;
        if ((any || timed) && stop_at_events) {
            e->status->event_pending = 1;
            return HY_EVENT;
        }
        if (any || timed) outcome = hy_event(e, &changed);
        if (!outcome && any) {
            int unresolved = 0;
            count_crossings(e, which, &unresolved);
            if (unresolved && !sliding) outcome = give_up_locating(e, changed);
            sliding |= unresolved;
        }
        if (outcome) return outcome;
        if (w.s >= w.h && !(timed && next_target(e, &w, &target))) return HY_OK;
        if (events == MOST_EVENTS) {
            hy_report(e, HY_FAILURE, "more than %d events within one step at t = %.9g s", MOST_EVENTS, e->data.v[0]);
            return HY_ERROR;
        }
    }
}

static int step_without_events(hy_engine *e, stretch w)
{
    int outcome = HY_OK;
    while (!outcome && w.s < w.h) {
        double target = w.h;
        outcome = left_end(e);
        if (!outcome) outcome = reach_towards(e, &w, &target);
        if (!outcome && e->n_seeds) memcpy(e->X, e->trial, sizeof(double) * (size_t)e->n_X);
        w.s = target;
    }
    return outcome;
}

int hy_steps_in(const hy_engine *e, double h)
{
    const double n = e->model->step > 0 ? ceil(h / e->model->step * (1 - 1e-9)) : 1;
    return n < 1 ? 1 : n > 1e9 ? 1000000000 : (int)n;
}

int hy_advance(hy_engine *e, double h, int n, int stop_at_events, double *reached)
{
    const double t0 = e->data.v[0];
    const int events = hy_has_events(e);
    int outcome = HY_OK;
    *reached = t0;
    if (!e->n_X && !events) n = 1; /* nothing to integrate */
    for (int i = 0; i < n && !outcome; i++) {
        stretch w = {t0 + h * ((double)i / n), h / n, t0 + h * ((double)(i + 1) / n), 0};
        if (!e->n_X && !events)
            place(e, w.t_end, e->X);
        else
            outcome = events ? step_with_events(e, w, stop_at_events) : step_without_events(e, w);
        *reached = e->data.v[0];
        if (!outcome && i + 1 < n) outcome = hy_completed(e);
    }
    return outcome;
}
