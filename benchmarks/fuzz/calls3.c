/* FMI 3.0 in any order, with right and wrong arguments; see calls.h. */
#include "calls.h"
#include "fmi3Functions.h"

static void quiet(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)e, (void)status, (void)category, (void)text;
}

/* Long runs: why a call failed, in the words of the FMU. */
static void tell(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)e, (void)category;
    if (status > fmi3Warning) fprintf(stderr, "%s\n", text);
}

typedef struct {
    dice *d;
    fmi3Instance c;
    fmi3FMUState state[3];
    fmi3Byte *bytes;
    size_t size;
    double t;
    int co_simulation, phase;
} rig;

static void values(dice *d, rig *r);

static void update(fmi3InstanceEnvironment e, fmi3Float64 t, fmi3Boolean set, fmi3Boolean get, fmi3Boolean finished,
                   fmi3Boolean may_return, fmi3Boolean *stop, fmi3Float64 *stop_time)
{
    rig *const r = e;
    (void)set, (void)get, (void)finished, (void)may_return;
    if (one_in(r->d, 4)) values(r->d, r);
    *stop = one_in(r->d, 7);
    *stop_time = one_in(r->d, 10) ? number(r->d) : t;
}

static void proper(dice *d, rig *r)
{
    fmi3Boolean flags[5];
    fmi3Float64 next;
    switch (r->phase) {
    case 0: fmi3EnterInitializationMode(r->c, one_in(d, 2), 1e-4, 0, one_in(d, 4), 1); break;
    case 1: fmi3ExitInitializationMode(r->c); break;
    case 2: fmi3UpdateDiscreteStates(r->c, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next); break;
    case 3: (void)(r->co_simulation ? fmi3EnterStepMode(r->c) : fmi3EnterContinuousTimeMode(r->c)); break;
    default:
        if (r->co_simulation) {
            if (fmi3DoStep(r->c, r->t, step_size(d), one_in(d, 2), flags, flags + 1, flags + 2, &next) <= fmi3Warning) r->t = next;
            if (one_in(d, 4)) fmi3EnterEventMode(r->c), r->phase = 1;
        } else if (r->phase % 3 == 0) {
            fmi3SetTime(r->c, r->t += step_size(d));
        } else if (r->phase % 3 == 1) {
            fmi3CompletedIntegratorStep(r->c, one_in(d, 2), flags, flags + 1);
        } else {
            fmi3EnterEventMode(r->c);
            r->phase = 1;
        }
    }
    r->phase++;
}

static void values(dice *d, rig *r)
{
    const size_t n = length(d), n_values = one_in(d, 20) ? length(d) : n;
    unsigned *const vr = slots(d, n);
    double *const real = numbers(d, n_values);
    int *const whole = integers(d, n_values);
    fmi3Boolean *const truth = room(d, n_values, sizeof *truth);
    fmi3String *const text = room(d, n_values, sizeof *text);
    size_t *const sizes = room(d, n_values, sizeof *sizes);
    fmi3Binary *const data = room(d, n_values, sizeof *data);
    switch (below(d, 14)) {
    case 0: fmi3GetInt32(r->c, vr, n, whole, n_values); break;
    case 1: fmi3SetInt32(r->c, vr, n, whole, n_values); break;
    case 2: fmi3GetBoolean(r->c, vr, n, truth, n_values); break;
    case 3: fmi3SetBoolean(r->c, vr, n, truth, n_values); break;
    case 4: fmi3GetString(r->c, vr, n, text, n_values); break;
    case 5: fmi3SetString(r->c, vr, n, text, n_values); break;
    case 6: fmi3GetBinary(r->c, vr, n, sizes, data, n_values); break;
    case 7: fmi3SetBinary(r->c, vr, n, sizes, (const fmi3Binary *)data, n_values); break;
    case 8: fmi3GetOutputDerivatives(r->c, vr, n, whole, real, n_values); break;
    case 9: fmi3GetClock(r->c, vr, n_values < n ? 0 : n, truth); break;
    case 10: case 11: fmi3SetFloat64(r->c, vr, n, real, n_values); break;
    default: fmi3GetFloat64(r->c, vr, n, real, n_values);
    }
    free(vr), free(real), free(whole), free(truth), free(text), free(sizes), free(data);
}

