/* A landing that is sampled and late, under forces that its designer does not know: exact piecewise
 * motion, written from the equations alone.
 *
 *     x'' = F + d(t) + u,  x >= 0,  x'+ = -e x'-,  u held over a period, the one of `delay` periods ago
 *     u = -F - g,  g = clip(max(x' - quiet, 0)/(N h), D, U)   (U < D: U if >= U, else D),  g = D at rest
 *
 * A line of standard input: U D N h delay e F M x v quiet force seed watch end
 * A line of standard output: the time of rest (nan: none), the least and the largest control, and the
 * largest distance from the wall after the time `watch`.
 *
 *     cc -O2 -o landing_oracle landing_oracle.c -lm
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

enum { UP, DOWN, DRIVE, FRICTION, PERIODS, TELEGRAPH, SAMPLED, SINE, FORCES };

typedef struct {
    double U, D, N, h, e, F, M, quiet;
    int force;
    uint64_t state;
    double x, v, t, resting, next, sign, watch, height;
} run;

static double uniform(run *r)
{
    r->state ^= r->state << 13, r->state ^= r->state >> 7, r->state ^= r->state << 17;
    return (double)(r->state >> 11) * 0x1p-53;
}

static double law(const run *r, double x, double v)
{
    double q = (v > 0 ? fmax(v - r->quiet, 0) : v) / (r->N * r->h);
    if (x == 0 && fabs(v) <= r->quiet) return r->D;
    if (q >= r->U) return r->U;
    return q > r->D ? q : r->D;
}

/* the unknown force now, and whether it turns with the velocity */
static double unknown(run *r, double measured)
{
    switch (r->force) {
    case UP: return r->M;
    case DOWN: return -r->M;
    case DRIVE: return r->v > 0 ? r->M : -r->M;
    case FRICTION: return r->v > 0 ? -r->M : r->M;
    case SAMPLED: return measured > 0 ? r->M : -r->M;
    default: return r->sign * r->M;
    }
}

/* moves for `time` under the known acceleration `c` */
static void move(run *r, double c, double time, double measured)
{
    double end = r->t + time, small = 1e-9 * r->h * fmin(r->D, r->U);
    int turns = r->force == DRIVE || r->force == FRICTION;
    while (r->t < end) {
        if (r->force == TELEGRAPH && r->t >= r->next) {
            r->sign = -r->sign;
            r->next = r->t - r->h * log(1 - uniform(r)) * 0.7;
        }
        double left = end - r->t;
        if (r->force == TELEGRAPH && r->next < end) left = r->next - r->t;
        if (r->force == SINE) left = fmin(left, r->h / 8), r->sign = sin(r->next + 6.0 * r->t / (r->N * r->h));
        double a = c + unknown(r, measured);
        if (turns && r->v == 0) {
            double up = r->force == DRIVE ? c + r->M : c - r->M;
            double down = r->force == DRIVE ? c - r->M : c + r->M;
            a = up > 0 ? up : down < 0 ? down : 0;
        }
        if (r->x == 0 && r->v == 0) {
            if (a <= 0) { /* pressed onto the wall */
                if (isnan(r->resting)) r->resting = r->t;
                r->t += left;
                continue;
            }
        }
        r->resting = NAN;
        double hit = INFINITY, turn = INFINITY;
        double inside = r->v * r->v - 2 * a * r->x;
        if (r->v < 0 || a < 0) {
            if (inside >= 0) {
                /* the first root > 0 of x + v t + a t^2/2 */
                double root = sqrt(inside);
                if (a < 0) hit = r->v <= 0 ? 2 * r->x / (root - r->v) : (r->v + root) / -a;
                else if (r->v < 0) hit = 2 * r->x / (root - r->v);
            }
        }
        if (turns && r->v * a < 0) turn = -r->v / a;
        double step = fmin(left, fmin(hit, turn));
        if (r->t >= r->watch) {
            double rise = r->v > 0 && a < 0 ? fmin(step, r->v / -a) : 0;
            r->height = fmax(r->height, fmax(r->x, r->x + (r->v + 0.5 * a * rise) * rise));
        }
        if (step == hit) {
            double speed = sqrt(fmax(inside, 0));
            r->t += hit, r->x = 0, r->v = r->e * speed;
            if (r->v < small && a < 0) r->v = 0;
            if (r->v == 0) r->resting = r->t;
        } else {
            r->x += (r->v + 0.5 * a * step) * step, r->v += a * step, r->t += step;
            if (step == turn) r->v = 0;
            if (r->x < 0) r->x = 0;
        }
    }
}

static void simulate(run *r, int delay, double end, double *least, double *most)
{
    double queue[64] = {0}; /* the controls on their way */
    *least = INFINITY, *most = -INFINITY;
    for (long k = 0; k * r->h < end; k++) {
        double u = -r->F - law(r, r->x, r->v), acts = u, measured = r->v;
        if (delay) acts = queue[k % delay], queue[k % delay] = u;
        *least = fmin(*least, acts), *most = fmax(*most, acts);
        if (r->force == PERIODS) r->sign = 2 * uniform(r) - 1;
        double goal = (k + 1) * r->h;
        move(r, r->F + acts, goal - r->t, measured);
        r->t = goal;
    }
}

int main(void)
{
    run r;
    int delay;
    unsigned long long seed;
    double end, least, most;
    while (scanf("%lf %lf %lf %lf %d %lf %lf %lf %lf %lf %lf %d %llu %lf %lf", &r.U, &r.D, &r.N, &r.h, &delay, &r.e,
                 &r.F, &r.M, &r.x, &r.v, &r.quiet, &r.force, &seed, &r.watch, &end) == 15) {
        r.t = r.height = 0, r.resting = NAN, r.sign = 1, r.next = 0;
        r.state = seed * 0x9e3779b97f4a7c15ull + 1;
        for (int i = 0; i < 8; i++) uniform(&r);
        if (r.force == SINE) r.next = 6.28 * uniform(&r);
        simulate(&r, delay, end, &least, &most);
        printf("%.17g %.17g %.17g %.17g\n", r.resting, least, most, r.height);
    }
    return 0;
}
