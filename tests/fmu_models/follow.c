/* A table that clamps displacement and speed of an oscillator and reads R and its loss; arguments: slots of both. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "hy_table.h"

enum { ROWS = 3000 };

int main(int argc, char **argv)
{
    static double x[ROWS], v[ROWS], slope[ROWS], out[2][ROWS];
    int columns[2], outputs[2], modes[2] = {HY_HERMITE, HY_HERMITE};
    const double *samples[2] = {x, v}, *slopes[2] = {v, slope};
    double *results[2] = {out[0], out[1]};
    hy_table t = {.version = HY_TABLE_VERSION, .rows = ROWS, .dt = 1e-3, .substeps = 1};
    if (argc != 5) return 2;
    for (int k = 0; k < 2; k++) {
        columns[k] = atoi(argv[1 + k]);
        outputs[k] = atoi(argv[3 + k]);
    }
    for (int i = 0; i < ROWS; i++) {
        const double at = 1e-3 * i, size = 5e-3 * sin(2 * at);
        x[i] = size * sin(90 * at);
        v[i] = size * 90 * cos(90 * at) + 1e-2 * cos(2 * at) * sin(90 * at);
        slope[i] = -size * 8100 * sin(90 * at);
    }
    t.n_columns = 2;
    t.column_slots = columns;
    t.column_modes = modes;
    t.samples = samples;
    t.slopes = slopes;
    t.output_slots = outputs;
    t.outputs = results;
    for (t.n_outputs = 1; t.n_outputs <= 2; t.n_outputs++) /* R alone takes the short way */
        if (hy_run_table(&t)) return printf("%s\n", t.failure), 1;
    return !isfinite(out[0][ROWS - 1] + out[1][ROWS - 1]);
}
