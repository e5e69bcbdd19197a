#include "hy_table.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hy_engine.h"
#include "hy_strip.h"
#include "hy_paths.h"

/* The first failure; of warnings the first of each kind, which its first letters tell, as far as there is room. */
static void note(void *owner, int level, const char *text)
{
    hy_table *t = owner;
    char *place = level == HY_FAILURE ? t->failure : t->warning, kind[12];
    const size_t used = strlen(place);
    snprintf(kind, sizeof kind, "%s", text);
    if (level == HY_INFO || (used && (level == HY_FAILURE || strstr(place, kind)))) return;
    snprintf(place + used, sizeof t->failure - used, "%s%s", used ? "; " : "", text);
}

/* Cubic through (0, u0) and (h, u1) with slopes d0 and d1; a line or a constant where the column says so. */
void hy_interpolate(const hy_table *t, int column, int row, double *c)
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
    for (int i = 0; i < t->n_columns; i++) hy_interpolate(t, i, row, e->driven[i].c);
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
    if (!outcome && e->model->completed_step) outcome = hy_completed(e);
    if (!outcome) put_outputs(e, t, row);
    return outcome;
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
    if (!outcome) outcome = put_row(e, t, row);
    if (!outcome && e->watched) hy_note_coarse(e);
    return outcome;
}

/* Of a model without anything to integrate or to locate. */
static int move_nothing(hy_engine *e, int n, double *const *rows)
{
    (void)e, (void)rows;
    return n;
}

static int follows_duhem(const hy_engine *e) { return e->model->n_duhem && e->model->duhem_methods->follows(e); }

/* How the states move without steps of time: springs with sliders and nothing else to integrate, or rate-independent
 * states and nothing else, or nothing at all; NULL where they have to be integrated. */
static hy_mover *mover_of(hy_engine *e)
{
    const struct hy_duhem_methods *const duhem = e->model->duhem_methods;
    const struct hy_stop_methods *const stops = e->model->stop_methods;
    if (follows_duhem(e)) return (e->duhem = duhem->open(e)) ? duhem->move : NULL;
    if (stops && stops->open(e)) return stops->move;
    return !e->n_X && !hy_has_events(e) ? move_nothing : NULL;
}

/* One row after another, with all that the model gives. */
static int moved_rows(hy_engine *e, hy_table *t, hy_mover *move)
{
    int outcome = HY_OK;
    for (int row = 1; row < t->rows && !outcome; row++) {
        t->failed_row = row;
        if (e->paths) e->model->paths->set(e, t, row - 1, 1);
        if (move(e, 1, NULL) < 1) return HY_RETRY;
        set_row(e, t, row);
        if (e->stops) e->model->stop_methods->mark(e);
        outcome = put_row(e, t, row);
    }
    return outcome;
}

/* A strip of rows after another: how the speeds lead through it, the states, the outputs. */
static int shown_rows(hy_engine *e, hy_table *t, hy_mover *move)
{
    const struct hy_strip_methods *const strips = e->model->strips;
    hy_strip strip;
    int outcome = strips->open(&strip, e);
    for (int row = 1, n; row < t->rows && !outcome; row += n) {
        n = t->rows - row < HY_STRIP ? t->rows - row : HY_STRIP;
        if (e->paths) e->model->paths->set(e, t, row - 1, n);
        t->failed_row = row + move(e, n, strip.states);
        if (t->failed_row < row + n)
            outcome = HY_RETRY;
        else
            strips->show(&strip, e, t, row, n);
    }
    strips->close(&strip);
    return outcome;
}

static int integrated_rows(hy_engine *e, hy_table *t)
{
    int outcome = HY_OK;
    const int watchable = !e->n_seeds && !e->n_clamped && !any_held(t); /* a held value jumps at the right end */
    for (int row = 1; row < t->rows && !outcome; row++) {
        t->failed_row = row;
        e->watched = watchable && hy_is_watched((unsigned)row);
        outcome = integrated_row(e, t, row);
    }
    return outcome;
}

static int run(hy_engine *e, hy_table *t)
{
    const hy_model *const m = e->model;
    hy_mover *move;
    int outcome = prepare(e, t);
    t->failed_row = 0;
    if (!outcome) outcome = first_row(e, t);
    if (!outcome && m->paths) outcome = m->paths->open(e);
    if (outcome) return outcome;
    move = mover_of(e);
    if (!move)
        outcome = integrated_rows(e, t);
    else
        outcome = m->strips && m->strips->serves(e, t) ? shown_rows(e, t, move) : moved_rows(e, t, move);
    if (!outcome) t->failed_row = -1;
    return outcome;
}

static int all_inside(const int *slots, int n, int size)
{
    for (int i = 0; i < n; i++)
        if (slots[i] < 0 || slots[i] >= size) return 0;
    return n >= 0;
}

/* Slots are indices into the block: one outside would read or write memory that is not the model's. There are as many
 * driven values as inputs and states. */
static const char *refusal(const hy_table *t)
{
    const hy_model *const m = &hy_the_model;
    if (t->version != HY_TABLE_VERSION) return "the table is of another version";
    if (t->rows < 1) return "the table has no rows";
    if (!isfinite(t->start_time) || !isfinite(t->dt) || t->dt < 0) return "the table's clock is not finite";
    if (t->n_columns > m->n_u + m->n_x) return "the table has more columns than the model has inputs and states";
    if (!all_inside(t->setting_slots, t->n_settings, m->n_values)) return "a setting has no slot of the model";
    if (!all_inside(t->column_slots, t->n_columns, m->n_values)) return "a column has no slot of the model";
    if (!all_inside(t->output_slots, t->n_outputs, m->n_values)) return "an output has no slot of the model";
    if (!all_inside(t->seed_slots, t->n_seeds, m->n_values)) return "a seed has no slot of the model";
    for (int i = 0; i < t->n_columns; i++)
        if (t->column_modes[i] < HY_HOLD || t->column_modes[i] > HY_HERMITE) return "a column has no known mode";
    return t->n_seeds && !m->forward ? "the model has no derivatives for seeds" : NULL;
}

int hy_run_table(hy_table *table)
{
    hy_engine engine;
    const char *const wrong = refusal(table);
    int outcome;
    table->failure[0] = table->warning[0] = 0;
    if (wrong) {
        table->failed_row = 0;
        note(table, HY_FAILURE, wrong);
        return HY_ERROR;
    }
    if (hy_open(&engine, &hy_the_model, note, table)) return HY_ERROR;
    if (table->substeps < 1) table->substeps = hy_steps_in(&engine, table->dt);
    outcome = run(&engine, table);
    hy_close(&engine);
    return outcome;
}
