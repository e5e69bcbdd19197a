/* The two-network model, sample by sample: open loop (motion given) and closed loop (force given).
 *
 * Members lie in the lanes of vectors: every step evaluates LANES members at once, so that a small ensemble costs as
 * much as one network, and open and closed loop run through the same code. Lanes beyond the last member have zero
 * weights and answer 0. What a step computes stands in TwoNetworkModel's docstring. */
#include <math.h>
#include <stdlib.h>
#include "vector.h"

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

/* One structure for all members: inputs and neurons per layer, and weights interleaved by member,
 * w[group][parameter][lane], in physical units, [W1 row by row, b1, W2, ...] per group. */
typedef struct {
    int layers;
    const int *sizes;
    const double *w;
    long stride; /* parameters per group */
} network;

typedef struct {
    int members, groups, inputs, lags; /* inputs: those besides the motion */
    const int *source;                 /* of each lag: an input, or -1 for v */
    const double *share;               /* of the difference to its source that a lag makes up in one sample */
    const double *level;               /* Level.numbers(), or NULL */
    const double *ends;                /* Ends.numbers(), or NULL */
    const double *curves;              /* of each input: number of points n (0: none), n times at, n times to; or NULL */
    double *near;                      /* x, v and the inputs that the networks see */
    network hysteresis, restoring;
    double band;
    vec *scratch; /* 2 * widest layer */
    int widest;
} model;

static vec evaluate(const network *net, int group, vec u0, vec u1, vec u2, const double *more, const double *late,
                    const model *m) {
    const vec *w = (const vec *)net->w + group * net->stride;
    vec *in = m->scratch, *out = m->scratch + m->widest;
    in[0] = u0, in[1] = u1, in[2] = u2;
    for (int i = 0; i < m->inputs; i++) in[3 + i] = splat(more[i]);
    for (int i = 0; i < m->lags; i++) in[3 + m->inputs + i] = splat(late[i]);
    for (int layer = 0; layer < net->layers; layer++) {
        int ni = net->sizes[layer], no = net->sizes[layer + 1];
        const vec *bias = w + (long)ni * no;
        for (int j = 0; j < no; j++) {
            vec sum = bias[j];
            for (int i = 0; i < ni; i++) sum += w[j * ni + i] * in[i];
            out[j] = layer < net->layers - 1 ? vtanh(sum) : sum;
        }
        w = bias + no;
        vec *swap = in;
        in = out, out = swap;
    }
    return in[0];
}

static double lane_sum(vec value) {
    double sum = 0;
    for (int k = 0; k < LANES; k++) sum += value[k];
    return sum;
}

/* What is held between samples: v_last, x0, each member's Rh0, and the lags. */
typedef struct {
    double last, x0;
    vec *rh0;
    double *late;
} state_of;

/* centre and spread of the force: see Level */
static void level_of(const model *m, double x, const double *more, const double *late, double *centre, double *spread) {
    int count = m->inputs + m->lags;
    const double *p = m->level, *growth = p + 3 + count;
    *centre = p[0] + p[1] * x, *spread = p[2 + count];
    for (int i = 0; i < count; i++) {
        double w = i < m->inputs ? more[i] : late[i - m->inputs];
        *centre += p[2 + i] * w, *spread += growth[i] * w;
    }
    if (!(*spread > growth[count])) *spread = growth[count];
}

static double clip(double value, const double *limits) {
    return value < limits[0] ? limits[0] : value > limits[1] ? limits[1] : value;
}

/* Straight lines between n points; beyond them the value of the nearest. */
static double along(const double *at, const double *to, int n, double value) {
    if (value <= at[0]) return to[0];
    for (int k = 1; k < n; k++)
        if (value <= at[k]) return to[k - 1] + (to[k] - to[k - 1]) / (at[k] - at[k - 1]) * (value - at[k - 1]);
    return to[n - 1];
}

/* What the networks see of the inputs. */
static void bend(const model *m) {
    const double *p = m->curves;
    for (int i = 0; p && i < m->inputs; i++) {
        int n = (int)*p++;
        if (n) m->near[2 + i] = along(p, p + n, n, m->near[2 + i]);
        p += 2 * n;
    }
}

