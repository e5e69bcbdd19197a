/* An FMI 2.0 co-simulation FMU, y = gain * u, that goes wrong in the way WRONG at the place WHERE. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#pragma GCC visibility push(default)
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { logger log; void *(*allocate)(size_t, size_t); void (*release)(void *); void *finished, *owner; } callbacks;
enum { FINE, CRASH, ABORT, LOOP, LEAK, EXIT0, EXIT3, DIVIDE, ILLEGAL, DEEP, KILL, PRINT, NOISE, CLOSE, FORK, NAN_, INFINITE,
       HUGE_, REFUSE, FATAL, LONG_MESSAGE, NULL_MESSAGE, FORMAT, SLEEP, WRITE_FILE, DOUBLE_FREE, READ_STDIN, BAD_ALLOC, FILL };
enum { NOWHERE, LOAD, INSTANTIATE, SETUP, STEP, GET, FREE };
static const callbacks *call;
static double u, gain = 2;
static volatile double sink;

static int deep(int n) { volatile char room[4096]; room[n % 4096] = (char)n; return deep(n + 1) + room[0]; }

static int wrong(int where)
{
    volatile int *nowhere = NULL;
    if (where != WHERE) return 0;
    switch (WRONG) {
    case CRASH: *nowhere = 1; break;
    case ABORT: abort();
    case LOOP: for (;;) sink += 1;
    case LEAK: for (;;) { char *p = malloc(1 << 24); if (p) memset(p, 1, 1 << 24); else *nowhere = 1; }
    case BAD_ALLOC: if (!malloc((size_t)1 << 50)) { fputs("terminate: std::bad_alloc\n", stderr); abort(); } break;
    case EXIT0: exit(0);
    case EXIT3: _exit(3);
    case DIVIDE: raise(SIGFPE); break;
    case ILLEGAL: raise(SIGILL); break;
    case DEEP: return deep(0);
    case KILL: raise(SIGKILL); break;
    case PRINT: for (int i = 0; i < 20000; i++) printf("\033[2J\033]0;evil\007 printed %d\n", i), fprintf(stderr, "\033[31mred\n");
        fflush(stdout); *nowhere = 1; break;
    case NOISE: for (int fd = 3; fd < 64; fd++) if (write(fd, "{\"answer\": 1} noise noise noise noise", 37) < 0) continue; break;
    case CLOSE: for (int fd = 0; fd < 64; fd++) close(fd); for (;;) pause();
    case FORK: if (!fork()) for (;;) pause(); exit(0);
    case REFUSE: return 3;
    case FATAL: return 4;
    case LONG_MESSAGE: { char *text = malloc(200001); memset(text, 'x', 200000); text[200000] = 0;
        call->log(call->owner, "i", 3, "error", "%s", text); return 3; }
    case NULL_MESSAGE: call->log(call->owner, NULL, 3, NULL, NULL); return 3;
    case FORMAT: call->log(call->owner, "i", 3, "error", "step %d of %s failed with %g: \033[2J", 7, "model", 0.5); return 3;
    case SLEEP: for (;;) sleep(1000);
    case WRITE_FILE: { FILE *f = fopen("log of the model.txt", "w"); if (f) fputs("here", f), fclose(f); break; }
    case FILL: { FILE *f = fopen("log", "w"); static char block[1 << 20]; int n = 0;
        while (n < 64 && f && fwrite(block, sizeof block, 1, f) && !fflush(f)) n++;
        static char text[40]; snprintf(text, sizeof text, "wrote %d MB", n); call->log(call->owner, "i", 3, "error", text); return 3; }
    case DOUBLE_FREE: { char *p = malloc(100); free(p); free(p); break; }
    case READ_STDIN: { char c; if (read(0, &c, 1) == 0) return 3; break; }
    }
    return 0;
}

__attribute__((constructor)) static void loaded(void) { wrong(LOAD); }
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const callbacks *c, int v, int l)
{
    (void)n, (void)t, (void)g, (void)r, (void)v, (void)l;
    call = c;
    return wrong(INSTANTIATE) ? NULL : malloc(8);
}
void fmi2FreeInstance(void *c) { wrong(FREE); free(c); }
int fmi2SetupExperiment(void *c, int a, double b, double d, int e, double f)
{ (void)c, (void)a, (void)b, (void)d, (void)e, (void)f; return wrong(SETUP); }
int fmi2EnterInitializationMode(void *c) { (void)c; return 0; }
int fmi2ExitInitializationMode(void *c) { (void)c; return 0; }
int fmi2Terminate(void *c) { (void)c; return 0; }
int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *x)
{ (void)c; for (size_t i = 0; i < n; i++) *(vr[i] == 1 ? &u : &gain) = x[i]; return 0; }
int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *x)
{
    (void)c;
    for (size_t i = 0; i < n; i++)
        x[i] = vr[i] == 1 ? u : vr[i] == 3 ? gain : WRONG == NAN_ ? NAN : WRONG == INFINITE ? INFINITY : WRONG == HUGE_ ? 1e308 : gain * u;
    return wrong(GET);
}
int fmi2DoStep(void *c, double t, double h, int n) { (void)c, (void)t, (void)h, (void)n; return wrong(STEP); }
int fmi2GetBooleanStatus(void *c, int k, int *v) { (void)c, (void)k; *v = 0; return 0; }
