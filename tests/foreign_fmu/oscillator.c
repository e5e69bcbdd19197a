/* mass dv/dt = F - k x - c v as an FMI 3.0 FMU for Model Exchange, written by hand from the standard: nothing in here
   comes from the shell of hystid, and functions that nobody calls are left out, as small tools do. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#pragma GCC visibility push(default)
typedef int fmi3Status; /* 0 OK, 3 error */
typedef uint32_t fmi3ValueReference;
typedef struct { double t, mass, k, c, F, x, v; } oscillator;
enum { TIME = 0, MASS = 11, STIFFNESS = 12, DAMPING = 13, FORCE = 21, X = 31, DX = 32, V = 41, DV = 42 };

static double acceleration(const oscillator *o) { return (o->F - o->k * o->x - o->c * o->v) / o->mass; }

const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible, bool log,
                                   void *environment, void *logger)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)log, (void)environment, (void)logger;
    oscillator *o = calloc(1, sizeof *o);
    if (o) o->mass = 2, o->k = 9000, o->c = 6;
    return o;
}
void fmi3FreeInstance(void *c) { free(c); }
fmi3Status fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const *names)
{
    (void)c, (void)on, (void)n, (void)names;
    return 0;
}
fmi3Status fmi3EnterInitializationMode(void *c, bool a, double b, double t, bool d, double e)
{
    (void)a, (void)b, (void)d, (void)e;
    ((oscillator *)c)->t = t;
    return 0;
}
fmi3Status fmi3ExitInitializationMode(void *c) { return (void)c, 0; }
fmi3Status fmi3EnterEventMode(void *c) { return (void)c, 0; }
fmi3Status fmi3EnterContinuousTimeMode(void *c) { return (void)c, 0; }
fmi3Status fmi3Terminate(void *c) { return (void)c, 0; }
fmi3Status fmi3UpdateDiscreteStates(void *c, bool *needed, bool *end, bool *nominals, bool *states, bool *defined,
                                    double *next)
{
    (void)c;
    *needed = *end = *nominals = *states = *defined = false, *next = 0;
    return 0;
}
fmi3Status fmi3CompletedIntegratorStep(void *c, bool no_set, bool *event, bool *end)
{
    (void)c, (void)no_set;
    *event = *end = false;
    return 0;
}
fmi3Status fmi3SetTime(void *c, double t) { return ((oscillator *)c)->t = t, 0; }
fmi3Status fmi3SetContinuousStates(void *c, const double *x, size_t n)
{
    oscillator *o = c;
    if (n != 2) return 3;
    o->x = x[0], o->v = x[1];
    return 0;
}
fmi3Status fmi3GetContinuousStates(void *c, double *x, size_t n)
{
    const oscillator *o = c;
    if (n != 2) return 3;
    x[0] = o->x, x[1] = o->v;
    return 0;
}
fmi3Status fmi3GetContinuousStateDerivatives(void *c, double *dx, size_t n)
{
    const oscillator *o = c;
    if (n != 2) return 3;
    dx[0] = o->v, dx[1] = acceleration(o);
    return 0;
}
fmi3Status fmi3GetNominalsOfContinuousStates(void *c, double *x, size_t n)
{
    (void)c;
    for (size_t i = 0; i < n; i++) x[i] = 1;
    return 0;
}
fmi3Status fmi3GetNumberOfContinuousStates(void *c, size_t *n) { return (void)c, *n = 2, 0; }
fmi3Status fmi3GetNumberOfEventIndicators(void *c, size_t *n) { return (void)c, *n = 0, 0; }
fmi3Status fmi3GetEventIndicators(void *c, double *z, size_t n) { return (void)c, (void)z, n ? 3 : 0; }
fmi3Status fmi3GetFloat64(void *c, const fmi3ValueReference *vr, size_t n, double *values, size_t n_values)
{
    const oscillator *o = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) switch (vr[i]) {
        case TIME: values[i] = o->t; break;
        case MASS: values[i] = o->mass; break;
        case STIFFNESS: values[i] = o->k; break;
        case DAMPING: values[i] = o->c; break;
        case FORCE: values[i] = o->F; break;
        case X: values[i] = o->x; break;
        case DX: case V: values[i] = o->v; break;
        case DV: values[i] = acceleration(o); break;
        default: return 3;
        }
    return 0;
}
fmi3Status fmi3SetFloat64(void *c, const fmi3ValueReference *vr, size_t n, const double *values, size_t n_values)
{
    oscillator *o = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) switch (vr[i]) {
        case MASS: o->mass = values[i]; break;
        case STIFFNESS: o->k = values[i]; break;
        case DAMPING: o->c = values[i]; break;
        case FORCE: o->F = values[i]; break;
        case X: o->x = values[i]; break;
        case V: o->v = values[i]; break;
        default: return 3;
        }
    return 0;
}
