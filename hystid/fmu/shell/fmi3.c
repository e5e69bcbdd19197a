/* FMI 3.0, Model Exchange and Co-Simulation. Each function: is it legal here, then one call into hy_fmi.c. */
#include <math.h>
#include <stdlib.h>

#include "fmi3Functions.h"
#include "hy_fmi.h"

enum {
    SET_DEBUG_LOGGING, ENTER_INITIALIZATION, EXIT_INITIALIZATION, ENTER_EVENT, TERMINATE, RESET,
    GET_VALUE, SET_VALUE, DEPENDENCIES, GET_STATE, SET_STATE, FREE_STATE, STATE_SIZE, WRITE_STATE, READ_STATE,
    DIRECTIONAL, ADJOINT, CONFIGURATION, CLOCK, EVALUATE_DISCRETE, UPDATE_DISCRETE,
    ENTER_CONTINUOUS, COMPLETED_STEP, SET_TIME, SET_STATES, GET_DERIVATIVES, GET_INDICATORS, GET_STATES, GET_NOMINALS,
    COUNT, ENTER_STEP, OUTPUT_DERIVATIVES, DO_STEP, PARTITION
};

enum {
    READABLE = INITIALIZATION | RUNNING | IN_STEP | STOPPED,
    SETTABLE = INSTANTIATED | INITIALIZATION | RUNNING | IN_STEP,
    SHOWN = INITIALIZATION | EVENT | CONTINUOUS | TERMINATED | FAILED
};

static const hy_call CALL[] = {
    [SET_DEBUG_LOGGING] = {"fmi3SetDebugLogging", ANYWHERE, 0},
    [ENTER_INITIALIZATION] = {"fmi3EnterInitializationMode", INSTANTIATED, 0},
    [EXIT_INITIALIZATION] = {"fmi3ExitInitializationMode", INITIALIZATION, 0},
    [ENTER_EVENT] = {"fmi3EnterEventMode", CONTINUOUS | STEP, 0},
    [TERMINATE] = {"fmi3Terminate", RUNNING | STEP_DISCARDED, 0},
    [RESET] = {"fmi3Reset", ANYWHERE, 0},
    [GET_VALUE] = {"fmi3Get{VariableType}", INSTANTIATED | READABLE, 0},
    [SET_VALUE] = {"fmi3Set{VariableType}", SETTABLE, 0},
    [DEPENDENCIES] = {"fmi3GetVariableDependencies", ANYWHERE, 0},
    [GET_STATE] = {"fmi3GetFMUState", ANYWHERE, 0},
    [SET_STATE] = {"fmi3SetFMUState", ANYWHERE, 0},
    [FREE_STATE] = {"fmi3FreeFMUState", ANYWHERE, 0},
    [STATE_SIZE] = {"fmi3SerializedFMUStateSize", ANYWHERE, 0},
    [WRITE_STATE] = {"fmi3SerializeFMUState", ANYWHERE, 0},
    [READ_STATE] = {"fmi3DeserializeFMUState", ANYWHERE, 0},
    [DIRECTIONAL] = {"fmi3GetDirectionalDerivative", READABLE, 0},
    [ADJOINT] = {"fmi3GetAdjointDerivative", READABLE, 0},
    [CONFIGURATION] = {"fmi3EnterConfigurationMode / fmi3ExitConfigurationMode", NOWHERE, 0},
    [CLOCK] = {"a function of clocks", INITIALIZATION | EVENT, 0},
    [EVALUATE_DISCRETE] = {"fmi3EvaluateDiscreteStates", EVENT, 0},
    [UPDATE_DISCRETE] = {"fmi3UpdateDiscreteStates", EVENT, 0},
    [ENTER_CONTINUOUS] = {"fmi3EnterContinuousTimeMode", EVENT, MODEL_EXCHANGE},
    [COMPLETED_STEP] = {"fmi3CompletedIntegratorStep", CONTINUOUS, MODEL_EXCHANGE},
    [SET_TIME] = {"fmi3SetTime", EVENT | CONTINUOUS, MODEL_EXCHANGE},
    [SET_STATES] = {"fmi3SetContinuousStates", CONTINUOUS, MODEL_EXCHANGE},
    [GET_DERIVATIVES] = {"fmi3GetContinuousStateDerivatives", SHOWN, MODEL_EXCHANGE},
    [GET_INDICATORS] = {"fmi3GetEventIndicators", SHOWN, MODEL_EXCHANGE},
    [GET_STATES] = {"fmi3GetContinuousStates", SHOWN, MODEL_EXCHANGE},
    [GET_NOMINALS] = {"fmi3GetNominalsOfContinuousStates", INSTANTIATED | SHOWN, MODEL_EXCHANGE},
    [COUNT] = {"fmi3GetNumberOf...", ANYWHERE, MODEL_EXCHANGE},
    [ENTER_STEP] = {"fmi3EnterStepMode", EVENT, CO_SIMULATION},
    [OUTPUT_DERIVATIVES] = {"fmi3GetOutputDerivatives", STEP | IN_STEP | TERMINATED, CO_SIMULATION},
    [DO_STEP] = {"fmi3DoStep", STEP, CO_SIMULATION},
    [PARTITION] = {"fmi3ActivateModelPartition", NOWHERE, 0},
};

