/* The floor for one step of a network FMU: a 3-5-5-1 tanh network behind the four functions that a driver calls.
 * Nothing is checked. Weights come from the generated header. */
#include <math.h>
#include <stdlib.h>

#include "weights.h"

static double network(const double *x)
{
    double a[5], b[5], y = B2[0];
    for (int i = 0; i < 5; i++) {
        double s = B0[i];
        for (int j = 0; j < 3; j++) s += W0[3 * i + j] * x[j];
        a[i] = tanh(s);
    }
    for (int i = 0; i < 5; i++) {
        double s = B1[i];
        for (int j = 0; j < 5; j++) s += W1[5 * i + j] * a[j];
        b[i] = tanh(s);
    }
    for (int i = 0; i < 5; i++) y += W2[i] * b[i];
    return y;
}

#define SHOWN __attribute__((visibility("default")))

SHOWN void *fmi2Instantiate(const char *name, int kind, const char *token, const char *where, const void *functions,
                            int visible, int logging)
{
    (void)name, (void)kind, (void)token, (void)where, (void)functions, (void)visible, (void)logging;
    return calloc(4, sizeof(double));
}

SHOWN int fmi2SetupExperiment(void *c, int a, double b, double s, int d, double e)
{
    (void)c, (void)a, (void)b, (void)s, (void)d, (void)e;
    return 0;
}

SHOWN int fmi2EnterInitializationMode(void *c) { return !c; }
SHOWN int fmi2ExitInitializationMode(void *c) { return !c; }

SHOWN int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *value)
{
    for (size_t i = 0; i < n; i++) ((double *)c)[vr[i]] = value[i];
    return 0;
}

SHOWN int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value)
{
    for (size_t i = 0; i < n; i++) value[i] = ((double *)c)[vr[i]];
    return 0;
}

SHOWN int fmi2DoStep(void *c, double t, double h, int last)
{
    (void)t, (void)h, (void)last;
    ((double *)c)[3] = network(c);
    return 0;
}

SHOWN void fmi2FreeInstance(void *c) { free(c); }
