/* Drives the FMI 3.0 functions of one model, right and wrong, under a memory checker: argv[1] steps, argv[2] token. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi3Functions.h"

static int messages, updates;

static void quiet(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)e, (void)status, (void)category;
    messages += text[0] != 0;
}

static void update(fmi3InstanceEnvironment e, fmi3Float64 t, fmi3Boolean set, fmi3Boolean get, fmi3Boolean finished,
                   fmi3Boolean may_return, fmi3Boolean *stop, fmi3Float64 *stop_time)
{
    (void)e, (void)set, (void)get, (void)finished, (void)may_return;
    *stop = ++updates % 7 == 0;
    *stop_time = t;
}

static void wrong_calls(fmi3Instance c)
{
    const fmi3ValueReference far[] = {123456};
    const fmi3Float64 nan_[] = {NAN};
    const fmi3Int32 whole[] = {1};
    const fmi3Boolean truth[] = {true};
    fmi3Float64 out[1];
    fmi3Int32 number[1];
    fmi3Boolean yes[5];
    fmi3FMUState state = NULL;
    fmi3String text[1];
    size_t size;
    fmi3SetFloat64(c, far, 1, nan_, 1);
    fmi3GetFloat64(c, far, 1, out, 1);
    fmi3GetFloat64(c, far, 1, out, 7);
    fmi3GetFloat64(c, NULL, 1, NULL, 1);
    fmi3GetInt32(c, far, 1, number, 1);
    fmi3GetInt32(c, far, 1, NULL, 1);
    fmi3SetInt32(c, far, 1, whole, 1);
    fmi3GetBoolean(c, far, 1, yes, 1);
    fmi3SetBoolean(c, NULL, 1, truth, 1);
    fmi3GetString(c, far, 1, text, 1);
    fmi3GetBinary(c, far, 1, NULL, NULL, 1);
    fmi3SetUInt64(c, far, 1, NULL, 1);
    fmi3DoStep(c, NAN, NAN, true, yes, yes + 1, yes + 2, out);
    fmi3DoStep(c, 0, -1, true, yes, yes + 1, yes + 2, out);
    fmi3DoStep(c, 0, 1, true, NULL, NULL, NULL, NULL);
    fmi3SetTime(c, NAN);
    fmi3SetContinuousStates(c, NULL, 99);
    fmi3GetContinuousStates(c, NULL, 99);
    fmi3GetContinuousStateDerivatives(c, NULL, 99);
    fmi3GetEventIndicators(c, NULL, 99);
    fmi3GetNominalsOfContinuousStates(c, NULL, 99);
    fmi3GetNumberOfContinuousStates(c, NULL);
    fmi3CompletedIntegratorStep(c, true, NULL, NULL);
    fmi3UpdateDiscreteStates(c, NULL, NULL, NULL, NULL, NULL, NULL);
    fmi3SerializedFMUStateSize(c, NULL, &size);
    fmi3SetFMUState(c, NULL);
    fmi3GetFMUState(c, NULL);
    fmi3FreeFMUState(c, NULL);
    fmi3FreeFMUState(c, &state);
    fmi3DeserializeFMUState(c, NULL, 0, NULL);
    fmi3GetDirectionalDerivative(c, NULL, 1, NULL, 1, NULL, 1, NULL, 1);
    fmi3GetAdjointDerivative(c, far, 1, far, 1, nan_, 1, out, 1);
    fmi3GetVariableDependencies(c, 1, NULL, NULL, NULL, NULL, 0);
    fmi3GetOutputDerivatives(c, far, 1, whole, out, 1);
    fmi3EnterConfigurationMode(c);
    fmi3ActivateModelPartition(c, 1, 0);
    fmi3SetClock(c, far, 1, truth);
    fmi3GetIntervalDecimal(c, far, 1, out, NULL);
}

static int steps(fmi3Instance c, double *t, int n)
{
    for (int k = 0; k < n; k++) {
        fmi3Boolean event, end, early, changed[5];
        fmi3Float64 next;
        if (fmi3DoStep(c, *t, 1e-3, true, &event, &end, &early, t) > fmi3Warning) return 1;
        if (event && (fmi3EnterEventMode(c) > fmi3Warning ||
                      fmi3UpdateDiscreteStates(c, changed, changed + 1, changed + 2, changed + 3, changed + 4, &next) > fmi3Warning ||
                      fmi3EnterStepMode(c)))
            return 1;
    }
    return 0;
}

static int co_simulation(const char *token, int n)
{
    fmi3FMUState state = NULL, other = NULL;
    fmi3Boolean changed[5];
    fmi3Float64 next;
    size_t size = 0;
    fmi3Byte *bytes;
    double t = 0;
    fmi3Instance c = fmi3InstantiateCoSimulation("one", token, NULL, false, true, true, true, NULL, 0, NULL, quiet, update);
    if (!c) return 1;
    wrong_calls(c);
    if (fmi3EnterInitializationMode(c, false, 0, 0, false, 0)) return 1;
    wrong_calls(c);
    if (fmi3ExitInitializationMode(c)) return 1;
    if (fmi3UpdateDiscreteStates(c, changed, changed + 1, changed + 2, changed + 3, changed + 4, &next)) return 2;
    if (fmi3EnterStepMode(c) || steps(c, &t, n)) return 3;
    if (fmi3GetFMUState(c, &state) || fmi3SerializedFMUStateSize(c, state, &size)) return 4;
    bytes = malloc(size);
    if (!bytes || fmi3SerializeFMUState(c, state, bytes, size) || fmi3DeserializeFMUState(c, bytes, size, &other)) return 5;
    if (fmi3SetFMUState(c, other) || steps(c, &t, 1)) return 6;
    fmi3FreeFMUState(c, &state);
    fmi3FreeFMUState(c, &other);
    free(bytes);
    wrong_calls(c);
    fmi3Terminate(c);
    wrong_calls(c);
    fmi3Reset(c);
    wrong_calls(c);
    fmi3FreeInstance(c);
    return 0;
}

static int model_exchange(const char *token)
{
    fmi3Boolean changed[5];
    fmi3Float64 next, x[64], dx[64], z[64];
    size_t n_x = 0, n_z = 0;
    fmi3Instance c = fmi3InstantiateModelExchange("two", token, NULL, false, false, NULL, quiet);
    if (!c || fmi3EnterInitializationMode(c, false, 0, 0, false, 0) || fmi3ExitInitializationMode(c)) return 7;
    if (fmi3UpdateDiscreteStates(c, changed, changed + 1, changed + 2, changed + 3, changed + 4, &next)) return 8;
    if (fmi3EnterContinuousTimeMode(c) || fmi3SetTime(c, 0.5)) return 9;
    if (fmi3GetNumberOfContinuousStates(c, &n_x) || fmi3GetNumberOfEventIndicators(c, &n_z) || n_x > 64 || n_z > 64) return 10;
    if (fmi3GetContinuousStates(c, x, n_x) || fmi3SetContinuousStates(c, x, n_x)) return 11;
    if (fmi3GetContinuousStateDerivatives(c, dx, n_x) || fmi3GetEventIndicators(c, z, n_z)) return 12;
    if (fmi3CompletedIntegratorStep(c, true, changed, changed + 1)) return 13;
    wrong_calls(c);
    fmi3FreeInstance(c);
    return 0;
}

int main(int argc, char **argv)
{
    int code;
    if (argc != 3) return 99;
    if (fmi3InstantiateCoSimulation("none", "wrong", NULL, false, false, false, false, NULL, 0, NULL, quiet, NULL)) return 98;
    code = co_simulation(argv[2], atoi(argv[1]));
    if (!code) code = model_exchange(argv[2]);
    if (!code && messages < 100) code = 97; /* the wrong calls must have been answered */
    printf("%d %d %d\n", code, messages, updates);
    return code;
}
