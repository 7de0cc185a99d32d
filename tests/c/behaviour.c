/* What the library promises of bad arguments, of several objects, and of copies. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "zivi.h"

static int failures;

#define EXPECT(condition) \
    do { \
        if (!(condition)) { \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition); \
            failures++; \
        } \
    } while (0)

static zivi_tracker_config tracker_config(void)
{
    zivi_tracker_config config;
    zivi_tracker_defaults(&config);
    config.mu1 = 30.0;
    config.mu2 = 17.0;
    config.h = 1e-3;
    config.e = 0.5;
    return config;
}

static zivi_observer_config observer_config(void)
{
    zivi_observer_config config;
    zivi_observer_defaults(&config);
    config.h = 1e-3;
    config.e = 0.5;
    return config;
}

static zivi_regulator_config regulator_config(void)
{
    zivi_regulator_config config;
    zivi_regulator_defaults(&config);
    config.mu1 = 3.0;
    config.mu2 = 2.0;
    config.h = 1e-3;
    config.e = 0.5;
    return config;
}

/* A change of one member of the tracker's settings gives this code and leaves the object alone. */
#define REFUSED(kind, member, value, expected) \
    do { \
        zivi_##kind it, before; \
        zivi_##kind##_config config = kind##_config(); \
        memset(&it, 0xa5, sizeof it); \
        before = it; \
        config.member = (value); \
        EXPECT(zivi_##kind##_init(&it, &config) == (expected)); \
        EXPECT(memcmp(&it, &before, sizeof it) == 0); \
    } while (0)

static void settings(void)
{
    REFUSED(tracker, size, sizeof(zivi_tracker_config) - 8, ZIVI_E_SIZE);
    REFUSED(tracker, size, 0, ZIVI_E_SIZE);
    REFUSED(tracker, h, 0.0, ZIVI_E_H);
    REFUSED(tracker, h, -1e-3, ZIVI_E_H);
    REFUSED(tracker, h, NAN, ZIVI_E_H);
    REFUSED(tracker, h, INFINITY, ZIVI_E_H);
    REFUSED(tracker, e, 0.0, ZIVI_E_E);
    REFUSED(tracker, e, -0.5, ZIVI_E_E);
    REFUSED(tracker, e, 1.5, ZIVI_E_E);
    REFUSED(tracker, e, NAN, ZIVI_E_E);
    REFUSED(tracker, kappa, 0.9, ZIVI_E_KAPPA);
    REFUSED(tracker, kappa, NAN, ZIVI_E_KAPPA);
    REFUSED(tracker, e_ref, 2.0, ZIVI_E_E_REF);
    REFUSED(tracker, e_ref, NAN, ZIVI_E_E_REF);
    REFUSED(tracker, kappa_ref, 1.0, ZIVI_E_KAPPA_REF);
    REFUSED(tracker, mu1, NAN, ZIVI_E_MU1);
    REFUSED(tracker, mu1, -1.0, ZIVI_E_MU1);
    REFUSED(tracker, mu2, 30.0, ZIVI_E_MU2);
    REFUSED(tracker, mu2, INFINITY, ZIVI_E_MU2);
    REFUSED(tracker, mu2, NAN, ZIVI_E_MU2);
    REFUSED(tracker, bound, 12.0, ZIVI_E_MU2);
    REFUSED(tracker, bound, 9.0, ZIVI_E_MU1);
    REFUSED(tracker, bound, -1.0, ZIVI_E_BOUND);
    REFUSED(tracker, bound, NAN, ZIVI_E_BOUND);
    REFUSED(tracker, depth, -0.1, ZIVI_E_DEPTH);
    REFUSED(tracker, depth, NAN, ZIVI_E_DEPTH);
    REFUSED(tracker, u_min, 1.0, ZIVI_E_U_MAX);
    REFUSED(tracker, u_min, NAN, ZIVI_E_U_MIN);
    REFUSED(tracker, u_max, NAN, ZIVI_E_U_MAX);
    REFUSED(tracker, branch, 2, ZIVI_E_BRANCH);
    REFUSED(tracker, tick, 3, ZIVI_E_TICK);
    REFUSED(tracker, shift, 2, ZIVI_E_SHIFT);
    REFUSED(tracker, press, NAN, ZIVI_E_PRESS);
    REFUSED(tracker, press, INFINITY, ZIVI_E_PRESS);
    REFUSED(tracker, quiet, -1e-3, ZIVI_E_QUIET);
    REFUSED(tracker, quiet, NAN, ZIVI_E_QUIET);
    REFUSED(tracker, horizon, 0.5, ZIVI_E_HORIZON);
    REFUSED(tracker, horizon, NAN, ZIVI_E_HORIZON);
    REFUSED(observer, size, 8, ZIVI_E_SIZE);
    REFUSED(observer, h, NAN, ZIVI_E_H);
    REFUSED(observer, e, 2.0, ZIVI_E_E);
    REFUSED(observer, noise_x, -1.0, ZIVI_E_NOISE);
    REFUSED(observer, noise_xdot, NAN, ZIVI_E_NOISE);
    REFUSED(observer, q_d, -1.0, ZIVI_E_Q_D);
    REFUSED(observer, se, 1.5, ZIVI_E_SE);
    REFUSED(observer, dmax, INFINITY, ZIVI_E_DMAX);
    REFUSED(observer, position_only, 2, ZIVI_E_POSITION_ONLY);
    REFUSED(observer, learn_e, 2, ZIVI_E_LEARN_E);
    REFUSED(observer, q_e, -1.0, ZIVI_E_Q_E);
    REFUSED(regulator, size, 4, ZIVI_E_SIZE);
    REFUSED(regulator, h, 0.0, ZIVI_E_H);
    REFUSED(regulator, e, 1.0000001, ZIVI_E_E);
    REFUSED(regulator, mu2, 3.0, ZIVI_E_MU2);
    REFUSED(regulator, bound, 2.5, ZIVI_E_MU1);
    REFUSED(regulator, tick, 7, ZIVI_E_TICK);
    REFUSED(regulator, quiet, INFINITY, ZIVI_E_QUIET);
}

/* A member that is zero is meant where its bit is set. */
static void meant(void)
{
    zivi_tracker it;
    zivi_tracker_config config = tracker_config();
    zivi_observer seen;
    zivi_observer_config seeing = observer_config();
    zivi_mass mass;
    zivi_mass_config moved;
    double u;
    REFUSED(tracker, given, ZIVI_GIVEN_DMAX, ZIVI_E_GIVEN);
    REFUSED(tracker, given, 1u << 31, ZIVI_E_GIVEN);
    REFUSED(regulator, given, ZIVI_GIVEN_PRESS, ZIVI_E_GIVEN);
    REFUSED(observer, given, ZIVI_GIVEN_DEPTH, ZIVI_E_GIVEN);
    REFUSED(tracker, given, ZIVI_GIVEN_AHEAD, ZIVI_E_AHEAD);
    REFUSED(tracker, given, ZIVI_GIVEN_U_LIMITS, ZIVI_E_U_MAX);
    REFUSED(tracker, given, ZIVI_GIVEN_E_REF, ZIVI_E_E_REF);
    REFUSED(tracker, given, ZIVI_GIVEN_KAPPA, ZIVI_E_KAPPA); /* it is not that of e = 0.5 */
    REFUSED(observer, given, ZIVI_GIVEN_NOISE_X, ZIVI_E_NOISE);
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_OK && it.depth == 0.1);
    EXPECT(zivi_tracker_step(&it, 0.0, 0.0, -9.81, -9.81, &u) == ZIVI_OK && u < 0.0);
    config.given = ZIVI_GIVEN_DEPTH | ZIVI_GIVEN_PRESS | ZIVI_GIVEN_KAPPA_REF;
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_OK && it.depth == 0.0 && it.e_ref == 1.0);
    EXPECT(zivi_tracker_step(&it, -1e-9, 0.0, -9.81, -9.81, &u) == ZIVI_E_X);
    EXPECT(zivi_tracker_step(&it, 0.0, 0.0, -9.81, -9.81, &u) == ZIVI_OK && u == 9.81);
    config.horizon = 0.0;
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_OK && it.horizon == 1.0);
    config.given |= ZIVI_GIVEN_HORIZON;
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_E_HORIZON);
    config.given = ZIVI_GIVEN_PRESS;
    config.bound = 1.0; /* which it does not press with */
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_E_PRESS);
    EXPECT(zivi_observer_init(&seen, &seeing) == ZIVI_OK && seen.config.dmax > 0.0);
    seeing.given = ZIVI_GIVEN_DMAX | ZIVI_GIVEN_Q_D;
    EXPECT(zivi_observer_init(&seen, &seeing) == ZIVI_OK);
    EXPECT(seen.config.dmax == 0.0 && seen.config.q_d == 0.0);
    EXPECT(zivi_mass_defaults(&moved) == ZIVI_OK && moved.given == 0);
    moved.h = 1e-3, moved.given = ZIVI_GIVEN_KAPPA;
    EXPECT(zivi_mass_init(&mass, &moved) == ZIVI_OK && mass.e == 1.0);
}

