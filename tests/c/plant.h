/* A mass above a wall under a force that is held for a period, through impacts into rest: exact up to
 * rounding, in doubles whatever the controller computes in. */
#ifndef PLANT_H
#define PLANT_H

#include <math.h>
#include <stddef.h>

typedef struct {
    double x, xdot, e;
} plant;

/* A loop: what goes in, and what comes out. */
typedef struct {
    double mu1, mu2, e, horizon, force, force_ref, h;
    double x, xdot, x_ref, xdot_ref; /* the start */
    double from; /* errors and variation are taken from here on (s) */
    double periods;
    /* out */
    double rest; /* from when on the mass rested with its reference, < 0: it did not */
    double variation; /* of u (m/s^3) */
    double error; /* root of the mean square of x - x_ref */
    double u; /* the last */
    double code;
} tracked_loop;

/* A mass that bounces by itself, and an observer of its position. */
typedef struct {
    double e, force, unknown, h, x, sigma, periods;
    /* out: roots of mean squares in flight */
    double of_xdot, of_d, refused;
} observed_loop;

/* Under the acceleration a. */
static void plant_move(plant *it, double a, double left)
{
    while (left > 0.0) {
        const double d = it->xdot * it->xdot - 2.0 * a * it->x;
        double t;
        if (it->x == 0.0 && it->xdot <= 0.0) {
            it->xdot *= -it->e;
            if (it->xdot == 0.0 && a <= 0.0)
                return;
        }
        if (it->x == 0.0 && a < 0.0 && 2.0 * it->xdot <= -a * (1.0 - it->e) * left) {
            it->xdot = 0.0; /* all further impacts: flights of 2 v/|a|, times e each */
            return;
        }
        if (it->x == 0.0)
            t = a < 0.0 ? -2.0 * it->xdot / a : INFINITY;
        else if (d < 0.0 || (a >= 0.0 && it->xdot >= 0.0))
            t = INFINITY;
        else
            t = it->xdot > 0.0 ? -(it->xdot + sqrt(d)) / a : 2.0 * it->x / (sqrt(d) - it->xdot);
        if (!(t <= left)) {
            it->x = fmax(it->x + left * (it->xdot + 0.5 * a * left), 0.0);
            it->xdot += a * left;
            return;
        }
        it->xdot = -sqrt(fmax(d, 0.0));
        it->x = 0.0;
        left -= t;
    }
}

/* A number from a normal distribution, nearly: the sum of twelve. */
static double plant_noise(unsigned long long *seed)
{
    double sum = -6.0;
    int k;
    for (k = 0; k < 12; k++) {
        *seed ^= *seed >> 12, *seed ^= *seed << 25, *seed ^= *seed >> 27;
        sum += (double)((*seed * 0x2545f4914f6cdd1dULL) >> 40) / 16777216.0;
    }
    return sum;
}

#endif
