/* An FMU, y = gain * u and der(x) = u - x, that goes wrong in the way WRONG at the place WHERE: FMI 2.0, and model exchange
 * of FMI 3.0. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#pragma GCC visibility push(default)
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { logger log; void *(*allocate)(size_t, size_t); void (*release)(void *); void *finished, *owner; } callbacks;
enum { FINE, CRASH, ABORT, LOOP, LEAK, EXIT0, EXIT3, DIVIDE, ILLEGAL, DEEP, KILL, PRINT, NOISE, CLOSE, FORK, NAN_, INFINITE,
       HUGE_, REFUSE, FATAL, LONG_MESSAGE, NULL_MESSAGE, FORMAT, SLEEP, WRITE_FILE, DOUBLE_FREE, READ_STDIN, BAD_ALLOC, FILL,
       FLOOD, STORM, CREEP, STOP, DAEMON, BELOW, EARLY, BYTES, ENDS, INSIST };
enum { NOWHERE, LOAD, INSTANTIATE, SETUP, STEP, GET, FREE, TIME, DERIVATIVES, DISCRETE };
static const callbacks *call;
static void (*log3)(void *, int, const char *, const char *);
static double u, gain = 2, now, x;
static int begun; /* initialization mode was entered */
static volatile double sink;

static int deep(int n) { volatile char room[4096]; room[n % 4096] = (char)n; return deep(n + 1) + room[0]; }

static void say(const char *text)
{
    if (log3) log3(NULL, 1, "all", text);
    else call->log(call->owner, "i", 1, "all", text);
}

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
    case BELOW: return -5;
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
    case FLOOD: for (int i = 0; i < 1000000; i++) say("here I am"); break;
    case STOP: raise(SIGSTOP); break;
    case DAEMON: { const pid_t child = fork(); if (!child) { setsid(); if (!fork()) for (;;) pause(); _exit(0); }
        waitpid(child, NULL, 0); break; }
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
    begun = 0;
    return wrong(INSTANTIATE) ? NULL : malloc(8);
}
void fmi2FreeInstance(void *c) { wrong(FREE); free(c); }
int fmi2SetupExperiment(void *c, int a, double b, double d, int e, double f)
{ (void)c, (void)a, (void)b, (void)d, (void)e, (void)f; return wrong(SETUP); }
int fmi2EnterInitializationMode(void *c) { (void)c; begun = 1; return 0; }
int fmi2ExitInitializationMode(void *c) { (void)c; return 0; }
int fmi2Terminate(void *c) { (void)c; return 0; }
int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *value)
{ (void)c; if (WRONG == INSIST && n && vr[0] == 1 && !begun) return 3;
  for (size_t i = 0; i < n; i++) *(vr[i] == 1 ? &u : vr[i] == 4 ? &x : &gain) = value[i]; return 0; }
int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value)
{
    (void)c;
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == 4 ? x : vr[i] == 5 ? u - x : vr[i] == 1 ? u : vr[i] == 3 ? gain : WRONG == NAN_ ? NAN : WRONG == INFINITE ? INFINITY : WRONG == HUGE_ ? 1e308 : gain * u;
    return wrong(GET);
}
int fmi2DoStep(void *c, double t, double h, int n) { (void)c, (void)t, (void)h, (void)n; return wrong(STEP); }
int fmi3DoStep(void *c, double t, double h, bool n, bool *event, bool *end, bool *early, double *last)
{ (void)c, (void)n; *event = *end = false; *early = WRONG == EARLY, *last = *early ? t : t + h; return wrong(STEP); }
int fmi3GetBinary(void *c, const unsigned *vr, size_t n, size_t *sizes, const unsigned char **value, size_t m)
{ (void)c, (void)vr, (void)n, (void)m; *value = (const unsigned char *)"ab", *sizes = WRONG == BYTES ? SIZE_MAX : 2; return 0; }
int fmi2GetBooleanStatus(void *c, int k, int *v) { (void)c, (void)k; *v = 0; return 0; }