static void derivatives(dice *d, rig *r)
{
    const size_t n_unknown = length(d), n_known = length(d), n_seed = one_in(d, 20) ? length(d) : n_known;
    const size_t n_result = one_in(d, 20) ? length(d) : n_unknown;
    unsigned *const unknown = slots(d, n_unknown), *const known = slots(d, n_known);
    double *const seed = numbers(d, n_seed), *const result = numbers(d, n_result);
    if (one_in(d, 2))
        fmi3GetDirectionalDerivative(r->c, unknown, n_unknown, known, n_known, seed, n_seed, result, n_result);
    else
        fmi3GetAdjointDerivative(r->c, known, n_known, unknown, n_unknown, seed, n_seed, result, n_result);
    free(unknown), free(known), free(seed), free(result);
}

static void states(dice *d, rig *r)
{
    fmi3FMUState *const state = &r->state[below(d, 3)];
    switch (below(d, 7)) {
    case 0: case 1: fmi3GetFMUState(r->c, one_in(d, 50) ? NULL : state); break;
    case 2: fmi3SetFMUState(r->c, *state); break;
    case 3: fmi3FreeFMUState(r->c, one_in(d, 50) ? NULL : state); break;
    case 4:
        free(r->bytes);
        r->bytes = NULL;
        if (!*state || fmi3SerializedFMUStateSize(r->c, *state, &r->size)) break;
        r->bytes = calloc(r->size, 1);
        if (one_in(d, 5)) r->size -= below(d, (unsigned)r->size);
        fmi3SerializeFMUState(r->c, *state, r->bytes, r->size);
        break;
    case 5:
        if (r->bytes && one_in(d, 2)) r->bytes[below(d, (unsigned)r->size)] ^= (fmi3Byte)(1 << below(d, 8));
        break;
    default:
        fmi3FreeFMUState(r->c, state);
        fmi3DeserializeFMUState(r->c, r->bytes, r->bytes ? r->size : 0, state);
    }
}

static void solver(dice *d, rig *r)
{
    size_t n = length(d);
    double *const x = numbers(d, n), next;
    fmi3Boolean flags[5];
    double *const time = one_in(d, 20) ? NULL : &next;
    switch (below(d, 12)) {
    case 0: fmi3SetTime(r->c, number(d)); break;
    case 1: fmi3SetContinuousStates(r->c, x, n); break;
    case 2: fmi3GetContinuousStates(r->c, x, n); break;
    case 3: fmi3GetContinuousStateDerivatives(r->c, x, n); break;
    case 4: fmi3GetEventIndicators(r->c, x, n); break;
    case 5: fmi3GetNominalsOfContinuousStates(r->c, x, n); break;
    case 6: fmi3CompletedIntegratorStep(r->c, one_in(d, 2), one_in(d, 20) ? NULL : flags, flags + 1); break;
    case 7: fmi3UpdateDiscreteStates(r->c, flags, flags + 1, flags + 2, flags + 3, flags + 4, time); break;
    case 8: fmi3EnterEventMode(r->c); break;
    case 9: (void)(one_in(d, 2) ? fmi3GetNumberOfContinuousStates(r->c, &n) : fmi3GetNumberOfEventIndicators(r->c, &n)); break;
    case 10: fmi3EvaluateDiscreteStates(r->c); break;
    default: fmi3EnterContinuousTimeMode(r->c);
    }
    free(x);
}

