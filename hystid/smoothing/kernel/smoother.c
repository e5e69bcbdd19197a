/* Kalman filter and Rauch-Tung-Striebel smoother of one motion seen through up to three channels.
 *
 * State: x and its derivatives in units of the sample time (v dt, a dt^2, ...), ORDER of them, the last one driven by white
 * noise. Channels measure the first three with variances r[0..2]; an infinite variance means that there is no such channel,
 * a value that is not finite that the channel has a gap there. Noise may be louder for a while.
 * A belief is a mean (ORDER) followed by a covariance (ORDER x ORDER, row by row).
 */
#include <math.h>
#include <string.h>

#ifndef ORDER
#define ORDER 3
#endif
#define EXPORT __attribute__((visibility("default")))
#define STEADY 1e-11   /* change per sample (share of the standard deviations) of a covariance that changes no more */

typedef struct { double m[ORDER]; double p[ORDER][ORDER]; } belief;

static double A[ORDER][ORDER], Q[ORDER][ORDER];

/* Transition over one sample (Taylor) and the covariance that white noise of unit density adds (its exact integral). */
static void prepare(double (*a)[ORDER], double (*q)[ORDER])
{
    double factorial[2 * ORDER] = {1};
    for (int i = 1; i < 2 * ORDER; i++) factorial[i] = factorial[i - 1] * i;
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
            int k = ORDER - 1 - i, l = ORDER - 1 - j;
            a[i][j] = j >= i ? 1.0 / factorial[j - i] : 0.0;
            q[i][j] = 1.0 / (factorial[k] * factorial[l] * (k + l + 1));
        }
}

static void propagate(const double p[ORDER][ORDER], double (*c)[ORDER])   /* c = P A' */
{
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
            double sum = 0;
            for (int k = j; k < ORDER; k++) sum += p[i][k] * A[j][k];
            c[i][j] = sum;
        }
}

static void step_mean(const belief *b, belief *out)
{
    for (int i = 0; i < ORDER; i++) {
        double mean = 0;
        for (int k = i; k < ORDER; k++) mean += A[i][k] * b->m[k];
        out->m[i] = mean;
    }
}

static void predict(const belief *b, double q, belief *out)
{
    double c[ORDER][ORDER];
    propagate(b->p, c);
    step_mean(b, out);
    for (int i = 0; i < ORDER; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = q * Q[i][j];
            for (int k = i; k < ORDER; k++) sum += A[i][k] * c[k][j];
            out->p[i][j] = out->p[j][i] = sum;
        }
    }
}

/* What one channel does to the mean: the covariance says how. */
typedef struct { double gain[ORDER], s, log_s; } correction;

static double correct(belief *b, int channel, double measured, const correction *by)
{
    double e = measured - b->m[channel];
    for (int i = 0; i < ORDER; i++) b->m[i] += by->gain[i] * e;
    return -0.5 * (by->log_s + e * e / by->s);
}

static double update(belief *b, int channel, double measured, double variance, correction *by)
{
    double h[ORDER];
    by->s = b->p[channel][channel] + variance;
    by->log_s = log(6.283185307179586 * by->s);
    for (int i = 0; i < ORDER; i++) {
        h[i] = b->p[i][channel];
        by->gain[i] = h[i] / by->s;
    }
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j <= i; j++) b->p[i][j] = b->p[j][i] = b->p[i][j] - h[i] * h[j] / by->s;
    return correct(b, channel, measured, by);
}

static int is_steady(const belief *a, const belief *b)
{
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j <= i; j++) {
            double change = a->p[i][j] - b->p[i][j];
            if (!(change * change <= STEADY * STEADY * a->p[i][i] * a->p[j][j])) return 0;
        }
    return 1;
}


