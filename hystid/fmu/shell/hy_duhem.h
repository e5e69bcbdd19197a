/* Rate-independent states on a given motion: der(z) = g(z, sign(speed)) |speed| (Duhem's law; Visintin, Differential
 * Models of Hysteresis, 1994, chapter V). While the motion keeps its sense such a state runs along one curve of z over the
 * way, the same one wherever it comes on. The curves of both senses are integrated once, as far as the motion asks for;
 * then the state is read off from one reversal to the next, in no steps of time. */
#ifndef HY_DUHEM_H
#define HY_DUHEM_H

#include "hy_engine.h"

int hy_duhem_follows(const hy_engine *e);  /* such states alone are integrated, their speeds are driven, no sensitivity */
hy_duhem *hy_open_duhem(hy_engine *e);     /* after the start: asks for the speeds; NULL where there is no memory for it */
int hy_move_duhem(hy_duhem *d, hy_engine *e, double h); /* states after h, the driven polynomials beginning now */
void hy_close_duhem(hy_duhem *d);

#endif