/* ---- model exchange ---- */

static int states(double *value) { *value = x; return 0; }
static int set_states(const double *value) { x = *value; return 0; }
static int derivatives(double *value) { *value = u - x; return wrong(DERIVATIVES); }
static int set_time(double t) { now = t; return wrong(TIME); }

typedef struct { int needed, terminate, nominals, values, defined; double next; } event_info;
/* STORM: the iteration of events has no end. CREEP: each event names the next one, a nanosecond ahead. */
static int discrete(event_info *e)
{
    *e = (event_info){WRONG == STORM, 0, 0, 0, WRONG == CREEP, now + 1e-9};
    return wrong(DISCRETE);
}

int fmi2EnterEventMode(void *c) { (void)c; return 0; }
int fmi2EnterContinuousTimeMode(void *c) { (void)c; return 0; }
int fmi2NewDiscreteStates(void *c, event_info *e) { (void)c; return discrete(e); }
int fmi2CompletedIntegratorStep(void *c, int a, int *event, int *end)
{ (void)c, (void)a; *event = 0, *end = WRONG == ENDS && now > 0.5; return 0; }
int fmi2SetTime(void *c, double t) { (void)c; return set_time(t); }
int fmi2SetContinuousStates(void *c, const double *v, size_t n) { (void)c, (void)n; return set_states(v); }
int fmi2GetContinuousStates(void *c, double *v, size_t n) { (void)c, (void)n; return states(v); }
int fmi2GetDerivatives(void *c, double *v, size_t n) { (void)c, (void)n; return derivatives(v); }
int fmi2GetNominalsOfContinuousStates(void *c, double *v, size_t n) { (void)c, (void)n; *v = 1; return 0; }
int fmi2GetEventIndicators(void *c, double *v, size_t n) { (void)c, (void)v, (void)n; return 0; }

const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateModelExchange(const char *n, const char *t, const char *r, bool v, bool l, void *e,
                                   void (*log)(void *, int, const char *, const char *))
{
    (void)n, (void)t, (void)r, (void)v, (void)l, (void)e;
    log3 = log;
    return malloc(8);
}
void *fmi3InstantiateCoSimulation(const char *n, const char *t, const char *r, bool v, bool l, bool e, bool early,
                                  const unsigned *given, size_t count, void *o,
                                  void (*log)(void *, int, const char *, const char *), void *update)
{ (void)e, (void)early, (void)given, (void)count, (void)update; return fmi3InstantiateModelExchange(n, t, r, v, l, o, log); }
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, bool a, double b, double t, bool d, double e)
{ (void)c, (void)a, (void)b, (void)t, (void)d, (void)e; return 0; }
int fmi3ExitInitializationMode(void *c) { (void)c; return 0; }
int fmi3Terminate(void *c) { (void)c; return 0; }
int fmi3EnterEventMode(void *c) { (void)c; return 0; }
int fmi3EnterContinuousTimeMode(void *c) { (void)c; return 0; }
int fmi3UpdateDiscreteStates(void *c, bool *needed, bool *end, bool *nominals, bool *values, bool *defined, double *next)
{
    event_info e;
    const int status = discrete(&e);
    (void)c, *needed = e.needed, *end = *nominals = *values = false, *defined = e.defined, *next = e.next;
    return status;
}
int fmi3CompletedIntegratorStep(void *c, bool a, bool *event, bool *end)
{ (void)c, (void)a; *event = false, *end = WRONG == ENDS && now > 0.5; return 0; }
int fmi3SetTime(void *c, double t) { (void)c; return set_time(t); }
int fmi3SetContinuousStates(void *c, const double *v, size_t n) { (void)c, (void)n; return set_states(v); }
int fmi3GetContinuousStates(void *c, double *v, size_t n) { (void)c, (void)n; return states(v); }
int fmi3GetContinuousStateDerivatives(void *c, double *v, size_t n) { (void)c, (void)n; return derivatives(v); }
int fmi3GetNominalsOfContinuousStates(void *c, double *v, size_t n) { (void)c, (void)n; *v = 1; return 0; }
int fmi3GetEventIndicators(void *c, double *v, size_t n) { (void)c, (void)v, (void)n; return 0; }
int fmi3SetFloat64(void *c, const unsigned *vr, size_t n, const double *value, size_t m)
{ (void)m; return fmi2SetReal(c, vr, n, value); }
int fmi3GetFloat64(void *c, const unsigned *vr, size_t n, double *value, size_t m)
{ (void)m; return fmi2GetReal(c, vr, n, value); }

