/* What FMI 2.0 and FMI 3.0 have in common: instances, which call is legal in which mode, values, states, steps.
 * Status numbers are the same in both standards: 0 OK, 1 warning, 2 discard, 3 error, 4 fatal. */
#ifndef HY_FMI_H
#define HY_FMI_H

#include "hy_engine.h"

enum { FMI_OK = 0, FMI_WARNING = 1, FMI_DISCARD = 2, FMI_ERROR = 3 };
enum { MODEL_EXCHANGE = 1, CO_SIMULATION = 2 };

/* Modes of an instance, as bits so that a call can list those that it is legal in. */
enum {
    INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, STEP_DISCARDED = 32, TERMINATED = 64,
    FAILED = 128, IN_STEP = 256, /* inside the intermediate update callback of FMI 3 */
    RUNNING = EVENT | CONTINUOUS | STEP, STOPPED = STEP_DISCARDED | TERMINATED | FAILED,
    ANYWHERE = INSTANTIATED | INITIALIZATION | RUNNING | STOPPED,
    NOWHERE = 0
};

typedef struct {
    const char *name;
    int modes; /* in which it is legal */
    int kind;  /* the one kind that has it, or 0 */
} hy_call;

/* One slot of the block as FMI sees it; generated from the model's variables. */
enum { NO_VARIABLE = 0, REAL = 1, INTEGER = 2, BOOLEAN = 3, ENUMERATION = 4 }; /* the last in FMI 3 */
enum { HAS_START = 1, IS_INPUT = 2, IS_TUNABLE = 4, IS_DISCRETE = 8, IS_OUTPUT = 16, HAS_LIMITS = 32 };
typedef struct {
    unsigned char type, flags;
    int size; /* of the array that begins here, 1 of a single value, 0 inside of an array (FMI 3) */
    const char *name;
    double min, max; /* of a parameter; infinite without a limit */
} hy_variable;
extern const hy_variable hy_variables[]; /* n_values entries */
extern const double hy_nominals[];       /* one per continuous state */
extern const char *const hy_texts[];     /* Strings that are built in: their references follow those of the indicators */
extern const int hy_n_texts;
extern const int hy_has_arrays;

typedef struct hy_instance hy_instance;
typedef void (*hy_logger)(const hy_instance *c, int status, const char *category, const char *text);

struct hy_instance {
    hy_engine engine;
    void *backup;        /* as large as engine.saved: to go back to when a step is discarded */
    char *name;
    int logging;         /* events are logged too */
    int warned;          /* a warning was logged during the present call */
    unsigned steps;      /* of the instance, wherever it was set back to: which of them are watched */
    int event_mode_used, early_return_allowed; /* FMI 3 co-simulation */
    hy_logger logger;
    void (*callback)(void); /* the importer's logger, its type known to the FMI version */
    void (*update)(void);   /* intermediate update, likewise */
    void *environment;
};

hy_instance *hy_new_instance(const char *name, const char *token, int kind, hy_logger logger, void (*callback)(void), void *environment);
void hy_free_instance(hy_instance *c);
int hy_allowed(hy_instance *c, const hy_call *call);
int hy_fail(hy_instance *c, const char *format, ...); /* logs and returns FMI_ERROR */
int hy_fmi_status(hy_instance *c, int outcome);       /* an outcome of the engine as a status; errors end the instance's run */

const char *hy_mode_name(int mode);
int hy_enter(hy_instance *c, int mode);
int hy_begin_again(hy_instance *c); /* as just made */

int hy_present(hy_instance *c); /* values belong together and can be shown */
int hy_setup(hy_instance *c, double start, int stop_defined, double stop);
int hy_exit_initialization(hy_instance *c);
int hy_set_logging(hy_instance *c, int on, size_t n, const char *const *categories);
int hy_get(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, double *value);
int hy_may_set(hy_instance *c, const char *call, unsigned vr, int type, double value);
int hy_set(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, const double *value);
/* The same for whole numbers and truth values in elements of 1, 4 or 8 bytes. */
int hy_get_whole(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, void *values, size_t size);
int hy_set_whole(hy_instance *c, const char *call, const unsigned *vr, size_t n, int type, const void *values, size_t size);
/* References of single elements in place of those of variables, n_values of them; the caller frees what was made. */
typedef struct {
    const unsigned *vr;
    unsigned *made;
} hy_elements;
int hy_spread(hy_instance *c, const char *call, const unsigned *vr, size_t n, size_t n_values, hy_elements *e);
int hy_get_texts(hy_instance *c, const char *call, const unsigned *vr, size_t n, const char **value);
int hy_set_texts(hy_instance *c, const char *call, const unsigned *vr, size_t n);
int hy_set_time(hy_instance *c, double time);
int hy_set_states(hy_instance *c, const double *x, size_t n);
int hy_get_states(hy_instance *c, double *x, size_t n);
int hy_get_nominals(hy_instance *c, double *x, size_t n);
int hy_get_derivatives(hy_instance *c, double *dx, size_t n);
int hy_get_indicators(hy_instance *c, double *z, size_t n);
int hy_new_discrete_states(hy_instance *c, int *states_changed, int *next_defined, double *next);
int hy_enter_continuous(hy_instance *c);
int hy_completed_step(hy_instance *c);
int hy_input_derivatives(hy_instance *c, const unsigned *vr, size_t n, const int *order, const double *value);
int hy_check_numbers(hy_instance *c, const char *what, const double *values, size_t n); /* HY_RETRY, and told, where one is not finite */
int hy_check_values(hy_instance *c); /* the same for outputs and states */
int hy_directional(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                   const double *seed, double *sensitivity);
int hy_adjoint(hy_instance *c, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
               const double *seed, double *sensitivity);

/* From the last communication point by h. stop_at_events: FMI 3 event mode; *reached tells how far, *event whether an
 * event waits there. between is called after each internal step and says when the step shall end at the latest; it may
 * be NULL. */
int hy_do_step(hy_instance *c, double t, double h, int stop_at_events, double (*between)(hy_instance *), double *reached,
               int *event);

int hy_get_state(hy_instance *c, void **state);
int hy_set_state(hy_instance *c, const void *state);
int hy_free_state(hy_instance *c, void **state);
int hy_state_size(hy_instance *c, const void *state, size_t *size);
int hy_write_state(hy_instance *c, const void *state, char *bytes, size_t size);
int hy_read_state(hy_instance *c, const char *bytes, size_t size, void **state);

#endif
