/* A ball bounces infinitely often in finite time, and is exactly at rest from then on.
 *
 *     cc -std=c99 bounce.c -I../../include libzivi.a -o bounce
 */
#include <stdio.h>

#include "zivi.h"

int main(void)
{
    zivi_mass ball;
    zivi_mass_config config;
    const double gravity = -9.81;
    double rest = -1.0;
    int32_t code;
    int k;

    if (zivi_abi_version() != ZIVI_ABI_VERSION)
        return fprintf(stderr, "zivi.h is not of the library %s\n", zivi_version()), 2;
    zivi_mass_defaults(&config);
    config.h = 1e-3;     /* s */
    config.kappa = 0.41; /* e = 0.418 */
    code = zivi_mass_init(&ball, &config);
    if (code == ZIVI_OK)
        code = zivi_mass_reset(&ball, 1.0, 6.0);
    for (k = 1; k <= 4000 && code >= 0; k++) {
        code = zivi_mass_step(&ball, gravity);
        if (k % 400 == 0 && rest < 0.0)
            printf("t = %.1f s   x = %.6f m   xdot = %9.6f m/s\n", k * config.h, ball.x, ball.xdot);
        if (ball.x == 0.0 && ball.xdot == 0.0 && rest < 0.0)
            rest = k * config.h;
    }
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_message(code)), 2;
    printf("rest at %.3f s, then x = %g, xdot = %g\n", rest, ball.x, ball.xdot);
    return ball.x == 0.0 && ball.xdot == 0.0 ? 0 : 1;
}
