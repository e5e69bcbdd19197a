/* Rate-independent states on a given motion: der(z) = g(z, sign(speed)) |speed| (Duhem's law; Visintin, Differential
 * Models of Hysteresis, 1994, chapter V). While the motion keeps its sense such a state runs along one curve of z over the
 * travel, the same one wherever it comes on. The curves of both senses are integrated once, as far as the motion asks for;
 * then the state is read off from one reversal to the next, in no steps of time. */
#include "hy_engine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hy_paths.h"

enum { FIRST_NODES = 64, MOST_NODES = 100000 };

static const double FIRST_STEP = 1e-9; /* travel to be tried first: a step that is far too short grows within a few nodes */
static const double EXACT = 3e-8;     /* error that a curve may have between its nodes, share of the state */
static const double AT_REST = 1e-12;  /* slope, share of that at z = 0, below which a state has come to rest */
static const double SHORTEST = 1e-12; /* step, share of the travel so far, in which a law jumps */
static const double TENFOLD = 10;     /* change of slope that a step may have */
static const double OF_STEP = 0.01;   /* error, share of the change of state in a step: beyond it a step leaps over rest */
static const double ROUNDING = 1e-14; /* error that numbers have, share of the state */

/* A point of a curve: travel, state, and the state's slope over the travel; c2, c3: of the cubic to the next point. */
typedef struct {
    double s, z, slope, c2, c3;
} node;

/* A curve on one side of z = 0; step: the length to be tried next, negative on the earlier side. */
typedef struct {
    node *nodes;
    int n, room;
    double step;
    enum { GOES_ON, RESTS, BREAKS } end;
} side;

/* The curve in one sense of the motion, from z = 0 on. */
typedef struct {
    side later, earlier;
    double sense; /* speed: 1 or -1 */
} curve;

/* One state with its curves, and where it is: on a curve (NULL where on none), after a node, at a travel. */
typedef struct {
    const hy_duhem_state *slots;
    curve curves[2];
    curve *on;
    int at;
    double s;
} follower;

struct hy_duhem {
    hy_data data; /* a block of its own, in which speed and state are whatever is asked about */
    int (*evaluate)(hy_data *m);
    follower *followers;
    int n;
};

static void say_nothing(void *owner, int level, const char *text)
{
    (void)owner;
    (void)level;
    (void)text;
}

static double slope_at(hy_duhem *d, const hy_duhem_state *slots, double sense, double z)
{
    double *const v = d->data.v;
    v[slots->speed] = sense;
    v[slots->state] = z;
    return d->evaluate(&d->data) == HY_OK ? v[slots->slope] : NAN;
}

/* State after one Runge-Kutta step along a curve. */
static double stepped(hy_duhem *d, const hy_duhem_state *slots, double sense, const node *from, double step)
{
    const double k1 = from->slope, k2 = slope_at(d, slots, sense, from->z + 0.5 * step * k1);
    const double k3 = slope_at(d, slots, sense, from->z + 0.5 * step * k2);
    const double k4 = slope_at(d, slots, sense, from->z + step * k3);
    return from->z + step / 6 * (k1 + 2 * (k2 + k3) + k4);
}

/* The cubic from a node to the next one, with the slopes of both. */
static void join(node *from, const node *to)
{
    const double h = to->s - from->s, mean = (to->z - from->z) / h;
    from->c2 = (3 * mean - 2 * from->slope - to->slope) / h;
    from->c3 = (from->slope + to->slope - 2 * mean) / (h * h);
}

static double after(const node *from, double s)
{
    const double u = s - from->s;
    return from->z + u * (from->slope + u * (from->c2 + u * from->c3));
}

/* Joins a node to the next one. Returns the error of the step over that allowed; middle: the state in its middle. */
static double misfit(node *from, const node *to, double middle)
{
    const double size = fmax(fabs(to->z), fabs(from->z)), change = to->slope / from->slope;
    const double allowed = fmin(EXACT * size, fmax(OF_STEP * fabs(to->z - from->z), ROUNDING * size));
    double error;
    join(from, to);
    error = fabs(after(from, 0.5 * (from->s + to->s)) - middle) / allowed;
    return (change == 0 || (change > 1 / TENFOLD && change < TENFOLD)) && isfinite(error) ? error : INFINITY;
}

