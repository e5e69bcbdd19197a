/* A tunable gain, a dependent parameter, an Integer input: y = gain rate + level. */
#include "hy_model.h"

static int parameters(hy_data *m)
{
    m->v[3] = m->v[1] * m->v[2];
    return HY_OK;
}

static int evaluate(hy_data *m)
{
    m->v[5] = m->v[3] + m->v[4];
    return HY_OK;
}

static const double start[6] = {0, 2, 3, 0, 0, 0};

const hy_model hy_the_model = {
    .name = "Tuned", .token = "tuned", .n_values = 6, .p = 1, .n_p = 3, .u = 4, .n_u = 1, .y = 5, .n_y = 1, .d = 6, .pre = 6,
    .rel = 6, .w = 6, .x = 6, .dx = 6, .step = 1e-3, .start = start, .parameters = parameters, .evaluate = evaluate,
};
