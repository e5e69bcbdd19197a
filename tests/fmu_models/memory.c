/* A force block with sampled memory, as surrogates have: R = k x + c * (x at the last reversal of v). */
#include "hy_model.h"
enum { T, K, C, X, V, LAST_V, X0, R, PRE_V, PRE_X0, N };
static const double start[N] = {[K] = 100, [C] = 7};
static double turning_point(const double *v) { return v[LAST_V] * v[V] <= 0 ? v[X] : v[X0]; }
static int evaluate(hy_data *m)
{
    m->v[R] = m->v[K] * m->v[X] + m->v[C] * turning_point(m->v);
    return HY_OK;
}
static int completed_step(hy_data *m)
{
    m->v[X0] = turning_point(m->v);
    m->v[LAST_V] = m->v[V];
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Memory", .token = "memory", .n_values = N, .p = K, .n_p = 2, .u = X, .n_u = 2, .x = N, .dx = N, .d = LAST_V,
    .n_d = 2, .y = R, .n_y = 1, .pre = PRE_V, .rel = N, .w = N, .step = 1e-4, .sample = 1e-4,
    .start = start, .evaluate = evaluate,
    .completed_step = completed_step};
