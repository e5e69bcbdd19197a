#include "hy_table.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hy_engine.h"
#include "hy_stops.h"

static void note(void *owner, int level, const char *text)
{
    hy_table *t = owner;
    char *place = level == HY_FAILURE ? t->failure : t->warning;
    if (level != HY_INFO && !place[0]) snprintf(place, sizeof t->failure, "%s", text);
}

/* Cubic through (0, u0) and (h, u1) with slopes d0 and d1; a line or a constant where the column says so. */
static void interpolate(const hy_table *t, int column, int row, double *c)
{
    const double *u = t->samples[column] + row;
    const double h = t->dt;
    c[0] = u[0];
    c[1] = c[2] = c[3] = 0;
    if (t->column_modes[column] == HY_LINEAR) c[1] = (u[1] - u[0]) / h;
    if (t->column_modes[column] == HY_HERMITE) {
        const double *d = t->slopes[column] + row;
        const double mean = (u[1] - u[0]) / h;
        c[1] = d[0];
        c[2] = (3 * mean - 2 * d[0] - d[1]) / h;
        c[3] = (d[0] + d[1] - 2 * mean) / (h * h);
    }
}

static double row_time(const hy_table *t, int row) { return t->start_time + row * t->dt; }

/* The values of a sample exactly as given, not as the end of the previous polynomial. */
static void set_row(hy_engine *e, const hy_table *t, int row)
{
    e->data.v[0] = row_time(t, row);
    for (int i = 0; i < t->n_columns; i++) {
        double *const value = e->data.v + t->column_slots[i];
        if (t->column_modes[i] == HY_HOLD && *value != t->samples[i][row]) e->status->event_pending = 1;
        *value = t->samples[i][row];
    }
    e->status->stale = 1;
}

static void set_polynomials(hy_engine *e, const hy_table *t, int row)
{
    e->status->origin = row_time(t, row);
    for (int i = 0; i < t->n_columns; i++) interpolate(t, i, row, e->driven[i].c);
}

/* During event iteration at a sample, driven values are that sample's. */
static void hold_row(hy_engine *e, const hy_table *t, int row)
{
    e->status->origin = row_time(t, row);
    for (int i = 0; i < t->n_columns; i++) {
        double *c = e->driven[i].c;
        c[0] = t->samples[i][row];
        c[1] = c[2] = c[3] = 0;
    }
}

static void put_gradients(hy_engine *e, hy_table *t, int row)
{
    for (int s = 0; s < t->n_seeds; s++) {
        hy_sensitivity(e, s);
        for (int k = 0; k < t->n_outputs; k++) t->gradients[k * t->n_seeds + s][row] = e->sens[t->output_slots[k]];
    }
}

static void put_outputs(const hy_engine *e, hy_table *t, int row)
{
    for (int k = 0; k < t->n_outputs; k++) t->outputs[k][row] = e->data.v[t->output_slots[k]];
}

/* A row is an accepted sample: it shows what its acceptance has changed in the memory. Gradients belong to the values
 * before that. */
static int put_row(hy_engine *e, hy_table *t, int row)
{
    int outcome = hy_settle(e);
    if (!outcome && t->n_seeds) put_gradients(e, t, row);
    if (!outcome) outcome = hy_completed(e);
    if (!outcome) put_outputs(e, t, row);
    return outcome;
}

/* The same where the states are known without their derivatives, and nothing but outputs is asked for. */
static int put_known(hy_engine *e, hy_table *t, int row)
{
    int outcome;
    if (!e->shows) return put_row(e, t, row);
    outcome = e->model->show(&e->data);
    if (!outcome) put_outputs(e, t, row);
    return outcome;
}

static int is_shown(const hy_model *m, int slot)
{
    for (int i = 0; i < m->n_shown; i++)
        if (m->shown[i] == slot) return 1;
    return slot < m->dx;
}

static int are_shown(const hy_model *m, const hy_table *t)
{
    for (int k = 0; k < t->n_outputs; k++)
        if (!is_shown(m, t->output_slots[k])) return 0;
    return m->show && !m->completed_step;
}

static int prepare(hy_engine *e, const hy_table *t)
{
    for (int i = 0; i < t->n_settings; i++) e->settings[t->setting_slots[i]] = t->settings[i];
    for (int i = 0; i < t->n_columns; i++) {
        e->settings[t->column_slots[i]] = t->samples[i][0];
        e->driven[i].slot = t->column_slots[i];
    }
    e->settings[0] = t->start_time;
    e->status->n_driven = t->n_columns;
    if (t->n_seeds && hy_carry(e, t->seed_slots, t->n_seeds)) return HY_ERROR;
    return hy_clamp_states(e, t->column_slots, t->n_columns);
}

