/* The twisting tracker as a Simulink block: a level-2 S-function.
 *
 *     mex sfun_zivi_tracker.c -I<prefix>/include <prefix>/lib/libzivi.a
 *
 * where <prefix> is what `python -c "import zivi.native as n; print(n.prefix())"` prints.
 *
 * Parameters  mu1, mu2, h, e, x_ref, xdot_ref   the last two: where the reference starts
 * Input       x, xdot, force, force_ref         sampled every h
 * Output      u, x_ref, xdot_ref, code          code < 0: the sample was refused, u is held
 *
 * The whole state is the structure zivi_tracker in a DWork vector, so that Simulink stores and
 * restores it. Outputs are computed on a copy, which makes them repeatable within a sample; the
 * update ticks the tracker itself. */
#define S_FUNCTION_NAME sfun_zivi_tracker
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"
#include "zivi.h"

enum { MU1, MU2, PERIOD, RESTITUTION, X_REF, XDOT_REF, PARAMETERS };
enum { INPUTS = 4, OUTPUTS = 4 };

static real_T parameter(SimStruct *S, int_T index)
{
    return mxGetScalar(ssGetSFcnParam(S, index));
}

static zivi_tracker *tracker_of(SimStruct *S)
{
    return (zivi_tracker *)ssGetDWork(S, 0);
}

static int32_t tick(SimStruct *S, zivi_tracker *tracker, double *u)
{
    const real_T *in = (const real_T *)ssGetInputPortSignal(S, 0);
    return zivi_tracker_step(tracker, in[0], in[1], in[2], in[3], u);
}

static void mdlInitializeSizes(SimStruct *S)
{
    ssSetNumSFcnParams(S, PARAMETERS);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S))
        return;
    if (!ssSetNumInputPorts(S, 1) || !ssSetNumOutputPorts(S, 1))
        return;
    ssSetInputPortWidth(S, 0, INPUTS);
    ssSetInputPortRequiredContiguous(S, 0, 1);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    ssSetOutputPortWidth(S, 0, OUTPUTS);
    ssSetNumSampleTimes(S, 1);
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, (int_T)((sizeof(zivi_tracker) + sizeof(real_T) - 1) / sizeof(real_T)));
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
    zivi_tracker *tracker = tracker_of(S);
    zivi_tracker_config config;
    int32_t code;
    zivi_tracker_defaults(&config);
    config.mu1 = parameter(S, MU1);
    config.mu2 = parameter(S, MU2);
    config.h = parameter(S, PERIOD);
    config.e = parameter(S, RESTITUTION);
    code = zivi_tracker_init(tracker, &config);
    if (code == ZIVI_OK)
        code = zivi_tracker_reset(tracker, parameter(S, X_REF), parameter(S, XDOT_REF));
    if (code < 0)
        ssSetErrorStatus(S, zivi_message(code));
}

static void mdlOutputs(SimStruct *S, int_T task)
{
    real_T *out = (real_T *)ssGetOutputPortSignal(S, 0);
    const zivi_tracker *tracker = tracker_of(S);
    zivi_tracker copy = *tracker;
    UNUSED_ARG(task);
    out[1] = tracker->x_ref;
    out[2] = tracker->xdot_ref;
    out[3] = tick(S, &copy, &out[0]);
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T task)
{
    double u;
    UNUSED_ARG(task);
    (void)tick(S, tracker_of(S), &u);
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
