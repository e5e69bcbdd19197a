/* Batch entry: a table of inputs in, a table of outputs out, in one call. The only function of the library besides FMI's.
 * Columns are separate arrays, so that callers need not interleave theirs. Slots are value references. */
#ifndef HY_TABLE_H
#define HY_TABLE_H

#include "hy_model.h"

enum { HY_TABLE_VERSION = 1 };
enum { HY_HOLD = 0, HY_LINEAR = 1, HY_HERMITE = 2 }; /* how a column runs between its samples */

typedef struct {
    int version;  /* HY_TABLE_VERSION */
    int rows;     /* samples, the first at start_time */
    double start_time, dt; /* [s] */
    int substeps; /* Runge-Kutta steps per sample; 0: as many as the model's own step asks for */
    int n_settings;
    const int *setting_slots;
    const double *settings; /* parameters and start values */
    int n_columns;
    const int *column_slots; /* inputs, and states that follow a given motion */
    const int *column_modes;
    const double *const *samples; /* n_columns arrays of rows values */
    const double *const *slopes;  /* their time derivatives, read for HY_HERMITE */
    int n_outputs;
    const int *output_slots;
    double *const *outputs; /* n_outputs arrays of rows values */
    int n_seeds;
    const int *seed_slots;     /* parameters */
    double *const *gradients;  /* n_outputs x n_seeds arrays of rows values, by output first */
    int failed_row;            /* where the run ended early, else -1 */
    char failure[400];         /* first failure in words */
    char warning[400];         /* first warning of each kind in words */
} hy_table;

#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
int hy_run_table(hy_table *table); /* 0, or an outcome of hy_model.h */

/* Four coefficients of a column's polynomial in the time since a row, up to the next one. */
void hy_interpolate(const hy_table *t, int column, int row, double *c);

#endif
