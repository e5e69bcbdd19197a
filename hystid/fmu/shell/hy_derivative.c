/* Directional and adjoint derivatives.
 *
 * Of the running equations: exact, by the functions that the model brings along. In Initialization Mode the unknowns also
 * depend on what is given through the initial equations, and states, discrete states and parameters are unknowns
 * themselves: these are differentiated by central differences of the solution, what follows from them exactly. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hy_fmi.h"

/* Part of a value's size by which the solution is disturbed: the cube root of the rounding error, where it and the
 * error of the difference are in balance. A value of 0 has no size of its own: SMALL. */
static const double PART = 6e-6, SMALL = 1e-3;

static int in_range(int slot, int first, int n) { return slot >= first && slot < first + n; }

static int is_initial(const hy_instance *c) { return c->engine.status->mode == INITIALIZATION; }

/* Time, settable parameters, inputs and states stand as they are while derivatives are taken: they are knowns, and where
 * an output is another name of one, its sensitivity is the seed. */
static int stands(const hy_model *m, int slot)
{
    return slot == 0 || in_range(slot, m->u, m->n_u) || in_range(slot, m->x, m->n_x) || in_range(slot, m->d, m->n_d)
        || (in_range(slot, m->p, m->n_p) && hy_variables[slot].flags & HAS_START);
}

/* Before the start: time, and whatever has a start value. */
static int is_given(int slot) { return slot == 0 || hy_variables[slot].flags & HAS_START; }

static int is_unknown(const hy_model *m, int slot)
{
    return in_range(slot, m->dx, m->n_x) || in_range(slot, m->y, m->n_y) || in_range(slot, m->x, m->n_x)
        || (hy_variables[slot].flags & IS_OUTPUT && stands(m, slot));
}

static int is_real(const hy_model *m, unsigned slot) { return slot < (unsigned)m->n_values && hy_variables[slot].type == REAL; }

static int check_known(hy_instance *c, unsigned slot)
{
    const hy_model *m = c->engine.model;
    if (is_initial(c) && is_real(m, slot) && !is_given((int)slot))
        return hy_fail(c, "derivative: %s is not known in initialization mode, for it has no start value",
                       hy_variables[slot].name ? hy_variables[slot].name : "a variable");
    if (!is_real(m, slot) || !(is_initial(c) || stands(m, (int)slot)))
        return hy_fail(c, "derivative: value reference %u is not time, a real parameter that can be set, an input or a state", slot);
    return FMI_OK;
}

static int check_unknown(hy_instance *c, unsigned slot)
{
    const hy_model *m = c->engine.model;
    if (is_real(m, slot) && (is_initial(c) ? slot < (unsigned)m->pre : is_unknown(m, (int)slot))) return FMI_OK;
    if (is_real(m, slot) && in_range((int)slot, m->p, m->n_p))
        return hy_fail(c, "derivative: %s stands after initialization mode; only there it has derivatives", hy_variables[slot].name);
    return hy_fail(c, "derivative: value reference %u is not an output or the derivative of a state", slot);
}

static int check_derivative(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known)
{
    if ((n_unknown && !unknown) || (n_known && !known)) return hy_fail(c, "derivative: a NULL array was given");
    for (size_t i = 0; i < n_known; i++)
        if (check_known(c, known[i])) return FMI_ERROR;
    for (size_t i = 0; i < n_unknown; i++)
        if (check_unknown(c, unknown[i])) return FMI_ERROR;
    return FMI_OK;
}

/* Room for a seed and its sensitivities comes with the first use. */
static int derivative_room(hy_instance *c)
{
    if (!c->engine.seed) hy_carry(&c->engine, NULL, 0);
    if (!c->engine.seed) return hy_fail(c, "out of memory");
    memset(c->engine.seed, 0, 2 * sizeof(double) * (size_t)c->engine.model->n_values);
    return FMI_OK;
}

/* ---- initialization mode ---- */

/* How far to go along the seed; a power of two, so that what is given itself gives the seed to the last bit. */
static double disturbance(const hy_model *m, const double *settings, const double *seed)
{
    double least = INFINITY;
    for (int i = 0; i < m->pre; i++)
        if (seed[i] != 0) least = fmin(least, PART * fmax(fabs(settings[i]), SMALL) / fabs(seed[i]));
    return isfinite(least) ? exp2(floor(log2(least))) : 0;
}

/* The initial equations solved with what is given moved by h along the seed; v: the solution. */
static int solve_moved(hy_instance *c, const double *seed, double h, double *v)
{
    hy_engine *e = &c->engine;
    const size_t size = sizeof(double) * (size_t)e->model->n_values;
    int outcome;
    memcpy(v, e->settings, size);
    for (int i = 0; i < e->model->pre; i++) e->settings[i] += h * seed[i];
    outcome = hy_start(e);
    if (!outcome) outcome = hy_settle(e);
    memcpy(e->settings, v, size);
    memcpy(v, e->data.v, size);
    return outcome;
}

/* What the initial equations give, and the running ones read. */
static int is_solved(const hy_model *m, int slot)
{
    return in_range(slot, m->x, m->n_x) || in_range(slot, m->d, m->n_d) || (in_range(slot, m->p, m->n_p) && !is_given(slot));
}

/* sens := d(solution)/d(what is given) . seed. States and the parameters and discrete states that the initial equations
 * give become seeds for the running equations, unless these have memory: then the start is an equation of its own. */
