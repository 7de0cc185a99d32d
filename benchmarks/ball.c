/* The yardstick: the bouncing ball by hand, for one scheme and one kind of force.
 *
 * Implicit Euler on the Zhuravlev-Ivanov system (theta = gamma = 1), constant force f < 0:
 *
 *   v+ = v + h ls f / R    s+ = s + h R v+    R = 1 - kappa ls lv    ls in sgn s+, lv in sgn v+
 *
 * solved by cases. By the symmetry (s, v) -> -(s, v) the step is taken on the side s >= 0, so
 * with b = -h f > 0 the everyday cases are
 *
 *   rising   v+ = v - b/(1 - kappa)   s+ = s + h ((1 - kappa) v - b)
 *   falling  v+ = v - b/(1 + kappa)   s+ = s + h ((1 + kappa) v - b)
 *
 * and the others end at the origin, on the wall, at the apex or on the other side of the wall.
 * The order in which nearly coincident cases are taken keeps rest exact.
 *
 * ball_run() records t, x, x', s, v, ls, lv and the natural residual of every step into memory
 * that it allocates; ball_fill() does so into memory of the caller; ball_loop() records nothing.
 * C99, no dependencies.
 */
#define _GNU_SOURCE /* posix_memalign, madvise */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <sys/mman.h>

enum { T, X, XDOT, S, V, LAMBDA_S, LAMBDA_V, RESIDUAL, COLUMNS };

typedef struct {
    double t0, t1, h, kappa, f, s0, v0;
    size_t n;
} ball_problem;

/* All that is constant over a run. */
typedef struct {
    double h, kappa, f, push, drop;     /* push = h f, drop = h push                */
    double travel_out, travel_in;       /* h (1 - kappa), h (1 + kappa)             */
    double kick_out, kick_in;           /* h f/(1 - kappa), h f/(1 + kappa)         */
} scheme;

/* A state with the multipliers of the step that led to it. */
typedef struct {
    double s, v, ls, lv;
} state;

/* Sign conditions hold to this relative tolerance. */
static const double TOL = 1e-13;

static double sgn(double z) { return (z > 0.0) - (z < 0.0); }

/* lambda = value/slope if it lies in [-1, 1], to within rounding. */
static int interior(double value, double slope, double *lambda)
{
    if (value == 0.0) {
        *lambda = 0.0;
        return 1;
    }
    *lambda = value / slope;
    if (!(fabs(*lambda) <= 1.0 + TOL))
        return 0;
    *lambda = fmax(-1.0, fmin(1.0, *lambda));
    return 1;
}

static int regular(const scheme *c, double s, double v, double ls, double lv, state *z)
{
    const int out = ls * lv > 0.0;
    const double travel = (out ? c->travel_out : c->travel_in) * v;
    const double kick = ls * (out ? c->kick_out : c->kick_in);
    const double drop = ls * c->drop;
    const double s1 = s + (travel + drop), v1 = v + kick;
    *z = (state){s1, v1, ls, lv};
    return ls * s1 >= -TOL * (s + fabs(travel) + fabs(drop)) &&
           lv * v1 >= -TOL * (fabs(v) + fabs(kick));
}

/* Everything but free flight and rest, on the side s >= 0. */
static __attribute__((noinline)) state switching(const scheme *c, double s, double v)
{
    state z = {0.0, 0.0, 0.0, 0.0};
    /* to the origin: R v = -ls push, of its solutions the one with the smallest |ls| */
    if (s <= TOL * c->h * (fabs(v) + fabs(c->push))) {
        const double speed = fabs(v / c->push);
        if (interior(speed, 1.0 + c->kappa * speed, &z.ls)) {
            z.ls *= sgn(v);
            z.lv = sgn(v);
            return z;
        }
    }
    /* to the wall, s+ = 0: s/h + v = ls (kappa lv v - push) */
    for (double lv = 1.0; lv >= -1.0; lv -= 2.0) {
        if (interior(s / c->h + v, c->kappa * lv * v - c->push, &z.ls)) {
            const double kick = z.ls * c->push / (1.0 - c->kappa * z.ls * lv);
            if (lv * (v + kick) >= -TOL * (fabs(v) + fabs(kick)))
                return (state){0.0, v + kick, z.ls, lv};
        }
    }
    /* to the apex, v+ = 0: R = -ls push/v, s+ = s */
    for (double ls = 1.0; ls >= -1.0; ls -= 2.0)
        if (interior(1.0 + ls * c->push / v, c->kappa * ls, &z.lv) && ls * s >= -TOL * s)
            return (state){s, 0.0, ls, z.lv};
    for (double ls = 1.0; ls >= -1.0; ls -= 2.0)
        for (double lv = 1.0; lv >= -1.0; lv -= 2.0)
            if (regular(c, s, v, ls, lv, &z))
                return z;
    return (state){NAN, NAN, NAN, NAN};
}

