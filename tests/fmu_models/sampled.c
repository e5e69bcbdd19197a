/* when sample(0, Ts) then n = pre(n) + 1; u_s = u; end when; y' = (u_s - y) / tau. */
#include <math.h>
#include "hy_model.h"
enum { T, TS, TAU, U, Y, DY, COUNT, US, PRE_COUNT, PRE_US, NEXT, N };
static const double start[N] = {[TS] = 0.1, [TAU] = 0.05};
static int evaluate(hy_data *m)
{
    m->v[DY] = (m->v[US] - m->v[Y]) / m->v[TAU];
    return HY_OK;
}
static int initialise(hy_data *m)
{
    m->v[NEXT] = 0;
    return HY_OK;
}
static int update(hy_data *m, int *again)
{
    double *v = m->v;
    if (v[T] < v[NEXT] * v[TS]) return HY_OK;
    v[COUNT] = v[PRE_COUNT] + 1;
    v[US] = v[U];
    v[NEXT] += 1;
    *again = 1;
    return HY_OK;
}
static double next_time_event(const hy_data *m) { return m->v[NEXT] * m->v[TS]; }
const hy_model hy_the_model = {
    .name = "Sampled", .token = "sampled", .n_values = N, .p = TS, .n_p = 2, .u = U, .n_u = 1, .x = Y, .n_x = 1, .dx = DY,
    .d = COUNT, .n_d = 2, .y = N, .pre = PRE_COUNT, .rel = N, .w = NEXT, .n_w = 1, .step = 1e-3, .start = start,
    .initialise = initialise, .evaluate = evaluate, .update = update, .next_time_event = next_time_event};
