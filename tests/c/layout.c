/* The layout of the structures as it is promised: what is stored on one machine is read on another.
 * Compiles or does not; also checks that the library agrees. */
#include <stddef.h>
#include <stdio.h>

#include "zivi.h"

#define SAME(name, condition) typedef char name[(condition) ? 1 : -1]
#define AT(type, member, offset) \
    SAME(type##_##member##_moved, offsetof(type, member) == (offset))

SAME(mass_size, sizeof(zivi_mass) == 96);
AT(zivi_mass, h, 0);
AT(zivi_mass, s, 24);
AT(zivi_mass, x, 48);
AT(zivi_mass, xdot, 56);
AT(zivi_mass, steps, 80);
AT(zivi_mass, seal, 88);
SAME(mass_config_size, sizeof(zivi_mass_config) == 32);
AT(zivi_mass_config, given, 4);
AT(zivi_mass_config, h, 8);

SAME(regulator_size, sizeof(zivi_regulator) == 128);
AT(zivi_regulator, quiet, 40);
AT(zivi_regulator, ahead, 72);
AT(zivi_regulator, u, 80);
AT(zivi_regulator, ticks, 104);
AT(zivi_regulator, status, 112);
AT(zivi_regulator, seal, 120);
SAME(regulator_config_size, sizeof(zivi_regulator_config) == 96);
AT(zivi_regulator_config, given, 12);
AT(zivi_regulator_config, mu1, 16);
AT(zivi_regulator_config, u_max, 88);

SAME(tracker_size, sizeof(zivi_tracker) == 240);
AT(zivi_tracker, press, 56);
AT(zivi_tracker, quiet, 64);
AT(zivi_tracker, branch, 104);
AT(zivi_tracker, s_ref, 120);
AT(zivi_tracker, x_ref, 144);
AT(zivi_tracker, u, 160);
AT(zivi_tracker, ticks, 216);
AT(zivi_tracker, iterations, 228);
AT(zivi_tracker, seal, 232);
SAME(tracker_config_size, sizeof(zivi_tracker_config) == 136);
AT(zivi_tracker_config, given, 20);
AT(zivi_tracker_config, mu1, 24);
AT(zivi_tracker_config, quiet, 96);
AT(zivi_tracker_config, horizon, 104);
AT(zivi_tracker_config, u_max, 128);
SAME(given_reference_size, sizeof(zivi_given_reference) == 24);

SAME(observer_size, sizeof(zivi_observer) == 328);
AT(zivi_observer, x, 88);
AT(zivi_observer, d, 104);
AT(zivi_observer, seen_y, 200);
AT(zivi_observer, started, 304);
AT(zivi_observer, seal, 320);
SAME(observer_config_size, sizeof(zivi_observer_config) == 88);
AT(zivi_observer_config, given, 12);
AT(zivi_observer_config, h, 16);

int main(void)
{
    if (zivi_mass_size() != sizeof(zivi_mass) || zivi_regulator_size() != sizeof(zivi_regulator)
        || zivi_tracker_size() != sizeof(zivi_tracker)
        || zivi_observer_size() != sizeof(zivi_observer))
        return 1;
    printf("layout: as promised\n");
    return 0;
}
