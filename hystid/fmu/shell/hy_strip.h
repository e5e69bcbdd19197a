/* Outputs of a strip of samples at once, where inputs and states are known: a processor works on many at a time, and the
 * cost of a call is shared. */
#ifndef HY_STRIP_H
#define HY_STRIP_H

#include "hy_engine.h"
#include "hy_table.h"
#include "hy_paths.h"

typedef struct {
    double *room;
    const double **in; /* rows of time, inputs and states, as the model's show takes them */
    double **states;   /* rows of the states, where they are not columns of the table */
    double **out;      /* rows of what is shown */
} hy_strip;

/* A model that has a show brings them along. */
struct hy_strip_methods {
    int (*serves)(const hy_engine *e, const hy_table *t); /* whether the table asks for nothing but what is shown */
    int (*open)(hy_strip *s, const hy_engine *e);         /* not 0: no memory; to be closed all the same */
    void (*show)(hy_strip *s, const hy_engine *e, hy_table *t, int row, int n); /* outputs of n rows from one on */
    void (*close)(hy_strip *s);
};

#endif