/* The next node of a side; 0 where there is none. A jump of the law is passed in the shortest step. */
static int advance(hy_duhem *d, const hy_duhem_state *slots, double sense, side *one)
{
    node *const from = one->nodes + one->n - 1;
    const double shortest = SHORTEST * fmax(fabs(from->s), FIRST_STEP);
    for (;;) {
        const double z = stepped(d, slots, sense, from, one->step), middle = stepped(d, slots, sense, from, 0.5 * one->step);
        const node to = {.s = from->s + one->step, .z = z, .slope = slope_at(d, slots, sense, z)};
        const double error = misfit(from, &to, middle), factor = 0.9 / sqrt(sqrt(error));
        if (error <= 1 || (fabs(one->step) <= shortest && isfinite(z + to.slope))) {
            one->nodes[one->n] = to;
            one->step *= fmin(fmax(factor, 0.5), 2.5);
            return to.s != from->s;
        }
        if (fabs(one->step) <= shortest) return 0;
        one->step *= fmin(fmax(factor, 0.1), 0.7);
    }
}

static void grow(hy_duhem *d, const hy_duhem_state *slots, double sense, side *one)
{
    if (one->n == one->room) {
        node *const more = one->n < MOST_NODES ? realloc(one->nodes, 2 * sizeof *more * (size_t)one->room) : NULL;
        if (!more) {
            one->end = BREAKS;
            return;
        }
        one->nodes = more;
        one->room *= 2;
    }
    if (fabs(one->nodes[one->n - 1].slope) <= AT_REST * fabs(one->nodes->slope))
        one->end = RESTS;
    else if (advance(d, slots, sense, one))
        one->n++;
    else
        one->end = BREAKS;
}

static int open_side(side *one, node origin, double step)
{
    one->step = step;
    one->room = FIRST_NODES;
    one->n = 1;
    one->nodes = malloc(sizeof *one->nodes * FIRST_NODES);
    if (!one->nodes) return 0;
    one->nodes[0] = origin;
    one->end = isfinite(origin.slope) && origin.slope != 0 ? GOES_ON : BREAKS;
    return 1;
}

static int is_followed(const hy_engine *e, const hy_duhem_state *one)
{
    return !hy_driven_at(e, one->state) && hy_driven_at(e, one->speed);
}

static int follows(const hy_engine *e)
{
    const hy_model *m = e->model;
    int n = 0;
    for (int i = 0; i < m->n_duhem; i++) n += is_followed(e, m->duhem + i);
    return n && n == m->n_x - e->n_clamped && !e->n_seeds && !hy_has_events(e);
}

static void close_all(hy_duhem *d)
{
    if (!d) return;
    for (int i = 0; d->followers && i < d->n; i++)
        for (int k = 0; k < 2; k++) {
            free(d->followers[i].curves[k].later.nodes);
            free(d->followers[i].curves[k].earlier.nodes);
        }
    free(d->followers);
    free(d->data.v);
    free(d);
}

/* Whether the curves of an earlier run are those of this one: its parameters are, and its states. */
static int serves(const hy_duhem *d, const hy_engine *e)
{
    const hy_model *const m = e->model;
    int n = 0;
    for (int i = 0; i < m->n_duhem; i++)
        if (is_followed(e, m->duhem + i) && (n == d->n || d->followers[n++].slots != m->duhem + i)) return 0;
    return n == d->n && !memcmp(d->data.v + m->p, e->data.v + m->p, sizeof(double) * (size_t)m->n_p);
}

static hy_duhem *opened(const hy_engine *e)
{
    const hy_model *const m = e->model;
    const size_t block = sizeof(double) * (size_t)m->n_values;
    hy_duhem *const d = calloc(1, sizeof *d);
    int complete;
    if (!d) return NULL;
    d->evaluate = m->evaluate;
    d->data.log = say_nothing;
    d->data.v = malloc(block);
    d->followers = calloc((size_t)m->n_duhem, sizeof *d->followers);
    complete = d->data.v && d->followers;
    if (complete) memcpy(d->data.v, e->data.v, block);
    for (int i = 0; complete && i < m->n_duhem; i++) {
        follower *const f = d->followers + d->n;
        if (!is_followed(e, m->duhem + i)) continue;
        d->n++;
        f->slots = m->duhem + i;
        for (int k = 0; complete && k < 2; k++) {
            curve *const c = f->curves + k;
            c->sense = k ? 1 : -1;
            complete = open_side(&c->later, (node){.slope = slope_at(d, f->slots, c->sense, 0)}, FIRST_STEP);
            complete = complete && open_side(&c->earlier, c->later.nodes[0], -FIRST_STEP);
        }
    }
    if (complete) return d;
    close_all(d);
    return NULL;
}

