/* Functions that FMI 2.0 and FMI 3.0 have alike, but for names. Before it includes this file, fmi2.c and fmi3.c each
 * define CALLS, the table of calls: CALL(number, name, modes in which it is legal, the one kind that has it or 0);
 * FMI(Name), which puts the prefix of the standard before a name; and the names that differ by more than the prefix. */
#define NUMBER(which, name, modes, kind) which,
#define ENTRY(which, name, modes, kind) [which] = {name, modes, kind},
enum { SHOWN = INITIALIZATION | EVENT | CONTINUOUS | TERMINATED | FAILED };
enum { CALLS(NUMBER) };
static const hy_call CALL[] = {CALLS(ENTRY)};

#define CHECK(which) \
    hy_instance *c = instance; \
    if (!hy_allowed(c, &CALL[which])) return FMI(Error)
#define REFUSE(...) return status(hy_fail(c, __VA_ARGS__))
#define NEED(which, pointers) \
    if (!(pointers)) REFUSE("%s: a NULL pointer was given", CALL[which].name)

/* A function of the standard: is it legal here, then one call into the shell. */
#define FUNCTION(name, which, parameters, call) \
    FMI(Status) name parameters \
    { \
        CHECK(which); \
        return status(call); \
    }

static FMI(Status) status(int code) { return (FMI(Status))code; }

FUNCTION(FMI(SetDebugLogging), SET_DEBUG_LOGGING,
         (void *instance, FMI(Boolean) on, size_t n, const char *const categories[]),
         hy_set_logging(c, on, n, categories))

void FMI(FreeInstance)(void *instance) { hy_free_instance(instance); }

FUNCTION(FMI(ExitInitializationMode), EXIT_INITIALIZATION, (void *instance), hy_exit_initialization(c))
FUNCTION(FMI(Terminate), TERMINATE, (void *instance), hy_enter(c, TERMINATED))
FUNCTION(FMI(Reset), RESET, (void *instance), hy_begin_again(c))

/* ---- states of the FMU ---- */

FUNCTION(FMU_STATE(Get, ), GET_STATE, (void *instance, void **state), hy_get_state(c, state))
FUNCTION(FMU_STATE(Set, ), SET_STATE, (void *instance, void *state), hy_set_state(c, state))
FUNCTION(FMU_STATE(Free, ), FREE_STATE, (void *instance, void **state), hy_free_state(c, state))
FUNCTION(FMU_STATE(Serialized, Size), STATE_SIZE, (void *instance, void *state, size_t *size),
         hy_state_size(c, state, size))
FUNCTION(FMU_STATE(Serialize, ), WRITE_STATE, (void *instance, void *state, FMI(Byte) bytes[], size_t size),
         hy_write_state(c, state, (char *)bytes, size))
FUNCTION(READ_FMU_STATE, READ_STATE, (void *instance, const FMI(Byte) bytes[], size_t size, void **state),
         hy_read_state(c, (const char *)bytes, size, state))

/* ---- model exchange ---- */

FUNCTION(FMI(EnterContinuousTimeMode), ENTER_CONTINUOUS, (void *instance), hy_enter_continuous(c))

FMI(Status) FMI(CompletedIntegratorStep)(void *instance, FMI(Boolean) no_set_state, FMI(Boolean) *enter_event_mode,
                                         FMI(Boolean) *terminate)
{
    CHECK(COMPLETED_STEP);
    (void)no_set_state;
    NEED(COMPLETED_STEP, enter_event_mode && terminate);
    *enter_event_mode = *terminate = 0;
    return status(hy_completed_step(c));
}

FUNCTION(FMI(SetTime), SET_TIME, (void *instance, double time), hy_set_time(c, time))
FUNCTION(FMI(SetContinuousStates), SET_STATES, (void *instance, const double x[], size_t n), hy_set_states(c, x, n))
FUNCTION(GET_STATE_DERIVATIVES, GET_DERIVATIVES, (void *instance, double dx[], size_t n), hy_get_derivatives(c, dx, n))
FUNCTION(FMI(GetEventIndicators), GET_INDICATORS, (void *instance, double z[], size_t n), hy_get_indicators(c, z, n))
FUNCTION(FMI(GetContinuousStates), GET_STATES, (void *instance, double x[], size_t n), hy_get_states(c, x, n))
FUNCTION(FMI(GetNominalsOfContinuousStates), GET_NOMINALS, (void *instance, double x[], size_t n),
         hy_get_nominals(c, x, n))
