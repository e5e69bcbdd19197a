/* Normal equations of least squares for a tanh network with one linear output; the Jacobian is never stored.
 *
 * Samples come in chunks: data[chunk][feature .. , target][length], zero-padded to a whole number of chunks. For each
 * chunk the rows d y/d w (one per parameter) and, last, the residual y - target are laid into Z, and the lower triangle
 * of Z Z' is added to S: J'J, J'e and e'e in one. S is double whatever REAL is.
 * Parameters: [W1 row by row, b1, W2, b2, ...]. */
#include <math.h>
#include "vector.h"

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

/* BLOCK^2 sums and BLOCK operands have to fit the vector registers: 32 with AVX-512, 16 elsewhere. */
#ifdef __AVX512F__
#define BLOCK 5
#else
#define BLOCK 3
#endif

typedef struct {
    int layers, count;  /* count: vectors per row of a chunk */
    const int *sizes;
    const REAL *w;
} network;

/* out = act(W in + b) for one chunk; rows of in and out are count vectors long. */
static void forward_layer(int count, const vec *restrict in, vec *restrict out, const REAL *w, const REAL *bias, int ni,
                          int no, int hidden) {
    for (int j = 0; j < no; j++, w += ni, out += count)
        for (int c = 0; c < count; c++) {
            vec sum = splat(bias[j]);
            for (int i = 0; i < ni; i++) sum += w[i] * in[(long)i * count + c];
            out[c] = hidden ? vtanh(sum) : sum;
        }
}

/* Activations of all layers one after the other in acts, which begins with the inputs; returns the output row. */
static const vec *forward(const network *net, vec *acts) {
    const REAL *w = net->w;
    for (int l = 0; l < net->layers; l++) {
        int ni = net->sizes[l], no = net->sizes[l + 1];
        vec *out = acts + (long)ni * net->count;
        forward_layer(net->count, acts, out, w, w + (long)ni * no, ni, no, l < net->layers - 1);
        w += (ni + 1L) * no;
        acts = out;
    }
    return acts;
}

/* delta of the layer below: (W' delta) (1 - a^2) */
static void backward_layer(int count, const vec *restrict delta, vec *restrict below, const vec *restrict acts,
                           const REAL *w, int ni, int no) {
    for (int i = 0; i < ni; i++)
        for (int c = 0; c < count; c++) {
            vec sum = w[i] * delta[c], a = acts[(long)i * count + c];
            for (int j = 1; j < no; j++) sum += w[(long)j * ni + i] * delta[(long)j * count + c];
            below[(long)i * count + c] = sum * (1 - a * a);
        }
}

/* Rows of the Jacobian into Z. delta (2 * widest rows) begins with d y/d y: 1, or 0 on padding. */
static void jacobian(const network *net, long parameters, const vec *acts_end, vec *delta, vec *spare, vec *Z) {
    int count = net->count;
    const vec *acts = acts_end;
    long at = parameters;
    for (int l = net->layers - 1; l >= 0; l--) {
        int ni = net->sizes[l], no = net->sizes[l + 1];
        acts -= (long)ni * count;
        at -= (ni + 1L) * no;
        vec *z = Z + at * count;
        for (int j = 0; j < no; j++)
            for (int i = 0; i < ni; i++, z += count)
                for (int c = 0; c < count; c++) z[c] = delta[(long)j * count + c] * acts[(long)i * count + c];
        memcpy(z, delta, sizeof(vec) * no * count);
        if (!l) break;
        backward_layer(count, delta, spare, acts, net->w + at, ni, no);
        vec *swap = delta;
        delta = spare, spare = swap;
    }
}

typedef REAL half __attribute__((vector_size(VECTOR_BYTES / 2)));
typedef REAL quarter __attribute__((vector_size(VECTOR_BYTES / 4)));

/* Sum of the lanes by halving: three dependent additions instead of LANES. */
static inline double lane_sum(vec value) {
    union { vec whole; half part[2]; } a = {value};
    union { half whole; quarter part[2]; } b = {a.part[0] + a.part[1]};
    quarter q = b.part[0] + b.part[1];
    double sum = 0;
    for (int k = 0; k < LANES / 4; k++) sum += q[k];
    return sum;
}

/* S[i][j] += z_i . z_j over one chunk, for the lower triangle of blocks. */
static void accumulate(const vec *Z, int blocks, int count, double *S, long stride) {
    for (int bi = 0; bi < blocks; bi++)
        for (int bj = 0; bj <= bi; bj++) {
            const vec *p = Z + (long)bi * BLOCK * count, *q = Z + (long)bj * BLOCK * count;
            vec sum[BLOCK][BLOCK] = {{{0}}};
            for (int c = 0; c < count; c++) {
                vec right[BLOCK];
#pragma GCC unroll 5
                for (int j = 0; j < BLOCK; j++) right[j] = q[(long)j * count + c];
#pragma GCC unroll 5
                for (int i = 0; i < BLOCK; i++) {
                    vec left = p[(long)i * count + c];
#pragma GCC unroll 5
                    for (int j = 0; j < BLOCK; j++) sum[i][j] += left * right[j];
                }
            }
            double *s = S + (long)bi * BLOCK * stride + bj * BLOCK;
            for (int i = 0; i < BLOCK; i++)
                for (int j = 0; j < BLOCK; j++) s[i * stride + j] += lane_sum(sum[i][j]);
        }
}

/* Returns the sum of squares. S: NULL, or stride x stride (stride a multiple of BLOCK, above the number of parameters).
 * work: see hystid_work. length: samples per chunk, a multiple of LANES. All arrays 64-byte aligned. */
API double hystid_normal(int layers, const int *sizes, const double *weights, long n, int length, const REAL *data,
                         double *S, long stride, vec *work) {
    long parameters = 0, neurons = sizes[0];
    int count = length / LANES, widest = 1;
    for (int l = 0; l < layers; l++) {
        parameters += (sizes[l] + 1L) * sizes[l + 1];
        neurons += sizes[l + 1];
        if (sizes[l + 1] > widest) widest = sizes[l + 1];
    }
    vec *Z = work, *acts = Z + stride * count, *delta = acts + neurons * count, *spare = delta + (long)widest * count;
    REAL *w = (REAL *)(spare + (long)widest * count);
    for (long k = 0; k < parameters; k++) w[k] = (REAL)weights[k];
    if (S) memset(S, 0, sizeof(double) * stride * stride), memset(Z, 0, sizeof(vec) * stride * count);
    network net = {layers, count, sizes, w};
    double total = 0;
    for (long begin = 0; begin < n; begin += length, data += (sizes[0] + 1L) * length) {
        memcpy(acts, data, sizeof(REAL) * sizes[0] * length);
        const vec *target = (const vec *)(data + (long)sizes[0] * length), *y = forward(&net, acts);
        vec *residual = Z + parameters * count, squares = {0};
        for (int c = 0; c < count; c++) residual[c] = y[c] - target[c];
        for (long k = n - begin; k < length; k++) ((REAL *)residual)[k] = 0;
        for (int c = 0; c < count; c++) squares += residual[c] * residual[c];
        total += lane_sum(squares);
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

API int hystid_lanes(void) {
    return LANES;
}