static void modes(dice *d, rig *r)
{
    fmi3Boolean flags[3];
    fmi3Float64 reached;
    size_t n = 0, elements[4], elements_of[4];
    fmi3ValueReference found[4];
    fmi3DependencyKind kinds[4];
    const fmi3String categories[] = {"logEvents", "nonsense"};
    switch (below(d, 13)) {
    case 0: fmi3EnterInitializationMode(r->c, one_in(d, 2), number(d), number(d), one_in(d, 2), number(d)); break;
    case 1: fmi3ExitInitializationMode(r->c); break;
    case 2: fmi3EnterStepMode(r->c); break;
    case 3: if (one_in(d, 5)) fmi3Terminate(r->c); break;
    case 4: fmi3EnterConfigurationMode(r->c); break;
    case 5: fmi3ExitConfigurationMode(r->c); break;
    case 6: fmi3SetDebugLogging(r->c, one_in(d, 2), below(d, 3), categories); break;
    case 7: fmi3DoStep(r->c, r->t, step_size(d), one_in(d, 2), flags, flags + 1, flags + 2, &reached); break;
    case 8: fmi3DoStep(r->c, number(d), fmin(number(d), 0.1), one_in(d, 2), flags, flags + 1, flags + 2, one_in(d, 5) ? NULL : &reached); break;
    case 9: fmi3ActivateModelPartition(r->c, slot(d), number(d)); break;
    case 10: fmi3GetNumberOfVariableDependencies(r->c, slot(d), &n); break;
    case 11: fmi3GetVariableDependencies(r->c, slot(d), elements, found, elements_of, kinds, below(d, 5)); break;
    default:
        if (one_in(d, 3) && fmi3Reset(r->c) == fmi3OK) r->phase = 0, r->t = 0;
    }
}

static void order(dice *d)
{
    rig r = {0};
    const int n = 10 + (int)below(d, 40);
    const char *const token = one_in(d, 500) ? "wrong" : the_token;
    r.d = d;
    r.co_simulation = one_in(d, 2);
    r.c = r.co_simulation ? fmi3InstantiateCoSimulation("one", token, NULL, false, one_in(d, 2), one_in(d, 2), one_in(d, 2), NULL, 0,
                                                        &r, quiet, one_in(d, 2) ? update : NULL)
                          : fmi3InstantiateModelExchange("one", token, NULL, false, one_in(d, 2), &r, quiet);
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
    for (int i = 0; r.c && i < 3; i++) fmi3FreeFMUState(r.c, &r.state[i]);
    free(r.bytes);
    fmi3FreeInstance(r.c);
}

static int exchanged(fmi3Instance c, int n)
{
    double x[64], dx[64], z[64], next;
    fmi3Boolean flags[5];
    size_t n_x = 0, n_z = 0;
    if (fmi3GetNumberOfContinuousStates(c, &n_x) || fmi3GetNumberOfEventIndicators(c, &n_z) || n_x > 64 || n_z > 64) return 5;
    if (fmi3UpdateDiscreteStates(c, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next) > fmi3Warning) return 4;
    if (fmi3EnterContinuousTimeMode(c)) return 4;
    for (int k = 0; k < n; k++) {
        if (fmi3SetTime(c, k * 1e-5) > fmi3Warning || fmi3GetContinuousStates(c, x, n_x) > fmi3Warning) return 6;
        if (fmi3GetContinuousStateDerivatives(c, dx, n_x) > fmi3Warning || fmi3GetEventIndicators(c, z, n_z) > fmi3Warning) return 7;
        for (size_t i = 0; i < n_x; i++) x[i] += 1e-5 * dx[i];
        if (fmi3SetContinuousStates(c, x, n_x) > fmi3Warning) return 8;
        if (fmi3CompletedIntegratorStep(c, true, flags, flags + 1) > fmi3Warning) return 8;
        if (k % 100 && !flags[0]) continue;
        if (fmi3EnterEventMode(c) || fmi3UpdateDiscreteStates(c, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next) > fmi3Warning
            || fmi3EnterContinuousTimeMode(c))
            return 9;
    }
    return 0;
}

static int steps(int co_simulation, int n)
{
    int code = 0;
    double t = 0;
    fmi3Boolean flags[3];
    fmi3Instance c = co_simulation
        ? fmi3InstantiateCoSimulation("one", the_token, NULL, false, false, false, false, NULL, 0, NULL, tell, NULL)
        : fmi3InstantiateModelExchange("one", the_token, NULL, false, false, NULL, tell);
    if (!c || fmi3EnterInitializationMode(c, false, 0, 0, false, 0) || fmi3ExitInitializationMode(c)) return 1;
    if (!co_simulation) code = exchanged(c, n);
    for (int k = 0; co_simulation && k < n && !code; k++)
        if (fmi3DoStep(c, k * 1e-4, 1e-4, true, flags, flags + 1, flags + 2, &t) > fmi3Warning) code = 2;
    fmi3FreeInstance(c);
    return code;
}
