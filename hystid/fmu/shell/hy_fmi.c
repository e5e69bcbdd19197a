#include "hy_fmi.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const CATEGORY[] = {"logEvents", "logStatusWarning", "logStatusError"};
enum { N_CATEGORIES = sizeof CATEGORY / sizeof *CATEGORY };

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

static const char *mode_name(int mode)
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
        hy_fail(c, "%s is not allowed here: the instance is %s", call->name, mode_name(c->engine.status->mode));
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

/* Initial values are solved when somebody asks for one. After an error the values are shown as they stand. */
int hy_present(hy_instance *c)
{
    hy_engine *e = &c->engine;
    int outcome = HY_OK;
    if (e->status->mode == FAILED) return HY_OK;
    if (e->status->mode == INITIALIZATION && !e->status->started) outcome = hy_start(e);
    return outcome ? outcome : hy_settle(e);
}

/* No NaN leaves without a word: a step whose outputs or states are not finite is one without answer. */
static int not_finite(hy_instance *c, int slot, const char *what, int number)
{
    const char *const name = hy_variables[slot].name;
    if (name)
        hy_fail(c, "%s is not finite at t = %.9g s", name, c->engine.data.v[0]);
    else
        hy_fail(c, "%s %d is not finite at t = %.9g s", what, number, c->engine.data.v[0]);
    return HY_RETRY;
}

static int check_values(hy_instance *c)
{
    const hy_model *m = c->engine.model;
    const double *v = c->engine.data.v;
    for (int i = m->y; i < m->y + m->n_y; i++)
        if (hy_variables[i].flags & IS_OUTPUT && !isfinite(v[i])) return not_finite(c, i, "output", i - m->y + 1);
    for (int i = m->x; i < m->x + m->n_x; i++)
        if (!isfinite(v[i])) return not_finite(c, i, "state", i - m->x + 1);
    return HY_OK;
}

static int check_derivatives(hy_instance *c)
{
    const hy_model *m = c->engine.model;
    for (int i = m->dx; i < m->dx + m->n_x; i++)
        if (!isfinite(c->engine.data.v[i])) return not_finite(c, i, "the derivative of state", i - m->dx + 1);
    return HY_OK;
}

int hy_check_numbers(hy_instance *c, const char *what, const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (isfinite(values[i])) continue;
        hy_fail(c, "%s is not finite at t = %.9g s", what, c->engine.data.v[0]);
        return HY_RETRY;
    }
    return HY_OK;
}

int hy_exit_initialization(hy_instance *c)
{
    hy_engine *e = &c->engine;
    hy_status *s = e->status;
    int changed, outcome = hy_present(c);
    if (!outcome) outcome = check_values(c);
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

/* The value references of FMI 3's event indicators come after the block's. */
static int is_indicator(const hy_instance *c, unsigned vr)
{
    return vr >= (unsigned)c->engine.model->n_values && vr - (unsigned)c->engine.model->n_values < (unsigned)c->engine.model->n_z;
}

/* An indicator that was exactly 0 after the last event is shown as "how far from 0", so that leaving 0 either way is a
 * sign change for importers that count 0 as negative. It has left beyond rounding errors of values of size one: a root
 * finder gets a slope to work on there, not a jump. */
static const double LEFT = 1e-15;

static int indicators(hy_instance *c, double *z)
{
    const hy_engine *e = &c->engine;
    const int outcome = e->model->indicators(&c->engine.data, z);
    for (int i = 0; i < e->model->n_z; i++)
        if (e->sign[i] == 0) z[i] = LEFT - fabs(z[i]);
    return outcome ? outcome : hy_check_numbers(c, "an event indicator", z, (size_t)e->model->n_z);
}

static int get_indicator(hy_instance *c, unsigned vr, double *value)
{
    const int outcome = indicators(c, c->engine.z);
    c->engine.z_stands = 0; /* as shown, which is not what the engine compares */
    *value = c->engine.z[vr - (unsigned)c->engine.model->n_values];
    return outcome;
}

int hy_get(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, double *value)
{
    const int instantiated = c->engine.status->mode == INSTANTIATED; /* FMI 3: start values can be read */
    const double *const v = instantiated ? c->engine.settings : c->engine.data.v;
    int outcome;
    if (n && (!vr || !value)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    outcome = instantiated ? HY_OK : hy_present(c);
    if (outcome) return hy_fmi_status(c, outcome);
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < (unsigned)c->engine.model->n_values && hy_variables[vr[i]].type == type) {
            value[i] = v[vr[i]];
            if (!isfinite(value[i]) && c->engine.status->mode & ~(INSTANTIATED | FAILED))
                outcome = not_finite(c, (int)vr[i], "variable", (int)vr[i]);
        } else if (type == REAL && !instantiated && is_indicator(c, vr[i])) {
            outcome = get_indicator(c, vr[i], value + i);
        } else {
            return hy_fail(c, "%s: there is no variable of this type with value reference %u", call, vr[i]);
        }
        if (outcome) return hy_fmi_status(c, outcome);
    }
    return FMI_OK;
}

