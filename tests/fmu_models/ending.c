/* A stranger's FMI 2.0 co-simulation FMU that asks for the end of the simulation at 0.5 s; x = 2 t, n counts steps. */
#include <stddef.h>

static double t;
static int n;
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *functions, int v, int l)
{
    (void)name, (void)type, (void)guid, (void)resources, (void)functions, (void)v, (void)l;
    n = 0;
    return &t;
}
void fmi2FreeInstance(void *c) { (void)c; }
int fmi2SetupExperiment(void *c, int has, double tolerance, double start, int stops, double stop)
{
    (void)c, (void)has, (void)tolerance, (void)stops, (void)stop;
    t = start;
    return 0;
}
int fmi2EnterInitializationMode(void *c) { return c == NULL; }
int fmi2ExitInitializationMode(void *c) { return c == NULL; }
int fmi2GetReal(void *c, const unsigned *vr, size_t k, double *value)
{
    (void)vr;
    for (size_t i = 0; i < k; i++) value[i] = 2 * t;
    return c == NULL;
}
int fmi2GetInteger(void *c, const unsigned *vr, size_t k, int *value)
{
    (void)vr;
    for (size_t i = 0; i < k; i++) value[i] = n;
    return c == NULL;
}
int fmi2GetString(void *c, const unsigned *vr, size_t k, const char **value)
{
    (void)vr;
    for (size_t i = 0; i < k; i++) value[i] = t < 0.25 ? "some text" : "another";
    return c == NULL;
}
int fmi2SetReal(void *c, const unsigned *vr, size_t k, const double *value)
{
    (void)c, (void)vr, (void)value;
    return k != 0; /* nothing can be set */
}
int fmi2SetInteger(void *c, const unsigned *vr, size_t k, const int *value)
{
    (void)c, (void)vr, (void)value;
    return k != 0;
}
int fmi2DoStep(void *c, double from, double h, int flag)
{
    (void)c, (void)flag;
    t = from + h;
    n++;
    return t < 0.5 - 1e-9 ? 0 : 2;
}
int fmi2GetBooleanStatus(void *c, int kind, int *value)
{
    (void)c;
    *value = t >= 0.5 - 1e-9;
    return kind != 3;
}
