/* One step of the classical Runge-Kutta method of order four (Kutta 1901), cut at events.
 *
 * An event is located on the Runge-Kutta solution itself: a trial step of any length from the left end costs four
 * evaluations, so that no interpolation error enters. The bracket is closed by inverse quadratic interpolation where its
 * three points are so placed that it can be trusted, else by bisection (Chandrupatla 1997). */
#include <math.h>
#include <string.h>

#include "hy_engine.h"

enum {
    MOST_CROSSINGS = 12,  /* of one indicator within one step: faster switching is not resolved by the step */
    MOST_EVENTS = 10000,  /* within one step, of all kinds */
    MOST_HALVINGS = 12,
    IN_A_ROW = 8, /* steps that are too long, before it is told */
    MOST_TRIALS = 100
};
static const double WIDTH = 1e-11; /* of an event's bracket, as part of the step */
static const double ROUNDING = 1e-5; /* most, as part of the step, by which rounding may blur an event */
/* Share of a state by which a step may be wrong: a vibration of nine steps a period has it, and a decay as fast as the
 * step; of what is slower the method leaves less than a thousandth. */
static const double COARSE = 0.01;
static const double NOTHING = 1e-9; /* size of a state, in its unit, below which its error does not count */

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

static int left_indicators(hy_engine *e)
{
    double *const z = e->z;
    if (!e->z_stands) return e->model->indicators(&e->data, e->z_left);
    e->z = e->z_left;
    e->z_left = z;
    return HY_OK;
}

static int left_end(hy_engine *e)
{
    const double *const x = e->data.v + e->model->x, *const dx = e->data.v + e->model->dx;
    int outcome = HY_OK;
    for (int i = 0; i < e->n_free; i++) e->X[i] = x[e->free[i]];
    if (!e->n_X && !e->model->n_z) return HY_OK;
    if (e->status->stale) e->z_stands = 0;
    if (e->status->stale || e->n_seeds)
        outcome = slope(e, e->K1);
    else
        for (int i = 0; i < e->n_free; i++) e->K1[i] = dx[e->free[i]];
    if (!outcome) e->status->stale = 0;
    if (!outcome && e->model->n_z) outcome = left_indicators(e);
    e->z_stands = 0;
    return outcome;
}

static int all_finite(const double *x, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += 0 * x[i]; /* 0 * inf and 0 * nan are nan */
    return sum == 0;
}

/* reach, for the usual case that no sensitivity is carried: stages are formed in the block itself. Slopes that depend on
 * driven values alone are the same at both stages in the middle. */
static int reach_plain(hy_engine *e, double h, double middle, double end)
{
    const hy_model *m = e->model;
    const int n = e->n_free, first = e->free[0];
    double *const v = e->data.v, *restrict const x = v + m->x + first, *restrict const sum = e->sum;
    const double *restrict const dx = v + m->dx + first, *restrict const X = e->X, *restrict const K1 = e->K1;
    int outcome;
    for (int i = 0; i < n; i++) x[i] = X[i] + 0.5 * h * K1[i];
    v[0] = middle;
    hy_drive(e);
    outcome = m->evaluate(&e->data);
    for (int i = 0; i < n; i++) {
        sum[i] = K1[i] + 2 * dx[i];
        x[i] = X[i] + 0.5 * h * dx[i];
    }
    if (!e->quadrature) {
        if (e->has_clamped) hy_drive(e);
        if (!outcome) outcome = m->evaluate(&e->data);
    }
    for (int i = 0; i < n; i++) {
        sum[i] += 2 * dx[i];
        x[i] = X[i] + h * dx[i];
    }
    v[0] = end;
    hy_drive(e);
    if (!outcome) outcome = m->evaluate(&e->data);
    for (int i = 0; i < n; i++) x[i] = X[i] + h / 6 * (sum[i] + dx[i]);
    if (e->has_clamped) hy_drive(e);
    return outcome ? outcome : all_finite(x, n) ? HY_OK : HY_RETRY;
}

