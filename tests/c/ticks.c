/* Many ticks in one call, for the comparison with the Python package. A row of `in` is
 * x, xdot, x_ref, xdot_ref, force, force_ref; of `out` u, x_ref, xdot_ref, code, iterations. */
#include <stddef.h>

#include "zivi.h"

void track_rows(zivi_tracker *tracker, const double *in, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, in += 6, out += 5) {
        out[3] = zivi_tracker_reset(tracker, in[2], in[3]);
        if (out[3] == ZIVI_OK)
            out[3] = zivi_tracker_step(tracker, in[0], in[1], in[4], in[5], &out[0]);
        out[1] = tracker->x_ref;
        out[2] = tracker->xdot_ref;
        out[4] = tracker->iterations;
    }
}

/* Rows x, xdot, force; u, code. */
void regulate_rows(zivi_regulator *regulator, const double *in, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, in += 3, out += 2)
        out[1] = zivi_regulator_step(regulator, in[0], in[1], in[2], &out[0]);
}

/* Rows s, v, x, xdot after each step. */
void fall(zivi_mass *mass, double force, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, out += 4) {
        zivi_mass_step(mass, force);
        out[0] = mass->s;
        out[1] = mass->v;
        out[2] = mass->x;
        out[3] = mass->xdot;
    }
}

/* Rows x, xdot, force, u; x, xdot, d, code. */
void observe_rows(zivi_observer *observer, const double *in, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, in += 4, out += 4) {
        out[3] = zivi_observer_step(observer, in[0], in[1], in[2], in[3]);
        out[0] = observer->x;
        out[1] = observer->xdot;
        out[2] = observer->d;
    }
}
