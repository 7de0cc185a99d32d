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

/* Without a reset, over periods of any length: rows dt, x, xdot, force, force_ref, x_ref, xdot_ref of a
 * reference that is given where `side` is not 0, x_ref, xdot_ref, side at the next sample; of `out` u,
 * x_ref, xdot_ref, code and the six multipliers. */
void track_periods(zivi_tracker *tracker, const double *in, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, in += 11, out += 10) {
        zivi_given_reference now, next;
        now.x = in[5], now.xdot = in[6], now.side = in[7];
        next.x = in[8], next.xdot = in[9], next.side = in[10];
        if (in[7] == 0.0)
            out[3] = zivi_tracker_step_over(tracker, in[0], in[1], in[2], in[3], in[4], &out[0]);
        else
            out[3] = zivi_tracker_step_to_over(tracker, in[0], in[1], in[2], in[3], &now, &next,
                                               in[4], &out[0]);
        out[1] = tracker->x_ref;
        out[2] = tracker->xdot_ref;
        out[4] = tracker->lambda_s, out[5] = tracker->lambda_v, out[6] = tracker->lambda_sr;
        out[7] = tracker->lambda_vr, out[8] = tracker->lambda_es, out[9] = tracker->lambda_ev;
    }
}

/* Rows dt, x, xdot, force; u, code and both multipliers. */
void regulate_periods(zivi_regulator *regulator, const double *in, double *out, size_t rows)
{
    size_t k;
    for (k = 0; k < rows; k++, in += 4, out += 4) {
        out[1] = zivi_regulator_step_over(regulator, in[0], in[1], in[2], in[3], &out[0]);
        out[2] = regulator->lambda_s, out[3] = regulator->lambda_v;
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
