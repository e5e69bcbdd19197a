/* m a + b v + k x = F, with exact forward and adjoint derivatives. */
#include "hy_model.h"
enum { T, M, B, K, F, X, V, DX, DV, R, N };
static const double start[N] = {[M] = 2, [B] = 4, [K] = 800};
static int evaluate(hy_data *m)
{
    double *v = m->v;
    v[R] = v[B] * v[V] + v[K] * v[X];
    v[DX] = v[V];
    v[DV] = (v[F] - v[R]) / v[M];
    return HY_OK;
}
static int forward(hy_data *m, const double *s, double *r)
{
    const double *v = m->v;
    r[R] = s[B] * v[V] + v[B] * s[V] + s[K] * v[X] + v[K] * s[X];
    r[DX] = s[V];
    r[DV] = (s[F] - r[R]) / v[M] - (v[F] - v[R]) / (v[M] * v[M]) * s[M];
    return HY_OK;
}
static int adjoint(hy_data *m, const double *s, double *r)
{
    const double *v = m->v;
    const double r_seed = s[R] - s[DV] / v[M];
    r[F] += s[DV] / v[M];
    r[M] += -(v[F] - v[R]) / (v[M] * v[M]) * s[DV];
    r[B] += v[V] * r_seed;
    r[K] += v[X] * r_seed;
    r[X] += v[K] * r_seed;
    r[V] += v[B] * r_seed + s[DX];
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Linear", .token = "linear", .n_values = N, .p = M, .n_p = 3, .u = F, .n_u = 1, .x = X, .n_x = 2, .dx = DX,
    .d = N, .y = R, .n_y = 1, .pre = N, .rel = N, .w = N, .step = 1e-3, .start = start,
    .evaluate = evaluate, .forward = forward, .adjoint = adjoint};
