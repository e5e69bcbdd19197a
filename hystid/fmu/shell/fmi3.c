/* FMI 3.0, Model Exchange and Co-Simulation. Each function: is it legal here, then one call into hy_fmi.c. */
#include <math.h>
#include <stdlib.h>

#include "fmi3Functions.h"
#include "hy_fmi.h"

enum {
    READABLE = INITIALIZATION | RUNNING | IN_STEP | STOPPED,
    SETTABLE = INSTANTIATED | INITIALIZATION | RUNNING | IN_STEP
};

#define FMI(Name) fmi3##Name
#define FMU_STATE(action, what) fmi3##action##FMUState##what
#define READ_FMU_STATE fmi3DeserializeFMUState
#define GET_STATE_DERIVATIVES fmi3GetContinuousStateDerivatives
#define CALLS(CALL) \
    CALL(SET_DEBUG_LOGGING, "fmi3SetDebugLogging", ANYWHERE, 0) \
    CALL(ENTER_INITIALIZATION, "fmi3EnterInitializationMode", INSTANTIATED, 0) \
    CALL(EXIT_INITIALIZATION, "fmi3ExitInitializationMode", INITIALIZATION, 0) \
    CALL(ENTER_EVENT, "fmi3EnterEventMode", CONTINUOUS | STEP, 0) \
    CALL(TERMINATE, "fmi3Terminate", RUNNING | STEP_DISCARDED, 0) \
    CALL(RESET, "fmi3Reset", ANYWHERE, 0) \
    CALL(GET_VALUE, "fmi3Get{VariableType}", INSTANTIATED | READABLE, 0) \
    CALL(SET_VALUE, "fmi3Set{VariableType}", SETTABLE, 0) \
    CALL(DEPENDENCIES, "fmi3GetVariableDependencies", ANYWHERE, 0) \
    CALL(GET_STATE, "fmi3GetFMUState", ANYWHERE, 0) \
    CALL(SET_STATE, "fmi3SetFMUState", ANYWHERE, 0) \
    CALL(FREE_STATE, "fmi3FreeFMUState", ANYWHERE, 0) \
    CALL(STATE_SIZE, "fmi3SerializedFMUStateSize", ANYWHERE, 0) \
    CALL(WRITE_STATE, "fmi3SerializeFMUState", ANYWHERE, 0) \
    CALL(READ_STATE, "fmi3DeserializeFMUState", ANYWHERE, 0) \
    CALL(DIRECTIONAL, "fmi3GetDirectionalDerivative", READABLE, 0) \
    CALL(ADJOINT, "fmi3GetAdjointDerivative", READABLE, 0) \
    CALL(CONFIGURATION, "fmi3EnterConfigurationMode / fmi3ExitConfigurationMode", NOWHERE, 0) \
    CALL(CLOCK, "a function of clocks", INITIALIZATION | EVENT, 0) \
    CALL(EVALUATE_DISCRETE, "fmi3EvaluateDiscreteStates", EVENT, 0) \
    CALL(UPDATE_DISCRETE, "fmi3UpdateDiscreteStates", EVENT, 0) \
    CALL(ENTER_CONTINUOUS, "fmi3EnterContinuousTimeMode", EVENT, MODEL_EXCHANGE) \
    CALL(COMPLETED_STEP, "fmi3CompletedIntegratorStep", CONTINUOUS, MODEL_EXCHANGE) \
    CALL(SET_TIME, "fmi3SetTime", EVENT | CONTINUOUS, MODEL_EXCHANGE) \
    CALL(SET_STATES, "fmi3SetContinuousStates", CONTINUOUS, MODEL_EXCHANGE) \
    CALL(GET_DERIVATIVES, "fmi3GetContinuousStateDerivatives", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_INDICATORS, "fmi3GetEventIndicators", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_STATES, "fmi3GetContinuousStates", SHOWN, MODEL_EXCHANGE) \
    CALL(GET_NOMINALS, "fmi3GetNominalsOfContinuousStates", INSTANTIATED | SHOWN, MODEL_EXCHANGE) \
    CALL(COUNT, "fmi3GetNumberOf...", ANYWHERE, MODEL_EXCHANGE) \
    CALL(ENTER_STEP, "fmi3EnterStepMode", EVENT, CO_SIMULATION) \
    CALL(OUTPUT_DERIVATIVES, "fmi3GetOutputDerivatives", STEP | IN_STEP | TERMINATED, CO_SIMULATION) \
    CALL(DO_STEP, "fmi3DoStep", STEP, CO_SIMULATION) \
    CALL(PARTITION, "fmi3ActivateModelPartition", NOWHERE, 0)
