/* The twisting tracker as a Simulink block: a level-2 S-function.
 *
 *     mex sfun_zivi_tracker.c -I<prefix>/include <prefix>/lib/libzivi.a
 *
 * where <prefix> is what `python -c "import zivi.native as n; print(n.prefix())"` prints.
 *
 * Parameters, [] for the default of all but the first four:
 *   mu1, mu2, h, e               gains, period, restitution
 *   x_ref, xdot_ref              where the reference starts, by default at rest
 *   e_ref, branch, tick          as in zivi_tracker_config, as all that follow
 *   bound, press, quiet, horizon, ahead, shift, depth, u_min, u_max
 *   delay                        periods after which u acts: the state is predicted (zivi_predictor)
 * Gains and the third line may be tuned while the model runs, the others are fixed.
 *
 * Input       x, xdot, force, force_ref         sampled every h
 * Output      u, x_ref, xdot_ref, code          code < 0: the sample was refused, u is held;
 *                                               with a delay the reference is that much ahead
 *
 * The whole state is the structure `block` in a DWork vector, so that Simulink stores and
 * restores it. Outputs are computed on a copy, which makes them repeatable within a sample; the
 * update ticks the block itself. */
#define S_FUNCTION_NAME sfun_zivi_tracker
#define S_FUNCTION_LEVEL 2

#include <math.h>

#include "simstruc.h"
#include "zivi.h"

enum {
    MU1, MU2, PERIOD, RESTITUTION,
    X_REF, XDOT_REF,
    E_REF, BRANCH, TICK,
    BOUND, PRESS, QUIET, HORIZON, AHEAD, SHIFT, DEPTH, U_MIN, U_MAX,
    DELAY,
    PARAMETERS
};
enum { INPUTS = 4, OUTPUTS = 4 };

typedef struct {
    zivi_tracker tracker;
    zivi_predictor predictor;
} block;

static int_T is_given(SimStruct *S, int_T index)
{
    return !mxIsEmpty(ssGetSFcnParam(S, index));
}

static real_T parameter(SimStruct *S, int_T index)
{
    return is_given(S, index) ? mxGetScalar(ssGetSFcnParam(S, index)) : 0.0;
}

/* A number that is given is meant, also where it is 0. */
static uint32_t meant(SimStruct *S, int_T index, uint32_t bit)
{
    return is_given(S, index) ? bit : 0;
}

static block *block_of(SimStruct *S)
{
    return (block *)ssGetDWork(S, 0);
}

/* A tracker and a predictor with the settings of the parameters, at their start. */
static int32_t configured(SimStruct *S, block *it)
{
    zivi_tracker_config config;
    zivi_predictor_config late;
    int32_t code;
    zivi_tracker_defaults(&config);
    config.mu1 = parameter(S, MU1), config.mu2 = parameter(S, MU2);
    config.h = parameter(S, PERIOD);
    config.e = parameter(S, RESTITUTION), config.e_ref = parameter(S, E_REF);
    config.branch = (uint32_t)parameter(S, BRANCH), config.tick = (uint32_t)parameter(S, TICK);
    config.bound = parameter(S, BOUND), config.press = parameter(S, PRESS);
    config.quiet = parameter(S, QUIET);
    config.ahead = (uint32_t)parameter(S, AHEAD), config.shift = (uint32_t)parameter(S, SHIFT);
    config.depth = parameter(S, DEPTH);
    config.u_min = parameter(S, U_MIN), config.u_max = parameter(S, U_MAX);
    if (is_given(S, HORIZON))
        config.horizon = parameter(S, HORIZON);
    config.given = meant(S, E_REF, ZIVI_GIVEN_E_REF) | meant(S, PRESS, ZIVI_GIVEN_PRESS)
        | meant(S, HORIZON, ZIVI_GIVEN_HORIZON) | meant(S, AHEAD, ZIVI_GIVEN_AHEAD)
        | meant(S, DEPTH, ZIVI_GIVEN_DEPTH) | meant(S, U_MAX, ZIVI_GIVEN_U_LIMITS);
    code = zivi_tracker_init(&it->tracker, &config);
    zivi_predictor_defaults(&late);
    late.h = config.h, late.e = config.e, late.depth = config.depth;
    late.given = meant(S, DEPTH, ZIVI_GIVEN_DEPTH);
    late.delay = (uint32_t)parameter(S, DELAY);
    return code < 0 ? code : zivi_predictor_init(&it->predictor, &late);
}