#define CHECK(which) \
    hy_instance *c = instance; \
    if (!hy_allowed(c, &CALL[which])) return fmi3Error
#define REFUSE(...) return (fmi3Status)hy_fail(c, __VA_ARGS__)

static fmi3Status status(int code) { return (fmi3Status)code; }

static void forward_log(const hy_instance *c, int code, const char *category, const char *text)
{
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->callback;
    if (logger) logger(c->environment, status(code), category, text);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    CHECK(SET_DEBUG_LOGGING);
    return status(hy_set_logging(c, on, n, categories));
}

static hy_instance *new_instance(fmi3String name, fmi3String token, int kind, fmi3Boolean logging,
                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    hy_instance *c = hy_new_instance(name, token, kind, forward_log, (void (*)(void))logger, environment);
    if (c) c->logging = logging;
    return c;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger)
{
    (void)resources;
    (void)visible;
    return new_instance(name, token, MODEL_EXCHANGE, logging, environment, logger);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    hy_instance *c = new_instance(name, token, CO_SIMULATION, logging, environment, logger);
    (void)resources;
    (void)visible;
    (void)required; /* every variable is available in intermediate update mode */
    (void)n_required;
    if (!c) return NULL;
    c->event_mode_used = event_mode_used;
    c->early_return_allowed = early_return_allowed;
    c->update = (void (*)(void))update;
    return c;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback logger, fmi3ClockUpdateCallback clock_update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock_update, (void)lock, (void)unlock;
    if (logger) logger(environment, fmi3Error, "logStatusError", "scheduled execution is not offered by this FMU");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance) { hy_free_instance(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    int code;
    CHECK(ENTER_INITIALIZATION);
    (void)tolerance_defined; /* fixed step: the tolerance has nothing to act on */
    (void)tolerance;
    code = hy_setup(c, start, stop_defined, stop);
    if (!code) c->engine.status->mode = INITIALIZATION;
    return status(code);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    CHECK(EXIT_INITIALIZATION);
    return status(hy_exit_initialization(c));
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    CHECK(ENTER_EVENT);
    if (c->engine.status->kind == CO_SIMULATION && !c->event_mode_used)
        REFUSE("fmi3EnterEventMode: the instance was made without eventModeUsed");
    c->engine.status->mode = EVENT;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    CHECK(TERMINATE);
    c->engine.status->mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    int kind;
    CHECK(RESET);
    kind = c->engine.status->kind;
    hy_reset(&c->engine);
    c->engine.status->kind = kind;
    c->engine.status->mode = INSTANTIATED;
    return fmi3OK;
}

/* ---- values ---- */

/* The answer of a call whose references have been taken apart into those of elements, where variables are arrays. */
#define SPREAD(e, call, vr, n, n_values, answer) \
    do { \
        hy_elements e; \
        int code; \
        if (hy_spread(c, call, vr, n, n_values, &e)) return fmi3Error; \
        code = answer; \
        free(e.made); \
        return status(code); \
    } while (0)

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t n_values)
{
    CHECK(GET_VALUE);
    if (hy_has_arrays) SPREAD(e, "fmi3GetFloat64", vr, n, n_values, hy_get(c, "fmi3GetFloat64", e.vr, n_values, REAL, values));
    if (n != n_values) REFUSE("fmi3GetFloat64: %zu variables, room for %zu values", n, n_values);
    return status(hy_get(c, "fmi3GetFloat64", vr, n, REAL, values));
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    CHECK(SET_VALUE);
    if (hy_has_arrays) SPREAD(e, "fmi3SetFloat64", vr, n, n_values, hy_set(c, "fmi3SetFloat64", e.vr, n_values, REAL, values));
    if (n != n_values) REFUSE("fmi3SetFloat64: %zu variables, %zu values", n, n_values);
    return status(hy_set(c, "fmi3SetFloat64", vr, n, REAL, values));
}

