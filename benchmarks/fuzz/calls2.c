/* FMI 2.0 in any order, with right and wrong arguments; see calls.h. */
#include "calls.h"
#include "fmi2Functions.h"

static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)e, (void)name, (void)status, (void)category, (void)text;
}

static _Thread_local int trying; /* how many values there are */

/* Long runs: why a call failed, in the words of the FMU. */
static void tell(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)e, (void)name, (void)category;
    if (status > fmi2Warning && !trying) fprintf(stderr, "%s\n", text);
}

static const fmi2CallbackFunctions callbacks = {quiet, calloc, free, NULL, NULL};
static const fmi2CallbackFunctions telling = {tell, calloc, free, NULL, NULL};

typedef struct {
    fmi2Component c;
    fmi2FMUstate state[3];
    fmi2Byte *bytes;
    size_t size;
    double t;
    int co_simulation, phase;
} rig;

/* What an importer would do next. */
static void proper(dice *d, rig *r)
{
    fmi2EventInfo info;
    fmi2Boolean enter, end;
    switch (r->phase) {
    case 0: fmi2SetupExperiment(r->c, one_in(d, 2), 1e-4, 0, one_in(d, 4), 1); break;
    case 1: fmi2EnterInitializationMode(r->c); break;
    case 2: fmi2ExitInitializationMode(r->c); break;
    default:
        if (r->co_simulation) {
            const double h = step_size(d);
            if (fmi2DoStep(r->c, r->t, h, one_in(d, 2)) <= fmi2Warning) r->t += h;
        } else if (r->phase % 5 == 3) {
            fmi2NewDiscreteStates(r->c, &info);
            fmi2EnterContinuousTimeMode(r->c);
        } else if (r->phase % 5 == 4) {
            fmi2SetTime(r->c, r->t += step_size(d));
        } else if (r->phase % 5 == 0) {
            fmi2CompletedIntegratorStep(r->c, one_in(d, 2), &enter, &end);
        } else if (r->phase % 5 == 2) {
            fmi2EnterEventMode(r->c);
        }
    }
    r->phase++;
}

static void values(dice *d, rig *r)
{
    const size_t n = length(d);
    unsigned *const vr = slots(d, n);
    double *const real = numbers(d, n);
    int *const whole = integers(d, n);
    fmi2String *const text = room(d, n, sizeof *text);
    switch (below(d, 11)) {
    case 0: fmi2GetInteger(r->c, vr, n, whole); break;
    case 1: fmi2SetInteger(r->c, vr, n, whole); break;
    case 2: fmi2GetBoolean(r->c, vr, n, whole); break;
    case 3: fmi2SetBoolean(r->c, vr, n, whole); break;
    case 4: fmi2GetString(r->c, vr, n, text); break;
    case 5: fmi2SetString(r->c, vr, n, text); break;
    case 6: fmi2SetRealInputDerivatives(r->c, vr, n, whole, real); break;
    case 7: fmi2GetRealOutputDerivatives(r->c, vr, n, whole, real); break;
    case 8: case 9: fmi2SetReal(r->c, vr, n, real); break;
    default: fmi2GetReal(r->c, vr, n, real);
    }
    free(vr), free(real), free(whole), free(text);
}

static void derivatives(dice *d, rig *r)
{
    const size_t n_unknown = length(d), n_known = length(d);
    unsigned *const unknown = slots(d, n_unknown), *const known = slots(d, n_known);
    double *const seed = numbers(d, n_known), *const result = numbers(d, n_unknown);
    fmi2GetDirectionalDerivative(r->c, unknown, n_unknown, known, n_known, seed, result);
    free(unknown), free(known), free(seed), free(result);
}

static void states(dice *d, rig *r)
{
    fmi2FMUstate *const state = &r->state[below(d, 3)];
    switch (below(d, 7)) {
    case 0: case 1: fmi2GetFMUstate(r->c, one_in(d, 50) ? NULL : state); break;
    case 2: fmi2SetFMUstate(r->c, *state); break;
    case 3: fmi2FreeFMUstate(r->c, one_in(d, 50) ? NULL : state); break;
    case 4:
        free(r->bytes);
        r->bytes = NULL;
        if (!*state || fmi2SerializedFMUstateSize(r->c, *state, &r->size)) break;
        r->bytes = calloc(r->size, 1);
        if (one_in(d, 5)) r->size -= below(d, (unsigned)r->size);
        fmi2SerializeFMUstate(r->c, *state, r->bytes, r->size);
        break;
    case 5:
        if (r->bytes && one_in(d, 2)) r->bytes[below(d, (unsigned)r->size)] ^= (fmi2Byte)(1 << below(d, 8));
        break;
    default:
        fmi2FreeFMUstate(r->c, state);
        fmi2DeSerializeFMUstate(r->c, r->bytes, r->bytes ? r->size : 0, state);
    }
}

static void solver(dice *d, rig *r)
{
    const size_t n = length(d);
    double *const x = numbers(d, n);
    fmi2EventInfo info;
    fmi2Boolean flags[2];
    switch (below(d, 10)) {
    case 0: fmi2SetTime(r->c, number(d)); break;
    case 1: fmi2SetContinuousStates(r->c, x, n); break;
    case 2: fmi2GetContinuousStates(r->c, x, n); break;
    case 3: fmi2GetDerivatives(r->c, x, n); break;
    case 4: fmi2GetEventIndicators(r->c, x, n); break;
    case 5: fmi2GetNominalsOfContinuousStates(r->c, x, n); break;
    case 6: fmi2CompletedIntegratorStep(r->c, one_in(d, 2), one_in(d, 20) ? NULL : flags, flags + 1); break;
    case 7: fmi2NewDiscreteStates(r->c, one_in(d, 20) ? NULL : &info); break;
    case 8: fmi2EnterEventMode(r->c); break;
    default: fmi2EnterContinuousTimeMode(r->c);
    }
    free(x);
}

