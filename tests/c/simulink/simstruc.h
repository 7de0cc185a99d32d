/* What examples/simulink uses of Simulink's simstruc.h, written for its test: the source is checked,
 * and run, where there is no Simulink. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H

#include <stddef.h>
#include <stdint.h>

typedef double real_T;
typedef int int_T;
typedef unsigned int uint_T;
typedef struct mxArray {
    double scalar;
    int given;
} mxArray;

enum { SS_DOUBLE = 0, SS_OPTION_EXCEPTION_FREE_CODE = 1 };

typedef struct SimStruct {
    mxArray parameters[24];
    int_T tunable[24];
    int_T expected, given;
    real_T input[8], output[8], work[128];
    int_T work_width, input_width, output_width, feedthrough;
    real_T period;
    const char *error;
} SimStruct;

#define UNUSED_ARG(arg) (void)(arg)
#define mxGetScalar(array) ((array)->scalar)
#define mxIsEmpty(array) (!(array)->given)
#define ssSetSFcnParamTunable(S, index, on) ((S)->tunable[index] = (on))
#define ssGetSFcnParam(S, index) (&(S)->parameters[index])
#define ssSetNumSFcnParams(S, n) ((S)->expected = (n))
#define ssGetNumSFcnParams(S) ((S)->expected)
#define ssGetSFcnParamsCount(S) ((S)->given)
#define ssSetNumInputPorts(S, n) ((n) == 1)
#define ssSetNumOutputPorts(S, n) ((n) == 1)
#define ssSetInputPortWidth(S, port, n) ((S)->input_width = (n))
#define ssSetInputPortRequiredContiguous(S, port, on) ((void)(on))
#define ssSetInputPortDirectFeedThrough(S, port, on) ((S)->feedthrough = (on))
#define ssSetOutputPortWidth(S, port, n) ((S)->output_width = (n))
#define ssGetInputPortSignal(S, port) ((const void *)(S)->input)
#define ssGetOutputPortSignal(S, port) ((void *)(S)->output)
#define ssSetNumSampleTimes(S, n) ((void)(n))
#define ssSetSampleTime(S, index, h) ((S)->period = (h))
#define ssSetOffsetTime(S, index, offset) ((void)(offset))
#define ssSetNumDWork(S, n) ((void)(n))
#define ssSetDWorkWidth(S, index, n) ((S)->work_width = (n))
#define ssSetDWorkDataType(S, index, type) ((void)(type))
#define ssGetDWork(S, index) ((void *)(S)->work)
#define ssSetOptions(S, options) ((void)(options))
#define ssSetErrorStatus(S, words) ((S)->error = (words))

#endif
