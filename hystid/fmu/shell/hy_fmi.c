#include "hy_fmi.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const CATEGORY[] = {"logEvents", "logStatusWarning", "logStatusError"};
enum { N_CATEGORIES = sizeof CATEGORY / sizeof *CATEGORY, MOST_AT_ONCE = 100 };

static void engine_log(void *owner, int level, const char *text)
{
    hy_instance *c = owner;
    static const int status[] = {FMI_OK, FMI_WARNING, FMI_ERROR};
    if (level == HY_WARNING) c->warned = 1;
    if (level != HY_INFO || c->logging) c->logger(c, status[level], CATEGORY[level], text);
}

int hy_fail(hy_instance *c, const char *format, ...)
{
    char text[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    c->logger(c, FMI_ERROR, "logStatusError", text);
    return FMI_ERROR;
}

const char *hy_mode_name(int mode)
{
    switch (mode) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "in initialization mode";
    case EVENT: return "in event mode";
    case CONTINUOUS: return "in continuous-time mode";
    case STEP: return "in step mode";
    case STEP_DISCARDED: return "after a discarded step";
    case TERMINATED: return "terminated";
    case IN_STEP: return "in intermediate update mode";
    default: return "in error";
    }
}

int hy_allowed(hy_instance *c, const hy_call *call)
{
    if (!c) return 0;
    c->warned = 0;
    if (call->kind && call->kind != c->engine.status->kind)
        hy_fail(c, "%s is not allowed here: it is a function of %s", call->name,
                call->kind == MODEL_EXCHANGE ? "model exchange" : "co-simulation");
    else if (c->engine.status->mode & call->modes)
        return 1;
    else
        hy_fail(c, "%s is not allowed here: the instance is %s", call->name, hy_mode_name(c->engine.status->mode));
    return 0;
}

/* Warnings and refusals are always told; events where they are asked for, by all categories (n = 0) or by name. */
int hy_set_logging(hy_instance *c, int on, size_t n, const char *const *categories)
{
    int events = !n;
    if (n && !categories) return hy_fail(c, "set debug logging: a NULL array was given for %zu categories", n);
    for (size_t i = 0; i < n; i++) {
        size_t k = 0;
        while (categories[i] && k < N_CATEGORIES && strcmp(categories[i], CATEGORY[k])) k++;
        if (!categories[i] || k == N_CATEGORIES)
            return hy_fail(c, "set debug logging: there is no category '%s'", categories[i] ? categories[i] : "NULL");
        events |= k == 0;
    }
    if (events) c->logging = on;
    return FMI_OK;
}

int hy_fmi_status(hy_instance *c, int outcome)
{
    if (outcome == HY_OK) return c->warned ? FMI_WARNING : FMI_OK;
    if (outcome == HY_RETRY) return FMI_DISCARD;
    c->engine.status->mode = FAILED;
    return FMI_ERROR;
}

static char *copy_of(const char *text)
{
    const size_t size = strlen(text) + 1;
    char *copy = malloc(size);
    return copy ? memcpy(copy, text, size) : NULL;
}

hy_instance *hy_new_instance(const char *name, const char *token, int kind, hy_logger logger, void (*callback)(void),
                             void *environment)
{
    hy_instance *c = calloc(1, sizeof *c);
    const char *refused = NULL;
    if (!c) return NULL;
    c->logger = logger;
    c->callback = callback;
    c->environment = environment;
    c->name = copy_of(name && name[0] ? name : hy_the_model.name);
    if (!name || !name[0]) refused = "an instance needs a name";
    if (!token || strcmp(token, hy_the_model.token)) refused = "the instantiation token is not that of this model's description";
    if (kind == MODEL_EXCHANGE && hy_the_model.sample < 0)
        refused = "model exchange is not offered: the memory moves on with each step, and no sample time is known";
    if (!refused && (!c->name || hy_open(&c->engine, &hy_the_model, engine_log, c))) refused = "out of memory";
    if (!refused) c->backup = malloc(c->engine.saved_size);
    if (!refused && !c->backup) refused = "out of memory";
    if (refused) {
        if (c->name) hy_fail(c, "%s", refused);
        hy_free_instance(c);
        return NULL;
    }
    c->engine.status->kind = kind;
    c->engine.status->mode = INSTANTIATED;
    return c;
}

void hy_free_instance(hy_instance *c)
{
    if (!c) return;
    hy_close(&c->engine);
    free(c->backup);
    free(c->name);
    free(c);
}

int hy_enter(hy_instance *c, int mode)
{
    c->engine.status->mode = mode;
    return FMI_OK;
}

int hy_begin_again(hy_instance *c)
{
    const int kind = c->engine.status->kind;
    hy_reset(&c->engine);
    c->engine.status->kind = kind;
    return hy_enter(c, INSTANTIATED);
}

