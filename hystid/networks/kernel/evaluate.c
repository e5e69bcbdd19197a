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
    int members, groups;
    network hysteresis, restoring;
    double band;
    vec *scratch; /* 2 * widest layer */
    int widest;
} model;

static vec evaluate(const network *net, int group, vec u0, vec u1, vec u2, vec *scratch, int widest) {
    const vec *w = (const vec *)net->w + group * net->stride;
    vec *in = scratch, *out = scratch + widest;
    in[0] = u0, in[1] = u1, in[2] = u2;
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

/* R for the memory as it stands; rh (groups vectors) receives the members' hysteretic forces. */
static double force(const model *m, double x, double v, double x0, const vec *rh0, vec *rh) {
    double sum = 0;
    for (int g = 0; g < m->groups; g++) {
        rh[g] = evaluate(&m->hysteresis, g, splat(x), splat(x0), rh0[g], m->scratch, m->widest);
        sum += lane_sum(evaluate(&m->restoring, g, splat(x), splat(v), rh[g], m->scratch, m->widest));
    }
    return sum / m->members;
}

/* Renews the memory at an accepted sample and returns R there. memory = [v_last, x0]. */
static double accept(const model *m, double x, double v, double *memory, vec *rh, vec *rh0) {
    int fast = fabs(v) >= m->band;
    if (memory[0] == 0 || (fast && memory[0] * v <= 0)) {
        memory[1] = x;
        memcpy(rh0, rh, sizeof(vec) * m->groups);
    }
    if (fast) memory[0] = v;
    return force(m, x, v, memory[1], rh0, rh);
}

static int open_model(model *m, int members, const int *sizes, int nh, int nr, const double *wh, const double *wr,
                      double band) {
    int groups = (members + LANES - 1) / LANES;
    *m = (model){.members = members, .groups = groups, .band = band, .widest = 3};
    m->hysteresis = (network){.layers = nh, .sizes = sizes, .w = wh};
    m->restoring = (network){.layers = nr, .sizes = sizes + nh + 1, .w = wr};
    network *nets[2] = {&m->hysteresis, &m->restoring};
    for (int k = 0; k < 2; k++)
        for (int l = 0; l < nets[k]->layers; l++) {
            int ni = nets[k]->sizes[l], no = nets[k]->sizes[l + 1];
            nets[k]->stride += (ni + 1L) * no;
            if (no > m->widest) m->widest = no;
        }
    m->scratch = aligned_alloc(sizeof(vec), sizeof(vec) * (2L * m->widest + 8L * groups));
    return m->scratch != NULL;
}

/* state = [v_last, x0, Rh[members], Rh0[members]] */
static void load(const model *m, const double *state, double *memory, vec *rh, vec *rh0) {
    memset(rh, 0, sizeof(vec) * m->groups);
    memset(rh0, 0, sizeof(vec) * m->groups);
    memcpy(memory, state, 2 * sizeof(double));
    memcpy(rh, state + 2, m->members * sizeof(double));
    memcpy(rh0, state + 2 + m->members, m->members * sizeof(double));
}

static void store(const model *m, double *state, const double *memory, const vec *rh, const vec *rh0) {
    memcpy(state, memory, 2 * sizeof(double));
    memcpy(state + 2, rh, m->members * sizeof(double));
    memcpy(state + 2 + m->members, rh0, m->members * sizeof(double));
}

/* Both entry points: sizes = those of the hysteresis network (nh + 1 numbers), then those of the restoring network
 * (nr + 1); weights 64-byte aligned. They return the number of rows done, or -1 when there is no memory.
 *
 * Open loop: R[k] and, where rh is not NULL, each member's Rh, rh[k * members + j]. */
API long hystid_response(int members, const int *sizes, int nh, int nr, const double *wh, const double *wr, double band,
                         long n, const double *x, const double *v, double *state, double *R, double *rh_out) {
    model m;
    if (!open_model(&m, members, sizes, nh, nr, wh, wr, band)) return -1;
    vec *rh = m.scratch + 2 * m.widest, *rh0 = rh + m.groups;
    double memory[2];
    load(&m, state, memory, rh, rh0);
    for (long k = 0; k < n; k++) {
        R[k] = accept(&m, x[k], v[k], memory, rh, rh0);
        if (rh_out) memcpy(rh_out + k * members, rh, members * sizeof(double));
    }
    store(&m, state, memory, rh, rh0);
    free(m.scratch);
    return n;
}

/* Far beyond any motion in SI units, and its square still finite. NaN is not below it either. */
#define HUGE_MOTION 1e100

/* Closed loop, m a = F - R: rows x, v, a, R; x[0] and v[0] are the start. Stops at the first row that has diverged. */
API long hystid_free_run(int members, const int *sizes, int nh, int nr, const double *wh, const double *wr, double band,
                         double mass, double dt, long n, const double *F, double *state, double *x, double *v, double *a,
                         double *R) {
    model m;
    if (!open_model(&m, members, sizes, nh, nr, wh, wr, band)) return -1;
    vec *rh = m.scratch + 2 * m.widest, *rh0 = rh + m.groups, *trial = rh0 + m.groups;
    double memory[2];
    long k = 0;
    load(&m, state, memory, rh, rh0);
    for (; k < n; k++) {
        R[k] = accept(&m, x[k], v[k], memory, rh, rh0);
        a[k] = (F[k] - R[k]) / mass;
        if (!(fabs(x[k]) < HUGE_MOTION && fabs(v[k]) < HUGE_MOTION && fabs(a[k]) < HUGE_MOTION)) break;
        if (k == n - 1) continue;
        double middle = 0.5 * (F[k] + F[k + 1]), x0 = memory[1];
        double v1 = v[k], a1 = a[k];
        double v2 = v1 + 0.5 * dt * a1, a2 = (middle - force(&m, x[k] + 0.5 * dt * v1, v2, x0, rh0, trial)) / mass;
        double v3 = v1 + 0.5 * dt * a2, a3 = (middle - force(&m, x[k] + 0.5 * dt * v2, v3, x0, rh0, trial)) / mass;
        double v4 = v1 + dt * a3, a4 = (F[k + 1] - force(&m, x[k] + dt * v3, v4, x0, rh0, trial)) / mass;
        x[k + 1] = x[k] + dt / 6 * (v1 + 2 * (v2 + v3) + v4);
        v[k + 1] = v1 + dt / 6 * (a1 + 2 * (a2 + a3) + a4);
    }
    store(&m, state, memory, rh, rh0);
    free(m.scratch);
    return k;
}
