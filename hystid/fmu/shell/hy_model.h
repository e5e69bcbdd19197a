/* What a generated model gives to the shell, and all that the shell knows of it.
 *
 * Every value of an instance lies in one block of doubles, v[0 .. n_values). A value reference is an index into it, and a
 * copy of the block is a complete FMU state. Integers and Booleans are stored as doubles.
 *
 *   v[0]                  time [s]
 *   v[p .. p+n_p)         parameters, first the settable ones, then the dependent ones
 *   v[u .. u+n_u)         inputs
 *   v[x .. x+n_x)         continuous states
 *   v[dx .. dx+n_x)       their derivatives
 *   v[d .. d+n_d)         discrete states (assigned in when-clauses, or memory of sampled blocks)
 *   v[y .. y+n_y)         algebraic variables and outputs
 *   v[pre .. pre+n_d)     pre(d)
 *   v[rel .. rel+n_rel)   frozen truth values of relations: they change at events only
 *   v[w .. w+n_w)         private memory (warm starts of nonlinear blocks, next sample times, ...)
 *
 * Functions return HY_OK, HY_RETRY (no answer here, a smaller step may help) or HY_ERROR, and report through hy_data.log.
 * They touch nothing but the block: instances are independent and may run in different threads. A NULL function is absent.
 *
 * Order of calls. Start: v := start, settings overwritten, parameters, initialise, then event iteration. Event iteration:
 * evaluate; then, until again stays 0: pre := d, update, evaluate. Step: evaluate at each stage, with time, u and x set.
 * Start may be repeated from fresh values, so that initialise must not rely on what an earlier call left in the block.
 *
 * Event indicators. A state event lies where an indicator changes sign. An indicator that is exactly 0 keeps the sign that
 * it had; one that is 0 after event iteration and then leaves 0 is an event too. Indicators may depend on rel, so that
 * hysteresis can be put in: z > 0 while the frozen relation agrees with the values is the recommended form.
 *
 * Derivatives. A seed on a settable parameter reaches dx and y also through the dependent parameters.
 */
#ifndef HY_MODEL_H
#define HY_MODEL_H

#if defined(FMI2_FUNCTION_PREFIX) || defined(FMI3_FUNCTION_PREFIX)
#include "hy_names.h" /* several FMUs in one program: the shell's own names get the prefix, too */
#endif

enum { HY_OK = 0, HY_RETRY = 1, HY_ERROR = 2 };
enum { HY_INFO = 0, HY_WARNING = 1, HY_FAILURE = 2 };

typedef struct {
    double *v;                                              /* the block */
    void (*log)(void *owner, int level, const char *text);  /* never NULL */
    void *owner;
} hy_data;

/* Slots of a spring in series with a dry slider: der(force) = slips ? 0 : stiffness speed, where slips says that the force
 * is at its limit and the speed drives it on; stiffness (-1: 1) and limit are parameters, the others relations. */
typedef struct {
    int force, stiffness, limit, speed, slips, above, forward, below, backward;
} hy_stop;

/* Slots of a rate-independent state: its derivative, slope, is that per travel times the size of the speed (a state or an
 * input), and depends on nothing else but the state itself, the sense of the motion and parameters. */
typedef struct {
    int state, slope, speed;
} hy_duhem_state;

extern const struct hy_stop_methods hy_stop_methods;
extern const struct hy_duhem_methods hy_duhem_methods;
extern const struct hy_path_methods hy_path_methods;
extern const struct hy_strip_methods hy_strip_methods;

typedef struct {
    const char *name;
    const char *token;        /* instantiation token, GUID of FMI 2 */
    int n_values;
    int p, n_p, u, n_u, x, n_x, dx, d, n_d, y, n_y, pre, rel, n_rel, w, n_w;
    int n_z;                  /* event indicators */
    int n_couples;            /* pairs (i, j): between events der(x[i]) depends on x[j] */
    const int (*couples)[2];  /* NULL: any may depend on any */
    int n_stops;
    const hy_stop *stops;     /* NULL unless all relations and discrete states of the model are theirs */
    const struct hy_stop_methods *stop_methods;
    int n_duhem;
    const hy_duhem_state *duhem; /* NULL where something happens at instants */
    const struct hy_duhem_methods *duhem_methods;
    const struct hy_path_methods *paths; /* with stops, or such states */
    int n_shown;
    const int *shown;         /* slots of the algebraic variables that show gives, outputs among them */
    double step;              /* default internal step [s] */
    double sample;            /* interval at which completed_step is called [s]; 0: at each accepted step; below 0: each step
                                 of co-simulation is a sample, and model exchange, whose steps are a solver's, not offered */
    const double *start;      /* n_values start values */

    int (*parameters)(hy_data *m);                  /* dependent parameters from the settable ones */
    int (*initialise)(hy_data *m);                  /* solves the initial equations: p (fixed=false), x, d, pre, rel, w */
    int (*evaluate)(hy_data *m);                    /* dx and y from time, p, u, x, d, rel */
    /* Outputs and what they need, of n samples: rows of what shown names, from v (parameters) and rows of time, u, x. */
    void (*show)(const double *v, const double *const *in, double *const *out, int n);
    const struct hy_strip_methods *strips; /* with show */
    int (*indicators)(hy_data *m, double *z);       /* n_z functions whose sign changes mark state events (after evaluate) */
    int (*update)(hy_data *m, int *again);          /* one pass of event iteration: rel from the current values, when-clauses
                                                       with pre, reinit of x; *again = 1 when anything changed. The shell sets
                                                       pre := d before each pass and calls evaluate after the last. */
    double (*next_time_event)(const hy_data *m);    /* next sample instant, or INFINITY */
    int (*completed_step)(hy_data *m);              /* sampled memory moves on; or what is watched over accepted steps */
    int (*forward)(hy_data *m, const double *seed, double *sens);  /* sens = d(dx, y)/d(p, u, x) . seed; both n_values long,
                                                                      time and d may carry seeds too (zero where not smooth) */
    int (*adjoint)(hy_data *m, const double *seed, double *sens);  /* sens += seed . d(dx, y)/d(p, u, x) */
} hy_model;

extern const hy_model hy_the_model;

#endif
