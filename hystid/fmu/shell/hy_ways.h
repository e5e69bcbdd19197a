/* Ways that a cubic speed leads from one reversal to the next: what rate-independent laws see of a motion. */
#ifndef HY_WAYS_H
#define HY_WAYS_H

#include "hy_engine.h"

enum { HY_MOST_WAYS = 4 };

/* Over s in [0, h] of a followed speed; returns how many ways there are, each of one sign. */
int hy_ways(const hy_driven *speed, double h, double ways[HY_MOST_WAYS]);

/* Where a cubic with such coefficients, monotone over [low, high] with ends of different sign, is 0. */
double hy_zero(const double *c, double low, double high);

#endif