/* FMPy asks for all functions of the standard. */
#define NONE(name) int name(void) { return 3; }
NONE(fmi2CancelStep) NONE(fmi2DeSerializeFMUstate) NONE(fmi2FreeFMUstate) NONE(fmi2GetBoolean)
NONE(fmi2GetDirectionalDerivative) NONE(fmi2GetFMUstate) NONE(fmi2GetInteger) NONE(fmi2GetIntegerStatus)
NONE(fmi2GetRealOutputDerivatives) NONE(fmi2GetRealStatus) NONE(fmi2GetStatus) NONE(fmi2GetString)
NONE(fmi2GetStringStatus) NONE(fmi2Reset) NONE(fmi2SerializeFMUstate) NONE(fmi2SerializedFMUstateSize)
NONE(fmi2SetBoolean) NONE(fmi2SetDebugLogging) NONE(fmi2SetFMUstate) NONE(fmi2SetInteger)
NONE(fmi2SetRealInputDerivatives) NONE(fmi2SetString)
NONE(fmi3ActivateModelPartition) NONE(fmi3DeserializeFMUState) NONE(fmi3EnterConfigurationMode)
NONE(fmi3EnterStepMode) NONE(fmi3EvaluateDiscreteStates) NONE(fmi3ExitConfigurationMode) NONE(fmi3FreeFMUState)
NONE(fmi3GetAdjointDerivative) NONE(fmi3GetBoolean) NONE(fmi3GetClock)
NONE(fmi3GetDirectionalDerivative) NONE(fmi3GetFMUState) NONE(fmi3GetFloat32) NONE(fmi3GetInt16) NONE(fmi3GetInt32)
NONE(fmi3GetInt64) NONE(fmi3GetInt8) NONE(fmi3GetIntervalDecimal) NONE(fmi3GetIntervalFraction)
NONE(fmi3GetNumberOfContinuousStates) NONE(fmi3GetNumberOfEventIndicators) NONE(fmi3GetNumberOfVariableDependencies)
NONE(fmi3GetOutputDerivatives) NONE(fmi3GetShiftDecimal) NONE(fmi3GetShiftFraction) NONE(fmi3GetString)
NONE(fmi3GetUInt16) NONE(fmi3GetUInt32) NONE(fmi3GetUInt64) NONE(fmi3GetUInt8) NONE(fmi3GetVariableDependencies)
NONE(fmi3InstantiateScheduledExecution) NONE(fmi3Reset)
NONE(fmi3SerializeFMUState) NONE(fmi3SerializedFMUStateSize) NONE(fmi3SetBinary) NONE(fmi3SetBoolean)
NONE(fmi3SetClock) NONE(fmi3SetDebugLogging) NONE(fmi3SetFMUState) NONE(fmi3SetFloat32) NONE(fmi3SetInt16)
NONE(fmi3SetInt32) NONE(fmi3SetInt64) NONE(fmi3SetInt8) NONE(fmi3SetIntervalDecimal) NONE(fmi3SetIntervalFraction)
NONE(fmi3SetShiftDecimal) NONE(fmi3SetShiftFraction) NONE(fmi3SetString) NONE(fmi3SetUInt16) NONE(fmi3SetUInt32)
NONE(fmi3SetUInt64) NONE(fmi3SetUInt8)