static void masses(void)
{
    zivi_mass mass, before;
    zivi_mass_config config;
    EXPECT(zivi_mass_defaults(NULL) == ZIVI_E_NULL);
    EXPECT(zivi_mass_defaults(&config) == ZIVI_OK && config.size == sizeof config);
    EXPECT(zivi_mass_init(&mass, NULL) == ZIVI_E_NULL);
    EXPECT(zivi_mass_init(NULL, &config) == ZIVI_E_NULL);
    EXPECT(zivi_mass_init(&mass, &config) == ZIVI_E_E);
    config.e = 0.5;
    EXPECT(zivi_mass_init(&mass, &config) == ZIVI_E_H);
    config.h = 1e-2;
    EXPECT(zivi_mass_init(&mass, &config) == ZIVI_OK);
    before = mass;
    EXPECT(zivi_mass_reset(&mass, -1.0, 0.0) == ZIVI_E_X);
    EXPECT(zivi_mass_reset(&mass, NAN, 0.0) == ZIVI_E_X);
    EXPECT(zivi_mass_reset(&mass, 1.0, INFINITY) == ZIVI_E_XDOT);
    EXPECT(zivi_mass_step(&mass, NAN) == ZIVI_E_FORCE);
    EXPECT(zivi_mass_step(&mass, 1e307) == ZIVI_OK);
    mass = before;
    EXPECT(zivi_mass_reset(&mass, 1e308, 1e308) == ZIVI_E_XDOT);
    EXPECT(memcmp(&mass, &before, sizeof mass) == 0);
    EXPECT(zivi_mass_step(NULL, 0.0) == ZIVI_E_NULL);
    memset(&mass, 0, sizeof mass);
    EXPECT(zivi_mass_step(&mass, 0.0) == ZIVI_E_STATE);
    EXPECT(zivi_mass_reset(&mass, 1.0, 0.0) == ZIVI_E_STATE);
}