#include "fmi_common.h"

static void forward_log(const hy_instance *c, int code, const char *category, const char *text)
{
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->callback;
    if (logger) logger(c->environment, status(code), category, text);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

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

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    int code;
    CHECK(ENTER_INITIALIZATION);
    (void)tolerance_defined; /* fixed step: the tolerance has nothing to act on */
    (void)tolerance;
    code = hy_setup(c, start, stop_defined, stop);
    return status(code ? code : hy_enter(c, INITIALIZATION));
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    CHECK(ENTER_EVENT);
    if (c->engine.status->kind == CO_SIMULATION && !c->event_mode_used)
        REFUSE("fmi3EnterEventMode: the instance was made without eventModeUsed");
    return status(hy_enter(c, EVENT));
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

#define TYPE(Type, get, set) \
    fmi3Status fmi3Get##Type(void *instance, const unsigned vr[], size_t n, fmi3##Type values[], size_t n_values) \
    { \
        CHECK(GET_VALUE); \
        if (n != n_values) REFUSE("fmi3Get" #Type ": %zu variables, room for %zu values", n, n_values); \
        return status(get); \
    } \
    fmi3Status fmi3Set##Type(void *instance, const unsigned vr[], size_t n, const fmi3##Type values[], size_t n_values) \
    { \
        CHECK(SET_VALUE); \
        if (n != n_values) REFUSE("fmi3Set" #Type ": %zu variables, %zu values", n, n_values); \
        return status(set); \
    }
#define WHOLE_TYPE(Type, kind) \
    TYPE(Type, hy_get_whole(c, "fmi3Get" #Type, vr, n, kind, values, sizeof *values), \
         hy_set_whole(c, "fmi3Set" #Type, vr, n, kind, values, sizeof *values))
TYPE(String, hy_get_texts(c, "fmi3GetString", vr, n, values), ((void)values, hy_set_texts(c, "fmi3SetString", vr, n)))
WHOLE_TYPE(Int32, INTEGER)
WHOLE_TYPE(Int64, ENUMERATION)
WHOLE_TYPE(Boolean, BOOLEAN)

/* Types that no variable of ours has: legal to call for no variables at all. */
#define NO_TYPE(Name, which, sizes, unused, const_, Type) \
    fmi3Status fmi3##Name(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, sizes const_ Type values[], \
                          size_t n_values) \
    { \
        CHECK(which); \
        (void)vr, (void)values, unused; \
        if (n || n_values) REFUSE("fmi3" #Name ": the model has no variables of this type"); \
        return fmi3OK; \
    }
#define SIZED(sizes) sizes,
#define NO_TYPES(Type) \
    NO_TYPE(Get##Type, GET_VALUE, , (void)0, , fmi3##Type) NO_TYPE(Set##Type, SET_VALUE, , (void)0, const, fmi3##Type)
NO_TYPES(Float32)
NO_TYPES(Int8)
NO_TYPES(UInt8)
NO_TYPES(Int16)
NO_TYPES(UInt16)
NO_TYPES(UInt32)
NO_TYPES(UInt64)
NO_TYPE(GetBinary, GET_VALUE, SIZED(size_t sizes[]), (void)sizes, , fmi3Binary)
NO_TYPE(SetBinary, SET_VALUE, SIZED(const size_t sizes[]), (void)sizes, const, fmi3Binary)

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

FUNCTION(fmi3EnterConfigurationMode, CONFIGURATION, (void *instance), FMI_ERROR)
FUNCTION(fmi3ExitConfigurationMode, CONFIGURATION, (void *instance), FMI_ERROR)

#define CLOCK_FUNCTION(name, parameters, unused) \
    fmi3Status name parameters \
    { \
        CHECK(CLOCK); \
        unused; \
        if (n) REFUSE("the model has no clocks"); \
        return fmi3OK; \
    }
#define CLOCKS void *instance, const unsigned vr[], size_t n
CLOCK_FUNCTION(fmi3GetClock, (CLOCKS, fmi3Clock values[]), ((void)vr, (void)values))
CLOCK_FUNCTION(fmi3SetClock, (CLOCKS, const fmi3Clock values[]), ((void)vr, (void)values))
CLOCK_FUNCTION(fmi3GetIntervalDecimal, (CLOCKS, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]),
               ((void)vr, (void)intervals, (void)qualifiers))
CLOCK_FUNCTION(fmi3GetIntervalFraction, (CLOCKS, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]),
               ((void)vr, (void)counters, (void)resolutions, (void)qualifiers))
CLOCK_FUNCTION(fmi3GetShiftDecimal, (CLOCKS, fmi3Float64 shifts[]), ((void)vr, (void)shifts))
CLOCK_FUNCTION(fmi3GetShiftFraction, (CLOCKS, fmi3UInt64 counters[], fmi3UInt64 resolutions[]),
               ((void)vr, (void)counters, (void)resolutions))
CLOCK_FUNCTION(fmi3SetIntervalDecimal, (CLOCKS, const fmi3Float64 intervals[]), ((void)vr, (void)intervals))
CLOCK_FUNCTION(fmi3SetIntervalFraction, (CLOCKS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]),
               ((void)vr, (void)counters, (void)resolutions))
CLOCK_FUNCTION(fmi3SetShiftDecimal, (CLOCKS, const fmi3Float64 shifts[]), ((void)vr, (void)shifts))
CLOCK_FUNCTION(fmi3SetShiftFraction, (CLOCKS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]),
               ((void)vr, (void)counters, (void)resolutions))

FUNCTION(fmi3ActivateModelPartition, PARTITION, (void *instance, fmi3ValueReference clock, fmi3Float64 time),
         ((void)clock, (void)time, FMI_ERROR))

/* ---- events ---- */

FUNCTION(fmi3EnterStepMode, ENTER_STEP, (void *instance), hy_enter_continuous(c))
FUNCTION(fmi3EvaluateDiscreteStates, EVALUATE_DISCRETE, (void *instance), hy_fmi_status(c, hy_settle(&c->engine)))

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *needs_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed, fmi3Boolean *next_defined,
                                    fmi3Float64 *next)
{
    int changed = 0, defined = 0, code;
    CHECK(UPDATE_DISCRETE);
    NEED(UPDATE_DISCRETE, needs_update && terminate && nominals_changed && states_changed && next_defined && next);
    code = hy_new_discrete_states(c, &changed, &defined, next);
    *needs_update = false; /* the iteration has been carried to its end */
    *terminate = *nominals_changed = false;
    *states_changed = changed;
    *next_defined = defined;
    return status(code);
}

/* ---- model exchange ---- */

#define COUNT_FUNCTION(Name, member) \
    fmi3Status fmi3GetNumberOf##Name(fmi3Instance instance, size_t *n) \
    { \
        CHECK(COUNT); \
        NEED(COUNT, n); \
        *n = (size_t)c->engine.model->member; \
        return fmi3OK; \
    }
COUNT_FUNCTION(EventIndicators, n_z)
COUNT_FUNCTION(ContinuousStates, n_x)

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
    NEED(DO_STEP, event_handling_needed && terminate && early_return && last_successful_time);
    code = hy_do_step(c, t, h, c->event_mode_used && c->early_return_allowed, c->update ? intermediate_update : NULL, &reached,
                      &event);
    if (code == FMI_DISCARD) c->engine.status->mode = STEP; /* nothing has happened: a shorter step may be tried */
    *event_handling_needed = event;
    *terminate = false;
    *early_return = reached < t + h - 1e-9 * h;
    *last_successful_time = reached;
    return status(code);
}