static int32_t tick(SimStruct *S, block *it, double *u)
{
    const real_T *in = (const real_T *)ssGetInputPortSignal(S, 0);
    const uint32_t delay = it->predictor.delay;
    int32_t seen, code;
    if (delay == 0)
        return zivi_tracker_step(&it->tracker, in[0], in[1], in[2], in[3], u);
    while (it->tracker.ticks < delay) /* its reference is as far ahead */
        if (zivi_tracker_step_over(&it->tracker, it->tracker.h, NAN, 0.0, 0.0, in[3], u) < 0)
            break;
    *u = it->tracker.u;
    seen = zivi_predictor_step(&it->predictor, in[0], in[1], in[2]);
    code = seen < 0 ? seen
                    : zivi_tracker_step(&it->tracker, it->predictor.x, it->predictor.xdot, in[2],
                                        in[3], u);
    (void)zivi_predictor_send(&it->predictor, *u);
    return code < 0 ? code : code | seen;
}

static void mdlInitializeSizes(SimStruct *S)
{
    int_T k;
    ssSetNumSFcnParams(S, PARAMETERS);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S))
        return;
    for (k = 0; k < PARAMETERS; k++)
        ssSetSFcnParamTunable(S, k, k <= MU2 || (k >= BOUND && k <= U_MAX));
    if (!ssSetNumInputPorts(S, 1) || !ssSetNumOutputPorts(S, 1))
        return;
    ssSetInputPortWidth(S, 0, INPUTS);
    ssSetInputPortRequiredContiguous(S, 0, 1);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    ssSetOutputPortWidth(S, 0, OUTPUTS);
    ssSetNumSampleTimes(S, 1);
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, (int_T)((sizeof(block) + sizeof(real_T) - 1) / sizeof(real_T)));
    ssSetDWorkDataType(S, 0, SS_DOUBLE);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, parameter(S, PERIOD));
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
    block *it = block_of(S);
    int32_t code = configured(S, it);
    if (code == ZIVI_OK)
        code = zivi_tracker_reset(&it->tracker, parameter(S, X_REF), parameter(S, XDOT_REF));
    if (code < 0)
        ssSetErrorStatus(S, zivi_message(code));
}

#define MDL_CHECK_PARAMETERS
static void mdlCheckParameters(SimStruct *S)
{
    block it;
    const int32_t code = configured(S, &it);
    if (code < 0)
        ssSetErrorStatus(S, zivi_message(code));
}

/* Other settings for the tracker where it is: what is checked and sealed is new, the rest stays. */
#define MDL_PROCESS_PARAMETERS
static void mdlProcessParameters(SimStruct *S)
{
    block *it = block_of(S), other;
    const zivi_tracker *last = &it->tracker;
    zivi_tracker *next = &other.tracker;
    const int32_t code = configured(S, &other);
    if (code < 0) {
        ssSetErrorStatus(S, zivi_message(code));
        return;
    }
    next->s_ref = last->s_ref, next->v_ref = last->v_ref, next->side = last->side;
    next->x_ref = last->x_ref, next->xdot_ref = last->xdot_ref;
    next->u = last->u, next->ticks = last->ticks;
    it->tracker = *next;
}

static void mdlOutputs(SimStruct *S, int_T task)
{
    real_T *out = (real_T *)ssGetOutputPortSignal(S, 0);
    const block *it = block_of(S);
    block copy = *it;
    UNUSED_ARG(task);
    out[1] = it->tracker.x_ref;
    out[2] = it->tracker.xdot_ref;
    out[3] = tick(S, &copy, &out[0]);
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T task)
{
    double u;
    UNUSED_ARG(task);
    (void)tick(S, block_of(S), &u);
}

static void mdlTerminate(SimStruct *S)
{
    UNUSED_ARG(S);
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
