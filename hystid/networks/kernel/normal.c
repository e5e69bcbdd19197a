/* Normal equations of least squares for a tanh network with one linear output; the Jacobian is never stored.
 *
 * Samples come in chunks: data[chunk][feature .. , target][length], zero-padded to a whole number of chunks. For each
 * chunk the rows d y/d w (one per parameter) and, last, the residual y - target are laid into Z, and the lower triangle
 * of Z Z' is added to S: J'J, J'e and e'e in one. S is double whatever REAL is. */
#include <math.h>
#include "perceptron.h"

/* residual = y - target on the first `valid` samples, 0 on the padding; returns its sum of squares. */
static double residuals(long count, const vec *y, const vec *target, long valid, vec *residual) {
    vec squares = {0};
    for (long c = 0; c < count; c++) residual[c] = y[c] - target[c];
    for (long k = valid; k < count * LANES; k++) ((REAL *)residual)[k] = 0;
    for (long c = 0; c < count; c++) squares += residual[c] * residual[c];
    return lane_sum(squares);
}

/* Returns the sum of squares. S: NULL, or stride x stride (stride a multiple of BLOCK, above the number of parameters).
 * work: stride + rows of activations + 2 * widest rows, and the parameters. length: samples per chunk, a multiple of
 * LANES. All arrays 64-byte aligned. */
API double hystid_normal(int layers, const int *sizes, const double *weights, long n, int length, const REAL *data,
                         double *S, long stride, vec *work) {
    network net = {layers, length / LANES, sizes, NULL};
    long parameters = parameters_of(&net), count = net.count, width = widest_of(&net) * count;
    vec *Z = work, *acts = Z + stride * count, *delta = acts + rows_of(&net) * count, *spare = delta + width;
    REAL *w = (REAL *)(spare + width);
    for (long k = 0; k < parameters; k++) w[k] = (REAL)weights[k];
    net.w = w;
    if (S) memset(S, 0, sizeof(double) * stride * stride), memset(Z, 0, sizeof(vec) * stride * count);
    double total = 0;
    for (long begin = 0; begin < n; begin += length, data += (sizes[0] + 1L) * length) {
        memcpy(acts, data, sizeof(REAL) * sizes[0] * length);
        const vec *y = forward(&net, acts);
        vec *residual = Z + parameters * count;
        total += residuals(count, y, (const vec *)(data + (long)sizes[0] * length), n - begin, residual);
        if (!S) continue;
        for (long k = 0; k < length; k++) ((REAL *)delta)[k] = k < n - begin;
        jacobian(&net, parameters, y, delta, spare, Z);
        accumulate(Z, stride / BLOCK, count, S, stride);
    }
    return total;
}

typedef double dvec __attribute__((vector_size(VECTOR_BYTES)));
#define DLANES ((int)(VECTOR_BYTES / sizeof(double)))

static inline dvec dload(const double *p) {
    dvec value;
    memcpy(&value, p, sizeof value);
    return value;
}

/* Solves (A + diag(damping)) step = g by Cholesky, A in the lower triangle of S, g in row `count` of S.
 * L (count rows of `stride` doubles) is working space. Returns 0 where the matrix is not positive definite. */
API int hystid_solve(long count, const double *S, long stride, const double *damping, double *L, double *step) {
    for (long i = 0; i < count; i++)
        for (long j = 0; j <= i; j++) {
            const double *li = L + i * stride, *lj = L + j * stride;
            double sum = S[i * stride + j] + (i == j ? damping[i] : 0);
            dvec dots = {0};
            long k = 0;
            for (; k + DLANES <= j; k += DLANES) dots += dload(li + k) * dload(lj + k);
            for (int lane = 0; lane < DLANES; lane++) sum -= dots[lane];
            for (; k < j; k++) sum -= li[k] * lj[k];
            if (i == j && !(sum > 0)) return 0;
            L[i * stride + j] = i == j ? sqrt(sum) : sum / lj[j];
        }
    for (long i = 0; i < count; i++) {
        double sum = S[count * stride + i];
        for (long k = 0; k < i; k++) sum -= L[i * stride + k] * step[k];
        step[i] = sum / L[i * stride + i];
    }
    for (long i = count - 1; i >= 0; i--) {
        double sum = step[i];
        for (long k = i + 1; k < count; k++) sum -= L[k * stride + i] * step[k];
        step[i] = sum / L[i * stride + i];
    }
    return 1;
}

API int hystid_block(void) {
    return BLOCK;
}
