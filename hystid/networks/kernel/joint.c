/* Normal equations of both networks together, in simulation: the memory that the hysteresis network is fed with is its own.
 *
 * Segments lie between turning points. Segment j has the displacement x0[j] and the force h0[j] of its turning point:
 * h0[j] = input scaling of g(xb[j], x0[j-1], h0[j-1]), with xb[j] the displacement one sample before; where a recording
 * begins (fresh[j]) h0[j] is given. Its derivative to the weights of g follows the same recursion, so that the Jacobian
 * is that of the simulated output. For a sample of segment j: h = g(x, x0[j], h0[j]), R = f(x, v, h).
 * The value h of g enters again as scale[0] h + scale[1] in g and as scale[2] h + scale[3] in f.
 *
 * Samples are sorted by segment and come in chunks data[chunk][x, v, further inputs, target, weight][length], zero-padded:
 * the residual is weight (R - target), and padding weighs nothing. Double precision. Both networks see the further inputs
 * after the three that they are named by; before[j][i] are those one sample before segment j begins. */
#include "perceptron.h"

typedef struct {
    long count;           /* segments */
    const double *x0, *xb;
    const int *fresh;
    int further;
    const double *before;
    double *h0, *slope;   /* slope[j][p] = d h0[j]/d w_p of g */
} segments;

/* Runs the memory through all turning points. with_slope: the derivatives too. Lane 0 holds the one sample. */
static void remember(const network *g, const double *scale, const segments *s, int with_slope, vec *work) {
    long parameters = parameters_of(g), width = widest_of(g);
    vec *Z = work, *acts = Z + parameters, *delta = acts + rows_of(g), *spare = delta + width;
    network one = *g;
    one.count = 1;
    for (long j = 0; j < s->count; j++) {
        double *slope = with_slope ? s->slope + j * parameters : NULL;
        if (s->fresh[j]) {
            if (with_slope) memset(slope, 0, sizeof(double) * parameters);
            continue;
        }
        acts[0] = splat(s->xb[j]), acts[1] = splat(s->x0[j - 1]), acts[2] = splat(s->h0[j - 1]);
        for (int i = 0; i < s->further; i++) acts[3 + i] = splat(s->before[j * s->further + i]);
        const vec *h = forward(&one, acts);
        s->h0[j] = scale[0] * h[0][0] + scale[1];
        if (!with_slope) continue;
        delta[0] = splat(1);
        const vec *first = jacobian(&one, parameters, h, delta, spare, Z);
        double through = input_derivative(&one, first, 2, 0)[0];
        for (long p = 0; p < parameters; p++) slope[p] = scale[0] * (Z[p][0] + through * slope[p - parameters]);
    }
}

/* residual = weight (y - target); returns its sum of squares. */
static double residuals(int count, const vec *y, const vec *target, const vec *weight, vec *residual) {
    vec squares = {0};
    for (int c = 0; c < count; c++) {
        residual[c] = weight[c] * (y[c] - target[c]);
        squares += residual[c] * residual[c];
    }
    return lane_sum(squares);
}

/* Rows of Z: weights of g, weights of f, residual. Arguments as in hystid_normal; segment[k]: that of sample k. */
API double hystid_joint(int layers_g, const int *sizes_g, int layers_f, const int *sizes_f, const double *weights,
                        const double *scale, long n_segments, const double *x0, const double *xb, const int *fresh,
                        const double *before, double *h0, double *slope, long n, int length, const double *data, const int *segment,
                        double *S, long stride, vec *work) {
    int count = length / LANES;
    network g = {layers_g, count, sizes_g, weights};
    long pg = parameters_of(&g);
    network f = {layers_f, count, sizes_f, weights + pg};
    long pf = parameters_of(&f), width = (widest_of(&g) > widest_of(&f) ? widest_of(&g) : widest_of(&f)) * count;
    int further = sizes_g[0] - 3;
    segments all = {n_segments, x0, xb, fresh, further, before, h0, slope};
    remember(&g, scale, &all, S != NULL, work);
    vec *Z = work, *acts_g = Z + stride * count, *acts_f = acts_g + rows_of(&g) * count;
    vec *delta = acts_f + rows_of(&f) * count, *spare = delta + width, *chain = spare + width;
    if (S) memset(S, 0, sizeof(double) * stride * stride), memset(Z, 0, sizeof(vec) * stride * count);
    double total = 0;
    for (long begin = 0; begin < n; begin += length, data += (4L + further) * length, segment += length) {
        long valid = n - begin < length ? n - begin : length;
        memset(acts_g, 0, sizeof(vec) * 3 * count);
        memcpy(acts_g, data, sizeof(double) * length);
        for (long k = 0; k < valid; k++) {
            ((double *)(acts_g + count))[k] = x0[segment[k]];
            ((double *)(acts_g + 2 * count))[k] = h0[segment[k]];
        }
        memcpy(acts_g + 3 * count, data + 2L * length, sizeof(double) * further * length);
        const vec *h = forward(&g, acts_g);
        memcpy(acts_f, data, sizeof(double) * 2 * length);
        for (int c = 0; c < count; c++) acts_f[2 * count + c] = scale[2] * h[c] + scale[3];
        memcpy(acts_f + 3 * count, data + 2L * length, sizeof(double) * further * length);
        const vec *y = forward(&f, acts_f);
        const vec *target = (const vec *)(data + (2L + further) * length), *weight = target + count;
        total += residuals(count, y, target, weight, Z + (pg + pf) * count);
        if (!S) continue;
        memcpy(delta, weight, sizeof(vec) * count);
        const vec *first = jacobian(&f, pf, y, delta, spare, Z + pg * count);
        for (int c = 0; c < count; c++) chain[c] = scale[2] * input_derivative(&f, first, 2, c);
        memcpy(delta, chain, sizeof(vec) * count);
        first = jacobian(&g, pg, h, delta, spare, Z);
        for (int c = 0; c < count; c++) chain[c] = input_derivative(&g, first, 2, c);
        for (long k = 0, end; k < valid; k = end) {
            const double *slope_k = slope + segment[k] * pg, *through = (const double *)chain;
            for (end = k + 1; end < valid && segment[end] == segment[k];) end++;
            for (long p = 0; p < pg; p++) {
                double *row = (double *)(Z + p * count);
                for (long q = k; q < end; q++) row[q] += through[q] * slope_k[p];
            }
        }
        accumulate(Z, stride / BLOCK, count, S, stride);
    }
    return total;
}