int hy_setup(hy_instance *c, double start, int stop_defined, double stop)
{
    hy_status *s = c->engine.status;
    if (!isfinite(start)) return hy_fail(c, "the start time must be finite");
    if (stop_defined && !(isfinite(stop) && stop >= start)) return hy_fail(c, "the stop time must be finite and not before the start");
    s->start_time = s->last_time = start;
    s->stop_time = stop_defined ? stop : INFINITY;
    c->engine.settings[0] = start;
    s->started = 0;
    return FMI_OK;
}

int hy_exit_initialization(hy_instance *c)
{
    hy_engine *e = &c->engine;
    hy_status *s = e->status;
    int changed, outcome = hy_present(c);
    if (!outcome) outcome = hy_check_values(c);
    if (outcome) return hy_fmi_status(c, HY_ERROR);
    if (s->kind == MODEL_EXCHANGE || c->event_mode_used) {
        s->mode = EVENT;
        return hy_fmi_status(c, hy_note_signs(e));
    }
    outcome = hy_event(e, &changed);
    if (!outcome && e->model->n_x) outcome = hy_completed(e);
    s->sampled = 1;
    s->mode = STEP;
    return outcome ? hy_fmi_status(c, HY_ERROR) : hy_fmi_status(c, HY_OK);
}

static int differ(const double *before, const double *after, int slot, int n)
{
    return memcmp(before + slot, after + slot, sizeof(double) * (size_t)n) != 0;
}

/* Whether the derivatives may jump at this event: a relation or a discrete state is another than before it. A sampled
 * memory is another after each sample, and most often without a jump: there the derivatives themselves are compared, as
 * for a memory of the past, whose jumps are in no relation. */
static int switched(const hy_engine *e, const double *before)
{
    const hy_model *m = e->model;
    const double *const after = e->data.v;
    return differ(before, after, m->rel, m->n_rel) || (!hy_has_ticks(e) && differ(before, after, m->d, m->n_d))
        || (m->completed_step && differ(before, after, m->dx, m->n_x));
}

/* Model exchange: the memory moves on at time events of its own, the first time when the start is over. */
static int tick(hy_instance *c)
{
    const hy_status *s = c->engine.status;
    int outcome;
    if (s->kind != MODEL_EXCHANGE || !s->sampled || !hy_has_ticks(&c->engine)) return HY_OK;
    outcome = hy_completed(&c->engine);
    c->engine.status->stale = 1; /* derivatives may be others now */
    return outcome ? outcome : hy_settle(&c->engine);
}

static double next_tick(const hy_instance *c)
{
    const hy_status *s = c->engine.status;
    if (s->kind != MODEL_EXCHANGE || !hy_has_ticks(&c->engine)) return INFINITY;
    return s->sampled ? s->tick : s->tick + c->engine.model->sample;
}

/* What happens now. Instants that differ by rounding, as 3*0.02 and 0.01 + 0.05, are one: no solver can step between. */
static int events(hy_engine *e, int *states_changed)
{
    int outcome = hy_event(e, states_changed), more;
    for (int i = 0; !outcome && i < MOST_AT_ONCE && hy_is_reached(e, hy_next_time_event(e), e->data.v[0]); i++) {
        outcome = hy_event(e, &more);
        *states_changed |= more;
    }
    return outcome;
}

/* In model exchange states count as changed where their derivatives may jump: importers in wide use restart their solver
 * for a new state alone, and a multistep solver that is not told goes on with the old slope, or past the event. The first
 * event iteration comes before any solver. */
int hy_new_discrete_states(hy_instance *c, int *states_changed, int *next_defined, double *next)
{
    hy_engine *e = &c->engine;
    double *const before = c->backup;
    int outcome = e->model->completed_step ? hy_settle(e) : HY_OK;
    memcpy(before, e->data.v, sizeof(double) * (size_t)e->model->n_values);
    if (!outcome) outcome = events(e, states_changed);
    if (!outcome) outcome = tick(c);
    if (e->status->kind == MODEL_EXCHANGE && e->status->sampled && e->model->n_x)
        *states_changed |= switched(e, before);
    *next = fmin(hy_next_time_event(e), next_tick(c));
    e->status->fresh = 1;
    *next_defined = isfinite(*next);
    if (!*next_defined) *next = 0;
    return hy_fmi_status(c, outcome ? HY_ERROR : HY_OK);
}

/* At the end of a solver's step; memory with instants of its own moves on in Event Mode alone. */
int hy_completed_step(hy_instance *c)
{
    return hy_fmi_status(c, hy_has_ticks(&c->engine) ? HY_OK : hy_completed(&c->engine));
}

int hy_enter_continuous(hy_instance *c)
{
    hy_status *s = c->engine.status;
    int outcome = HY_OK;
    if (!s->sampled && (s->kind == MODEL_EXCHANGE || c->engine.model->n_x)) outcome = hy_completed(&c->engine);
    s->sampled = 1;
    s->mode = s->kind == MODEL_EXCHANGE ? CONTINUOUS : STEP;
    return hy_fmi_status(c, outcome);
}