/* Initial equations may move a clamped state: the motion has the last word. */
static int first_row(hy_engine *e, hy_table *t)
{
    int changed, outcome = hy_start(e);
    if (outcome) return outcome;
    hold_row(e, t, 0);
    set_row(e, t, 0);
    outcome = hy_has_events(e) ? hy_event(e, &changed) : HY_OK;
    return outcome ? outcome : put_row(e, t, 0);
}

static int any_held(const hy_table *t)
{
    for (int i = 0; i < t->n_columns; i++)
        if (t->column_modes[i] == HY_HOLD) return 1;
    return 0;
}

/* With events, smooth columns keep the polynomial's end value (the sample to one rounding), which saves an evaluation. */
static int integrated_row(hy_engine *e, hy_table *t, int row)
{
    double reached;
    int outcome;
    set_polynomials(e, t, row - 1);
    outcome = hy_advance(e, t->dt, t->substeps, 0, &reached);
    if (outcome) return outcome;
    if (!hy_has_events(e) || any_held(t)) {
        hold_row(e, t, row);
        set_row(e, t, row);
        outcome = hy_inputs_changed(e);
    }
    return outcome ? outcome : put_row(e, t, row);
}

/* Integral of a column over the interval after a row; NaN where it may change its sign there. */
static double way_after(const hy_table *t, int column, int row)
{
    const double *const u = t->samples[column] + row, h = t->dt;
    double bend = 0, early = u[0], late = u[1]; /* early, late: Bernstein coefficients between the two ends */
    if (t->column_modes[column] == HY_HOLD) return h * u[0];
    if (t->column_modes[column] == HY_HERMITE) {
        const double *const d = t->slopes[column] + row;
        early += h / 3 * d[0];
        late -= h / 3 * d[1];
        bend = h / 12 * (d[0] - d[1]);
    }
    if ((u[0] >= 0 && early >= 0 && late >= 0 && u[1] >= 0) || (u[0] <= 0 && early <= 0 && late <= 0 && u[1] <= 0))
        return h * (0.5 * (u[0] + u[1]) + bend);
    return NAN;
}

/* Of the columns that are followed over their way; what is evaluated at samples alone needs none. */
static void set_speeds(hy_engine *e, const hy_table *t, int row)
{
    for (int i = 0; i < t->n_columns; i++) {
        if (!e->driven[i].followed) continue;
        e->driven[i].way = way_after(t, i, row);
        if (isnan(e->driven[i].way)) interpolate(t, i, row, e->driven[i].c);
    }
}

/* Springs with sliders and nothing else to integrate: no step, no event. */
static int stopped_row(hy_engine *e, hy_table *t, int row)
{
    set_speeds(e, t, row - 1);
    hy_move_stops(e, t->dt);
    set_row(e, t, row);
    if (!e->shows) hy_mark_stops(e);
    return put_known(e, t, row);
}

static int follows_duhem(const hy_engine *e) { return e->model->n_duhem && e->model->duhem_methods->follows(e); }

/* Rate-independent states and nothing else to integrate: no step. */
static int followed_row(hy_engine *e, hy_table *t, int row)
{
    set_speeds(e, t, row - 1);
    if (e->model->duhem_methods->move(e->duhem, e, t->dt)) return HY_RETRY;
    set_row(e, t, row);
    return put_known(e, t, row);
}

/* A model without anything to integrate or to locate: one evaluation a sample. */
static int evaluated_row(hy_engine *e, hy_table *t, int row)
{
    set_row(e, t, row);
    return put_row(e, t, row);
}

static int run(hy_engine *e, hy_table *t)
{
    int (*next)(hy_engine *, hy_table *, int) = integrated_row;
    int outcome = prepare(e, t);
    t->failed_row = 0;
    e->shows = are_shown(e->model, t);
    if (!outcome) outcome = first_row(e, t);
    if (!e->n_X && !hy_has_events(e)) next = evaluated_row;
    if (!outcome && hy_open_stops(e)) next = stopped_row;
    if (!outcome && follows_duhem(e)) {
        next = followed_row;
        e->duhem = e->model->duhem_methods->open(e);
        if (!e->duhem) return HY_ERROR;
    }
    for (int row = 1; row < t->rows && !outcome; row++) {
        t->failed_row = row;
        outcome = next(e, t, row);
    }
    if (!outcome) t->failed_row = -1;
    return outcome;
}

int hy_run_table(hy_table *table)
{
    hy_engine engine;
    int outcome;
    table->failure[0] = table->warning[0] = 0;
    if (table->version != HY_TABLE_VERSION || table->rows < 1) return HY_ERROR;
    if (hy_open(&engine, &hy_the_model, note, table)) return HY_ERROR;
    if (table->substeps < 1) table->substeps = hy_steps_in(&engine, table->dt);
    outcome = run(&engine, table);
    hy_close(&engine);
    return outcome;
}
