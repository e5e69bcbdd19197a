/* FMI 2.0.x, Model Exchange and Co-Simulation. Each function: is it legal here, then one call into hy_fmi.c. */
#include "fmi2Functions.h"
#include "hy_fmi.h"

enum {
    READABLE = INITIALIZATION | RUNNING | STOPPED,
    SETTABLE = INSTANTIATED | INITIALIZATION | RUNNING,
    STEPPED = STEP | STEP_DISCARDED | TERMINATED
};

#define FMI(Name) fmi2##Name
#define FMU_STATE(action, what) fmi2##action##FMUstate##what
#define READ_FMU_STATE fmi2DeSerializeFMUstate
#define GET_STATE_DERIVATIVES fmi2GetDerivatives
#define CALLS(CALL) \
    CALL(SET_DEBUG_LOGGING, "fmi2SetDebugLogging", ANYWHERE, 0) \
    CALL(SETUP_EXPERIMENT, "fmi2SetupExperiment", INSTANTIATED, 0) \
    CALL(ENTER_INITIALIZATION, "fmi2EnterInitializationMode", INSTANTIATED, 0) \
    CALL(EXIT_INITIALIZATION, "fmi2ExitInitializationMode", INITIALIZATION, 0) \
    CALL(TERMINATE, "fmi2Terminate", RUNNING | STEP_DISCARDED, 0) \
    CALL(RESET, "fmi2Reset", ANYWHERE, 0) \
    CALL(GET_REAL, "fmi2GetReal", READABLE, 0) \
    CALL(GET_INTEGER, "fmi2GetInteger", READABLE, 0) \
    CALL(GET_BOOLEAN, "fmi2GetBoolean", READABLE, 0) \
    CALL(GET_STRING, "fmi2GetString", READABLE, 0) \
    CALL(SET_REAL, "fmi2SetReal", SETTABLE, 0) \
    CALL(SET_INTEGER, "fmi2SetInteger", SETTABLE, 0) \
    CALL(SET_BOOLEAN, "fmi2SetBoolean", SETTABLE, 0) \
    CALL(SET_STRING, "fmi2SetString", SETTABLE, 0) \
    CALL(GET_STATE, "fmi2GetFMUstate", ANYWHERE, 0) \
    CALL(SET_STATE, "fmi2SetFMUstate", ANYWHERE, 0) \
    CALL(FREE_STATE, "fmi2FreeFMUstate", ANYWHERE, 0) \
    CALL(STATE_SIZE, "fmi2SerializedFMUstateSize", ANYWHERE, 0) \
    CALL(WRITE_STATE, "fmi2SerializeFMUstate", ANYWHERE, 0) \
    CALL(READ_STATE, "fmi2DeSerializeFMUstate", ANYWHERE, 0) \
    CALL(DIRECTIONAL, "fmi2GetDirectionalDerivative", READABLE, 0) \
    CALL(ENTER_EVENT, "fmi2EnterEventMode", EVENT | CONTINUOUS, MODEL_EXCHANGE) \
    CALL(NEW_DISCRETE_STATES, "fmi2NewDiscreteStates", EVENT, MODEL_EXCHANGE) \
    CALL(ENTER_CONTINUOUS, "fmi2EnterContinuousTimeMode", EVENT, MODEL_EXCHANGE) \
    CALL(COMPLETED_STEP, "fmi2CompletedIntegratorStep", CONTINUOUS, MODEL_EXCHANGE) \
    CALL(SET_TIME, "fmi2SetTime", EVENT | CONTINUOUS, MODEL_EXCHANGE) \
    CALL(SET_STATES, "fmi2SetContinuousStates", CONTINUOUS, MODEL_EXCHANGE) \
    CALL(GET_DERIVATIVES, "fmi2GetDerivatives", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_INDICATORS, "fmi2GetEventIndicators", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_STATES, "fmi2GetContinuousStates", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_NOMINALS, "fmi2GetNominalsOfContinuousStates", INSTANTIATED | SHOWN, MODEL_EXCHANGE) \
    CALL(INPUT_DERIVATIVES, "fmi2SetRealInputDerivatives", INSTANTIATED | INITIALIZATION | STEP, CO_SIMULATION) \
    CALL(OUTPUT_DERIVATIVES, "fmi2GetRealOutputDerivatives", STEPPED, CO_SIMULATION) \
    CALL(DO_STEP, "fmi2DoStep", STEP, CO_SIMULATION) \
    CALL(CANCEL_STEP, "fmi2CancelStep", NOWHERE, CO_SIMULATION) \
    CALL(GET_STATUS, "fmi2GetStatus", STEPPED, CO_SIMULATION) \
    CALL(GET_REAL_STATUS, "fmi2GetRealStatus", STEPPED, CO_SIMULATION) \
    CALL(GET_INTEGER_STATUS, "fmi2GetIntegerStatus", STEPPED, CO_SIMULATION) \
    CALL(GET_BOOLEAN_STATUS, "fmi2GetBooleanStatus", STEPPED, CO_SIMULATION) \
    CALL(GET_STRING_STATUS, "fmi2GetStringStatus", STEPPED, CO_SIMULATION)
#include "fmi_common.h"

