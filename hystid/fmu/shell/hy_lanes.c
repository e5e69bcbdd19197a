/* Several tables at once, for the table runner in a process; no part of an FMU.
 *
 * Within a step each operation waits for the one before it: the slopes need the states, the states the slopes. The
 * processor idles meanwhile. Lanes go through the stages of the Runge-Kutta method side by side, so that it works on
 * one while another one waits. They share nothing: each gives the same bits as alone. */
#include <stdlib.h>

#include "hy_table.c"

#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
void hy_run_tables(hy_table *tables, int n, int *outcomes);

enum {
    LANES = 4,    /* more gain nothing: the processor's window is full */
    BROKEN = 8,  /* one row in so many may be broken */
    SETTLING = 200 /* rows before that is judged */
};

typedef struct {
    hy_engine e;
    hy_table *t;
    int row, step;             /* that are being reached */
    double t0, h, middle, end; /* start of the row; length, middle and end of the step [s] */
    double *kept;              /* what the block holds at the start of the row, parameters apart */
    int good;                  /* 1 as long as nothing happens in the row: no event, no refusal */
    int broken;                /* rows in which something happened */
    int *outcome;
} lane;

/* Whether rows can be integrated in lanes: what is left out here is rare and takes the way of a single table. */
static int goes_in_lanes(const hy_engine *e, const hy_table *t)
{
    const hy_model *m = e->model;
    if ((m->stop_methods && m->stop_methods->alone(e)) || follows_duhem(e)) return 0;
    return e->n_free && !t->n_seeds && !m->completed_step && !m->next_time_event && !(hy_has_events(e) && any_held(t));
}

static size_t kept_size(const hy_model *m) { return sizeof(double) * (size_t)(m->n_values - m->u); }

static void begin_step(lane *l)
{
    const double dt = l->t->dt, n = l->t->substeps;
    hy_engine *const e = &l->e;
    const double *const x = e->data.v + e->model->x + e->free[0];
    double left;
    if (!l->step) {
        set_polynomials(e, l->t, l->row - 1);
        memcpy(l->kept, e->data.v + e->model->u, kept_size(e->model));
        l->t0 = e->data.v[0];
        l->good = 1;
    }
    left = l->t0 + dt * (l->step / n);
    l->h = dt / n;
    l->middle = left + 0.5 * l->h;
    l->end = l->t0 + dt * ((l->step + 1) / n);
    memcpy(e->X, x, sizeof *x * (size_t)e->n_free);
}

/* From the slopes in the block to the states of the next stage; weight: of the slopes in the sum of the step. */
static void move(lane *l, double weight, double length)
{
    hy_engine *const e = &l->e;
    const int n = e->n_free, first = e->free[0];
    const double *restrict const dx = e->data.v + e->model->dx + first, *restrict const X = e->X;
    double *restrict const x = e->data.v + e->model->x + first, *restrict const sum = e->sum;
    for (int i = 0; i < n; i++) sum[i] = weight == 1 ? dx[i] : sum[i] + weight * dx[i];
    for (int i = 0; i < n; i++) x[i] = X[i] + length * dx[i];
}

static void finish(lane *l)
{
    hy_engine *const e = &l->e;
    const double *const dx = e->data.v + e->model->dx + e->free[0], part = l->h / 6;
    double *const x = e->data.v + e->model->x + e->free[0];
    double check = 0;
    for (int i = 0; i < e->n_free; i++) x[i] = e->X[i] + part * (e->sum[i] + dx[i]);
    if (e->has_clamped) hy_drive(e);
    for (int i = 0; i < e->n_free; i++) check += 0 * x[i]; /* 0 * inf and 0 * nan are nan */
    l->good &= check == 0;
    if (l->step + 1 == l->t->substeps && !hy_has_events(e)) {
        hold_row(e, l->t, l->row);
        set_row(e, l->t, l->row);
    }
}

static void drive(lane *l, double time)
{
    l->e.data.v[0] = time;
    hy_drive(&l->e);
}

static void evaluate(lane *l) { l->good &= l->e.model->evaluate(&l->e.data) == HY_OK; }

/* Something has happened: the row is integrated anew, by the step that knows events and refusals. */
static int again(lane *l)
{
    hy_engine *const e = &l->e;
    memcpy(e->data.v + e->model->u, l->kept, kept_size(e->model));
    e->data.v[0] = l->t0;
    e->status->stale = e->z_stands = 0;
    return integrated_row(e, l->t, l->row);
}

