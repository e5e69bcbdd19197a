/* One running instance of a model: the value block, event iteration, fixed-step RK4 with located events.
 * Knows nothing of FMI. The FMI functions (fmi2.c, fmi3.c) and the table runner (hy_table.c) stand on it. */
#ifndef HY_ENGINE_H
#define HY_ENGINE_H

#include <stddef.h>

#include "hy_model.h"

/* A value that follows a cubic polynomial of time instead of being held or integrated: an input whose derivatives are
 * known, or a state clamped to a measured motion. value(t) = c[0] + s (c[1] + s (c[2] + s c[3])), s = t - origin. */
typedef struct {
    int slot;
    double c[4];
    struct hy_path *path; /* of a speed that states run along, nothing being integrated in steps of time; else NULL */
} hy_driven;

/* What of an instance must survive saving and restoring, besides the block. */
typedef struct {
    int kind, mode;    /* of the FMI layer */
    int sampled;       /* 1: the sampled memory has taken the initial point */
    int stale;         /* 0: dx and y belong to the present values; 1: they do not; 2: y does, but the memory has moved on */
    int started;       /* 1: initial equations solved since the last change of a start value */
    int event_pending; /* 1: an event was found and not yet handled */
    int fresh;         /* 1: an event was handled between two steps of co-simulation */
    int chattered;     /* 1: chattering has been reported */
    int coarse;        /* steps in a row whose error is too large, as many as are counted */
    int n_driven;
    double origin;     /* time origin of the driven polynomials [s] */
    double start_time, stop_time; /* stop_time is INFINITY where none was given */
    double last_time;  /* last successful communication point [s] */
    double tick;       /* of a model with a sample interval: when its memory moves on next [s] */
    double time_event; /* instant of the last time event that was handled [s] */
    double renewed, pause, shrink; /* instant of the last event that set states anew [s], the time since the one before
                                      [s], and that as a part of the one before that */
} hy_status;

typedef struct hy_duhem hy_duhem; /* curves of rate-independent states */

typedef struct {
    const hy_model *model;
    hy_data data;      /* data.v is the block */
    void *saved;       /* status, block, settings, signs, driven in one piece: what an FMU state consists of */
    size_t saved_size; /* [bytes] */
    hy_status *status;
    double *settings;  /* block as set by the user before the initial equations were solved */
    double *sign;      /* sign of each indicator after the last event: -1, 0, 1 */
    hy_driven *driven; /* room for n_u + n_x */
    int *free;         /* indices of the states that are integrated; where no sensitivity is carried they are a range
                          without gaps, for fast loops: clamped ones in it are overwritten by their motion */
    int n_free;
    int n_clamped;     /* states in all */
    int has_clamped;   /* 1: some of them lie in the range */
    int quadrature;    /* 1: the slopes of what is integrated depend on clamped states and time alone */
    int n_seeds;       /* sensitivities carried along, to the parameters in seed_slots */
    const int *seed_slots;
    double *seed, *sens; /* n_values each, or NULL */
    int z_stands;      /* 1: z belongs to the present values */
    int n_X;           /* length of the extended state: n_free states, then n_free sensitivities per seed */
    double *X;         /* extended state at the left end of the present step */
    double *K1, *K, *sum, *trial;
    double *x_before, *z, *z_left;
    int *crossings;    /* how often each indicator crossed zero within the present step; then n_z marks and n_z indices, scratch */
    double *scratch;   /* one allocation behind X ... z_left */
    int watched;       /* 1: the slopes of the last stage of a step are kept in K */
    double h_last;     /* length of the step that they belong to [s]; 0: of none, or of one with an event */
    double *stops;     /* of a table whose springs with sliders are moved in closed form, or NULL */
    hy_duhem *duhem;   /* of a table that is run that way, or NULL */
    struct hy_path *paths; /* where driven speeds have theirs, or NULL */
} hy_engine;

/* Moves what runs along the paths of driven speeds by n rows; rows: of states, where each of them goes, or NULL. Gives the
 * number of rows before one that has no finite answer. */
typedef int hy_mover(hy_engine *e, int n, double *const *rows);