/* From the left end to offset s; the result stands in the block, and in trial where sensitivities are carried along.
 * X and K1 stay, for another trial. */
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
    if (!e->n_seeds) {
        e->status->stale = 1;
        return reach_plain(e, h, middle, end);
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

/* Keeps the slopes of the last stage, which the block holds until it is evaluated again. */
static void note_slopes(hy_engine *e, double h)
{
    if (!e->n_free) return;
    memcpy(e->K, e->data.v + e->model->dx + e->free[0], sizeof(double) * (size_t)e->n_free);
    e->h_last = h;
}

/* Error of the last step as a share of the states. With the slope at the right end in the place of that of the last stage
 * the weights of the method are those of one of order three: the two differ by h (K4 - K5) / 6. */
static double error_of_step(const hy_engine *e)
{
    const double *const x = e->data.v + e->model->x + e->free[0], *const dx = e->data.v + e->model->dx + e->free[0];
    double most = 0;
    for (int i = 0; i < e->n_free; i++) {
        const double size = fmax(fmax(fabs(x[i]), fabs(e->X[i])), NOTHING);
        most = fmax(most, e->h_last / 6 * fabs(e->K[i] - dx[i]) / size);
    }
    return most;
}

/* Steps that have been too long for a while: a jump is one in a row, what is stiff goes on. */
void hy_note_coarse(hy_engine *e)
{
    const double error = e->h_last > 0 ? error_of_step(e) : 0;
    if (e->status->coarse >= IN_A_ROW) return;
    e->status->coarse = error > COARSE ? e->status->coarse + 1 : 0;
    if (e->status->coarse == IN_A_ROW)
        hy_report(e, HY_WARNING,
                  "steps of %.3g s are too long for this model at t = %.9g s: a state may be off by %.2g of its size; take "
                  "smaller steps, or Model Exchange with a solver for stiff models",
                  e->h_last, e->data.v[0], error);
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
    hy_report(e, HY_FAILURE,
              "no finite solution beyond t = %.9g s: a nonlinear equation does not converge or a state overflows; take "
              "smaller steps, or Model Exchange with a solver for stiff models",
              e->data.v[0]);
    return outcome;
}

/* Negative before the first of the n indicators that have crossed at the right end does so, positive after. */
static double violation(const hy_engine *e, const double *z, const int *which, int n)
{
    double most = -INFINITY;
    for (int k = 0; k < n; k++) {
        const int i = which[k];
        const double f = e->sign[i] != 0 ? -e->sign[i] * z[i] : fabs(z[i]);
        most = f > most ? f : most;
    }
    return most;
}

/* The latest look, the end opposite to it, and the look before. zero_from: where the low end began to be exactly 0. */
typedef struct {
    double at, f, other, f_other, before, f_before;
    double margin, zero_from;
    int looks;
} bracket;

static double low_of(const bracket *b) { return b->f > 0 ? b->other : b->at; }
static double high_of(const bracket *b) { return b->f > 0 ? b->at : b->other; }
static double f_low_of(const bracket *b) { return b->f > 0 ? b->f_other : b->f; }

/* A low end that is exactly 0 is the root; behind it the indicator may rest within rounding of 0. The looks go on from
 * there with growing steps, and end at the first that is positive, as far behind 0 as rounding. A rest that lasts longer
 * than rounding explains has an end of its own, which is looked for in halves. */
static int on_a_plateau(const bracket *b) { return f_low_of(b) >= 0; }
static double plateau(const bracket *b) { return 16 * (low_of(b) - b->zero_from); }

static int is_closed(const bracket *b, double width, double rounding)
{
    const double open = high_of(b) - low_of(b);
    return open <= width || (on_a_plateau(b) && open <= plateau(b) && plateau(b) <= rounding);
}

/* Where the latest three looks say, as part of the way from the latest one to the other end; -1 where they cannot be
 * trusted: too bent, or no nearer to 0 than the look before, as on a kink. */
static double interpolated(const bracket *b)
{
    const double xi = (b->at - b->other) / (b->before - b->other);
    const double phi = (b->f - b->f_other) / (b->f_before - b->f_other);
    if (!(phi * phi < xi && (1 - phi) * (1 - phi) < 1 - xi) || fabs(b->f) > 0.5 * fabs(b->f_before)) return -1;
    return b->f / (b->f_other - b->f) * b->f_before / (b->f_other - b->f_before) +
           (b->before - b->at) / (b->other - b->at) * b->f / (b->f_before - b->f) * b->f_other / (b->f_before - b->f_other);
}

/* Every other time not the middle but, where that is nearer, the geometric mean of the secant's offset and the whole,
 * which is the root of a parabola that starts flat. A slider that begins to unload is one: its force leaves the limit
 * with the square of time. */
static double next_look(const bracket *b)
{
    const double low = low_of(b), width = high_of(b) - low;
    const double secant = width * f_low_of(b) / (f_low_of(b) - (b->f > 0 ? b->f : b->f_other));
    double part;
    if (on_a_plateau(b)) return low + (plateau(b) < width ? plateau(b) : 0.5 * width);
    if (!b->looks) return low + secant;
    part = interpolated(b);
    if (part >= 0) return b->at + part * (b->other - b->at);
    return low + (b->looks % 2 ? fmin(0.5 * width, sqrt(secant * width)) : 0.5 * width);
}

static void look(bracket *b, double at, double f)
{
    const int same_side = (f > 0) == (b->f > 0);
    if (f == 0 && !on_a_plateau(b)) b->zero_from = at;
    b->before = same_side ? b->at : b->other;
    b->f_before = same_side ? b->f : b->f_other;
    if (!same_side) b->other = b->at, b->f_other = b->f;
    b->at = at;
    b->f = f;
    b->looks++;
}

/* The earliest crossing in (w->s, *s]: sets *s and leaves the block just behind it. */
static int locate(hy_engine *e, const stretch *w, const int *marks, double *s)
{
    int *const which = e->crossings + 2 * e->model->n_z; /* third part */
    bracket b = {.at = *s, .other = w->s, .margin = 0.25 * WIDTH * w->h, .zero_from = w->s};
    double at = *s;
    int n = 0, outcome = HY_OK;
    for (int i = 0; i < e->model->n_z; i++)
        if (marks[i]) which[n++] = i;
    b.f = violation(e, e->z, which, n);
    b.f_other = violation(e, e->z_left, which, n);
    while (b.looks < MOST_TRIALS && !is_closed(&b, WIDTH * w->h, ROUNDING * w->h) && !outcome) {
        at = fmin(fmax(next_look(&b), low_of(&b) + b.margin), high_of(&b) - b.margin);
        outcome = reach(e, w, at);
        if (!outcome) outcome = hy_settle(e);
        if (!outcome) outcome = e->model->indicators(&e->data, e->z);
        look(&b, at, violation(e, e->z, which, n));
    }
    *s = high_of(&b);
    if (!outcome && at != *s) outcome = reach(e, w, *s);
    e->z_stands = 0;
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
    if (states_changed) return hy_accumulated(e);
    if (!e->status->chattered)
        hy_report(e, HY_WARNING,
                  "chattering: a relation switches faster than the step from t = %.9g s; there it is held over each step, "
                  "which is accurate to first order only", e->data.v[0]);
    e->status->chattered = 1;
    return HY_OK;
}

static int next_target(const hy_engine *e, const stretch *w, double *target)
{
    double next;
    *target = w->h;
    if (!e->model->next_time_event) return 0;
    next = hy_next_time_event(e);
    if (!hy_is_reached(e, next, w->t_end)) return 0;
    *target = fmin(fmax(next - w->t, w->s), w->h);
    return 1;
}

/* A whole step in the hope that nothing happens in it, which is most of them. *done = 0: something does happen, or the
 * model found no answer; the block stands at the left end again. */
static int quiet_step(hy_engine *e, const stretch *w, int *done)
{
    double target;
    int any = 1, outcome;
    *done = 0;
    if (e->n_seeds || e->n_clamped || next_target(e, w, &target)) return HY_OK;
    outcome = left_end(e);
    if (outcome) return outcome;
    outcome = reach(e, w, w->h);
    if (e->watched && !outcome) note_slopes(e, w->h);
    if (!outcome) outcome = hy_settle(e);
    if (!outcome) outcome = hy_crossed(e, &any);
    *done = !outcome && !any;
    if (!*done) e->h_last = 0;
    if (!*done) place(e, time_at(w, w->s), e->X);
    return HY_OK;
}

static int step_with_events(hy_engine *e, stretch w, int stop_at_events)
{
    int *which = e->crossings + e->model->n_z; /* second part */
    int sliding = 0, fresh = e->status->fresh, done = 0, outcome = fresh ? HY_OK : quiet_step(e, &w, &done);
    e->status->fresh = 0;
    if (outcome || done) return outcome;
    for (int i = 0; i < e->model->n_z; i++) e->crossings[i] = 0;
    for (int events = 0;; events++) {
        double target, wanted;
        int any = 0, changed = 0, timed = next_target(e, &w, &target);
        wanted = target;
        if (fresh && !sliding) target = fmin(target, w.s + HY_FIRST_LOOK * w.h);
        outcome = left_end(e);
        if (!outcome && target > w.s) {
            outcome = reach_towards(e, &w, &target);
            if (e->watched && !outcome) note_slopes(e, target - w.s);
        }
        if (!outcome) outcome = hy_settle(e);
        if (!outcome) outcome = mark_crossed(e, which, &any);
        if (!outcome && any && !sliding && target > w.s) {
            outcome = locate(e, &w, which, &target);
            if (!outcome) outcome = hy_settle(e);
        }
        if (outcome) return outcome;
        if (e->n_seeds && target > w.s) memcpy(e->X, e->trial, sizeof(double) * (size_t)e->n_X);
        w.s = target;
        timed = timed && target >= wanted;
        fresh = any || timed;
        if ((any || timed) && stop_at_events) {
            e->status->event_pending = 1;
            return HY_EVENT;
        }
        if (any || timed) e->h_last = 0;
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
        if (e->watched && !outcome) note_slopes(e, target - w.s);
        w.s = target;
    }
    return outcome;
}

int hy_steps_in(const hy_engine *e, double h)
{
    const double n = e->model->step > 0 ? ceil(h / e->model->step * (1 - 1e-9)) : 1;
    return n < 1 ? 1 : n > 1e9 ? 1000000000 : (int)n;
}

static int advance(hy_engine *e, double h, int n, int stop_at_events, double *reached)
{
    const double t0 = e->data.v[0];
    const int events = hy_has_events(e);
    int outcome = HY_OK;
    *reached = t0;
    e->h_last = 0;
    if (!e->n_X && !events) n = 1; /* nothing to integrate */
    for (int i = 0; i < n && !outcome; i++) {
        stretch w = {t0, h, t0 + h, 0};
        if (n > 1) w = (stretch){t0 + h * ((double)i / n), h / n, t0 + h * ((double)(i + 1) / n), 0};
        if (!e->n_X && !events)
            place(e, w.t_end, e->X);
        else
            outcome = events ? step_with_events(e, w, stop_at_events) : step_without_events(e, w);
        *reached = e->data.v[0];
        if (!outcome && i + 1 < n) outcome = hy_completed(e);
    }
    return outcome;
}

/* The end of the present stretch: where a memory with instants of its own moves on next, or the end of the step. The
 * first sample after a start is that of the first step's end. */
static double next_stop(const hy_engine *e, double end)
{
    const double sample = e->model->sample, near = 1e-3 * sample;
    double tick = e->status->tick;
    if (tick < e->data.v[0] + near) tick += sample;
    return tick < end - near ? tick : end;
}

static int steps_of_part(int n, double part)
{
    const double steps = ceil(n * part - 1e-9);
    return steps < 1 ? 1 : (int)steps;
}

int hy_advance(hy_engine *e, double h, int n, int stop_at_events, double *reached)
{
    const double end = e->data.v[0] + h;
    double part = h, stop;
    int outcome = HY_OK;
    if (!hy_has_ticks(e)) return advance(e, h, n, stop_at_events, reached);
    stop = next_stop(e, end);
    while (stop < end && !outcome) {
        part = stop - e->data.v[0];
        outcome = advance(e, part, steps_of_part(n, part / h), stop_at_events, reached);
        if (outcome) return outcome;
        *reached = e->data.v[0] = stop;
        outcome = hy_completed(e);
        part = end - stop;
        stop = next_stop(e, end);
    }
    return outcome ? outcome : advance(e, part, steps_of_part(n, part / h), stop_at_events, reached);
}