static void samples(void)
{
    const double bad[] = {NAN, INFINITY, -INFINITY};
    zivi_tracker it, before;
    zivi_regulator other, other_before;
    zivi_tracker_config config = tracker_config();
    zivi_regulator_config other_config = regulator_config();
    double u = 0.0;
    size_t k;
    config.u_min = -20.0;
    config.u_max = 60.0;
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_OK);
    EXPECT(zivi_tracker_reset(&it, 3.0, 3.0) == ZIVI_OK);
    EXPECT(zivi_tracker_step(&it, 6.0, 5.0, -9.81, -19.81, &u) == ZIVI_SATURATED);
    EXPECT(u == -20.0 && it.status == ZIVI_SATURATED && it.ticks == 1);
    EXPECT(zivi_regulator_init(&other, &other_config) == ZIVI_OK);
    EXPECT(zivi_regulator_step(&other, 1.0, -0.5, 0.0, &u) == ZIVI_OK && u == -1.0);
    before = it;
    other_before = other;
    for (k = 0; k < 3; k++) {
        u = 7.0;
        EXPECT(zivi_tracker_step(&it, bad[k], 0.0, 0.0, 0.0, &u) == ZIVI_E_X && u == -20.0);
        u = 7.0;
        EXPECT(zivi_tracker_step(&it, 1.0, bad[k], 0.0, 0.0, &u) == ZIVI_E_XDOT && u == -20.0);
        u = 7.0;
        EXPECT(zivi_tracker_step(&it, 1.0, 0.0, bad[k], 0.0, &u) == ZIVI_E_FORCE && u == -20.0);
        u = 7.0;
        EXPECT(zivi_tracker_step(&it, 1.0, 0.0, 0.0, bad[k], &u) == ZIVI_E_FORCE_REF && u == -20.0);
        u = 7.0;
        EXPECT(zivi_regulator_step(&other, bad[k], 0.0, 0.0, &u) == ZIVI_E_X && u == -1.0);
        EXPECT(zivi_tracker_reset(&it, bad[k], 0.0) == ZIVI_E_X_REF);
        EXPECT(zivi_tracker_reset(&it, 1.0, bad[k]) == ZIVI_E_XDOT_REF);
    }
    u = 7.0;
    EXPECT(zivi_tracker_step(&it, -0.2, 0.0, 0.0, 0.0, &u) == ZIVI_E_X && u == -20.0);
    u = 7.0;
    EXPECT(zivi_tracker_step(&it, 1.0, 0.0, 0.0, 0.0, NULL) == ZIVI_E_NULL);
    EXPECT(zivi_tracker_step(NULL, 1.0, 0.0, 0.0, 0.0, &u) == ZIVI_E_NULL && u == 7.0);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    EXPECT(memcmp(&other, &other_before, sizeof other) == 0);
    EXPECT((zivi_tracker_step(&it, -1e-9, 0.0, 0.0, 0.0, &u) & ZIVI_CLAMPED) == ZIVI_CLAMPED);
    EXPECT(zivi_tracker_step(&it, 1.0, 0.0, 0.0, 0.0, &it.u) >= 0); /* u may lie in the object */
    memset(&it, 0, sizeof it);
    u = 7.0;
    EXPECT(zivi_tracker_step(&it, 1.0, 0.0, 0.0, 0.0, &u) == ZIVI_E_STATE && u == 7.0);
    EXPECT(zivi_tracker_reset(&it, 1.0, 0.0) == ZIVI_E_STATE);
}