/* After the start; NULL where there is no memory. Asks for the paths of the speeds. */
static hy_duhem *open_all(hy_engine *e)
{
    hy_duhem *d = e->duhem;
    if (!d || !serves(d, e)) {
        close_all(d);
        d = opened(e);
    }
    for (int i = 0; d && i < d->n; i++) {
        d->followers[i].on = NULL;
        hy_follow(e, d->followers[i].slots->speed);
    }
    return d;
}

/* Whether a state lies further out than a node of a side that leads to larger states, or to smaller ones. */
static int is_beyond(double z, const node *edge, int rises) { return rises ? z > edge->z : z < edge->z; }

/* Travel at which a curve meets a state between two nodes. */
static double way_to(const node *from, const node *to, double z)
{
    const double c[4] = {from->z - z, from->slope, from->c2, from->c3}, h = to->s - from->s;
    return from->s + hy_zero(c, fmin(0, h), fmax(0, h));
}

/* Finds a state on a curve. 0 where the curve does not come there: a fixed point of the law lies in between. */
static int locate(hy_duhem *d, follower *f, curve *c, double z)
{
    const int rises = c->later.nodes->slope > 0, on_later = z == 0 || (z > 0) == rises;
    side *const one = on_later ? &c->later : &c->earlier;
    int low = 0, high;
    while (one->end == GOES_ON && (one->n == 1 || is_beyond(z, one->nodes + one->n - 1, on_later == rises)))
        grow(d, f->slots, c->sense, one);
    high = one->n - 1;
    if (!high || is_beyond(z, one->nodes + high, on_later == rises)) return 0;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (is_beyond(z, one->nodes + middle, on_later == rises))
            low = middle;
        else
            high = middle;
    }
    f->on = c;
    f->at = on_later ? low : -high;
    f->s = way_to(one->nodes + low, one->nodes + high, z);
    return 1;
}

/* Goes on along the curve; at: number of the node before, negative on the earlier side. */
static double along(hy_duhem *d, follower *f, double travel)
{
    side *const later = &f->on->later, *const earlier = &f->on->earlier;
    f->s += travel;
    while (f->at < 0 && earlier->nodes[-f->at - 1].s < f->s) f->at++;
    if (f->at < 0) return after(earlier->nodes - f->at - 1, f->s);
    for (;; f->at++) {
        while (f->at == later->n - 1 && later->end == GOES_ON) grow(d, f->slots, f->on->sense, later);
        if (f->at == later->n - 1) return later->end == RESTS ? later->nodes[f->at].z : NAN;
        if (later->nodes[f->at + 1].s >= f->s) return after(later->nodes + f->at, f->s);
    }
}

/* The same from where no curve through z = 0 comes. */
static double apart(hy_duhem *d, const follower *f, double sense, double z, double travel)
{
    side one;
    double reached = z;
    if (!open_side(&one, (node){.z = z, .slope = slope_at(d, f->slots, sense, z)}, travel)) return NAN;
    if (one.nodes->slope != 0) {
        while (one.end == GOES_ON && one.nodes[one.n - 1].s < travel) grow(d, f->slots, sense, &one);
        reached = one.nodes[one.n - 1].z;
        if (one.nodes[one.n - 1].s >= travel) reached = after(one.nodes + one.n - 2, travel);
        else if (one.end != RESTS) reached = NAN;
    }
    free(one.nodes);
    return reached;
}

static double followed(hy_duhem *d, follower *f, double z, double travel)
{
    curve *const c = &f->curves[travel > 0];
    const double length = fabs(travel);
    if (!(length > 0)) return z + travel; /* no motion, or not a number */
    if (f->on != c && !locate(d, f, c, z)) {
        f->on = NULL;
        return apart(d, f, c->sense, z, length);
    }
    return along(d, f, length);
}

/* Along a path, by n rows; returns the number of those that have an answer. */
static int run_along(hy_duhem *d, follower *f, const hy_path *path, double *z, int n, double *restrict row)
{
    const double *travel = path->travels;
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < path->n[i]; k++) *z = followed(d, f, *z, *travel++);
        if (!isfinite(*z)) return i;
        if (row) row[i] = *z;
    }
    return n;
}

static int move(hy_engine *e, int n, double *const *rows)
{
    hy_duhem *const d = e->duhem;
    for (int i = 0; i < d->n; i++) {
        follower *const f = d->followers + i;
        const int state = f->slots->state;
        double z = e->data.v[state];
        n = run_along(d, f, hy_driven_at(e, f->slots->speed)->path, &z, n, rows ? rows[state - e->model->x] : NULL);
        e->data.v[state] = z;
    }
    e->status->stale = 1;
    return n;
}

const struct hy_duhem_methods hy_duhem_methods = {follows, open_all, move, close_all};
