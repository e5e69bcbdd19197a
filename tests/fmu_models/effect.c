/* A memoryless block: f = k3 x^3 + b2 v |v|; the input h is there and unused, as in many effects. */
#include <math.h>
#include "hy_model.h"
enum { T, K3, B2, X, V, A, H, FORCE, N };
static const double start[N] = {[K3] = 1e6, [B2] = 3};
static int evaluate(hy_data *m)
{
    double *v = m->v;
    if (v[K3] < 0) return HY_RETRY; /* stands for a nonlinear equation without solution */
    v[FORCE] = v[A] == 77 ? NAN : /* stands for a division by zero */ v[K3] * v[X] * v[X] * v[X] + v[B2] * v[V] * fabs(v[V]);
    return HY_OK;
}
static int forward(hy_data *m, const double *s, double *r)
{
    const double *v = m->v;
    r[FORCE] = s[K3] * v[X] * v[X] * v[X] + 3 * v[K3] * v[X] * v[X] * s[X] + s[B2] * v[V] * fabs(v[V])
               + 2 * v[B2] * fabs(v[V]) * s[V];
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Effect", .token = "effect", .n_values = N, .p = K3, .n_p = 2, .u = X, .n_u = 4, .x = N, .dx = N, .d = N,
    .y = FORCE, .n_y = 1, .pre = N, .rel = N, .w = N, .step = 1e-4, .start = start, .evaluate = evaluate, .forward = forward};
