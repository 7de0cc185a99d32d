/* The impact oscillator by hand: x'' = -k x - c x' - g + A cos(w t), x >= 0, x'+ = -e x'-.
 *
 * Between impacts the motion is the forced response p(t) and a damped swing,
 *
 *   x(t) = p(t) + exp(-c (t - t0)/2) (a cos(wd (t - t0)) + b sin(wd (t - t0))),
 *   p(t) = P cos(w t) + Q sin(w t) - g/k,   wd = sqrt(k - c^2/4),
 *
 * and the next impact is looked for as a careful user does: in steps of a twentieth of the
 * quicker period until the sign changes, then by Newton's method, kept within its bracket.
 * No rest and no accumulation: it does not end where the mass comes to rest.
 * C99, no dependencies.
 */
#include <math.h>
#include <stddef.h>

typedef struct {
    double k, c, g, a, w, e;
} oscillator;

typedef struct {
    double rate, wd, P, Q, lift; /* c/2, and the response */
} response;

typedef struct {
    double t0, a, b;
} flight;

static void forced(const oscillator *o, const response *r, double t, double *x, double *v)
{
    const double C = cos(o->w * t), S = sin(o->w * t);
    *x = r->P * C + r->Q * S + r->lift;
    *v = o->w * (r->Q * C - r->P * S);
}

static void at(const oscillator *o, const response *r, const flight *f, double tau, double *x,
               double *v)
{
    const double C = cos(r->wd * tau), S = sin(r->wd * tau), fade = exp(-r->rate * tau);
    double px, pv;
    forced(o, r, f->t0 + tau, &px, &pv);
    *x = px + fade * (f->a * C + f->b * S);
    *v = pv + fade * ((r->wd * f->b - r->rate * f->a) * C - (r->wd * f->a + r->rate * f->b) * S);
}

static flight start(const oscillator *o, const response *r, double t, double x, double v)
{
    double px, pv;
    forced(o, r, t, &px, &pv);
    const double a = x - px;
    return (flight){t, a, (v - pv + r->rate * a) / r->wd};
}

/* From (x, v) at t = 0 to t1; the number of impacts, the time and speed after the last in end. */
size_t oscillator_run(const oscillator *o, double x, double v, double t1, double end[2])
{
    const double D = (o->k - o->w * o->w) * (o->k - o->w * o->w) + o->c * o->c * o->w * o->w;
    const response r = {o->c / 2.0, sqrt(o->k - o->c * o->c / 4.0),
                        o->a * (o->k - o->w * o->w) / D, o->a * o->c * o->w / D, -o->g / o->k};
    const double step = 0.05 * 6.283185307179586 / (o->w > r.wd ? o->w : r.wd);
    flight f = start(o, &r, 0.0, x, v);
    size_t impacts = 0;
    while (f.t0 < t1) {
        double low = 0.0, high = 0.0, px, pv;
        do {
            low = high;
            high += step;
            at(o, &r, &f, high, &px, &pv);
        } while (px > 0.0 && f.t0 + high < t1);
        if (px > 0.0)
            break;
        double tau = 0.5 * (low + high);
        for (int k = 0; k < 60; k++) {
            at(o, &r, &f, tau, &px, &pv);
            if (px > 0.0)
                low = tau;
            else
                high = tau;
            double next = tau - px / pv;
            if (!(next > low && next < high))
                next = 0.5 * (low + high);
            if (fabs(next - tau) <= 1e-15 * (f.t0 + tau))
                break;
            tau = next;
        }
        if (f.t0 + tau > t1)
            break;
        end[0] = f.t0 + tau;
        end[1] = -o->e * pv;
        f = start(o, &r, end[0], 0.0, end[1]);
        impacts++;
    }
    return impacts;
}
