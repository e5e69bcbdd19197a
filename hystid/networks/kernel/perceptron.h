/* A tanh network with one linear output on chunks of samples: outputs, rows of the Jacobian, their products.
 *
 * Rows are `count` vectors long, one sample per lane. Parameters: [W1 row by row, b1, W2, b2, ...]. */
#ifndef HYSTID_PERCEPTRON_H
#define HYSTID_PERCEPTRON_H

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

static inline long parameters_of(const network *net) {
    long count = 0;
    for (int l = 0; l < net->layers; l++) count += (net->sizes[l] + 1L) * net->sizes[l + 1];
    return count;
}

/* Rows of activations, inputs and output included. */
static inline long rows_of(const network *net) {
    long count = net->sizes[0];
    for (int l = 0; l < net->layers; l++) count += net->sizes[l + 1];
    return count;
}

static inline long widest_of(const network *net) {
    long widest = 1;
    for (int l = 0; l < net->layers; l++)
        if (net->sizes[l + 1] > widest) widest = net->sizes[l + 1];
    return widest;
}

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

/* Rows of the Jacobian into Z. delta begins with d y/d y (1, or what comes before in a chain; 0 on padding); delta and
 * spare have `widest` rows. Returns the deltas of the first layer. */
static const vec *jacobian(const network *net, long parameters, const vec *acts_end, vec *delta, vec *spare, vec *Z) {
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
        if (!l) return delta;
        backward_layer(count, delta, spare, acts, net->w + at, ni, no);
        vec *swap = delta;
        delta = spare, spare = swap;
    }
    return delta;
}

/* d y/d u for input number `input`, from the deltas of the first layer. */
static inline vec input_derivative(const network *net, const vec *delta, int input, int c) {
    vec sum = {0};
    for (int j = 0; j < net->sizes[1]; j++) sum += net->w[j * net->sizes[0] + input] * delta[(long)j * net->count + c];
    return sum;
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

#endif