/* Where too many rows are broken, to integrate them twice costs more than lanes save. */
static void alone(lane *l)
{
    for (; l->row < l->t->rows && !*l->outcome; l->row += !*l->outcome) {
        l->t->failed_row = l->row;
        *l->outcome = integrated_row(&l->e, l->t, l->row);
    }
}

static void end_step(lane *l)
{
    hy_engine *const e = &l->e;
    int any = 0;
    e->status->stale = 0;
    if (l->good && hy_has_events(e)) l->good = hy_crossed(e, &any) == HY_OK && !any;
    if (l->good && ++l->step < l->t->substeps) return;
    *l->outcome = l->good ? put_row(e, l->t, l->row) : again(l);
    l->t->failed_row = l->row;
    l->step = 0;
    l->broken += !l->good;
    if (!*l->outcome) l->row++;
    if (!*l->outcome && BROKEN * l->broken > l->row + SETTLING) alone(l);
}

static void step_all(lane *const *on, int n)
{
    for (int i = 0; i < n; i++) {
        begin_step(on[i]);
        move(on[i], 1, 0.5 * on[i]->h);
        drive(on[i], on[i]->middle);
    }
    for (int i = 0; i < n; i++) evaluate(on[i]);
    for (int i = 0; i < n; i++) {
        move(on[i], 2, 0.5 * on[i]->h);
        if (on[i]->e.has_clamped) drive(on[i], on[i]->middle);
    }
    for (int i = 0; i < n; i++)
        if (!on[i]->e.quadrature) evaluate(on[i]);
    for (int i = 0; i < n; i++) {
        move(on[i], 2, on[i]->h);
        drive(on[i], on[i]->end);
    }
    for (int i = 0; i < n; i++) evaluate(on[i]);
    for (int i = 0; i < n; i++) finish(on[i]);
    for (int i = 0; i < n; i++) evaluate(on[i]);
    for (int i = 0; i < n; i++) end_step(on[i]);
}

static void close_lane(lane *l)
{
    if (!*l->outcome) l->t->failed_row = -1;
    free(l->kept);
    hy_close(&l->e);
}

/* Opens a table and puts its first row. 0 where it is over already, or was run by itself; curves: of tables before it. */
static int open_lane(lane *l, hy_table *t, int *outcome, hy_duhem **curves)
{
    memset(l, 0, sizeof *l);
    l->t = t;
    l->outcome = outcome;
    t->failure[0] = t->warning[0] = 0;
    t->failed_row = 0;
    *outcome = HY_ERROR;
    if (t->version != HY_TABLE_VERSION || t->rows < 1 || hy_open(&l->e, &hy_the_model, note, t)) return 0;
    if (t->substeps < 1) t->substeps = hy_steps_in(&l->e, t->dt);
    l->kept = malloc(kept_size(l->e.model));
    *outcome = l->kept ? prepare(&l->e, t) : HY_ERROR;
    if (!*outcome && !goes_in_lanes(&l->e, t)) {
        l->e.duhem = *curves;
        *outcome = run(&l->e, t);
        *curves = l->e.duhem;
        l->e.duhem = NULL;
    } else if (!*outcome) {
        *outcome = first_row(&l->e, t);
        l->row = 1;
        if (!*outcome && t->rows > 1) return 1;
    }
    close_lane(l);
    return 0;
}

/* Every table has its own outcome; none hinders another. */
void hy_run_tables(hy_table *tables, int n, int *outcomes)
{
    lane lanes[LANES], *on[LANES];
    hy_duhem *curves = NULL;
    int next = 0, open = 0;
    for (int i = 0; i < LANES; i++) on[i] = &lanes[i];
    for (;;) {
        for (; open < LANES && next < n; next++) open += open_lane(on[open], &tables[next], &outcomes[next], &curves);
        if (!open) break;
        step_all(on, open);
        for (int i = open - 1; i >= 0; i--) {
            lane *const over = on[i];
            if (!*over->outcome && over->row < over->t->rows) continue;
            close_lane(over);
            on[i] = on[--open];
            on[open] = over;
        }
    }
    if (curves) hy_the_model.duhem_methods->close(curves);
}
