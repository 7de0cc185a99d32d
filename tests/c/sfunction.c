/* The S-function of examples/simulink, run in a loop, gives the bits of the library. */
#include <stdio.h>
#include <string.h>

#include "../../examples/simulink/sfun_zivi_tracker.c"

static SimStruct S;
static int failures;

static void give(int index, double value)
{
    S.parameters[index].scalar = value;
    S.parameters[index].given = 1;
}

static void start(void)
{
    memset(&S, 0, sizeof S);
    S.given = PARAMETERS;
    give(MU1, 30.0), give(MU2, 17.0), give(PERIOD, 1e-3), give(RESTITUTION, 0.5);
    give(X_REF, 3.0), give(XDOT_REF, 3.0);
}

static void initialise(void)
{
    mdlInitializeSizes(&S);
    mdlInitializeSampleTimes(&S);
    mdlCheckParameters(&S);
    mdlInitializeConditions(&S);
    failures += S.error != NULL || S.period != 1e-3 || S.feedthrough != 1;
    failures += S.work_width * sizeof(real_T) < sizeof(block);
    failures += (size_t)S.work_width > sizeof S.work / sizeof *S.work;
}

/* What the library says of a sample, without the S-function. */
static int32_t stepped(zivi_tracker *tracker, zivi_predictor *before, const double *in, double *u)
{
    int32_t seen, code;
    if (before == NULL)
        return zivi_tracker_step(tracker, in[0], in[1], in[2], in[3], u);
    seen = zivi_predictor_step(before, in[0], in[1], in[2]);
    code = seen < 0 ? seen : zivi_tracker_step(tracker, before->x, before->xdot, in[2], in[3], u);
    zivi_predictor_send(before, *u);
    return code < 0 ? code : code | seen;
}

static void run(zivi_tracker *tracker, zivi_predictor *before, int from, int to)
{
    double u = tracker->u;
    int k;
    for (k = from; k < to; k++) {
        const double x = tracker->x_ref + 1e-3 * (k % 7) - (k % 50 == 49 ? 1e-3 : 0.0);
        const double sample[INPUTS] = {k % 100 == 99 ? -1.0 : x, 0.1, -9.81, -19.81};
        memcpy(S.input, sample, sizeof sample);
        mdlOutputs(&S, 0);
        mdlOutputs(&S, 0); /* may be asked twice */
        failures += S.output[1] != tracker->x_ref || S.output[2] != tracker->xdot_ref;
        failures += S.output[3] != stepped(tracker, before, sample, &u);
        failures += S.output[0] != u;
        mdlUpdate(&S, 0);
    }
    failures += memcmp(&block_of(&S)->tracker, tracker, sizeof *tracker) != 0;
    failures += before != NULL && memcmp(&block_of(&S)->predictor, before, sizeof *before) != 0;
}

static zivi_tracker_config usual(void)
{
    zivi_tracker_config config;
    zivi_tracker_defaults(&config);
    config.mu1 = 30.0, config.mu2 = 17.0, config.h = 1e-3, config.e = 0.5;
    return config;
}

static void placed(zivi_tracker *tracker, const zivi_tracker_config *config)
{
    failures += zivi_tracker_init(tracker, config) != ZIVI_OK;
    failures += zivi_tracker_reset(tracker, 3.0, 3.0) != ZIVI_OK;
}

static void defaults_and_errors(void)
{
    zivi_tracker tracker;
    const zivi_tracker_config config = usual();
    start(), initialise();
    placed(&tracker, &config);
    run(&tracker, NULL, 0, 3000);
    give(MU2, 40.0);
    mdlCheckParameters(&S);
    failures += S.error == NULL || strstr(S.error, "mu2") == NULL;
    S.error = NULL;
    mdlProcessParameters(&S);
    failures += S.error == NULL || memcmp(&block_of(&S)->tracker, &tracker, sizeof tracker) != 0;
}

static void all_settings_tuned(void)
{
    zivi_tracker tracker, other;
    zivi_tracker_config config = usual();
    int k;
    start();
    give(E_REF, 0.6), config.e_ref = 0.6;
    give(BRANCH, ZIVI_BRANCH_NEAREST), config.branch = ZIVI_BRANCH_NEAREST;
    give(BOUND, 2.0), config.bound = 2.0;
    give(PRESS, 15.0), config.press = 15.0;
    give(QUIET, 0.01), config.quiet = 0.01;
    give(HORIZON, 3.0), config.horizon = 3.0;
    give(AHEAD, 2.0), config.ahead = 2;
    give(SHIFT, 1.0), config.shift = 1;
    give(DEPTH, 0.0), config.given = ZIVI_GIVEN_DEPTH;
    give(U_MIN, -20.0), config.u_min = -20.0;
    give(U_MAX, 30.0), config.u_max = 30.0;
    initialise();
    for (k = 0; k < PARAMETERS; k++)
        failures += S.tunable[k] != (k == MU1 || k == MU2 || (k > TICK && k < DELAY));
    placed(&tracker, &config);
    run(&tracker, NULL, 0, 1000);
    /* other gains where it is: as one that was initialised with them and has this state */
    give(MU1, 40.0), config.mu1 = 40.0;
    give(U_MAX, 25.0), config.u_max = 25.0;
    mdlCheckParameters(&S);
    mdlProcessParameters(&S);
    placed(&other, &config);
    other.s_ref = tracker.s_ref, other.v_ref = tracker.v_ref, other.side = tracker.side;
    other.x_ref = tracker.x_ref, other.xdot_ref = tracker.xdot_ref;
    other.u = tracker.u, other.ticks = tracker.ticks;
    run(&other, NULL, 1000, 2000);
    failures += S.error != NULL;
}

static void late(void)
{
    zivi_tracker tracker;
    zivi_predictor before;
    zivi_predictor_config config;
    const zivi_tracker_config settings = usual();
    double u;
    int k;
    start(), give(DELAY, 4.0), initialise();
    placed(&tracker, &settings);
    zivi_predictor_defaults(&config);
    config.h = 1e-3, config.e = 0.5, config.delay = 4;
    failures += zivi_predictor_init(&before, &config) != ZIVI_OK;
    memset(S.input, 0, sizeof S.input), S.input[3] = -19.81;
    mdlOutputs(&S, 0), mdlUpdate(&S, 0);
    for (k = 0; k < 4; k++)
        zivi_tracker_step_over(&tracker, 1e-3, NAN, 0.0, 0.0, -19.81, &u);
    stepped(&tracker, &before, S.input, &u);
    run(&tracker, &before, 1, 3000);
}

int main(void)
{
    defaults_and_errors();
    all_settings_tuned();
    late();
    mdlTerminate(&S);
    printf("S-function: %s\n", failures == 0 ? "the bits of the library" : "DIFFERS");
    return failures == 0 ? 0 : 1;
}