/* Periods of another length, or without a sample: what is refused changes nothing, h stays. */
static void other_periods(void)
{
    const double bad[] = {NAN, INFINITY, -INFINITY, 0.0, -1e-3};
    zivi_given_reference now = {1.0, 0.5, 1.0}, next = {1.0005, 0.49, 1.0}, wrong = {1.0, 0.5, 0.0};
    zivi_tracker it, before;
    zivi_regulator other, other_before;
    zivi_tracker_config config = tracker_config();
    zivi_regulator_config other_config = regulator_config();
    double u = 0.0, v = 0.0;
    size_t k;
    EXPECT(zivi_tracker_init(&it, &config) == ZIVI_OK);
    EXPECT(zivi_tracker_reset(&it, 3.0, 3.0) == ZIVI_OK);
    EXPECT(zivi_tracker_step(&it, 6.0, 5.0, -9.81, -19.81, &u) == ZIVI_OK);
    EXPECT(zivi_regulator_init(&other, &other_config) == ZIVI_OK);
    EXPECT(zivi_regulator_step(&other, 1.0, -0.5, 0.0, &v) == ZIVI_OK && v == -1.0);
    before = it;
    other_before = other;
    for (k = 0; k < 5; k++) {
        v = 7.0;
        EXPECT(zivi_tracker_step_over(&it, bad[k], 6.0, 5.0, -9.81, -19.81, &v) == ZIVI_E_DT && v == u);
        v = 7.0;
        EXPECT(zivi_tracker_step_to_over(&it, bad[k], NAN, 0.0, 0.0, &now, &next, NAN, &v) == ZIVI_E_DT);
        EXPECT(v == u);
        EXPECT(zivi_regulator_step_over(&other, bad[k], NAN, 0.0, 0.0, &v) == ZIVI_E_DT && v == -1.0);
    }
    EXPECT(zivi_tracker_step_over(&it, 1e-2, INFINITY, 5.0, -9.81, -19.81, &v) == ZIVI_E_X);
    EXPECT(zivi_tracker_step_over(&it, 1e-2, 6.0, NAN, -9.81, -19.81, &v) == ZIVI_E_XDOT);
    EXPECT(zivi_tracker_step_over(&it, 1e-2, NAN, 0.0, -9.81, NAN, &v) == ZIVI_E_FORCE_REF);
    EXPECT(zivi_tracker_step_to_over(&it, 1e-2, NAN, 0.0, 0.0, &now, &wrong, NAN, &v) == ZIVI_E_SIDE);
    EXPECT(zivi_tracker_step_to_over(&it, 1e-2, NAN, 0.0, 0.0, NULL, &next, NAN, &v) == ZIVI_E_NULL);
    EXPECT(zivi_tracker_step_over(&it, 1e-2, 6.0, 5.0, 0.0, 0.0, NULL) == ZIVI_E_NULL);
    EXPECT(zivi_regulator_step_over(&other, 1e-2, 1.0, NAN, 0.0, &v) == ZIVI_E_XDOT);
    EXPECT(zivi_regulator_step_over(NULL, 1e-2, 1.0, 0.0, 0.0, &v) == ZIVI_E_NULL);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    EXPECT(memcmp(&other, &other_before, sizeof other) == 0);
    /* missing: the control is held, the reference moves on, the signs stay */
    EXPECT(zivi_tracker_step_over(&it, 1e-3, NAN, NAN, NAN, -19.81, &v) == ZIVI_OK && v == u);
    EXPECT(it.x_ref > before.x_ref && it.lambda_es == before.lambda_es && it.ticks == 2);
    EXPECT(zivi_tracker_step_to_over(&it, 1e-3, NAN, 0.0, 0.0, &now, &next, NAN, &v) == ZIVI_OK);
    EXPECT(v == u && it.x_ref == next.x && it.h == before.h && it.seal == before.seal);
    EXPECT(zivi_regulator_step_over(&other, 1e-2, NAN, NAN, NAN, &v) == ZIVI_OK && v == -1.0);
    EXPECT(other.h == other_before.h && other.seal == other_before.seal && other.ticks == 2);
    /* with h they are the calls without dt */
    before = it;
    EXPECT(zivi_tracker_step_over(&it, it.h, 6.0, 5.0, -9.81, -19.81, &u)
           == zivi_tracker_step(&before, 6.0, 5.0, -9.81, -19.81, &v));
    EXPECT(u == v && memcmp(&it, &before, sizeof it) == 0);
    memset(&it, 0, sizeof it);
    EXPECT(zivi_tracker_step_over(&it, 1e-3, 1.0, 0.0, 0.0, 0.0, &u) == ZIVI_E_STATE);
    memset(&other, 0, sizeof other);
    EXPECT(zivi_regulator_step_over(&other, 1e-3, NAN, 0.0, 0.0, &u) == ZIVI_E_STATE);
}

