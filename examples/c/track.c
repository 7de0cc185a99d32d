/* The tracker makes a mass follow a bouncing reference into its rest. In this program the mass is a
 * zivi_mass; on a target it is what the sensors measure. At rest the control presses the mass onto
 * the wall; config.tick = ZIVI_TICK_PAPER would hold it there with u = -force. */
#include <stdio.h>

#include "zivi.h"

int main(void)
{
    zivi_mass mass;
    zivi_mass_config plant;
    zivi_tracker tracker;
    zivi_tracker_config config;
    const double force = -9.81, force_ref = -19.81; /* m/s^2, on the mass and on the reference */
    double u = 0.0, last = 0.0;
    int32_t code;
    int k;

    zivi_mass_defaults(&plant);
    zivi_tracker_defaults(&config);
    plant.h = config.h = 1e-3;
    plant.kappa = config.kappa = 0.5; /* e = 1/3 */
    config.mu1 = 30.0;
    config.mu2 = 17.0;
    code = zivi_mass_init(&mass, &plant);
    if (code == ZIVI_OK)
        code = zivi_mass_reset(&mass, 6.0, 5.0);
    if (code == ZIVI_OK)
        code = zivi_tracker_init(&tracker, &config);
    if (code == ZIVI_OK)
        code = zivi_tracker_reset(&tracker, 3.0, 3.0);
    for (k = 0; k < 4000 && code >= 0; k++) {
        const double error = mass.x - tracker.x_ref;
        if (error > 1e-2 || error < -1e-2)
            last = k * config.h;
        code = zivi_tracker_step(&tracker, mass.x, mass.xdot, force, force_ref, &u);
        if (code >= 0)
            code = zivi_mass_step(&mass, force + u);
    }
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_message(code)), 2;
    printf("within 1 cm of the reference from %.3f s on\n", last + config.h);
    printf("at the end x = %g, xdot = %g, u = %.6f m/s^2\n", mass.x, mass.xdot, u);
    return mass.x == 0.0 && mass.xdot == 0.0 ? 0 : 1;
}
