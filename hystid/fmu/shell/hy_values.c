/* Values of an instance: asked for, set, and shown only where they are finite. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "hy_fmi.h"

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

int hy_check_values(hy_instance *c)
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
        hy_fail(c, "%s: %s cannot be set while the instance is %s", call, variable->name, hy_mode_name(c->engine.status->mode));
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

/* What is set before each step, continuous inputs without limits, needs no further look; 0 where something else is set. */
static int set_inputs(hy_instance *c, const unsigned *vr, size_t n, int type, const double *value)
{
    const hy_engine *const e = &c->engine;
    const unsigned n_values = (unsigned)e->model->n_values;
    int moved = 0;
    if (e->status->mode != STEP) return 0;
    for (size_t i = 0; i < n; i++) {
        const hy_variable *const variable = hy_variables + vr[i];
        if (vr[i] >= n_values || variable->type != type || !isfinite(value[i])
            || (variable->flags & (IS_INPUT | IS_DISCRETE | HAS_LIMITS)) != IS_INPUT)
            return 0;
    }
    for (size_t i = 0; i < n; i++) {
        moved |= e->data.v[vr[i]] != value[i];
        e->data.v[vr[i]] = value[i];
    }
    if (moved) e->status->stale = 1;
    return 1;
}

/* All values are checked before the first is taken: a refused call changes nothing. */
int hy_set(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, const double *value)
{
    int outcome = HY_OK;
    if (n && (!vr || !value)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    if (set_inputs(c, vr, n, type, value)) return FMI_OK;
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

/* One element of an array of whole numbers: truth values in FMI 3 take a byte, the others 4 or 8. */
static long long whole_at(const void *values, size_t i, size_t size)
{
    if (size == 1) return ((const unsigned char *)values)[i];
    return size == sizeof(int64_t) ? ((const int64_t *)values)[i] : ((const int32_t *)values)[i];
}

int hy_get_whole(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, void *values, size_t size)
{
    if (n && (!vr || !values)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    for (size_t i = 0; i < n; i++) {
        double number;
        const int code = hy_get(c, call, vr + i, 1, type, &number);
        const long long whole = code ? 0 : type == BOOLEAN ? number != 0 : llround(number);
        if (code) return code;
        if (size == 1)
            ((unsigned char *)values)[i] = (unsigned char)whole;
        else if (size == sizeof(int64_t))
            ((int64_t *)values)[i] = whole;
        else
            ((int32_t *)values)[i] = (int32_t)whole;
    }
    return FMI_OK;
}

/* All are checked before the first is set. */
int hy_set_whole(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, const void *values, size_t size)
{
    int worst = FMI_OK;
    if (n && (!vr || !values)) return hy_fail(c, "%s: a NULL array was given for %zu values", call, n);
    for (int set = 0; set < 2; set++) {
        for (size_t i = 0; i < n && worst <= FMI_WARNING; i++) {
            const long long whole = whole_at(values, i, size);
            const double number = type == BOOLEAN ? whole != 0 : (double)whole;
            if (set)
                worst = hy_set(c, call, vr + i, 1, type, &number);
            else if (!hy_may_set(c, call, vr[i], type, number))
                return FMI_ERROR;
        }
    }
    return worst;
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
