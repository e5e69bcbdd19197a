/* One step of co-simulation from plain C: set inputs, step, get an output. Libraries alternate in one run.
 * drive ROUNDS STEPS, then for each library: PATH TOKEN OUTPUT_VR N_IN IN_VR...
 * Prints for each: median over the rounds of the CPU time of a step [ns] and of its ratio to the first library's, and the
 * last output. */
#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"

typedef struct {
    fmi2Component c;
    fmi2SetRealTYPE *set;
    fmi2GetRealTYPE *get;
    fmi2DoStepTYPE *step;
    unsigned in[8], out;
    int n_in;
    double t, last, times[64], ratios[64];
} client;

static void log_(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String category, fmi2String text, ...)
{
    (void)e, (void)name, (void)s, (void)category;
    fprintf(stderr, "%s\n", text);
}

static const fmi2CallbackFunctions callbacks = {log_, calloc, free, NULL, NULL};

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int open_client(client *k, const char *path, const char *token)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    fmi2InstantiateTYPE *make;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    if (!library) return fprintf(stderr, "%s\n", dlerror());
    *(void **)&make = dlsym(library, "fmi2Instantiate");
    *(void **)&setup = dlsym(library, "fmi2SetupExperiment");
    *(void **)&enter = dlsym(library, "fmi2EnterInitializationMode");
    *(void **)&leave = dlsym(library, "fmi2ExitInitializationMode");
    *(void **)&k->set = dlsym(library, "fmi2SetReal");
    *(void **)&k->get = dlsym(library, "fmi2GetReal");
    *(void **)&k->step = dlsym(library, "fmi2DoStep");
    k->c = make("bench", fmi2CoSimulation, token, "", &callbacks, 0, 0);
    k->t = 0;
    return !k->c || setup(k->c, 0, 0, 0, 0, 0) || enter(k->c) || leave(k->c);
}

static int run(client *k, int steps, int round)
{
    const double h = 1e-4, begin = now();
    double u[8];
    for (int s = 0; s < steps; s++) {
        for (int i = 0; i < k->n_in; i++) u[i] = 1e-3 * (double)((s * (i + 3)) % 1999 - 999);
        if (k->set(k->c, k->in, (size_t)k->n_in, u) || k->step(k->c, k->t, h, 1) || k->get(k->c, &k->out, 1, &k->last)) return 1;
        k->t += h;
    }
    k->times[round] = (now() - begin) / steps;
    return 0;
}

static int by_size(const void *a, const void *b)
{
    const double d = *(const double *)a - *(const double *)b;
    return d > 0 ? 1 : d < 0 ? -1 : 0;
}

int main(int argc, char **argv)
{
    static client all[8];
    int n = 0;
    const int rounds = atoi(argv[1]), steps = atoi(argv[2]);
    for (int i = 3; i < argc; n++) {
        client *k = all + n;
        if (open_client(k, argv[i], argv[i + 1])) return 2;
        k->out = (unsigned)atoi(argv[i + 2]);
        k->n_in = atoi(argv[i + 3]);
        for (int j = 0; j < k->n_in; j++) k->in[j] = (unsigned)atoi(argv[i + 4 + j]);
        i += 4 + k->n_in;
    }
    for (int round = 0; round < rounds; round++)
        for (int i = 0; i < n; i++)
            if (run(all + i, steps, round)) return 3;
    for (int i = n - 1; i >= 0; i--)
        for (int round = 0; round < rounds; round++) all[i].ratios[round] = all[i].times[round] / all[0].times[round];
    for (int i = 0; i < n; i++) {
        qsort(all[i].ratios, (size_t)rounds, sizeof(double), by_size);
        qsort(all[i].times, (size_t)rounds, sizeof(double), by_size);
        printf("%.3f %.3f %.17g\n", all[i].times[rounds / 2], all[i].ratios[rounds / 2], all[i].last);
    }
    return 0;
}
