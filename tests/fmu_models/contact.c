/* Mass on a spring with a stiff one-sided stop at x >= gap: the relation is frozen and located, with hysteresis form of z. */
#include "hy_model.h"
enum { T, M, K, KS, GAP, F, X, V, DX, DV, R, TOUCHES, N };
static const double start[N] = {[M] = 1, [K] = 100, [KS] = 10000, [GAP] = 0.5, [V] = 10};
static int evaluate(hy_data *m)
{
    double *v = m->v;
    v[R] = v[K] * v[X] + (v[TOUCHES] ? v[KS] * (v[X] - v[GAP]) : 0);
    v[DX] = v[V];
    v[DV] = (v[F] - v[R]) / v[M];
    return HY_OK;
}
static int indicators(hy_data *m, double *z)
{
    const double depth = m->v[X] - m->v[GAP];
    z[0] = (m->v[TOUCHES] ? depth : -depth) + 1e-14;
    return HY_OK;
}
static int update(hy_data *m, int *again)
{
    const double touches = m->v[X] >= m->v[GAP];
    *again = touches != m->v[TOUCHES];
    m->v[TOUCHES] = touches;
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Contact", .token = "contact", .n_values = N, .p = M, .n_p = 4, .u = F, .n_u = 1, .x = X, .n_x = 2, .dx = DX,
    .d = N, .y = R, .n_y = 1, .pre = N, .rel = TOUCHES, .n_rel = 1, .w = N, .n_z = 1, .step = 1e-3, .start = start,
    .evaluate = evaluate, .indicators = indicators, .update = update};