/* Two trackers in turn give what each gives alone, and a copy goes on like its original. */
static void independence(void)
{
    zivi_tracker alone[2], together[2], copy;
    double u = 0.0, v = 0.0, x;
    int j, k;
    for (j = 0; j < 2; j++) {
        zivi_tracker_config config = tracker_config();
        config.e = 0.5 - 0.2 * j;
        config.branch = (uint32_t)j;
        EXPECT(zivi_tracker_init(&alone[j], &config) == ZIVI_OK);
        EXPECT(zivi_tracker_reset(&alone[j], 1.0 + j, 2.0) == ZIVI_OK);
        together[j] = alone[j];
    }
    for (j = 0; j < 2; j++)
        for (k = 0; k < 3000; k++) {
            x = alone[j].x_ref + 0.05 * sin(0.01 * k) * sin(0.01 * k);
            EXPECT(zivi_tracker_step(&alone[j], x, alone[j].xdot_ref, -9.81, -9.81, &u) >= 0);
        }
    for (k = 0; k < 3000; k++)
        for (j = 0; j < 2; j++) {
            x = together[j].x_ref + 0.05 * sin(0.01 * k) * sin(0.01 * k);
            EXPECT(zivi_tracker_step(&together[j], x, together[j].xdot_ref, -9.81, -9.81, &u) >= 0);
        }
    EXPECT(memcmp(alone, together, sizeof alone) == 0);
    EXPECT(zivi_tracker_reset(&alone[0], 1.0, 2.0) == ZIVI_OK);
    for (k = 0; k < 2000; k++) {
        if (k == 700)
            memcpy(&copy, &alone[0], sizeof copy);
        EXPECT(zivi_tracker_step(&alone[0], 0.3, 0.1 * k, -9.81, -9.81, &u) >= 0);
        if (k >= 700)
            EXPECT(zivi_tracker_step(&copy, 0.3, 0.1 * k, -9.81, -9.81, &v) >= 0 && u == v);
    }
    EXPECT(memcmp(&alone[0], &copy, sizeof copy) == 0);
}

