/* m a + R = F; R = B v + Kl x + f; Jenkins element with turning-point-free memory: f' = Ks v inside +-fc, else 0. */
#include <math.h>
#include "hy_model.h"
enum { T, M, B, KL, KS, FC, F, X, V, Z, DX, DV, DZ, A, R, N };
static const double start[N] = {0, 1.0, 5.0, 4e4, 2e4, 20.0, 0};
static int evaluate(hy_data *m)
{
    double *v = m->v;
    const double z = v[Z], f = z > v[FC] ? v[FC] : z < -v[FC] ? -v[FC] : z;
    v[R] = v[B] * v[V] + v[KL] * v[X] + f;
    v[A] = (v[F] - v[R]) / v[M];
    v[DX] = v[V];
    v[DV] = v[A];
    v[DZ] = (z >= v[FC] && v[V] > 0) || (z <= -v[FC] && v[V] < 0) ? 0 : v[KS] * v[V];
    return HY_OK;
}
static int forward(hy_data *m, const double *s, double *r)
{
    const double *v = m->v;
    const int slips = (v[Z] >= v[FC] && v[V] > 0) || (v[Z] <= -v[FC] && v[V] < 0);
    const double df = v[Z] > v[FC] ? s[FC] : v[Z] < -v[FC] ? -s[FC] : s[Z];
    r[R] = s[B] * v[V] + v[B] * s[V] + s[KL] * v[X] + v[KL] * s[X] + df;
    r[A] = (s[F] - r[R]) / v[M] - v[A] * s[M] / v[M];
    r[DX] = s[V];
    r[DV] = r[A];
    r[DZ] = slips ? 0 : s[KS] * v[V] + v[KS] * s[V];
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Jenkins", .token = "jenkins", .n_values = N, .p = M, .n_p = 5, .u = F, .n_u = 1, .x = X, .n_x = 3, .dx = DX,
    .d = N, .y = A, .n_y = 2, .pre = N, .rel = N, .w = N, .step = 1e-4, .start = start,
    .evaluate = evaluate, .forward = forward};