/* How springs in series with sliders are moved (hy_stops.c); a model that has some brings it along. */
struct hy_stop_methods {
    int (*alone)(const hy_engine *e);    /* whether nothing else is integrated, and no sensitivity is carried */
    int (*open)(hy_engine *e);           /* that, and their speeds are driven, their limits not negative: asks for paths */
    hy_mover *move;
    void (*mark)(hy_engine *e);          /* relations and modes from the present forces and speeds */
};

/* How rate-independent states are followed (hy_duhem.c); a model that has such states brings it along. */
struct hy_duhem_methods {
    int (*follows)(const hy_engine *e);  /* whether such states alone are integrated, their speeds driven, no sensitivity */
    hy_duhem *(*open)(hy_engine *e);     /* goes on with the engine's where the parameters are the same, else closes them */
    hy_mover *move;                      /* along the engine's curves */
    void (*close)(hy_duhem *d);
};

/* After an event the first look is this part of the step further on. A mass that bounces off a stop is still a rounding
 * error inside it; were the next look at the step's end, where it may have come back, both crossings would be missed. */
#define HY_FIRST_LOOK 1e-6

enum { HY_EVENT = 3 }; /* hy_advance stopped at an event that it was told not to handle */

/* Driven values at the present time. Here, like the next one, for each stage of each step comes by. */
static inline void hy_drive(hy_engine *e)
{
    const double s = e->data.v[0] - e->status->origin;
    for (int i = 0; i < e->status->n_driven; i++) {
        const double *c = e->driven[i].c;
        e->data.v[e->driven[i].slot] = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
    }
}

/* Evaluate, if stale. */
static inline int hy_settle(hy_engine *e)
{
    int outcome = HY_OK;
    if (e->status->stale == 1) {
        outcome = e->model->evaluate(&e->data);
        e->z_stands = 0;
        if (!outcome) e->status->stale = 0;
    }
    return outcome;
}

int hy_open(hy_engine *e, const hy_model *model, void (*log)(void *, int, const char *), void *owner);
void hy_close(hy_engine *e);
void hy_reset(hy_engine *e);                       /* back to start values */
int hy_carry(hy_engine *e, const int *slots, int n);        /* sensitivities to these parameters; before the next two */
int hy_clamp_states(hy_engine *e, const int *slots, int n); /* these states are driven from now on */
void hy_sensitivity(hy_engine *e, int which);               /* sens := d(everything)/d(parameter), at the present values */

int hy_start(hy_engine *e);                        /* solves the initial equations; event iteration not yet done */
hy_driven *hy_driven_at(const hy_engine *e, int slot); /* NULL where that is not driven */
int hy_event(hy_engine *e, int *states_changed);   /* event iteration at the present time */
int hy_is_reached(const hy_engine *e, double instant, double now); /* whether it lies ahead by no more than rounding */
double hy_next_time_event(const hy_engine *e);     /* first time event that was not handled yet, INFINITY without one */
int hy_accumulated(hy_engine *e);                  /* reports a Zeno point at the present time */
int hy_note_signs(hy_engine *e);                   /* takes the indicators' present signs as reference */
int hy_crossed(hy_engine *e, int *any);            /* whether an indicator left its reference sign */
int hy_has_events(const hy_engine *e);
int hy_inputs_changed(hy_engine *e);               /* event iteration where new inputs call for it */

/* From the present time t0 to t0 + h in n equal steps; time is counted in steps, never summed up. With stop_at_events the
 * call returns HY_EVENT at the first event, which is left to the caller; *reached is the time got to. Steps inside are
 * completed; the last one is the caller's to complete, who may want to set the inputs of its end first. */
int hy_advance(hy_engine *e, double h, int n, int stop_at_events, double *reached);
int hy_steps_in(const hy_engine *e, double h);     /* how many of the model's own steps an interval h needs */
static inline int hy_is_watched(unsigned step) { return (step & 127) < 10; } /* now and then, which costs next to nothing */
void hy_note_coarse(hy_engine *e);                 /* reports once, of a settled right end, that steps are too long */
int hy_completed(hy_engine *e);                    /* one step is accepted: sampled memory moves on, if it is time */
int hy_has_ticks(const hy_engine *e);              /* whether the memory moves on at instants of its own */

void hy_report(hy_engine *e, int level, const char *format, ...);

#endif