/* ---- co-simulation ---- */

int hy_input_derivatives(hy_instance *c, const unsigned *vr, size_t n, const int *order, const double *value)
{
    static const double factorial[] = {1, 1, 2, 6};
    hy_engine *e = &c->engine;
    if (n && (!vr || !order || !value)) return hy_fail(c, "input derivatives: a NULL array was given");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= (unsigned)e->model->n_values || hy_variables[vr[i]].type != REAL || !(hy_variables[vr[i]].flags & IS_INPUT))
            return hy_fail(c, "input derivatives: value reference %u is not a real input", vr[i]);
        if (order[i] < 1 || order[i] > 3) return hy_fail(c, "input derivatives of order %d are not supported: 1 to 3 are", order[i]);
        if (!isfinite(value[i])) return hy_fail(c, "the derivative of %s must be finite", hy_variables[vr[i]].name);
    }
    for (size_t i = 0; i < n; i++) {
        int k = 0;
        while (k < e->status->n_driven && e->driven[k].slot != (int)vr[i]) k++;
        if (k == e->status->n_driven) {
            memset(e->driven + k, 0, sizeof *e->driven);
            e->driven[k].slot = (int)vr[i];
            e->status->n_driven++;
        }
        e->driven[k].c[order[i]] = value[i] / factorial[order[i]];
    }
    return FMI_OK;
}

/* A step is completed by hy_do_step; those inside, here, after the importer has seen them and has not ended the step. */
static int advance(hy_instance *c, double t, double h, int stop_at_events, double (*between)(hy_instance *), double *reached)
{
    hy_engine *e = &c->engine;
    const int n = e->model->n_x || hy_has_events(e) ? hy_steps_in(e, h) : 1; /* nothing to integrate: one sample */
    double end = t + h;
    int outcome = HY_OK;
    if (!between) return hy_advance(e, h, n, stop_at_events, reached);
    for (int i = 0; i < n; i++) {
        const double next = fmin(t + h * ((double)(i + 1) / n), end);
        outcome = hy_advance(e, next - e->data.v[0], 1, stop_at_events, reached);
        if (outcome) break;
        *reached = e->data.v[0] = next;
        end = fmin(end, fmax(between(c), next));
        if (next >= end) break;
        outcome = hy_completed(e);
        if (!outcome) outcome = hy_inputs_changed(e);
        if (outcome) break;
    }
    return outcome;
}

/* Whether a time is off by more than rounding: an importer that sums up n steps is off by n roundings, at most. Most are
 * off by none, which takes no division to see. */
static int is_off(const hy_status *s, double by, double t, double h)
{
    double steps;
    if (!(by > 1e-6 * h)) return 0;
    steps = 1 + fabs(t - s->start_time) / h;
    return by > fmin(1e-6 * h + DBL_EPSILON * fabs(t) * steps, 0.01 * h);
}

static int check_step(hy_instance *c, double t, double h)
{
    const hy_status *s = c->engine.status;
    if (!isfinite(t) || !isfinite(h) || h <= 0) return hy_fail(c, "a step must have a finite start and a positive length");
    if (is_off(s, fabs(t - s->last_time), t, h))
        return hy_fail(c, "a step starts at %.12g s, but the instance stands at %.12g s", t, s->last_time);
    if (is_off(s, t + h - s->stop_time, t + h, h))
        return hy_fail(c, "a step to %.12g s goes beyond the stop time %.12g s", t + h, s->stop_time);
    return FMI_OK;
}

int hy_do_step(hy_instance *c, double t, double h, int stop_at_events, double (*between)(hy_instance *), double *reached,
               int *event)
{
    hy_engine *e = &c->engine;
    hy_status *s = e->status;
    int outcome;
    *reached = s->last_time;
    *event = 0;
    if (check_step(c, t, h)) return FMI_ERROR;
    memcpy(c->backup, e->saved, e->saved_size);
    e->watched = hy_is_watched(c->steps++);
    e->data.v[0] = s->origin = t;
    for (int i = 0; i < s->n_driven; i++) e->driven[i].c[0] = e->data.v[e->driven[i].slot];
    outcome = hy_inputs_changed(e);
    if (!outcome) outcome = advance(c, t, h, stop_at_events, between, reached);
    *event = outcome == HY_EVENT;
    if (*event || !outcome) outcome = hy_settle(e);
    if (!*event && !outcome && e->watched) hy_note_coarse(e);
    if (!outcome) outcome = hy_check_values(c);
    if (!outcome) outcome = hy_completed(e);
    if (outcome == HY_RETRY) {
        memcpy(e->saved, c->backup, e->saved_size);
        e->z_stands = 0;
        *reached = s->last_time;
        s->mode = STEP_DISCARDED;
    } else {
        s->last_time = *reached;
        s->n_driven = 0;
    }
    return hy_fmi_status(c, outcome);
}
