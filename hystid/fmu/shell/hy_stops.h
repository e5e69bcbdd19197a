/* Springs in series with dry sliders (stop operators) on a given motion, in closed form: between reversals of the motion
 * the force of such a spring moves with the displacement until it meets its limit (Visintin, Differential Models of
 * Hysteresis, 1994, III.2). No event has to be located: the speed is a cubic polynomial within a row, and so are its
 * reversals and the way between them known. */
#ifndef HY_STOPS_H
#define HY_STOPS_H

#include "hy_engine.h"

int hy_only_stops_are_free(const hy_engine *e); /* nothing else is integrated, and no sensitivity is carried */
int hy_open_stops(hy_engine *e);                /* and their speeds are driven, their limits not negative: asks for paths */
hy_mover hy_move_stops;
void hy_mark_stops(hy_engine *e);               /* relations and modes from the present forces and speeds */

#endif
