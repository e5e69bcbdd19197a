/* FMI 2.0.x, Model Exchange and Co-Simulation. Each function: is it legal here, then one call into hy_fmi.c. */
#include <math.h>

#include "fmi2Functions.h"
#include "hy_fmi.h"

enum {
    SET_DEBUG_LOGGING, SETUP_EXPERIMENT, ENTER_INITIALIZATION, EXIT_INITIALIZATION, TERMINATE, RESET,
    GET_REAL, GET_INTEGER, GET_BOOLEAN, GET_STRING, SET_REAL, SET_INTEGER, SET_BOOLEAN, SET_STRING,
    GET_STATE, SET_STATE, FREE_STATE, STATE_SIZE, WRITE_STATE, READ_STATE, DIRECTIONAL,
    ENTER_EVENT, NEW_DISCRETE_STATES, ENTER_CONTINUOUS, COMPLETED_STEP, SET_TIME, SET_STATES,
    GET_DERIVATIVES, GET_INDICATORS, GET_STATES, GET_NOMINALS,
    INPUT_DERIVATIVES, OUTPUT_DERIVATIVES, DO_STEP, CANCEL_STEP,
    GET_STATUS, GET_REAL_STATUS, GET_INTEGER_STATUS, GET_BOOLEAN_STATUS, GET_STRING_STATUS
};

enum {
    READABLE = INITIALIZATION | RUNNING | STOPPED,
    SETTABLE = INSTANTIATED | INITIALIZATION | RUNNING,
    SHOWN = INITIALIZATION | EVENT | CONTINUOUS | TERMINATED | FAILED,
    STEPPED = STEP | STEP_DISCARDED | TERMINATED
};

static const hy_call CALL[] = {
    [SET_DEBUG_LOGGING] = {"fmi2SetDebugLogging", ANYWHERE, 0},
    [SETUP_EXPERIMENT] = {"fmi2SetupExperiment", INSTANTIATED, 0},
    [ENTER_INITIALIZATION] = {"fmi2EnterInitializationMode", INSTANTIATED, 0},
    [EXIT_INITIALIZATION] = {"fmi2ExitInitializationMode", INITIALIZATION, 0},
    [TERMINATE] = {"fmi2Terminate", RUNNING | STEP_DISCARDED, 0},
    [RESET] = {"fmi2Reset", ANYWHERE, 0},
    [GET_REAL] = {"fmi2GetReal", READABLE, 0},
    [GET_INTEGER] = {"fmi2GetInteger", READABLE, 0},
    [GET_BOOLEAN] = {"fmi2GetBoolean", READABLE, 0},
    [GET_STRING] = {"fmi2GetString", READABLE, 0},
    [SET_REAL] = {"fmi2SetReal", SETTABLE, 0},
    [SET_INTEGER] = {"fmi2SetInteger", SETTABLE, 0},
    [SET_BOOLEAN] = {"fmi2SetBoolean", SETTABLE, 0},
    [SET_STRING] = {"fmi2SetString", SETTABLE, 0},
    [GET_STATE] = {"fmi2GetFMUstate", ANYWHERE, 0},
    [SET_STATE] = {"fmi2SetFMUstate", ANYWHERE, 0},
    [FREE_STATE] = {"fmi2FreeFMUstate", ANYWHERE, 0},
    [STATE_SIZE] = {"fmi2SerializedFMUstateSize", ANYWHERE, 0},
    [WRITE_STATE] = {"fmi2SerializeFMUstate", ANYWHERE, 0},
    [READ_STATE] = {"fmi2DeSerializeFMUstate", ANYWHERE, 0},
    [DIRECTIONAL] = {"fmi2GetDirectionalDerivative", READABLE, 0},
    [ENTER_EVENT] = {"fmi2EnterEventMode", EVENT | CONTINUOUS, MODEL_EXCHANGE},
    [NEW_DISCRETE_STATES] = {"fmi2NewDiscreteStates", EVENT, MODEL_EXCHANGE},
    [ENTER_CONTINUOUS] = {"fmi2EnterContinuousTimeMode", EVENT, MODEL_EXCHANGE},
    [COMPLETED_STEP] = {"fmi2CompletedIntegratorStep", CONTINUOUS, MODEL_EXCHANGE},
    [SET_TIME] = {"fmi2SetTime", EVENT | CONTINUOUS, MODEL_EXCHANGE},
    [SET_STATES] = {"fmi2SetContinuousStates", CONTINUOUS, MODEL_EXCHANGE},
    [GET_DERIVATIVES] = {"fmi2GetDerivatives", SHOWN, MODEL_EXCHANGE},
    [GET_INDICATORS] = {"fmi2GetEventIndicators", SHOWN, MODEL_EXCHANGE},
    [GET_STATES] = {"fmi2GetContinuousStates", SHOWN, MODEL_EXCHANGE},
    [GET_NOMINALS] = {"fmi2GetNominalsOfContinuousStates", INSTANTIATED | SHOWN, MODEL_EXCHANGE},
    [INPUT_DERIVATIVES] = {"fmi2SetRealInputDerivatives", INSTANTIATED | INITIALIZATION | STEP, CO_SIMULATION},
    [OUTPUT_DERIVATIVES] = {"fmi2GetRealOutputDerivatives", STEPPED, CO_SIMULATION},
    [DO_STEP] = {"fmi2DoStep", STEP, CO_SIMULATION},
    [CANCEL_STEP] = {"fmi2CancelStep", NOWHERE, CO_SIMULATION},
    [GET_STATUS] = {"fmi2GetStatus", STEPPED, CO_SIMULATION},
    [GET_REAL_STATUS] = {"fmi2GetRealStatus", STEPPED, CO_SIMULATION},
    [GET_INTEGER_STATUS] = {"fmi2GetIntegerStatus", STEPPED, CO_SIMULATION},
    [GET_BOOLEAN_STATUS] = {"fmi2GetBooleanStatus", STEPPED, CO_SIMULATION},
    [GET_STRING_STATUS] = {"fmi2GetStringStatus", STEPPED, CO_SIMULATION},
};

