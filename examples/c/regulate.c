/* The regulator brings a mass to exact rest at the wall. In this program the mass is a zivi_mass;
 * on a target it is what the sensors measure. */
#include <stdio.h>

#include "zivi.h"

int main(void)
{
    zivi_mass mass;
    zivi_mass_config plant;
    zivi_regulator regulator;
    zivi_regulator_config config;
    double u = 0.0, rest = -1.0;
    int32_t code;
    int k;

    zivi_mass_defaults(&plant);
    zivi_regulator_defaults(&config);
    plant.h = config.h = 1e-3;
    plant.e = config.e = 0.5;
    config.mu1 = 3.0;
    config.mu2 = 2.0;
    config.bound = 0.9; /* m/s^2: what the gains must stand */
    code = zivi_mass_init(&mass, &plant);
    if (code == ZIVI_OK)
        code = zivi_mass_reset(&mass, 1.0, -0.5);
    if (code == ZIVI_OK)
        code = zivi_regulator_init(&regulator, &config);
    for (k = 0; k < 8000 && code >= 0; k++) {
        code = zivi_regulator_step(&regulator, mass.x, mass.xdot, 0.0, &u);
        if (code >= 0)
            code = zivi_mass_step(&mass, u);
        if (mass.x == 0.0 && mass.xdot == 0.0 && rest < 0.0)
            rest = (k + 1) * config.h;
    }
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_message(code)), 2;
    printf("rest at %.3f s, then x = %g, xdot = %g, u = %g m/s^2\n", rest, mass.x, mass.xdot, u);
    return mass.x == 0.0 && mass.xdot == 0.0 ? 0 : 1;
}
