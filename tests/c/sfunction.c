/* The S-function of examples/simulink, run in a loop, gives the bits of the library. */
#include <stdio.h>
#include <string.h>

#include "../../examples/simulink/sfun_zivi_tracker.c"

int main(void)
{
    static SimStruct block;
    const double settings[PARAMETERS] = {30.0, 17.0, 1e-3, 0.5, 3.0, 3.0};
    zivi_tracker tracker;
    zivi_tracker_config config;
    double u;
    int k, failures = 0;
    for (k = 0; k < PARAMETERS; k++)
        block.parameters[k].scalar = settings[k];
    block.given = PARAMETERS;
    mdlInitializeSizes(&block);
    mdlInitializeSampleTimes(&block);
    mdlInitializeConditions(&block);
    failures += block.error != NULL || block.period != 1e-3 || block.feedthrough != 1;
    failures += block.work_width * sizeof(real_T) < sizeof(zivi_tracker);
    zivi_tracker_defaults(&config);
    config.mu1 = 30.0, config.mu2 = 17.0, config.h = 1e-3, config.e = 0.5;
    failures += zivi_tracker_init(&tracker, &config) != ZIVI_OK;
    failures += zivi_tracker_reset(&tracker, 3.0, 3.0) != ZIVI_OK;
    for (k = 0; k < 3000; k++) {
        const double sample[INPUTS] = {tracker.x_ref + 1e-3 * (k % 7), 0.1, -9.81, -19.81};
        memcpy(block.input, sample, sizeof sample);
        mdlOutputs(&block, 0);
        mdlOutputs(&block, 0); /* may be asked twice */
        failures += block.output[1] != tracker.x_ref || block.output[2] != tracker.xdot_ref;
        failures += block.output[3] != zivi_tracker_step(&tracker, sample[0], sample[1], sample[2],
                                                         sample[3], &u);
        failures += block.output[0] != u;
        mdlUpdate(&block, 0);
    }
    failures += memcmp(block.work, &tracker, sizeof tracker) != 0;
    block.parameters[MU2].scalar = 40.0;
    mdlInitializeConditions(&block);
    failures += block.error == NULL || strstr(block.error, "mu2") == NULL;
    mdlTerminate(&block);
    printf("S-function: %s\n", failures == 0 ? "the bits of the library" : "DIFFERS");
    return failures == 0 ? 0 : 1;
}
