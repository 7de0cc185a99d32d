/* A box variational inequality and a run with a force of its own, in C.
 *
 *     cc -std=c99 complementarity.c -I<prefix>/include -L<prefix>/lib -lzivi -lm
 */
#include <math.h>
#include <stdio.h>

#include "zivi_host.h"

/* Kojima and Shindo's problem, which has two solutions: (sqrt 6 / 2, 0, 0, 1/2) and (1, 0, 3, 0). */
static int32_t kojima_shindo(void *user, size_t n, const double *z, double *f)
{
    (void)user;
    (void)n;
    f[0] = 3 * z[0] * z[0] + 2 * z[0] * z[1] + 2 * z[1] * z[1] + z[2] + 3 * z[3] - 6;
    f[1] = 2 * z[0] * z[0] + z[1] * z[1] + z[0] + 10 * z[2] + 2 * z[3] - 2;
    f[2] = 3 * z[0] * z[0] + z[0] * z[1] + 2 * z[1] * z[1] + 2 * z[2] + 9 * z[3] - 9;
    f[3] = z[0] * z[0] + 3 * z[1] * z[1] + 2 * z[2] + 3 * z[3] - 3;
    return 0;
}

/* A spring and the weight: x'' = -k x - g. */
static int32_t spring(void *user, double t, double x, double xdot, double *force)
{
    (void)t;
    (void)xdot;
    *force = -*(const double *)user * x - 9.81;
    return 0;
}

int main(void)
{
    const double lower[4] = {0, 0, 0, 0};
    double z[4] = {1, 1, 1, 1}, stiffness = 20.0;
    zivi_vi_problem problem;
    zivi_vi_report report;
    zivi_system system;
    zivi_run *run = NULL;
    int32_t code;

    zivi_vi_defaults(&problem);
    problem.n = 4;
    problem.lower = lower;
    problem.map = kojima_shindo;
    code = zivi_solve_vi(&problem, z, &report);
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_last_error()), 2;
    printf("z = (%.6f, %.6f, %.6f, %.6f), %s\n", z[0], z[1], z[2], z[3], code <= 1 ? "solved" : "NOT");

    zivi_system_defaults(&system);
    system.e = 0.5;
    system.function = spring;
    system.user = &stiffness;
    code = zivi_simulate(&system, NULL, 0.0, 4.0, 1.0, 0.0, &run);
    if (code < 0)
        return fprintf(stderr, "zivi: %s\n", zivi_last_error()), 2;
    printf("%zu samples, at rest from %.9f s on: %s\n", zivi_run_samples(run),
           zivi_run_rest_time(run), zivi_status_message(code));
    zivi_run_free(run);
    return report.residual < 1e-9 && code == 0 ? 0 : 1;
}