static int before_start(const hy_instance *c) { return c->engine.status->mode & (INSTANTIATED | INITIALIZATION); }

/* Between events an importer sets what its solver moves: continuous inputs and states. A discrete input that stands as it
 * did is let pass, for some set all their inputs alike. */
static int settable_between_events(const hy_instance *c, unsigned vr, double value)
{
    const hy_model *m = c->engine.model;
    const int flags = hy_variables[vr].flags;
    if (flags & IS_INPUT) return !(flags & IS_DISCRETE) || c->engine.data.v[vr] == value;
    return c->engine.status->mode == CONTINUOUS && vr >= (unsigned)m->x && vr < (unsigned)(m->x + m->n_x);
}

static int settable_now(const hy_instance *c, unsigned vr, double value)
{
    if (before_start(c)) return hy_variables[vr].flags & HAS_START;
    if (c->engine.status->mode & (CONTINUOUS | IN_STEP)) return settable_between_events(c, vr, value);
    return hy_variables[vr].flags & (IS_INPUT | IS_TUNABLE);
}

int hy_may_set(hy_instance *c, const char *call, unsigned vr, int type, double value)
{
    const hy_variable *variable = vr < (unsigned)c->engine.model->n_values ? hy_variables + vr : NULL;
    /* what is set before each step needs no further look */
    if (variable && variable->type == type && (variable->flags & (IS_INPUT | IS_DISCRETE | HAS_LIMITS)) == IS_INPUT
        && c->engine.status->mode == STEP && isfinite(value))
        return 1;
    if (!variable || variable->type != type)
        hy_fail(c, "%s: there is no variable of this type with value reference %u", call, vr);
    else if (!isfinite(value))
        hy_fail(c, "%s: %s must be a finite number", call, variable->name);
    else if (variable->flags & HAS_LIMITS && value < variable->min)
        hy_fail(c, "%s: %s = %g is below its minimum %g", call, variable->name, value, variable->min);
    else if (variable->flags & HAS_LIMITS && value > variable->max)
        hy_fail(c, "%s: %s = %g is above its maximum %g", call, variable->name, value, variable->max);
    else if (settable_now(c, vr, value))
        return 1;
    else
        hy_fail(c, "%s: %s cannot be set while the instance is %s", call, variable->name, mode_name(c->engine.status->mode));
    return 0;
}

static int set_running(hy_instance *c, unsigned vr, double value)
{
    hy_engine *e = &c->engine;
    if (e->data.v[vr] == value) return HY_OK;
    e->data.v[vr] = value;
    e->status->stale = 1;
    if (hy_variables[vr].flags & IS_DISCRETE) e->status->event_pending = 1;
    if (hy_variables[vr].flags & IS_TUNABLE && e->model->parameters) return e->model->parameters(&e->data);
    return HY_OK;
}

/* All values are checked before the first is taken: a refused call changes nothing. */
int hy_set(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, const double *value)
{
    int outcome = HY_OK;
    if (n && (!vr || !value)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    for (size_t i = 0; i < n; i++)
        if (!hy_may_set(c, call, vr[i], type, value[i])) return FMI_ERROR;
    if (before_start(c)) {
        for (size_t i = 0; i < n; i++) c->engine.settings[vr[i]] = value[i];
        c->engine.status->started = 0;
        return FMI_OK;
    }
    for (size_t i = 0; i < n && !outcome; i++) outcome = set_running(c, vr[i], value[i]);
    return hy_fmi_status(c, outcome);
}

static int is_text(const hy_instance *c, unsigned vr)
{
    const hy_model *m = c->engine.model;
    const unsigned first = (unsigned)(m->n_values + m->n_z);
    return vr >= first && vr - first < (unsigned)hy_n_texts;
}

int hy_get_texts(hy_instance *c, const char *call, const unsigned *vr, size_t n, const char **value)
{
    const hy_model *m = c->engine.model;
    if (n && (!vr || !value)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    for (size_t i = 0; i < n; i++) {
        if (!is_text(c, vr[i])) return hy_fail(c, "%s: there is no String with value reference %u", call, vr[i]);
        value[i] = hy_texts[vr[i] - (unsigned)(m->n_values + m->n_z)];
    }
    return FMI_OK;
}

int hy_set_texts(hy_instance *c, const char *call, const unsigned *vr, size_t n)
{
    if (!n) return FMI_OK;
    if (!vr || !is_text(c, vr[0])) return hy_fail(c, "%s: there is no String with this value reference", call);
    return hy_fail(c, "%s: the Strings of this model are built in: change them in the model and build it again", call);
}

int hy_set_time(hy_instance *c, double time)
{
    if (!isfinite(time)) return hy_fail(c, "time must be finite");
    c->engine.data.v[0] = time;
    c->engine.status->stale = 1;
    return FMI_OK;
}

static int right_length(hy_instance *c, const void *values, size_t n, int expected, const char *what)
{
    if (n == (size_t)expected && (values || !n)) return 1;
    hy_fail(c, "an array of %d %s is needed, one of %zu was given", expected, what, values ? n : 0);
    return 0;
}

int hy_set_states(hy_instance *c, const double *x, size_t n)
{
    if (!right_length(c, x, n, c->engine.model->n_x, "states")) return FMI_ERROR;
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i])) return hy_fail(c, "continuous state %zu must be finite", i + 1);
    if (n) memcpy(c->engine.data.v + c->engine.model->x, x, n * sizeof *x);
    c->engine.status->stale = 1;
    return FMI_OK;
}