static void observers(void)
{
    const double bad[] = {NAN, INFINITY, -INFINITY};
    zivi_observer it, before;
    zivi_observer_config config = observer_config();
    size_t k;
    EXPECT(zivi_observer_init(NULL, &config) == ZIVI_E_NULL);
    EXPECT(zivi_observer_init(&it, &config) == ZIVI_OK);
    EXPECT(zivi_observer_step(&it, 1.0, NAN, -9.81, 0.0) == ZIVI_OK && it.x == 1.0);
    EXPECT(zivi_observer_step(&it, 1.0, 0.0, -9.81, 0.0) == ZIVI_OK);
    before = it;
    for (k = 0; k < 3; k++) {
        EXPECT(k == 0 || zivi_observer_step(&it, bad[k], 0.0, 0.0, 0.0) == ZIVI_E_X);
        EXPECT(k == 0 || zivi_observer_step(&it, 1.0, bad[k], 0.0, 0.0) == ZIVI_E_XDOT);
        EXPECT(zivi_observer_step(&it, 1.0, 0.0, bad[k], 0.0) == ZIVI_E_FORCE);
        EXPECT(zivi_observer_step(&it, 1.0, 0.0, 0.0, bad[k]) == ZIVI_E_U);
    }
    for (k = 0; k < 3; k++)
        EXPECT(zivi_observer_step_after(&it, bad[k], 1.0, 0.0, 0.0, 0.0) == ZIVI_E_DT);
    EXPECT(zivi_observer_step_after(&it, 0.0, 1.0, 0.0, 0.0, 0.0) == ZIVI_E_DT);
    EXPECT(zivi_observer_step_after(&it, 1e-3, INFINITY, 0.0, 0.0, 0.0) == ZIVI_E_X);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    /* with h it is the other call; a missing measurement follows the motion and leaves its noise */
    EXPECT(zivi_observer_step(&before, 1.0, NAN, -9.81, 0.0) == ZIVI_OK);
    EXPECT(zivi_observer_step_after(&it, it.config.h, 1.0, NAN, -9.81, 0.0) == ZIVI_OK);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    EXPECT(zivi_observer_step_after(&it, 0.1, NAN, 7.0, -9.81, 0.0) == ZIVI_OK);
    EXPECT(it.x < before.x - 0.04 && it.p_xx > before.p_xx && it.seen == before.seen);
    before = it;
    EXPECT(zivi_observer_step(&it, NAN, 7.0, -9.81, 0.0) == ZIVI_OK && it.x < before.x);
    EXPECT(zivi_observer_step_after(&before, it.config.h, NAN, NAN, -9.81, 0.0) == ZIVI_OK);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    EXPECT(zivi_observer_reset(&it) == ZIVI_OK && it.started == 0 && it.seen == 0);
    config.learn_e = 1;
    EXPECT(zivi_observer_init(&it, &config) == ZIVI_OK && it.e == config.e && it.p_ee > 0.0);
    EXPECT(zivi_observer_step(NULL, 1.0, 0.0, 0.0, 0.0) == ZIVI_E_NULL);
    memset(&it, 0, sizeof it);
    EXPECT(zivi_observer_step(&it, 1.0, 0.0, 0.0, 0.0) == ZIVI_E_STATE);
    EXPECT(zivi_observer_reset(&it) == ZIVI_E_STATE);
}