#define CHECK(which) \
    hy_instance *instance = c; \
    if (!hy_allowed(instance, &CALL[which])) return fmi2Error

static fmi2Status status(int code) { return (fmi2Status)code; }

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

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    CHECK(SET_DEBUG_LOGGING);
    return status(hy_set_logging(instance, on, n, categories));
}

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

void fmi2FreeInstance(fmi2Component c) { hy_free_instance(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    CHECK(SETUP_EXPERIMENT);
    (void)tolerance_defined; /* fixed step: the tolerance has nothing to act on */
    (void)tolerance;
    return status(hy_setup(instance, start, stop_defined, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    CHECK(ENTER_INITIALIZATION);
    instance->engine.status->mode = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CHECK(EXIT_INITIALIZATION);
    return status(hy_exit_initialization(instance));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    CHECK(TERMINATE);
    instance->engine.status->mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    int kind;
    CHECK(RESET);
    kind = instance->engine.status->kind;
    hy_reset(&instance->engine);
    instance->engine.status->kind = kind;
    instance->engine.status->mode = INSTANTIATED;
    return fmi2OK;
}

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    CHECK(GET_REAL);
    return status(hy_get(instance, "fmi2GetReal", vr, n, REAL, value));
}

static fmi2Status get_whole(hy_instance *c, int which, const unsigned *vr, size_t n, int type, int *value)
{
    if (n && !value) return status(hy_fail(c, "%s: a NULL array was given", CALL[which].name));
    for (size_t i = 0; i < n; i++) {
        double number;
        const int code = hy_get(c, CALL[which].name, vr ? vr + i : NULL, 1, type, &number);
        if (code) return status(code);
        value[i] = type == BOOLEAN ? number != 0 : (int)lround(number);
    }
    return fmi2OK;
}

static double whole(int type, int value) { return type == BOOLEAN ? value != 0 : value; }

static fmi2Status set_whole(hy_instance *c, int which, const unsigned *vr, size_t n, int type, const int *value)
{
    fmi2Status worst = fmi2OK;
    if (n && (!vr || !value)) return status(hy_fail(c, "%s: a NULL array was given", CALL[which].name));
    for (size_t i = 0; i < n; i++)
        if (!hy_may_set(c, CALL[which].name, vr[i], type, whole(type, value[i]))) return fmi2Error;
    for (size_t i = 0; i < n && worst <= fmi2Warning; i++) {
        const double number = whole(type, value[i]);
        worst = status(hy_set(c, CALL[which].name, vr + i, 1, type, &number));
    }
    return worst;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    CHECK(GET_INTEGER);
    return get_whole(instance, GET_INTEGER, vr, n, INTEGER, value);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    CHECK(GET_BOOLEAN);
    return get_whole(instance, GET_BOOLEAN, vr, n, BOOLEAN, value);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    CHECK(GET_STRING);
    return status(hy_get_texts(instance, "fmi2GetString", vr, n, value));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    CHECK(SET_REAL);
    return status(hy_set(instance, "fmi2SetReal", vr, n, REAL, value));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    CHECK(SET_INTEGER);
    return set_whole(instance, SET_INTEGER, vr, n, INTEGER, value);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    CHECK(SET_BOOLEAN);
    return set_whole(instance, SET_BOOLEAN, vr, n, BOOLEAN, value);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    CHECK(SET_STRING);
    (void)value;
    return status(hy_set_texts(instance, "fmi2SetString", vr, n));
}

/* ---- states of the FMU ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    CHECK(GET_STATE);
    return status(hy_get_state(instance, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    CHECK(SET_STATE);
    return status(hy_set_state(instance, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    CHECK(FREE_STATE);
    return status(hy_free_state(instance, state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    CHECK(STATE_SIZE);
    return status(hy_state_size(instance, state, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    CHECK(WRITE_STATE);
    return status(hy_write_state(instance, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    CHECK(READ_STATE);
    return status(hy_read_state(instance, bytes, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    CHECK(DIRECTIONAL);
    return status(hy_directional(instance, unknown, n_unknown, known, n_known, seed, sensitivity));
}

/* ---- model exchange ---- */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    CHECK(ENTER_EVENT);
    instance->engine.status->mode = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    int changed = 0, defined = 0, code;
    CHECK(NEW_DISCRETE_STATES);
    if (!info) return status(hy_fail(instance, "fmi2NewDiscreteStates: a NULL pointer was given"));
    code = hy_new_discrete_states(instance, &changed, &defined, &info->nextEventTime);
    info->newDiscreteStatesNeeded = fmi2False; /* the iteration has been carried to its end */
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = changed;
    info->nextEventTimeDefined = defined;
    return status(code);
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    CHECK(ENTER_CONTINUOUS);
    return status(hy_enter_continuous(instance));
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state, fmi2Boolean *enter_event_mode,
                                       fmi2Boolean *terminate)
{
    CHECK(COMPLETED_STEP);
    (void)no_set_state;
    if (!enter_event_mode || !terminate)
        return status(hy_fail(instance, "fmi2CompletedIntegratorStep: a NULL pointer was given"));
    *enter_event_mode = *terminate = fmi2False;
    return status(hy_completed_step(instance));
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    CHECK(SET_TIME);
    return status(hy_set_time(instance, time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    CHECK(SET_STATES);
    return status(hy_set_states(instance, x, n));
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t n)
{
    CHECK(GET_DERIVATIVES);
    return status(hy_get_derivatives(instance, derivatives, n));
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n)
{
    CHECK(GET_INDICATORS);
    return status(hy_get_indicators(instance, indicators, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    CHECK(GET_STATES);
    return status(hy_get_states(instance, x, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    CHECK(GET_NOMINALS);
    return status(hy_get_nominals(instance, nominals, n));
}

/* ---- co-simulation ---- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    CHECK(INPUT_DERIVATIVES);
    return status(hy_input_derivatives(instance, vr, n, order, value));
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    CHECK(OUTPUT_DERIVATIVES);
    (void)vr;
    (void)order;
    (void)value;
    return n ? status(hy_fail(instance, "output derivatives are not provided (maxOutputDerivativeOrder is 0)")) : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state)
{
    double reached;
    int event;
    CHECK(DO_STEP);
    (void)no_set_state;
    return status(hy_do_step(instance, t, h, 0, NULL, &reached, &event));
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    CHECK(CANCEL_STEP); /* steps are never asynchronous */
    return fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    CHECK(GET_STATUS);
    if (!value) return status(hy_fail(instance, "fmi2GetStatus: a NULL pointer was given"));
    if (kind != fmi2DoStepStatus) return fmi2Discard;
    *value = instance->engine.status->mode == STEP_DISCARDED ? fmi2Discard : fmi2OK;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    CHECK(GET_REAL_STATUS);
    if (!value) return status(hy_fail(instance, "fmi2GetRealStatus: a NULL pointer was given"));
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = instance->engine.status->last_time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    CHECK(GET_INTEGER_STATUS);
    (void)kind;
    (void)value;
    return fmi2Discard; /* the standard defines no integer status */
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    CHECK(GET_BOOLEAN_STATUS);
    if (!value) return status(hy_fail(instance, "fmi2GetBooleanStatus: a NULL pointer was given"));
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    CHECK(GET_STRING_STATUS);
    if (!value) return status(hy_fail(instance, "fmi2GetStringStatus: a NULL pointer was given"));
    if (kind != fmi2PendingStatus) return fmi2Discard;
    *value = "";
    return fmi2OK;
}