/* Factor a symmetric matrix as L D L'. */
static void factor(const double p[ORDER][ORDER], double (*l)[ORDER], double *d)
{
    for (int j = 0; j < ORDER; j++) {
        d[j] = p[j][j];
        for (int k = 0; k < j; k++) d[j] -= l[j][k] * l[j][k] * d[k];
        for (int i = j + 1; i < ORDER; i++) {
            l[i][j] = p[i][j];
            for (int k = 0; k < j; k++) l[i][j] -= l[i][k] * l[j][k] * d[k];
            l[i][j] = d[j] > 0 ? l[i][j] / d[j] : 0.0;
        }
    }
}

/* b := smoothed belief at k from the filtered one (b), the predicted one and the smoothed one at k + 1. */
static void back(belief *b, const belief *next, const belief *later)
{
    double c[ORDER][ORDER], l[ORDER][ORDER], d[ORDER], g[ORDER][ORDER], change[ORDER][ORDER];
    propagate(b->p, c);
    factor(next->p, l, d);
    for (int i = 0; i < ORDER; i++) {                    /* gain: one row of c at a time, solved against L D L' */
        double y[ORDER];
        for (int j = 0; j < ORDER; j++) {
            y[j] = c[i][j];
            for (int k = 0; k < j; k++) y[j] -= l[j][k] * y[k];
        }
        for (int j = ORDER - 1; j >= 0; j--) {
            g[i][j] = d[j] > 0 ? y[j] / d[j] : 0.0;
            for (int k = j + 1; k < ORDER; k++) g[i][j] -= l[k][j] * g[i][k];
        }
    }
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
            double sum = 0;
            for (int k = 0; k < ORDER; k++) sum += g[i][k] * (later->p[k][j] - next->p[k][j]);
            change[i][j] = sum;
        }
    for (int i = 0; i < ORDER; i++) {
        for (int k = 0; k < ORDER; k++) b->m[i] += g[i][k] * (later->m[k] - next->m[k]);
        for (int j = 0; j <= i; j++) {
            double sum = b->p[i][j];
            for (int k = 0; k < ORDER; k++) sum += change[i][k] * g[j][k];
            b->p[i][j] = b->p[j][i] = sum;
        }
    }
}

/* channels: 3 x n, r: 3, louder: 3 x n factors on r, or NULL where they are 1. start: the first belief. filtered, predicted: n beliefs of work space, or NULL for the
 * likelihood alone. On return filtered holds the smoothed beliefs. Returns the log-likelihood.
 * Where the covariance has become steady, and no gap disturbs it, the mean alone is carried on. */
EXPORT double hy_smooth(long n, const double *channels, const double *r, const double *louder, double q,
                        const belief *start, belief *filtered, belief *predicted)
{
    belief ahead = *start, now = *start;
    correction by[3];
    double likelihood = 0;
    int steady = 0;
    prepare(A, Q);
    for (long k = 0; k < n; k++) {
        int gaps = 0;
        for (int c = 0; c < 3; c++) {
            gaps |= isfinite(r[c]) && !isfinite(channels[c * n + k]);
            gaps |= louder && k && louder[c * n + k] != louder[c * n + k - 1];
        }
        int frozen = steady && !gaps;
        if (frozen) step_mean(&now, &ahead);
        else if (k) {
            belief last = ahead;
            predict(&now, q, &ahead);
            steady = !gaps && is_steady(&ahead, &last);
        }
        if (predicted) predicted[k] = ahead;
        if (frozen) memcpy(now.m, ahead.m, sizeof now.m);
        else now = ahead;
        for (int c = 0; c < 3; c++) {
            double measured = channels[c * n + k];
            if (isfinite(r[c]) && isfinite(measured))
                likelihood += frozen ? correct(&now, c, measured, &by[c])
                                     : update(&now, c, measured, louder ? r[c] * louder[c * n + k] : r[c], &by[c]);
        }
        if (filtered) filtered[k] = now;
    }
    if (filtered)
        for (long k = n - 2; k >= 0; k--) back(&filtered[k], &predicted[k + 1], &filtered[k + 1]);
    return likelihood;
}
