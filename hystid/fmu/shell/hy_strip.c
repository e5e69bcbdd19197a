#include "hy_strip.h"

#include <stdlib.h>
#include <string.h>

enum { LENGTH = HY_STRIP + 8 }; /* of a row, so that those of many states do not meet in the same corner of a cache */

/* Row of a slot among those that show takes, -1 where there is none. */
static int row_taken(const hy_model *m, int slot)
{
    if (!slot) return 0;
    if (slot >= m->u && slot < m->u + m->n_u) return 1 + slot - m->u;
    if (slot >= m->x && slot < m->x + m->n_x) return 1 + m->n_u + slot - m->x;
    return -1;
}

/* Row of a slot among those that show gives, -1 where there is none. */
static int row_shown(const hy_model *m, int slot)
{
    int i = m->n_shown - 1;
    while (i >= 0 && m->shown[i] != slot) i--;
    return i;
}

static int rows_taken(const hy_model *m) { return 1 + m->n_u + m->n_x; }

static int serves(const hy_engine *e, const hy_table *t)
{
    const hy_model *const m = e->model;
    for (int k = 0; k < t->n_outputs; k++)
        if (row_taken(m, t->output_slots[k]) < 0 && row_shown(m, t->output_slots[k]) < 0) return 0;
    return !m->completed_step && !t->n_seeds;
}

/* Value in the block of what such a row holds. */
static double value_taken(const hy_engine *e, int row)
{
    const hy_model *const m = e->model;
    return e->data.v[!row ? 0 : row <= m->n_u ? m->u + row - 1 : m->x + row - 1 - m->n_u];
}

static int open_strip(hy_strip *s, const hy_engine *e)
{
    const hy_model *const m = e->model;
    const int taken = rows_taken(m);
    s->room = malloc(sizeof *s->room * LENGTH * (size_t)(taken + m->n_shown));
    s->in = malloc(sizeof *s->in * (size_t)taken);
    s->states = malloc(sizeof *s->states * (size_t)(m->n_x + m->n_shown + 1));
    if (!s->room || !s->in || !s->states) return HY_ERROR;
    s->out = s->states + m->n_x;
    for (int k = 0; k < taken; k++) {
        double *const row = s->room + k * LENGTH, value = value_taken(e, k);
        for (int i = 0; i < HY_STRIP; i++) row[i] = value;
        s->in[k] = row;
    }
    for (int k = 0; k < m->n_x; k++) s->states[k] = s->room + (1 + m->n_u + k) * LENGTH;
    for (int k = 0; k < m->n_shown; k++) s->out[k] = s->room + (taken + k) * LENGTH;
    return HY_OK;
}

static void show(hy_strip *s, const hy_engine *e, hy_table *t, int row, int n)
{
    const hy_model *const m = e->model;
    for (int i = 0; i < n; i++) s->room[i] = t->start_time + (row + i) * t->dt;
    for (int c = 0; c < t->n_columns; c++) s->in[row_taken(m, t->column_slots[c])] = t->samples[c] + row;
    m->show(e->data.v, s->in, s->out, n);
    for (int k = 0; k < t->n_outputs; k++) {
        const int shown = row_shown(m, t->output_slots[k]);
        const double *const from = shown >= 0 ? s->out[shown] : s->in[row_taken(m, t->output_slots[k])];
        memcpy(t->outputs[k] + row, from, sizeof *from * (size_t)n);
    }
}

static void close_strip(hy_strip *s)
{
    free(s->room);
    free(s->in);
    free(s->states);
}

const struct hy_strip_methods hy_strip_methods = {serves, open_strip, show, close_strip};
