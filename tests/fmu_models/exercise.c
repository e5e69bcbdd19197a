/* Drives the FMI 2.0 functions of one model, right and wrong, under a memory checker: argv[1] steps, argv[2] token. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

static int messages;

static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)e, (void)name, (void)status, (void)category;
    messages += text[0] != 0;
}

static void wrong_calls(fmi2Component c)
{
    const fmi2ValueReference far[] = {123456};
    const fmi2Real nan_[] = {NAN};
    fmi2Real out[1];
    fmi2Boolean yes;
    size_t size;
    fmi2SetReal(c, far, 1, nan_);
    fmi2GetReal(c, far, 1, out);
    fmi2GetReal(c, NULL, 1, NULL);
    fmi2GetInteger(c, far, 1, NULL);
    fmi2SetBoolean(c, NULL, 1, NULL);
    fmi2GetString(c, far, 1, NULL);
    fmi2DoStep(c, NAN, NAN, 1);
    fmi2DoStep(c, 0, -1, 1);
    fmi2SetTime(c, NAN);
    fmi2SetContinuousStates(c, NULL, 99);
    fmi2GetDerivatives(c, NULL, 99);
    fmi2GetEventIndicators(c, NULL, 99);
    fmi2CompletedIntegratorStep(c, 1, NULL, NULL);
    fmi2NewDiscreteStates(c, NULL);
    fmi2GetBooleanStatus(c, fmi2Terminated, &yes);
    fmi2SerializedFMUstateSize(c, NULL, &size);
    fmi2SetFMUstate(c, NULL);
    fmi2GetFMUstate(c, NULL);
    fmi2FreeFMUstate(c, NULL);
    fmi2DeSerializeFMUstate(c, NULL, 0, NULL);
    fmi2GetDirectionalDerivative(c, NULL, 1, NULL, 1, NULL, NULL);
    fmi2SetRealInputDerivatives(c, NULL, 1, NULL, NULL);
}

static int co_simulation(const fmi2CallbackFunctions *callbacks, const char *token, int n)
{
    fmi2FMUstate state = NULL, other = NULL;
    size_t size = 0;
    char *bytes;
    fmi2Component c = fmi2Instantiate("one", fmi2CoSimulation, token, "", callbacks, 0, 1);
    if (!c || fmi2SetupExperiment(c, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(c) || fmi2ExitInitializationMode(c)) return 1;
    for (int k = 0; k < n; k++)
        if (fmi2DoStep(c, k * 1e-3, 1e-3, 1) > fmi2Warning) return 2;
    if (fmi2GetFMUstate(c, &state) || fmi2SerializedFMUstateSize(c, state, &size)) return 3;
    bytes = malloc(size);
    if (!bytes || fmi2SerializeFMUstate(c, state, bytes, size) || fmi2DeSerializeFMUstate(c, bytes, size, &other)) return 4;
    if (fmi2SetFMUstate(c, other) || fmi2DoStep(c, n * 1e-3, 1e-3, 1) > fmi2Warning) return 5;
    fmi2FreeFMUstate(c, &state);
    fmi2FreeFMUstate(c, &other);
    free(bytes);
    wrong_calls(c);
    fmi2Terminate(c);
    wrong_calls(c);
    fmi2Reset(c);
    fmi2FreeInstance(c);
    return 0;
}

static int model_exchange(const fmi2CallbackFunctions *callbacks, const char *token)
{
    fmi2EventInfo info;
    fmi2Component c = fmi2Instantiate("two", fmi2ModelExchange, token, "", callbacks, 0, 0);
    if (!c || fmi2SetupExperiment(c, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(c) || fmi2ExitInitializationMode(c)) return 6;
    if (fmi2NewDiscreteStates(c, &info) || fmi2EnterContinuousTimeMode(c) || fmi2SetTime(c, 0.5)) return 7;
    wrong_calls(c);
    fmi2FreeInstance(c);
    return 0;
}

int main(int argc, char **argv)
{
    const fmi2CallbackFunctions callbacks = {quiet, calloc, free, NULL, NULL};
    int code;
    if (argc != 3) return 99;
    if (fmi2Instantiate("none", fmi2CoSimulation, "wrong", "", &callbacks, 0, 0)) return 98;
    code = co_simulation(&callbacks, argv[2], atoi(argv[1]));
    if (!code) code = model_exchange(&callbacks, argv[2]);
    if (!code && messages < 20) code = 97; /* the wrong calls must have been answered */
    printf("%d %d\n", code, messages);
    return code;
}
