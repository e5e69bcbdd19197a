/* The path of a cubic speed: travels from one reversal to the next, which rate-independent laws see of a motion. */
#ifndef HY_PATHS_H
#define HY_PATHS_H

#include "hy_engine.h"
#include "hy_table.h"

enum {
    HY_STRIP = 128,     /* samples that are worked on at a time: those of a dozen variables stay near the processor */
    HY_MOST_TRAVELS = 4 /* of a sample: a cubic has three reversals */
};

/* How a speed leads through a strip of rows: how many travels each row has, and all of them one after another. */
typedef struct hy_path {
    int n[HY_STRIP];
    double travels[HY_STRIP * HY_MOST_TRAVELS];
} hy_path;

/* A model whose laws follow paths brings them along. */
struct hy_path_methods {
    int (*open)(hy_engine *e); /* room for the paths of what is driven; not 0: no memory */
    void (*set)(hy_engine *e, const hy_table *t, int row, int n); /* of the n rows after one */
};

int hy_follow(hy_engine *e, int slot); /* has the path of a driven speed kept from now on; not 0: it is not driven */

/* Where a cubic with such coefficients, monotone over [low, high] with ends of different sign, is 0. */
double hy_zero(const double *c, double low, double high);

#endif