static void modes(dice *d, rig *r)
{
    fmi2Status told;
    fmi2Real real;
    fmi2Integer whole;
    fmi2Boolean truth;
    fmi2String text;
    const fmi2String categories[] = {"logEvents", "nonsense"};
    const int kind = (int)below(d, 5);
    switch (below(d, 14)) {
    case 0: fmi2SetupExperiment(r->c, one_in(d, 2), number(d), number(d), one_in(d, 2), number(d)); break;
    case 1: fmi2EnterInitializationMode(r->c); break;
    case 2: fmi2ExitInitializationMode(r->c); break;
    case 3: if (one_in(d, 5)) fmi2Terminate(r->c); break;
    case 4: fmi2CancelStep(r->c); break;
    case 5: fmi2GetStatus(r->c, kind, &told); break;
    case 6: fmi2GetRealStatus(r->c, kind, &real); break;
    case 7: fmi2GetIntegerStatus(r->c, kind, &whole); break;
    case 8: fmi2GetBooleanStatus(r->c, kind, &truth); break;
    case 9: fmi2GetStringStatus(r->c, kind, &text); break;
    case 10: fmi2SetDebugLogging(r->c, one_in(d, 2), below(d, 3), categories); break;
    case 11: fmi2DoStep(r->c, r->t, step_size(d), one_in(d, 2)); break;
    case 12: fmi2DoStep(r->c, number(d), fmin(number(d), 0.1), one_in(d, 2)); break;
    default:
        if (one_in(d, 3) && fmi2Reset(r->c) == fmi2OK) r->phase = 0, r->t = 0;
    }
}

static void order(dice *d)
{
    rig r = {0};
    const int n = 10 + (int)below(d, 40);
    r.co_simulation = one_in(d, 2);
    r.c = fmi2Instantiate("one", r.co_simulation ? fmi2CoSimulation : fmi2ModelExchange, one_in(d, 500) ? "wrong" : the_token,
                          one_in(d, 10) ? NULL : "", &callbacks, 0, one_in(d, 2));
    for (int k = 0; k < n && r.c; k++, d->calls++) {
        switch (below(d, 10)) {
        case 0: case 1: values(d, &r); break;
        case 2: derivatives(d, &r); break;
        case 3: states(d, &r); break;
        case 4: solver(d, &r); break;
        case 5: modes(d, &r); break;
        default: proper(d, &r);
        }
    }
    for (int i = 0; r.c && i < 3; i++) fmi2FreeFMUstate(r.c, &r.state[i]);
    free(r.bytes);
    fmi2FreeInstance(r.c);
}

/* A forward Euler method in the part of the importer; inputs of the block are moved as a recording would. */
static int exchanged(fmi2Component c, int n)
{
    double x[64], dx[64], z[64];
    fmi2EventInfo info;
    fmi2Boolean enter, end;
    size_t n_x = 0, n_z = 0;
    trying = 1;
    while (n_x < 64 && fmi2GetNominalsOfContinuousStates(c, x, n_x) > fmi2Warning) n_x++;
    if (fmi2NewDiscreteStates(c, &info) > fmi2Warning || fmi2EnterContinuousTimeMode(c)) return 4;
    while (n_z < 64 && fmi2GetEventIndicators(c, z, n_z) > fmi2Warning) n_z++;
    trying = 0;
    if (n_x == 64 || n_z == 64) return 5;
    for (int k = 0; k < n; k++) {
        if (fmi2SetTime(c, k * 1e-5) > fmi2Warning || fmi2GetContinuousStates(c, x, n_x) > fmi2Warning) return 6;
        if (fmi2GetDerivatives(c, dx, n_x) > fmi2Warning || fmi2GetEventIndicators(c, z, n_z) > fmi2Warning) return 7;
        for (size_t i = 0; i < n_x; i++) x[i] += 1e-5 * dx[i];
        if (fmi2SetContinuousStates(c, x, n_x) > fmi2Warning || fmi2CompletedIntegratorStep(c, 1, &enter, &end) > fmi2Warning) return 8;
        if (k % 100 && !enter) continue;
        if (fmi2EnterEventMode(c) || fmi2NewDiscreteStates(c, &info) > fmi2Warning || fmi2EnterContinuousTimeMode(c)) return 9;
    }
    return 0;
}

static int steps(int co_simulation, int n)
{
    int code = 0;
    fmi2Component c = fmi2Instantiate("one", co_simulation ? fmi2CoSimulation : fmi2ModelExchange, the_token, "", &telling, 0, 0);
    if (!c || fmi2SetupExperiment(c, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(c) || fmi2ExitInitializationMode(c)) return 1;
    if (!co_simulation) code = exchanged(c, n);
    for (int k = 0; co_simulation && k < n && !code; k++)
        if (fmi2DoStep(c, k * 1e-4, 1e-4, 1) > fmi2Warning) code = 2;
    fmi2FreeInstance(c);
    return code;
}