/* Numbers that are finite and too large, limits without 0, references that are missing. */
static void extremes(void)
{
    zivi_predictor it, before;
    zivi_predictor_config config;
    zivi_tracker tracker;
    zivi_tracker_config tracking = tracker_config();
    zivi_regulator regulator;
    zivi_regulator_config regulating = regulator_config();
    zivi_given_reference rest = {0.0, 0.0, 1.0};
    double u = NAN;
    EXPECT(zivi_predictor_defaults(&config) == ZIVI_OK);
    config.h = 0.02, config.e = 0.67, config.delay = 59;
    EXPECT(zivi_predictor_init(&it, &config) == ZIVI_OK);
    before = it;
    EXPECT(zivi_predictor_step(&it, 0.39, -1.4e160, 0.0) == ZIVI_E_OVERFLOW);
    EXPECT(memcmp(&it, &before, sizeof it) == 0);
    EXPECT(zivi_predictor_step(&it, 0.39, -1.4, 0.0) == ZIVI_OK && it.x < 1.0);
    /* before the first sample the control is within the limits, too */
    tracking.u_min = regulating.u_min = 2.0, tracking.u_max = regulating.u_max = 5.0;
    EXPECT(zivi_tracker_init(&tracker, &tracking) == ZIVI_OK && tracker.u == 2.0);
    EXPECT(zivi_tracker_step_over(&tracker, 1e-3, NAN, 0.0, 0.0, -9.81, &u) == ZIVI_OK);
    EXPECT(u == 2.0 && zivi_tracker_reset(&tracker, 0.0, 0.0) == ZIVI_OK && tracker.u == 2.0);
    u = NAN;
    EXPECT(zivi_tracker_step(&tracker, NAN, 0.0, 0.0, -9.81, &u) == ZIVI_E_X && u == 2.0);
    tracker.u = 3.0; /* of a tick */
    u = NAN;
    EXPECT(zivi_tracker_step_to(&tracker, 0.0, 0.0, 0.0, NULL, &rest, NAN, &u) == ZIVI_E_NULL);
    EXPECT(u == 3.0);
    u = NAN;
    EXPECT(zivi_tracker_step_to_over(&tracker, 1e-3, 0.0, 0.0, 0.0, &rest, NULL, NAN, &u) == ZIVI_E_NULL);
    EXPECT(u == 3.0);
    EXPECT(zivi_regulator_init(&regulator, &regulating) == ZIVI_OK && regulator.u == 2.0);
    EXPECT(zivi_regulator_step_over(&regulator, 1e-3, NAN, 0.0, 0.0, &u) == ZIVI_OK && u == 2.0);
    regulator.u = 0.0;
    EXPECT(zivi_regulator_reset(&regulator) == ZIVI_OK && regulator.u == 2.0);
}

static void words(void)
{
    EXPECT(strcmp(zivi_message(ZIVI_OK), "ok") == 0);
    EXPECT(strstr(zivi_message(ZIVI_E_TICK), "ZIVI_TICK_PAPER") != NULL);
    EXPECT(strstr(zivi_message(ZIVI_E_XDOT_REF), "xdot_ref") != NULL);
    EXPECT(strcmp(zivi_message(12345), "not a code of this library") == 0);
    EXPECT(strcmp(zivi_message(-2147483647 - 1), "not a code of this library") == 0);
}

int main(void)
{
    settings();
    meant();
    masses();
    samples();
    other_periods();
    independence();
    observers();
    extremes();
    words();
    printf("behaviour: %s\n", failures == 0 ? "as promised" : "NOT as promised");
    return failures == 0 ? 0 : 1;
}
