/* See bits.h. Needs no library but zivi: runs on a computer and on a bare microcontroller. */
#include "bits.h"

#include "zivi.h"

typedef union {
    zivi_mass mass;
    zivi_regulator regulator;
    zivi_tracker tracker;
    zivi_observer observer;
} object;

enum { MASS, REGULATOR, TRACKER, FOLLOWER, OBSERVER };
enum { WIDE, NEAR, FAST };

static const struct {
    const char *name;
    int kind, draws, variant;
} plan[BITS_SERIES] = {
    {"mass, wide", MASS, WIDE, 0},
    {"mass, near", MASS, NEAR, 0},
    {"mass, fast", MASS, FAST, 0},
    {"regulator", REGULATOR, WIDE, 0},
    {"regulator of the paper", REGULATOR, FAST, 1},
    {"tracker, wide", TRACKER, WIDE, 0},
    {"tracker, near", TRACKER, NEAR, 0},
    {"tracker, fast", TRACKER, FAST, 0},
    {"tracker, nearest branch, near", TRACKER, NEAR, 1},
    {"tracker, nearest branch, fast", TRACKER, FAST, 1},
    {"tracker of the paper, near", TRACKER, NEAR, 2},
    {"tracker of the paper, fast", TRACKER, FAST, 2},
    {"tracker with horizon, near", TRACKER, NEAR, 3},
    {"tracker with horizon, fast", TRACKER, FAST, 3},
    {"tracker to a given reference, wide", FOLLOWER, WIDE, 1},
    {"tracker to a given reference, fast", FOLLOWER, FAST, 3},
    {"observer", OBSERVER, WIDE, 0},
    {"observer of positions", OBSERVER, FAST, 1},
};

static uint64_t seed;

/* xorshift64*, its upper bits as a number in [0, 1) */
static double uniform(void)
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return (double)(uint32_t)((seed * 0x2545f4914f6cdd1dULL) >> 32) / 4294967296.0;
}

static double about_zero(double scale)
{
    return scale * 2.0 * (uniform() + uniform() + uniform() - 1.5);
}

static double magnitude(double z)
{
    return z < 0.0 ? -z : z;
}

static void draw(int kind, double *x, double *xdot)
{
    *x = magnitude(about_zero(kind == WIDE ? 3.0 : kind == NEAR ? 1e-4 : 1e-3));
    if (kind == NEAR && uniform() < 0.5)
        *x = 0.0;
    *xdot = about_zero(kind == WIDE ? 5.0 : kind == NEAR ? 1e-2 : 4.0);
    if (kind == FAST)
        *xdot = -magnitude(*xdot);
}

static double not_known(void)
{
    const volatile double zero = 0.0;
    return zero / zero;
}

static uint64_t mixed(uint64_t hash, double value)
{
    union {
        double number;
        uint64_t bits;
    } it;
    it.bits = 0; /* a number in single precision has half of them */
    it.number = value;
    hash = (hash ^ it.bits) * 0x9e3779b97f4a7c15ULL;
    return hash ^ (hash >> 29);
}

static int prepared(int number, object *it)
{
    const int variant = plan[number].variant;
    zivi_mass_config mass;
    zivi_regulator_config regulator;
    zivi_tracker_config tracker;
    zivi_observer_config observer;
    switch (plan[number].kind) {
    case MASS:
        zivi_mass_defaults(&mass);
        mass.h = 1e-3, mass.kappa = 0.41;
        return zivi_mass_init(&it->mass, &mass);
    case REGULATOR:
        zivi_regulator_defaults(&regulator);
        regulator.mu1 = 30.0, regulator.mu2 = 17.0, regulator.h = 1e-3, regulator.e = 0.5;
        regulator.tick = variant == 1 ? ZIVI_TICK_PAPER : ZIVI_TICK_LANDING;
        return zivi_regulator_init(&it->regulator, &regulator);
    case OBSERVER:
        zivi_observer_defaults(&observer);
        observer.h = 1e-3, observer.e = 0.6, observer.se = 0.02;
        observer.position_only = (uint32_t)variant;
        return zivi_observer_init(&it->observer, &observer);
    default:
        zivi_tracker_defaults(&tracker);
        tracker.mu1 = 30.0, tracker.mu2 = 17.0, tracker.h = 1e-3;
        tracker.kappa = 0.41, tracker.e_ref = 0.5;
        tracker.branch = variant == 1 ? ZIVI_BRANCH_NEAREST : ZIVI_BRANCH_POSITIVE;
        tracker.tick = variant == 2 ? ZIVI_TICK_PAPER : ZIVI_TICK_LANDING;
        if (variant == 3) {
            tracker.horizon = 3.0, tracker.shift = 1, tracker.press = 15.0, tracker.ahead = 2;
        }
        return zivi_tracker_init(&it->tracker, &tracker);
    }
}