static void forward_log(const hy_instance *c, int code, const char *category, const char *text)
{
    char plain[400]; /* the logger takes a printf format: no percent sign may reach it */
    size_t i = 0;
    fmi2CallbackLogger logger = (fmi2CallbackLogger)c->callback;
    for (; text[i] && i + 1 < sizeof plain; i++) plain[i] = text[i] == '%' ? '#' : text[i];
    plain[i] = 0;
    if (logger) logger(c->environment, c->name, status(code), category, plain);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    hy_instance *instance;
    (void)resources;
    (void)visible;
    if (!functions || (type != fmi2ModelExchange && type != fmi2CoSimulation)) return NULL;
    instance = hy_new_instance(name, token, type == fmi2ModelExchange ? MODEL_EXCHANGE : CO_SIMULATION, forward_log,
                               (void (*)(void))functions->logger, functions->componentEnvironment);
    if (instance) instance->logging = logging;
    return instance;
}

fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    CHECK(SETUP_EXPERIMENT);
    (void)tolerance_defined; /* fixed step: the tolerance has nothing to act on */
    (void)tolerance;
    return status(hy_setup(c, start, stop_defined, stop));
}

FUNCTION(fmi2EnterInitializationMode, ENTER_INITIALIZATION, (void *instance), hy_enter(c, INITIALIZATION))

/* ---- values ---- */

#define VALUES(Type, value) (void *instance, const unsigned vr[], size_t n, Type value[])
FUNCTION(fmi2GetReal, GET_REAL, VALUES(double, value), hy_get(c, "fmi2GetReal", vr, n, REAL, value))
FUNCTION(fmi2SetReal, SET_REAL, VALUES(const double, value), hy_set(c, "fmi2SetReal", vr, n, REAL, value))
FUNCTION(fmi2GetInteger, GET_INTEGER, VALUES(int, value),
         hy_get_whole(c, "fmi2GetInteger", vr, n, INTEGER, value, sizeof *value))
FUNCTION(fmi2SetInteger, SET_INTEGER, VALUES(const int, value),
         hy_set_whole(c, "fmi2SetInteger", vr, n, INTEGER, value, sizeof *value))
FUNCTION(fmi2GetBoolean, GET_BOOLEAN, VALUES(int, value),
         hy_get_whole(c, "fmi2GetBoolean", vr, n, BOOLEAN, value, sizeof *value))
FUNCTION(fmi2SetBoolean, SET_BOOLEAN, VALUES(const int, value),
         hy_set_whole(c, "fmi2SetBoolean", vr, n, BOOLEAN, value, sizeof *value))
FUNCTION(fmi2GetString, GET_STRING, VALUES(fmi2String, value), hy_get_texts(c, "fmi2GetString", vr, n, value))
FUNCTION(fmi2SetString, SET_STRING, VALUES(const fmi2String, value),
         ((void)value, hy_set_texts(c, "fmi2SetString", vr, n)))

FUNCTION(fmi2GetDirectionalDerivative, DIRECTIONAL,
         (void *instance, const unsigned unknown[], size_t n_unknown, const unsigned known[], size_t n_known,
          const double seed[], double sensitivity[]),
         hy_directional(c, unknown, n_unknown, known, n_known, seed, sensitivity))

/* ---- model exchange ---- */

FUNCTION(fmi2EnterEventMode, ENTER_EVENT, (void *instance), hy_enter(c, EVENT))

fmi2Status fmi2NewDiscreteStates(fmi2Component instance, fmi2EventInfo *info)
{
    int changed = 0, defined = 0, code;
    CHECK(NEW_DISCRETE_STATES);
    NEED(NEW_DISCRETE_STATES, info);
    code = hy_new_discrete_states(c, &changed, &defined, &info->nextEventTime);
    info->newDiscreteStatesNeeded = fmi2False; /* the iteration has been carried to its end */
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = changed;
    info->nextEventTimeDefined = defined;
    return status(code);
}

/* ---- co-simulation ---- */

FUNCTION(fmi2SetRealInputDerivatives, INPUT_DERIVATIVES,
         (void *instance, const unsigned vr[], size_t n, const int order[], const double value[]),
         hy_input_derivatives(c, vr, n, order, value))

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component instance, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    CHECK(OUTPUT_DERIVATIVES);
    (void)vr;
    (void)order;
    (void)value;
    return n ? status(hy_fail(c, "output derivatives are not provided (maxOutputDerivativeOrder is 0)")) : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state)
{
    double reached;
    int event;
    CHECK(DO_STEP);
    (void)no_set_state;
    return status(hy_do_step(c, t, h, 0, NULL, &reached, &event));
}

FUNCTION(fmi2CancelStep, CANCEL_STEP, (void *instance), FMI_ERROR) /* never legal: steps are not asynchronous */

/* What is known after a step. asked: the only kind of question that has an answer. */
#define STATUS_FUNCTION(Name, which, Type, asked, answer) \
    fmi2Status fmi2Get##Name##Status(fmi2Component instance, const fmi2StatusKind kind, Type *value) \
    { \
        CHECK(which); \
        NEED(which, value); \
        if (kind != asked) return fmi2Discard; \
        *value = answer; \
        return fmi2OK; \
    }
STATUS_FUNCTION(, GET_STATUS, fmi2Status, fmi2DoStepStatus,
                c->engine.status->mode == STEP_DISCARDED ? fmi2Discard : fmi2OK)
STATUS_FUNCTION(Real, GET_REAL_STATUS, fmi2Real, fmi2LastSuccessfulTime, c->engine.status->last_time)
STATUS_FUNCTION(Boolean, GET_BOOLEAN_STATUS, fmi2Boolean, fmi2Terminated, fmi2False)
STATUS_FUNCTION(String, GET_STRING_STATUS, fmi2String, fmi2PendingStatus, "")
FUNCTION(fmi2GetIntegerStatus, GET_INTEGER_STATUS, (void *instance, const fmi2StatusKind kind, fmi2Integer *value),
         ((void)kind, (void)value, FMI_DISCARD)) /* the standard defines no integer status */