/* Whole numbers of the block as values of a C type, and back. All are checked before the first is set. */
#define WHOLE_TYPE(Type, kind, FROM_NUMBER) \
    fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##Type values[], size_t n_values) \
    { \
        CHECK(GET_VALUE); \
        if (n != n_values || (n && (!vr || !values))) \
            REFUSE("fmi3Get" #Type ": %zu variables, room for %zu values", n, n_values); \
        for (size_t i = 0; i < n; i++) { \
            double number; \
            const int code = hy_get(c, "fmi3Get" #Type, vr + i, 1, kind, &number); \
            if (code) return status(code); \
            values[i] = FROM_NUMBER(number); \
        } \
        return fmi3OK; \
    } \
    fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3##Type values[], \
                             size_t n_values) \
    { \
        fmi3Status worst = fmi3OK; \
        CHECK(SET_VALUE); \
        if (n != n_values || (n && (!vr || !values))) REFUSE("fmi3Set" #Type ": %zu variables, %zu values", n, n_values); \
        for (size_t i = 0; i < n; i++) \
            if (!hy_may_set(c, "fmi3Set" #Type, vr[i], kind, (double)values[i])) return fmi3Error; \
        for (size_t i = 0; i < n && worst <= fmi3Warning; i++) { \
            const double number = (double)values[i]; \
            worst = status(hy_set(c, "fmi3Set" #Type, vr + i, 1, kind, &number)); \
        } \
        return worst; \
    }
#define TO_INT32(number) (fmi3Int32)lround(number)
#define TO_INT64(number) (fmi3Int64)llround(number)
#define TO_BOOLEAN(number) ((number) != 0)
WHOLE_TYPE(Int32, INTEGER, TO_INT32)
WHOLE_TYPE(Int64, ENUMERATION, TO_INT64)
WHOLE_TYPE(Boolean, BOOLEAN, TO_BOOLEAN)

/* Types that no variable of ours has: legal to call for no variables at all. */
#define NO_TYPE(Name, which, const_, Type) \
    fmi3Status fmi3##Name(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const_ Type values[], size_t n_values) \
    { \
        CHECK(which); \
        (void)vr, (void)values; \
        if (n || n_values) REFUSE("fmi3" #Name ": the model has no variables of this type"); \
        return fmi3OK; \
    }
#define NO_TYPES(Type) NO_TYPE(Get##Type, GET_VALUE, , fmi3##Type) NO_TYPE(Set##Type, SET_VALUE, const, fmi3##Type)
NO_TYPES(Float32)
NO_TYPES(Int8)
NO_TYPES(UInt8)
NO_TYPES(Int16)
NO_TYPES(UInt16)
NO_TYPES(UInt32)
NO_TYPES(UInt64)

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3String values[], size_t n_values)
{
    CHECK(GET_VALUE);
    if (n != n_values) REFUSE("fmi3GetString: %zu variables, room for %zu values", n, n_values);
    return status(hy_get_texts(c, "fmi3GetString", vr, n, values));
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3String values[],
                         size_t n_values)
{
    CHECK(SET_VALUE);
    (void)values;
    if (n != n_values) REFUSE("fmi3SetString: %zu variables, %zu values", n, n_values);
    return status(hy_set_texts(c, "fmi3SetString", vr, n));
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t n_values)
{
    CHECK(GET_VALUE);
    (void)vr, (void)sizes, (void)values;
    if (n || n_values) REFUSE("fmi3GetBinary: the model has no variables of this type");
    return fmi3OK;
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values)
{
    CHECK(SET_VALUE);
    (void)vr, (void)sizes, (void)values;
    if (n || n_values) REFUSE("fmi3SetBinary: the model has no variables of this type");
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t *n)
{
    CHECK(DEPENDENCIES);
    (void)vr;
    (void)n;
    REFUSE("dependencies of single elements are not provided (providesPerElementDependencies is false)");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t elements[],
                                       fmi3ValueReference independents[], size_t independent_elements[],
                                       fmi3DependencyKind kinds[], size_t n)
{
    CHECK(DEPENDENCIES);
    (void)dependent, (void)elements, (void)independents, (void)independent_elements, (void)kinds, (void)n;
    REFUSE("dependencies of single elements are not provided (providesPerElementDependencies is false)");
}

/* ---- states of the FMU ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    CHECK(GET_STATE);
    return status(hy_get_state(c, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    CHECK(SET_STATE);
    return status(hy_set_state(c, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    CHECK(FREE_STATE);
    return status(hy_free_state(c, state));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    CHECK(STATE_SIZE);
    return status(hy_state_size(c, state, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    CHECK(WRITE_STATE);
    return status(hy_write_state(c, state, (char *)bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    CHECK(READ_STATE);
    return status(hy_read_state(c, (const char *)bytes, size, state));
}

typedef int derivative(hy_instance *, const unsigned *, size_t, const unsigned *, size_t, const double *, double *);

static int by_elements(hy_instance *c, derivative *compute, const hy_elements *unknowns, size_t n_unknowns, const unsigned *knowns,
                       size_t n_knowns, size_t n_values, const double *seed, double *sensitivity)
{
    hy_elements e;
    int code;
    if (hy_spread(c, "derivative", knowns, n_knowns, n_values, &e)) return FMI_ERROR;
    code = compute(c, unknowns->vr, n_unknowns, e.vr, n_values, seed, sensitivity);
    free(e.made);
    return code;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    CHECK(DIRECTIONAL);
    if (hy_has_arrays)
        SPREAD(u, "fmi3GetDirectionalDerivative", unknowns, n_unknowns, n_sensitivity,
               by_elements(c, hy_directional, &u, n_sensitivity, knowns, n_knowns, n_seed, seed, sensitivity));
    if (n_seed != n_knowns || n_sensitivity != n_unknowns) REFUSE("fmi3GetDirectionalDerivative: array lengths do not match");
    return status(hy_directional(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    CHECK(ADJOINT);
    if (hy_has_arrays)
        SPREAD(u, "fmi3GetAdjointDerivative", unknowns, n_unknowns, n_seed,
               by_elements(c, hy_adjoint, &u, n_seed, knowns, n_knowns, n_sensitivity, seed, sensitivity));
    if (n_seed != n_unknowns || n_sensitivity != n_knowns) REFUSE("fmi3GetAdjointDerivative: array lengths do not match");
    return status(hy_adjoint(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

/* ---- structural parameters and clocks: the model has none ---- */

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    CHECK(CONFIGURATION);
    return fmi3Error;
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    CHECK(CONFIGURATION);
    return fmi3Error;
}

#define NO_CLOCKS(n) \
    CHECK(CLOCK); \
    if (n) REFUSE("the model has no clocks"); \
    return fmi3OK

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
{
    (void)vr, (void)values;
    NO_CLOCKS(n);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
{
    (void)vr, (void)values;
    NO_CLOCKS(n);
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)intervals, (void)qualifiers;
    NO_CLOCKS(n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    NO_CLOCKS(n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
{
    (void)vr, (void)shifts;
    NO_CLOCKS(n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    NO_CLOCKS(n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 intervals[])
{
    (void)vr, (void)intervals;
    NO_CLOCKS(n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    NO_CLOCKS(n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
{
    (void)vr, (void)shifts;
    NO_CLOCKS(n);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    NO_CLOCKS(n);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
{
    CHECK(PARTITION);
    (void)clock, (void)time;
    return fmi3Error;
}

/* ---- events ---- */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    CHECK(EVALUATE_DISCRETE);
    return status(hy_fmi_status(c, hy_settle(&c->engine)));
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *needs_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed, fmi3Boolean *next_defined,
                                    fmi3Float64 *next)
{
    int changed = 0, defined = 0, code;
    CHECK(UPDATE_DISCRETE);
    if (!needs_update || !terminate || !nominals_changed || !states_changed || !next_defined || !next)
        REFUSE("fmi3UpdateDiscreteStates: a NULL pointer was given");
    code = hy_new_discrete_states(c, &changed, &defined, next);
    *needs_update = false; /* the iteration has been carried to its end */
    *terminate = *nominals_changed = false;
    *states_changed = changed;
    *next_defined = defined;
    return status(code);
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    CHECK(ENTER_CONTINUOUS);
    return status(hy_enter_continuous(c));
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    CHECK(ENTER_STEP);
    return status(hy_enter_continuous(c));
}

/* ---- model exchange ---- */

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_state, fmi3Boolean *enter_event_mode,
                                       fmi3Boolean *terminate)
{
    CHECK(COMPLETED_STEP);
    (void)no_set_state;
    if (!enter_event_mode || !terminate) REFUSE("fmi3CompletedIntegratorStep: a NULL pointer was given");
    *enter_event_mode = *terminate = false;
    return status(hy_completed_step(c));
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    CHECK(SET_TIME);
    return status(hy_set_time(c, time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    CHECK(SET_STATES);
    return status(hy_set_states(c, x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t n)
{
    CHECK(GET_DERIVATIVES);
    return status(hy_get_derivatives(c, derivatives, n));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n)
{
    CHECK(GET_INDICATORS);
    return status(hy_get_indicators(c, indicators, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    CHECK(GET_STATES);
    return status(hy_get_states(c, x, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
{
    CHECK(GET_NOMINALS);
    return status(hy_get_nominals(c, nominals, n));
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    CHECK(COUNT);
    if (!n) REFUSE("fmi3GetNumberOfEventIndicators: a NULL pointer was given");
    *n = (size_t)c->engine.model->n_z;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    CHECK(COUNT);
    if (!n) REFUSE("fmi3GetNumberOfContinuousStates: a NULL pointer was given");
    *n = (size_t)c->engine.model->n_x;
    return fmi3OK;
}

/* ---- co-simulation ---- */

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values)
{
    CHECK(OUTPUT_DERIVATIVES);
    (void)vr, (void)orders, (void)values;
    if (n || n_values) REFUSE("output derivatives are not provided (maxOutputDerivativeOrder is 0)");
    return fmi3OK;
}

/* The importer may set inputs for the next internal step and may end the step, here or further on. */
static double intermediate_update(hy_instance *c)
{
    fmi3IntermediateUpdateCallback update = (fmi3IntermediateUpdateCallback)c->update;
    const double now = c->engine.data.v[0];
    fmi3Boolean stop = false;
    fmi3Float64 stop_time = now;
    c->engine.status->mode = IN_STEP;
    update(c->environment, now, true, true, true, c->early_return_allowed, &stop, &stop_time);
    if (c->engine.status->mode == IN_STEP) c->engine.status->mode = STEP;
    return stop && c->early_return_allowed ? stop_time : INFINITY;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state,
                      fmi3Boolean *event_handling_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    double reached = t;
    int event, code;
    CHECK(DO_STEP);
    (void)no_set_state;
    if (!event_handling_needed || !terminate || !early_return || !last_successful_time)
        REFUSE("fmi3DoStep: a NULL pointer was given");
    code = hy_do_step(c, t, h, c->event_mode_used && c->early_return_allowed, c->update ? intermediate_update : NULL, &reached,
                      &event);
    if (code == FMI_DISCARD) c->engine.status->mode = STEP; /* nothing has happened: a shorter step may be tried */
    *event_handling_needed = event;
    *terminate = false;
    *early_return = reached < t + h - 1e-9 * h;
    *last_successful_time = reached;
    return status(code);
}