static inline state step(const scheme *c, double s, double v)
{
    if (s != 0.0 && v != 0.0) {
        /* free flight, not mirrored: that would lengthen the chain from step to step */
        const double ls = s > 0.0 ? 1.0 : -1.0, lv = v > 0.0 ? 1.0 : -1.0;
        const int out = (s > 0.0) == (v > 0.0);
        const double travel = (out ? c->travel_out : c->travel_in) * v;
        const double kick = ls * (out ? c->kick_out : c->kick_in);
        const double drop = ls * c->drop;
        const double s1 = s + (travel + drop), v1 = v + kick;
        if (ls * s1 >= TOL * (fabs(s) + fabs(travel) + fabs(drop)) &&
            lv * v1 >= TOL * (fabs(v) + fabs(kick)))
            return (state){s1, v1, ls, lv};
    } else if (s == 0.0 && v == 0.0) {
        return (state){0.0, 0.0, 0.0, 0.0}; /* at rest */
    }
    const double side = copysign(1.0, s != 0.0 ? s : v);
    const state z = switching(c, side * s, side * v);
    /* adding 0.0 turns a mirrored -0.0 into 0.0 */
    return (state){side * z.s + 0.0, side * z.v + 0.0, side * z.ls + 0.0, side * z.lv + 0.0};
}

/* |max(z - 1, min(z + 1, F))|, zero at a solution of F in -N_[-1,1](z). */
static inline double natural(double z, double F)
{
    const double inner = z + 1.0 < F ? z + 1.0 : F;
    return fabs(z - 1.0 > inner ? z - 1.0 : inner);
}

/* Relative natural residual of the step from (s, v), from the inclusion itself. */
static inline double residual(const scheme *c, double s, double v, double ls, double lv)
{
    const double R = 1.0 - c->kappa * ls * lv;
    const double kick = c->h * c->f / R;
    const double Fs = -(s + c->h * (R * v + c->h * ls * c->f)), Fv = -(v + ls * kick);
    const double size_s = fabs(s) + c->h * (R * fabs(v) + c->h * fabs(c->f));
    const double size_v = fabs(v) + fabs(kick);
    const double of_s = natural(ls, Fs / size_s), of_v = natural(lv, Fv / size_v);
    return of_s > of_v ? of_s : of_v;
}

static scheme prepare(const ball_problem *p, double h)
{
    const double out = 1.0 - p->kappa, in = 1.0 + p->kappa, push = h * p->f;
    return (scheme){h, p->kappa, p->f, push, h * push, h * out, h * in, push / out, push / in};
}

static inline void put(double *const column[COLUMNS], size_t k, double t, double kappa, state z,
                       double res)
{
    const double side = z.s != 0.0 ? copysign(1.0, z.s) : sgn(z.v);
    column[T][k] = t;
    column[X][k] = fabs(z.s);
    column[XDOT][k] = (1.0 - kappa * side * sgn(z.v)) * z.v * side;
    column[S][k] = z.s;
    column[V][k] = z.v;
    column[LAMBDA_S][k] = z.ls;
    column[LAMBDA_V][k] = z.lv;
    column[RESIDUAL][k] = res;
}

/* n steps into eight arrays of n + 1 doubles each. */
void ball_fill(const ball_problem *p, double *const column[COLUMNS])
{
    /* local copies, which the stores below cannot alias */
    const scheme c = prepare(p, p->h);
    double *const out[COLUMNS] = {column[0], column[1], column[2], column[3],
                                  column[4], column[5], column[6], column[7]};
    const double t0 = p->t0, t1 = p->t1;
    const size_t n = p->n;
    state z = {p->s0, p->v0, sgn(p->s0), sgn(p->v0)};
    put(out, 0, t0, c.kappa, z, 0.0);
    for (size_t k = 1; k <= n; k++) {
        const state next = step(&c, z.s, z.v);
        const double t = k < n ? t0 + (double)k * c.h : t1;
        put(out, k, t, c.kappa, next, residual(&c, z.s, z.v, next.ls, next.lv));
        z = next;
    }
}

/* The same into fresh memory; 0 if there is none. Each column is freed by ball_free(). */
int ball_run(const ball_problem *p, double *column[COLUMNS])
{
    int complete = 1;
    for (int j = 0; j < COLUMNS; j++) {
        column[j] = malloc((p->n + 1) * sizeof(double));
        complete = complete && column[j] != NULL;
    }
    if (complete)
        ball_fill(p, column);
    return complete;
}

/* The same into one fresh block for which large pages are asked (where the system knows them). */
int ball_run_large(const ball_problem *p, double *column[COLUMNS])
{
    const size_t row = p->n + 1, bytes = COLUMNS * row * sizeof(double);
    void *block;
    if (posix_memalign(&block, 4096, bytes) != 0)
        return 0;
#ifdef MADV_HUGEPAGE
    madvise(block, bytes, MADV_HUGEPAGE);
#endif
    for (int j = 0; j < COLUMNS; j++)
        column[j] = (double *)block + (size_t)j * row;
    ball_fill(p, column);
    return 1;
}

void ball_free_large(double *const column[COLUMNS])
{
    free(column[0]);
}

void ball_free(double *const column[COLUMNS])
{
    for (int j = 0; j < COLUMNS; j++)
        free(column[j]);
}

/* The steps alone: only the end (s, v) is kept. */
void ball_loop(const ball_problem *p, double end[2])
{
    const scheme c = prepare(p, p->h);
    const size_t n = p->n;
    state z = {p->s0, p->v0, 0.0, 0.0};
    for (size_t k = 1; k <= n; k++)
        z = step(&c, z.s, z.v);
    end[0] = z.s;
    end[1] = z.v;
}