static int initial_sensitivity(hy_instance *c, double *seed, double *sens, double *room)
{
    hy_engine *e = &c->engine;
    const hy_model *m = e->model;
    double *const high = room, *const low = room + m->n_values;
    const double h = disturbance(m, e->settings, seed);
    int outcome = h ? solve_moved(c, seed, h, high) : HY_OK, back;
    if (!outcome && h) outcome = solve_moved(c, seed, -h, low);
    back = hy_start(e);
    if (!back) back = hy_settle(e);
    if (outcome || back) return HY_RETRY;
    if (!h) return HY_OK;
    for (int i = 0; i < m->pre; i++) sens[i] = (high[i] - low[i]) / (2 * h);
    if (m->completed_step) return HY_OK;
    memcpy(high, sens, sizeof(double) * (size_t)m->pre);
    for (int i = 1; i < m->pre; i++)
        if (is_solved(m, i)) seed[i] = high[i];
    outcome = m->forward(&e->data, seed, sens);
    for (int i = 0; i < m->pre; i++)
        if (!in_range(i, m->dx, m->n_x) && !in_range(i, m->y, m->n_y)) sens[i] = high[i];
    return outcome;
}

static int given(hy_instance *c, int outcome, const double *derivatives, size_t n)
{
    return hy_fmi_status(c, outcome ? outcome : hy_check_numbers(c, "a directional derivative", derivatives, n));
}

static int initial_failed(hy_instance *c, int outcome)
{
    if (outcome == HY_RETRY) return hy_fail(c, "derivative: the initial equations have no solution beside the present one");
    return hy_fmi_status(c, outcome);
}

static int initial_directional(hy_instance *c, const unsigned *unknown, size_t n_unknown, double *sensitivity)
{
    hy_engine *e = &c->engine;
    double *const room = malloc(2 * sizeof(double) * (size_t)e->model->n_values);
    int outcome;
    if (!room) return hy_fail(c, "out of memory");
    outcome = initial_sensitivity(c, e->seed, e->sens, room);
    free(room);
    for (size_t i = 0; i < n_unknown && !outcome; i++) sensitivity[i] = e->sens[unknown[i]];
    return outcome ? initial_failed(c, outcome) : given(c, HY_OK, sensitivity, n_unknown);
}

/* Row by row, for the initial equations are not differentiated backwards. */
static int initial_adjoint(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                           const double *seed, double *sensitivity)
{
    hy_engine *e = &c->engine;
    double *const room = malloc(2 * sizeof(double) * (size_t)e->model->n_values);
    int outcome = HY_OK;
    if (!room) return hy_fail(c, "out of memory");
    for (size_t k = 0; k < n_known && !outcome; k++) {
        memset(e->seed, 0, 2 * sizeof(double) * (size_t)e->model->n_values);
        e->seed[known[k]] = 1;
        outcome = initial_sensitivity(c, e->seed, e->sens, room);
        sensitivity[k] = 0;
        for (size_t i = 0; i < n_unknown; i++) sensitivity[k] += seed[i] * e->sens[unknown[i]];
    }
    free(room);
    return outcome ? initial_failed(c, outcome) : given(c, HY_OK, sensitivity, n_known);
}

/* ---- both ---- */

int hy_directional(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                   const double *seed, double *sensitivity)
{
    hy_engine *e = &c->engine;
    const hy_model *m = e->model;
    int outcome;
    if (!m->forward) return hy_fail(c, "this model has no directional derivatives");
    if (check_derivative(c, unknown, n_unknown, known, n_known) || derivative_room(c)) return FMI_ERROR;
    if ((n_known && !seed) || (n_unknown && !sensitivity)) return hy_fail(c, "derivative: a NULL array was given");
    outcome = hy_present(c);
    for (size_t i = 0; i < n_known; i++) e->seed[known[i]] += seed[i];
    if (outcome) return hy_fmi_status(c, outcome);
    if (is_initial(c)) return initial_directional(c, unknown, n_unknown, sensitivity);
    outcome = m->forward(&e->data, e->seed, e->sens);
    for (size_t i = 0; i < n_unknown; i++)
        sensitivity[i] = stands(m, (int)unknown[i]) ? e->seed[unknown[i]] : e->sens[unknown[i]];
    return given(c, outcome, sensitivity, n_unknown);
}

int hy_adjoint(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
               const double *seed, double *sensitivity)
{
    hy_engine *e = &c->engine;
    const hy_model *m = e->model;
    int outcome;
    if (!m->adjoint) return hy_fail(c, "this model has no adjoint derivatives");
    if (check_derivative(c, unknown, n_unknown, known, n_known) || derivative_room(c)) return FMI_ERROR;
    if ((n_unknown && !seed) || (n_known && !sensitivity)) return hy_fail(c, "derivative: a NULL array was given");
    outcome = hy_present(c);
    if (outcome) return hy_fmi_status(c, outcome);
    if (is_initial(c)) return initial_adjoint(c, unknown, n_unknown, known, n_known, seed, sensitivity);
    for (size_t i = 0; i < n_unknown; i++) {
        if (stands(m, (int)unknown[i]))
            e->sens[unknown[i]] += seed[i];
        else
            e->seed[unknown[i]] += seed[i];
    }
    outcome = m->adjoint(&e->data, e->seed, e->sens);
    for (size_t i = 0; i < n_known; i++) sensitivity[i] = e->sens[known[i]];
    return given(c, outcome, sensitivity, n_known);
}
