/* Bouncing mass: x'' = -g; when x < 0 and v < 0: v := -e v. */
#include "hy_model.h"
enum { T, G, E, X, V, DX, DV, COUNT, PRE, BELOW, N };
static const double start[N] = {[G] = 9.81, [E] = 0.7, [X] = 1};
static int evaluate(hy_data *m)
{
    m->v[DX] = m->v[V];
    m->v[DV] = -m->v[G];
    return HY_OK;
}
static int indicators(hy_data *m, double *z)
{
    z[0] = m->v[X];
    return HY_OK;
}
static int update(hy_data *m, int *again)
{
    double *v = m->v;
    const double below = v[X] < 0;
    if (below && !v[BELOW] && v[V] < 0) {
        v[V] = -v[E] * v[V];
        v[COUNT] = v[PRE] + 1;
        *again = 1;
    }
    if (below != v[BELOW]) *again = 1;
    v[BELOW] = below;
    return HY_OK;
}
const hy_model hy_the_model = {
    .name = "Bouncing", .token = "bouncing", .n_values = N, .p = G, .n_p = 2, .u = N, .x = X, .n_x = 2, .dx = DX,
    .d = COUNT, .n_d = 1, .y = N, .pre = PRE, .rel = BELOW, .n_rel = 1, .w = N, .n_z = 1, .step = 1e-3, .start = start,
    .evaluate = evaluate, .indicators = indicators, .update = update};
