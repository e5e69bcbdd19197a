#include "hy_engine.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PASSES = 100 }; /* of one event iteration: a model that needs more switches back and forth */

void hy_report(hy_engine *e, int level, const char *format, ...)
{
    char text[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    e->data.log(e->data.owner, level, text);
}

static size_t at_least_one(int n) { return n > 0 ? (size_t)n : 1; }

static int allocate_scratch(hy_engine *e)
{
    const hy_model *m = e->model;
    const size_t n_X = at_least_one(e->n_X), n_x = at_least_one(m->n_x), n_z = at_least_one(m->n_z);
    double *s = calloc(5 * n_X + n_x + 2 * n_z, sizeof *s);
    if (!s) return HY_ERROR;
    free(e->scratch);
    e->scratch = s;
    e->X = s;
    e->K1 = s + n_X;
    e->K = s + 2 * n_X;
    e->sum = s + 3 * n_X;
    e->trial = s + 4 * n_X;
    e->x_before = s + 5 * n_X;
    e->z = e->x_before + n_x;
    e->z_left = e->z + n_z;
    return HY_OK;
}

int hy_open(hy_engine *e, const hy_model *model, void (*log)(void *, int, const char *), void *owner)
{
    const size_t block = sizeof(double) * (size_t)model->n_values;
    const size_t signs = sizeof(double) * (size_t)model->n_z;
    const size_t driven = sizeof(hy_driven) * (size_t)(model->n_u + model->n_x);
    char *saved;
    memset(e, 0, sizeof *e);
    e->model = model;
    e->data.log = log;
    e->data.owner = owner;
    e->saved_size = sizeof(hy_status) + 2 * block + signs + driven;
    e->saved = saved = calloc(1, e->saved_size);
    e->free = calloc(at_least_one(model->n_x), sizeof *e->free);
    e->crossings = calloc(3 * at_least_one(model->n_z), sizeof *e->crossings);
    e->n_X = e->n_free = model->n_x;
    if (!saved || !e->free || !e->crossings || allocate_scratch(e)) {
        hy_close(e);
        return HY_ERROR;
    }
    e->status = e->saved;
    e->data.v = (double *)(void *)(saved + sizeof(hy_status));
    e->settings = e->data.v + model->n_values;
    e->sign = e->settings + model->n_values;
    e->driven = (hy_driven *)(void *)(e->sign + model->n_z);
    for (int i = 0; i < model->n_x; i++) e->free[i] = i;
    hy_reset(e);
    return HY_OK;
}

void hy_close(hy_engine *e)
{
    free(e->saved);
    free(e->free);
    free(e->crossings);
    free(e->scratch);
    free(e->seed);
    free(e->stops);
    free(e->paths);
    if (e->duhem) e->model->duhem_methods->close(e->duhem);
    memset(e, 0, sizeof *e);
}

void hy_reset(hy_engine *e)
{
    const size_t block = sizeof(double) * (size_t)e->model->n_values;
    memset(e->saved, 0, e->saved_size);
    memcpy(e->data.v, e->model->start, block);
    memcpy(e->settings, e->model->start, block);
    e->status->stale = 1;
    e->status->stop_time = INFINITY;
}

static int is_driven(const hy_engine *e, int state, const int *slots, int n)
{
    for (int k = 0; k < n; k++)
        if (slots[k] == e->model->x + state) return 1;
    return 0;
}

static int is_quadrature(const hy_engine *e, const int *slots, int n)
{
    const hy_model *m = e->model;
    for (int k = 0; m->couples && k < m->n_couples; k++)
        if (!is_driven(e, m->couples[k][0], slots, n) && !is_driven(e, m->couples[k][1], slots, n)) return 0;
    return m->couples != NULL;
}

static void close_gaps(hy_engine *e)
{
    const int n = e->n_free, first = e->free[0], range = n ? e->free[n - 1] - first + 1 : 0;
    for (int i = 0; i < range; i++) e->free[i] = first + i;
    e->n_free = range;
    e->has_clamped = range > n;
}

int hy_clamp_states(hy_engine *e, const int *slots, int n)
{
    const hy_model *m = e->model;
    e->n_free = 0;
    for (int i = 0; i < m->n_x; i++)
        if (!is_driven(e, i, slots, n)) e->free[e->n_free++] = i;
    e->n_clamped = m->n_x - e->n_free;
    e->quadrature = is_quadrature(e, slots, n);
    if (!e->n_seeds) close_gaps(e);
    e->n_X = e->n_free * (1 + e->n_seeds);
    return allocate_scratch(e);
}

int hy_carry(hy_engine *e, const int *slots, int n)
{
    e->n_seeds = n;
    e->seed_slots = slots;
    e->n_X = e->n_free * (1 + n);
    free(e->seed);
    e->seed = calloc(2 * at_least_one(e->model->n_values), sizeof *e->seed);
    e->sens = e->seed ? e->seed + e->model->n_values : NULL;
    return e->seed ? allocate_scratch(e) : HY_ERROR;
}

int hy_has_events(const hy_engine *e)
{
    return e->model->update != NULL; /* a when-clause on a Boolean input needs neither indicator nor time event */
}

hy_driven *hy_driven_at(const hy_engine *e, int slot)
{
    for (int i = 0; i < e->status->n_driven; i++)
        if (e->driven[i].slot == slot) return &e->driven[i];
    return NULL;
}

static int solve_initial(hy_engine *e)
{
    const hy_model *m = e->model;
    int outcome = m->parameters ? m->parameters(&e->data) : HY_OK;
    if (!outcome && m->initialise) outcome = m->initialise(&e->data);
    return outcome;
}

/* d(initial states)/d(parameter) by central differences: the initial equations are solved anew on either side. */
static int start_sensitivities(hy_engine *e)
{
    const hy_model *m = e->model;
    const size_t block = sizeof(double) * (size_t)m->n_values;
    double *S = e->X + e->n_free;
    for (int s = 0; s < e->n_seeds; s++) {
        const double p = e->settings[e->seed_slots[s]];
        const double step = 6e-6 * (fabs(p) > 1e-6 ? fabs(p) : 1e-6);
        for (int side = 1; side >= -1; side -= 2) {
            memcpy(e->data.v, e->settings, block);
            e->data.v[e->seed_slots[s]] = p + side * step;
            if (solve_initial(e)) return HY_ERROR;
            for (int i = 0; i < e->n_free; i++) {
                double *slot = S + s * e->n_free + i;
                const double x = e->data.v[m->x + e->free[i]];
                *slot = side > 0 ? x : (*slot - x) / (2 * step);
            }
        }
    }
    return HY_OK;
}

int hy_start(hy_engine *e)
{
    const size_t block = sizeof(double) * (size_t)e->model->n_values;
    int outcome = e->n_seeds ? start_sensitivities(e) : HY_OK;
    if (outcome) return outcome;
    memcpy(e->data.v, e->settings, block);
    outcome = solve_initial(e);
    e->status->time_event = e->status->renewed = -INFINITY;
    e->status->tick = e->settings[0];
    e->status->stale = 1;
    e->status->started = !outcome;
    return outcome;
}

int hy_accumulated(hy_engine *e)
{
    hy_report(e, HY_FAILURE, "Zeno: events accumulate at t = %.9g s and each sets states anew; give the model a resting mode",
              e->data.v[0]);
    return HY_ERROR;
}

static int pass(hy_engine *e, int *again)
{
    const hy_model *m = e->model;
    double *v = e->data.v;
    int outcome;
    *again = 0;
    memcpy(v + m->pre, v + m->d, sizeof(double) * (size_t)m->n_d);
    e->z_stands = 0;
    outcome = m->update(&e->data, again);
    hy_drive(e); /* a clamped state follows its motion, whatever reinit says */
    e->status->stale = 1;
    return outcome ? outcome : hy_settle(e);
}

static int iterate(hy_engine *e)
{
    int again = 1, outcome = HY_OK;
    for (int i = 0; again && !outcome; i++) {
        if (i == MOST_PASSES) {
            hy_report(e, HY_FAILURE, "event iteration does not settle at t = %.9g s: when-clauses switch each other back and forth",
                      e->data.v[0]);
            return HY_ERROR;
        }
        outcome = pass(e, &again);
    }
    return outcome;
}

/* Steps reach an instant to rounding only, which adds up over many of them. What lies ahead by no more than that is
 * now: a ten-millionth of a step, far less than any answer changes in. */
int hy_is_reached(const hy_engine *e, double instant, double now)
{
    return instant - now <= 1e-7 * e->model->step + 1e-14 * fabs(now);
}

static int is_now(const hy_engine *e, double instant)
{
    const double now = e->data.v[0];
    return instant > now && hy_is_reached(e, instant, now);
}

/* The present time; the instant of a time event that was handled here, as the model named it, counts as passed. */
static double event_clock(const hy_engine *e)
{
    return is_now(e, e->status->time_event) ? e->status->time_event : e->data.v[0];
}

double hy_next_time_event(const hy_engine *e)
{
    double *const time = e->data.v, now = *time, next = INFINITY;
    if (!e->model->next_time_event) return next;
    *time = event_clock(e);
    next = e->model->next_time_event(&e->data);
    *time = now;
    return next;
}

/* The instant of a time event that is due, as the model named it rather than as the step's arithmetic rounded it. */
static double due(const hy_engine *e)
{
    const double next = hy_next_time_event(e);
    return is_now(e, next) ? next : event_clock(e);
}

/* Whether events that each set states anew follow each other as a geometric series, of which the next one comes before
 * the first look at the model: a ball that bounces would fall through the floor. */
static int accumulates(hy_engine *e)
{
    hy_status *s = e->status;
    const double pause = e->data.v[0] - s->renewed, shrink = pause / s->pause, look = HY_FIRST_LOOK * e->model->step;
    const int steady = shrink < 1 && shrink < 2 * s->shrink && s->shrink < 2 * shrink;
    s->renewed = e->data.v[0];
    s->pause = pause;
    s->shrink = shrink;
    return steady && pause >= look && shrink * pause < look; /* shorter ones are rounding: events of one instant */
}

int hy_event(hy_engine *e, int *states_changed)
{
    const hy_model *m = e->model;
    const double *x = e->data.v + m->x;
    const size_t size = sizeof(double) * (size_t)m->n_x;
    const double now = e->data.v[0];
    int outcome;
    e->status->event_pending = 0;
    *states_changed = 0;
    e->data.v[0] = e->status->time_event = due(e);
    if (e->data.v[0] != now) e->status->stale = 1;
    outcome = hy_settle(e);
    if (outcome || !m->update) return outcome;
    memcpy(e->x_before, x, size);
    outcome = iterate(e);
    if (outcome) return outcome;
    *states_changed = memcmp(e->x_before, x, size) != 0;
    if (e->data.v[0] != now) e->status->stale = 1;
    e->data.v[0] = now;
    if (*states_changed && accumulates(e)) return hy_accumulated(e);
    return hy_note_signs(e);
}

int hy_note_signs(hy_engine *e)
{
    int outcome = HY_OK;
    if (!e->model->n_z) return HY_OK;
    outcome = hy_settle(e);
    if (!outcome) outcome = e->model->indicators(&e->data, e->z);
    for (int i = 0; i < e->model->n_z; i++) e->sign[i] = (e->z[i] > 0) - (e->z[i] < 0);
    e->z_stands = !outcome;
    return outcome;
}

int hy_crossed(hy_engine *e, int *any)
{
    const double *const z = e->z, *const sign = e->sign;
    const int n = e->model->n_z;
    int outcome = HY_OK, found = 0;
    if (n) outcome = e->model->indicators(&e->data, e->z);
    e->z_stands = !outcome;
    for (int i = 0; i < n; i++) found |= !(z[i] * sign[i] > 0); /* most often nothing: the close look is rare */
    *any = 0;
    for (int i = 0; found && i < n; i++) *any |= (z[i] * sign[i] < 0) | ((sign[i] == 0) & (z[i] != 0));
    return outcome;
}

int hy_inputs_changed(hy_engine *e)
{
    int any = 0, changed, outcome;
    if (!hy_has_events(e) || (e->status->stale != 1 && e->z_stands && !e->status->event_pending)) return HY_OK;
    outcome = hy_settle(e);
    if (!outcome) outcome = hy_crossed(e, &any);
    if (outcome || !(any || e->status->event_pending)) return outcome;
    return hy_event(e, &changed);
}

int hy_has_ticks(const hy_engine *e) { return e->model->completed_step && e->model->sample > 0; }

/* Whether the memory moves on now; then the next instant is counted from the start, never summed up. Rounding of times
 * that an importer has summed up stays far below a thousandth of a sample. */
static int is_sample(hy_engine *e)
{
    const double now = e->data.v[0], start = e->settings[0], sample = e->model->sample, blur = 1e-3;
    if (!hy_has_ticks(e)) return e->model->completed_step != NULL;
    if (now < e->status->tick - blur * sample) return 0;
    e->status->tick = start + sample * (floor((now - start) / sample + blur) + 1);
    return 1;
}

int hy_completed(hy_engine *e)
{
    int outcome;
    if (!is_sample(e)) return HY_OK;
    outcome = hy_settle(e);
    if (!outcome) outcome = e->model->completed_step(&e->data);
    e->status->stale = 2;
    return outcome;
}

void hy_sensitivity(hy_engine *e, int which)
{
    const hy_model *m = e->model;
    const double *S = e->X + e->n_free * (1 + which);
    double *seed = e->seed;
    seed[e->seed_slots[which]] = 1;
    for (int i = 0; i < e->n_free; i++) seed[m->x + e->free[i]] = S[i];
    if (m->forward(&e->data, seed, e->sens))
        for (int i = 0; i < m->n_values; i++) e->sens[i] = NAN;
    for (int i = 0; i < m->n_x; i++) e->sens[m->x + i] = seed[m->x + i];
    for (int i = 0; i < e->n_free; i++) seed[m->x + e->free[i]] = 0;
    seed[e->seed_slots[which]] = 0;
}
