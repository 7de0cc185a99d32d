/* The tracker on a target that measures positions alone: an observer gives it the velocity, and the force
 * that is not known, through the impacts. */
#include <math.h>
#include <stdio.h>

#include "zivi.h"

int main(void)
{
    zivi_mass mass;
    zivi_mass_config plant;
    zivi_tracker tracker;
    zivi_tracker_config config;
    zivi_observer observer;
    zivi_observer_config sensor;
    const double force = -9.81, unknown = 1.5, force_ref = -9.81; /* m/s^2 */
    double u = 0.0, before = 0.0;
    int32_t code;
    int k;

    zivi_mass_defaults(&plant);
    zivi_tracker_defaults(&config);
    zivi_observer_defaults(&sensor);
    plant.h = config.h = sensor.h = 1e-3;
    plant.e = config.e = sensor.e = 0.5;
    config.mu1 = 30.0;
    config.mu2 = 17.0;
    sensor.position_only = 1;
    sensor.noise_x = 1e-5;
    code = zivi_mass_init(&mass, &plant);
    if (code == ZIVI_OK)
        code = zivi_mass_reset(&mass, 1.0, 2.0);
    if (code == ZIVI_OK)
        code = zivi_tracker_init(&tracker, &config);
    if (code == ZIVI_OK)
        code = zivi_tracker_reset(&tracker, 1.2, 2.0);
    if (code == ZIVI_OK)
        code = zivi_observer_init(&observer, &sensor);
    for (k = 0; k < 4000 && code >= 0; k++) {
        code = zivi_observer_step(&observer, mass.x, NAN, force, u);
        if (k == 600) /* in the air, on the reference */
            before = observer.d;
        if (code >= 0)
            code = zivi_tracker_step(&tracker, observer.x, observer.xdot, force + observer.d,
                                     force_ref, &u);
        if (code >= 0)
            code = zivi_mass_step(&mass, force + unknown + u);
    }
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_message(code)), 2;
    printf("unknown force %.2f m/s^2, estimate in the air %.2f\n", unknown, before);
    printf("at the end x = %g, xdot = %g\n", mass.x, mass.xdot);
    return mass.x == 0.0 && mass.xdot == 0.0 && fabs(before - unknown) < 0.1 ? 0 : 1;
}
