/* Loads an FMU's library, runs co-simulation steps and prints every output: the same program for every system, to compare
 * what a library does where it was built for with what it does here.
 * Arguments: library, version (2 or 3), token, step size, number of steps, inputs as reference=value, outputs as reference. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
static void *open_library(const char *path) { return (void *)LoadLibraryA(path); }
static void *symbol(void *library, const char *name) { return (void *)(uintptr_t)GetProcAddress((HMODULE)library, name); }
#else
#include <dlfcn.h>
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW); }
static void *symbol(void *library, const char *name) { return dlsym(library, name); }
#endif

typedef void *(*instantiate2)(const char *, int, const char *, const char *, const void *, int, int);
typedef void *(*instantiate3)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
                              void *, void *, void *);
typedef int (*setup2)(void *, int, double, double, int, double);
typedef int (*enter3)(void *, bool, double, double, bool, double);
typedef int (*plain)(void *);
typedef int (*values2)(void *, const uint32_t *, size_t, double *);
typedef int (*values3)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*step2)(void *, double, double, int);
typedef int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *);

static void *library;

static void *need(const char *name)
{
    void *found = symbol(library, name);
    if (!found) {
        printf("%s is missing\n", name);
        exit(3);
    }
    return found;
}

static int values(int version, const char *name2, const char *name3, void *c, uint32_t vr, double *value)
{
    if (version == 2) return ((values2)need(name2))(c, &vr, 1, value);
    return ((values3)need(name3))(c, &vr, 1, value, 1);
}

static void *start(int version, const char *token)
{
    void *callbacks[5] = {NULL, (void *)calloc, (void *)free, NULL, NULL};
    void *c;
    if (version == 2) {
        c = ((instantiate2)need("fmi2Instantiate"))("i", 1, token, "", callbacks, 0, 0);
        return c && !((setup2)need("fmi2SetupExperiment"))(c, 0, 0, 0, 0, 0) ? c : NULL;
    }
    return ((instantiate3)need("fmi3InstantiateCoSimulation"))("i", token, "", false, false, false, false, NULL, 0, NULL, NULL,
                                                              NULL);
}

static int initialise(int version, void *c)
{
    if (version == 2)
        return ((plain)need("fmi2EnterInitializationMode"))(c) || ((plain)need("fmi2ExitInitializationMode"))(c);
    return ((enter3)need("fmi3EnterInitializationMode"))(c, false, 0, 0, false, 0)
        || ((plain)need("fmi3ExitInitializationMode"))(c);
}

static int step(int version, void *c, double t, double h)
{
    bool flags[3];
    double reached;
    if (version == 2) return ((step2)need("fmi2DoStep"))(c, t, h, 1);
    return ((step3)need("fmi3DoStep"))(c, t, h, true, flags, flags + 1, flags + 2, &reached);
}

int main(int n_arguments, char **argument)
{
    const int version = n_arguments > 5 ? atoi(argument[2]) : 0;
    void *c;
    if (!version || !(library = open_library(argument[1]))) {
        puts("the library cannot be loaded");
        return 1;
    }
    c = start(version, argument[3]);
    if (!c) return 4;
    for (int i = 6; i < n_arguments; i++) {
        const char *equals = strchr(argument[i], '=');
        double value = equals ? atof(equals + 1) : 0;
        if (equals && values(version, "fmi2SetReal", "fmi3SetFloat64", c, (uint32_t)atoi(argument[i]), &value)) return 5;
    }
    if (initialise(version, c)) return 6;
    for (int k = 0; k < atoi(argument[5]); k++) {
        const double h = atof(argument[4]);
        if (step(version, c, k * h, h) > 1) return 7;
        for (int i = 6; i < n_arguments; i++) {
            double value;
            if (strchr(argument[i], '=')) continue;
            if (values(version, "fmi2GetReal", "fmi3GetFloat64", c, (uint32_t)atoi(argument[i]), &value)) return 8;
            printf("%.17g%s", value, i + 1 < n_arguments ? " " : "\n");
        }
    }
    return 0;
}