int hy_get_states(hy_instance *c, double *x, size_t n)
{
    int outcome;
    if (!right_length(c, x, n, c->engine.model->n_x, "states")) return FMI_ERROR;
    outcome = hy_present(c);
    if (n) memcpy(x, c->engine.data.v + c->engine.model->x, n * sizeof *x);
    return hy_fmi_status(c, outcome);
}

int hy_get_nominals(hy_instance *c, double *x, size_t n)
{
    if (!right_length(c, x, n, c->engine.model->n_x, "nominals")) return FMI_ERROR;
    if (n) memcpy(x, hy_nominals, n * sizeof *x);
    return FMI_OK;
}

int hy_get_derivatives(hy_instance *c, double *dx, size_t n)
{
    hy_engine *e = &c->engine;
    int outcome;
    if (!right_length(c, dx, n, e->model->n_x, "derivatives")) return FMI_ERROR;
    if (e->status->stale == 2) e->status->stale = 1;
    outcome = hy_present(c);
    if (!outcome && e->status->mode != FAILED) outcome = check_derivatives(c);
    if (n) memcpy(dx, e->data.v + e->model->dx, n * sizeof *dx);
    return hy_fmi_status(c, outcome);
}

int hy_get_indicators(hy_instance *c, double *z, size_t n)
{
    int outcome;
    if (!right_length(c, z, n, c->engine.model->n_z, "event indicators")) return FMI_ERROR;
    outcome = hy_present(c);
    if (!outcome && n) outcome = indicators(c, z);
    return hy_fmi_status(c, outcome);
}

/* Whether the derivatives may jump at this event: a relation or a discrete state is another than before it. A sampled
 * memory is another after each sample, and most often without a jump: there the derivatives themselves are compared. */
static int switched(const hy_engine *e, const double *before)
{
    const hy_model *m = e->model;
    const double *const after = e->data.v;
    const int slot = hy_has_ticks(e) ? m->dx : m->d, n = hy_has_ticks(e) ? m->n_x : m->n_d;
    return memcmp(before + m->rel, after + m->rel, sizeof(double) * (size_t)m->n_rel) != 0
        || memcmp(before + slot, after + slot, sizeof(double) * (size_t)n) != 0;
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

/* In model exchange states count as changed where their derivatives may jump: importers in wide use restart their solver
 * for a new state alone, and a multistep solver that is not told goes on with the old slope, or past the event. The first
 * event iteration comes before any solver. */
int hy_new_discrete_states(hy_instance *c, int *states_changed, int *next_defined, double *next)
{
    hy_engine *e = &c->engine;
    double *const before = c->backup;
    int outcome = hy_has_ticks(e) ? hy_settle(e) : HY_OK;
    memcpy(before, e->data.v, sizeof(double) * (size_t)e->model->n_values);
    if (!outcome) outcome = hy_event(e, states_changed);
    if (!outcome) outcome = tick(c);
    if (e->status->kind == MODEL_EXCHANGE && e->status->sampled && e->model->n_x)
        *states_changed |= switched(e, before);
    *next = fmin(hy_next_time_event(e), next_tick(c));
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
    e->data.v[0] = s->origin = t;
    for (int i = 0; i < s->n_driven; i++) e->driven[i].c[0] = e->data.v[e->driven[i].slot];
    outcome = hy_inputs_changed(e);
    if (!outcome) outcome = advance(c, t, h, stop_at_events, between, reached);
    *event = outcome == HY_EVENT;
    if (*event || !outcome) outcome = hy_settle(e);
    if (!outcome) outcome = check_values(c);
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