/* One call with drawn arguments: its code, its cost, and what it gave mixed into the hash. */
static int called(int number, int k, object *it, uint64_t *hash, uint32_t *cost)
{
    const int kind = plan[number].kind, draws = plan[number].draws;
    zivi_given_reference now = {0.0, 0.0, 1.0}, next = {0.0, 0.0, 1.0};
    double x, xdot, u = 0.0;
    const double force = -9.81 + about_zero(3.0), force_ref = -9.81 + about_zero(3.0);
    const double push = 0.1 * force_ref;
    uint32_t start;
    int code = 0;
    draw(draws, &x, &xdot);
    draw(draws, &now.x, &now.xdot);
    if (k % 9 == 0)
        now.x = now.xdot = 0.0; /* the reference rests: the landing */
    if (kind == MASS)
        code = zivi_mass_reset(&it->mass, x, xdot);
    else if (kind == TRACKER)
        code = zivi_tracker_reset(&it->tracker, now.x, now.xdot);
    next.x = magnitude(now.x + 1e-3 * now.xdot), next.xdot = now.xdot + 1e-3 * force_ref;
    now.side = k % 2 == 0 ? 1.0 : -1.0, next.side = k % 5 == 0 ? 1.0 : now.side;
    start = bits_clock();
    if (code == ZIVI_OK)
        switch (kind) {
        case MASS:
            code = zivi_mass_step(&it->mass, k % 4 == 0 ? -force : force);
            break;
        case REGULATOR:
            code = zivi_regulator_step(&it->regulator, x, xdot, force, &u);
            break;
        case TRACKER:
            code = zivi_tracker_step(&it->tracker, x, xdot, force, force_ref, &u);
            break;
        case FOLLOWER:
            code = zivi_tracker_step_to(&it->tracker, x, xdot, force, &now, &next,
                                        k % 3 == 0 ? force_ref : not_known(), &u);
            break;
        default:
            code = zivi_observer_step(&it->observer, x, xdot, force, push);
        }
    *cost = bits_clock() - start;
    if (kind == MASS) {
        *hash = mixed(mixed(*hash, it->mass.s), it->mass.v);
        *hash = mixed(mixed(*hash, it->mass.x), it->mass.xdot);
    } else if (kind == OBSERVER) {
        *hash = mixed(mixed(*hash, it->observer.x), it->observer.xdot);
        *hash = mixed(mixed(*hash, it->observer.d), it->observer.p_dd);
    } else if (kind != REGULATOR) {
        *hash = mixed(mixed(*hash, it->tracker.x_ref), it->tracker.xdot_ref);
        *hash = mixed(mixed(*hash, it->tracker.lambda_es), it->tracker.iterations);
    }
    *hash = mixed(mixed(*hash, u), code);
    return code;
}

int bits_run(int number, bits_series *series)
{
    static object it; /* not on the stack that is measured */
    uint32_t sum = 0, cost, most = 0;
    int k;
    series->name = plan[number].name;
    series->calls = BITS_CALLS;
    series->hash = 0;
    seed = 0x853c49e6748fea9bULL + (uint64_t)number;
    if (prepared(number, &it) != ZIVI_OK)
        return 1;
    bits_paint();
    for (k = 0; k < BITS_CALLS; k++) {
        if (called(number, k, &it, &series->hash, &cost) < 0)
            return 2;
        sum += cost;
        most = cost > most ? cost : most;
    }
    series->mean = sum / BITS_CALLS;
    series->most = most;
    series->stack = bits_depth();
    return 0;
}