/* x, v and inputs into m->near, moved to the nearest of the training range, the inputs along their curves; returns the
 * force of the tail. */
static double nearest(const model *m, double x, double v, const double *more) {
    double *near = m->near;
    near[0] = x, near[1] = v;
    for (int i = 0; i < m->inputs; i++) near[2 + i] = more[i];
    for (int i = 0; m->ends && i < 2 + m->inputs; i++) near[i] = clip(near[i], m->ends + 2 + 2 * i);
    bend(m);
    if (!m->ends) return 0;
    return m->ends[0] * (x - near[0]) + m->ends[1] * (v - near[1]);
}

/* R for the memory as it stands, with the further inputs `more`; rh (groups vectors) receives the members' hysteretic
 * forces and each, where it is not NULL, their restoring forces. */
static double force(const model *m, double x, double v, const double *more, const state_of *s, vec *rh, double *each) {
    double sum = 0, centre = 0, spread = 1, beyond = nearest(m, x, v, more);
    x = m->near[0], v = m->near[1], more = m->near + 2;
    if (m->level) level_of(m, x, more, s->late, &centre, &spread);
    for (int g = 0; g < m->groups; g++) {
        rh[g] = evaluate(&m->hysteresis, g, splat(x), splat(s->x0), s->rh0[g], more, s->late, m);
        vec R = evaluate(&m->restoring, g, splat(x), splat(v), rh[g], more, s->late, m);
        sum += lane_sum(R);
        for (int k = 0; each && k < LANES && g * LANES + k < m->members; k++) each[g * LANES + k] = centre + spread * R[k] + beyond;
    }
    return (m->level ? centre + spread * (sum / m->members) : sum / m->members) + beyond;
}

/* Renews the memory at an accepted sample and returns R there. */
static double accept(const model *m, double x, double v, const double *more, state_of *s, vec *rh, double *each) {
    int fast = fabs(v) >= m->band;
    nearest(m, x, v, more);
    if (s->last == 0 || (fast && s->last * v <= 0)) {
        s->x0 = m->near[0];
        memcpy(s->rh0, rh, sizeof(vec) * m->groups);
    }
    if (fast) s->last = v;
    double R = force(m, x, v, more, s, rh, each);
    for (int i = 0; i < m->lags; i++)
        s->late[i] += m->share[i] * (m->near[m->source[i] < 0 ? 1 : 2 + m->source[i]] - s->late[i]);
    return R;
}

static int open_model(model *m, int members, const int *sizes, int nh, int nr, const double *wh, const double *wr,
                      double band, int lags, const int *source, const double *share, const double *level, const double *ends,
                      const double *curves) {
    int groups = (members + LANES - 1) / LANES;
    *m = (model){.members = members, .groups = groups, .band = band, .widest = sizes[0]};
    m->lags = lags, m->inputs = sizes[0] - 3 - lags, m->source = source, m->share = share, m->level = level, m->ends = ends;
    m->curves = curves;
    m->hysteresis = (network){.layers = nh, .sizes = sizes, .w = wh};
    m->restoring = (network){.layers = nr, .sizes = sizes + nh + 1, .w = wr};
    network *nets[2] = {&m->hysteresis, &m->restoring};
    for (int k = 0; k < 2; k++)
        for (int l = 0; l < nets[k]->layers; l++) {
            int ni = nets[k]->sizes[l], no = nets[k]->sizes[l + 1];
            nets[k]->stride += (ni + 1L) * no;
            if (no > m->widest) m->widest = no;
        }
    m->scratch = aligned_alloc(sizeof(vec), sizeof(vec) * (2L * m->widest + 8L * groups + 2 * sizes[0]));
    m->near = (double *)(m->scratch + 2 * m->widest + 8 * groups + sizes[0]);
    return m->scratch != NULL;
}

/* state = [v_last, x0, Rh[members], Rh0[members], lags] */
static void load(const model *m, const double *state, state_of *s, vec *rh) {
    memset(rh, 0, sizeof(vec) * m->groups);
    memset(s->rh0, 0, sizeof(vec) * m->groups);
    s->last = state[0], s->x0 = state[1];
    memcpy(rh, state + 2, m->members * sizeof(double));
    memcpy(s->rh0, state + 2 + m->members, m->members * sizeof(double));
    memcpy(s->late, state + 2 + 2 * m->members, m->lags * sizeof(double));
}

static void store(const model *m, double *state, const state_of *s, const vec *rh) {
    state[0] = s->last, state[1] = s->x0;
    memcpy(state + 2, rh, m->members * sizeof(double));
    memcpy(state + 2 + m->members, s->rh0, m->members * sizeof(double));
    memcpy(state + 2 + 2 * m->members, s->late, m->lags * sizeof(double));
}

/* Both entry points: sizes = those of the hysteresis network (nh + 1 numbers), then those of the restoring network
 * (nr + 1); weights 64-byte aligned. They return the number of rows done, or -1 when there is no memory.
 *
 * more: further inputs, more[k * inputs + i]; source, share, level, ends, curves: see model.
 * Open loop: R[k] and each member's own, each[k * members + j]. */
API long hystid_response(int members, const int *sizes, int nh, int nr, const double *wh, const double *wr, double band,
                         int lags, const int *source, const double *share, const double *level,
                         const double *ends, const double *curves, long n, const double *x, const double *v, const double *more, double *state, double *R,
                         double *each) {
    model m;
    if (!open_model(&m, members, sizes, nh, nr, wh, wr, band, lags, source, share, level, ends, curves)) return -1;
    vec *rh = m.scratch + 2 * m.widest;
    state_of s = {.rh0 = rh + m.groups, .late = (double *)(rh + 2 * m.groups)};
    load(&m, state, &s, rh);
    for (long k = 0; k < n; k++)
        R[k] = accept(&m, x[k], v[k], more + k * m.inputs, &s, rh, each + k * members);
    store(&m, state, &s, rh);
    free(m.scratch);
    return n;
}

/* Far beyond any motion in SI units, and its square still finite. NaN is not below it either. */
#define HUGE_MOTION 1e100

/* Closed loop, m a = F - R: rows x, v, a, R; x[0] and v[0] are the start. Stops at the first row that has diverged. */
API long hystid_free_run(int members, const int *sizes, int nh, int nr, const double *wh, const double *wr, double band,
                         int lags, const int *source, const double *share, const double *level,
                         const double *ends, const double *curves, double mass, double dt, long n, const double *F, const double *more, double *state, double *x,
                         double *v, double *a, double *R) {
    model m;
    if (!open_model(&m, members, sizes, nh, nr, wh, wr, band, lags, source, share, level, ends, curves)) return -1;
    vec *rh = m.scratch + 2 * m.widest, *trial = rh + 2 * m.groups;
    state_of s = {.rh0 = rh + m.groups, .late = (double *)(trial + m.groups)};
    double *mean = s.late + lags;
    long k = 0;
    load(&m, state, &s, rh);
    for (; k < n; k++) {
        const double *now = more + k * m.inputs, *next = now + m.inputs;
        R[k] = accept(&m, x[k], v[k], now, &s, rh, NULL);
        a[k] = (F[k] - R[k]) / mass;
        if (!(fabs(x[k]) < HUGE_MOTION && fabs(v[k]) < HUGE_MOTION && fabs(a[k]) < HUGE_MOTION)) break;
        if (k == n - 1) continue;
        double middle = 0.5 * (F[k] + F[k + 1]);
        for (int i = 0; i < m.inputs; i++) mean[i] = 0.5 * (now[i] + next[i]);
        double h = 0.5 * dt, v1 = v[k], a1 = a[k];
        double v2 = v1 + h * a1, a2 = (middle - force(&m, x[k] + h * v1, v2, mean, &s, trial, NULL)) / mass;
        double v3 = v1 + h * a2, a3 = (middle - force(&m, x[k] + h * v2, v3, mean, &s, trial, NULL)) / mass;
        double v4 = v1 + dt * a3, a4 = (F[k + 1] - force(&m, x[k] + dt * v3, v4, next, &s, trial, NULL)) / mass;
        x[k + 1] = x[k] + dt / 6 * (v1 + 2 * (v2 + v3) + v4);
        v[k + 1] = v1 + dt / 6 * (a1 + 2 * (a2 + a3) + a4);
    }
    store(&m, state, &s, rh);
    free(m.scratch);
    return k;
}
