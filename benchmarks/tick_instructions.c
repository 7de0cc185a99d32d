/* Counts the instructions of one call of the C library, exactly: the process that calls is stepped one
 * instruction at a time. Linux on x86-64.
 *
 *     cc -O2 tick_instructions.c -I<prefix>/include <prefix>/lib/libzivi.a -lm && ./a.out
 *
 * -DDRAWS=40 for fewer calls of each kind.
 */
#define _GNU_SOURCE
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include "zivi.h"

#ifndef DRAWS
#define DRAWS 300
#endif

enum { KINDS = 7 };
static const char *names[KINDS] = {"mass",          "regulator", "tracker, wide",        "tracker, near",
                                   "tracker, fast", "observer",  "observer of positions"};

static double uniform(void)
{
    return (double)random() / 2147483648.0;
}

static double normal(double scale)
{
    double sum = -6.0;
    int k;
    for (k = 0; k < 12; k++)
        sum += uniform();
    return scale * sum;
}

#define MARK() __asm__ volatile("int3" ::: "memory")

static void draw(int kind, double *x, double *v)
{
    double scale = kind == 3 ? 1e-4 : kind == 4 ? 1e-3 : 3.0;
    *x = fabs(normal(scale));
    *v = kind == 3 ? normal(1e-2) : kind == 4 ? -fabs(normal(4.0)) : normal(5.0);
}

/* A mass that bounces, seen with noise. */
static void observed(uint32_t position_only)
{
    zivi_observer observer;
    zivi_observer_config config;
    double x = 0.5, v = 1.0;
    int k;
    zivi_observer_defaults(&config);
    config.h = 1e-2;
    config.e = 0.8;
    config.position_only = position_only;
    zivi_observer_init(&observer, &config);
    for (k = 0; k < DRAWS; k++) {
        const double seen_x = x + normal(1e-4), seen_v = v + normal(1e-2);
        MARK();
        zivi_observer_step(&observer, seen_x, seen_v, -9.81, 0.0);
        MARK();
        x += 1e-2 * (v - 0.5 * 9.81 * 1e-2);
        v -= 9.81 * 1e-2;
        if (x < 0.0) { /* back along the flight to the wall, and up again */
            const double fast = sqrt(v * v + 2.0 * 9.81 * x), since = (fast + v) / -9.81;
            v = 0.8 * fast - 9.81 * since;
            x = fmax(0.0, since * (0.8 * fast - 0.5 * 9.81 * since));
        }
    }
}

static void calls(void)
{
    zivi_mass mass;
    zivi_mass_config mass_config;
    zivi_regulator regulator;
    zivi_regulator_config regulator_config;
    zivi_tracker tracker;
    zivi_tracker_config tracker_config;
    int kind, k;
    zivi_mass_defaults(&mass_config);
    zivi_regulator_defaults(&regulator_config);
    zivi_tracker_defaults(&tracker_config);
    mass_config.h = regulator_config.h = tracker_config.h = 1e-3;
    mass_config.e = regulator_config.e = tracker_config.e = 0.5;
    regulator_config.mu1 = tracker_config.mu1 = 30.0;
    regulator_config.mu2 = tracker_config.mu2 = 17.0;
    zivi_mass_init(&mass, &mass_config);
    zivi_regulator_init(&regulator, &regulator_config);
    zivi_tracker_init(&tracker, &tracker_config);
    for (kind = 0; kind < 5; kind++)
        for (k = 0; k < DRAWS; k++) {
            double x, v, x_ref, v_ref, u;
            draw(kind, &x, &v);
            draw(kind, &x_ref, &v_ref);
            zivi_mass_reset(&mass, x, v);
            zivi_tracker_reset(&tracker, x_ref, v_ref);
            MARK();
            if (kind == 0)
                zivi_mass_step(&mass, -9.81);
            else if (kind == 1)
                zivi_regulator_step(&regulator, x, v, -9.81, &u);
            else
                zivi_tracker_step(&tracker, x, v, -9.81, -9.81, &u);
            MARK();
        }
    observed(0);
    observed(1);
}

static int ascending(const void *a, const void *b)
{
    return *(const int *)a - *(const int *)b;
}

int main(void)
{
    static int counts[KINDS][DRAWS];
    int status, seen = 0, counted = 0, kind, k;
    const pid_t child = fork();
    if (child == 0) {
        if (ptrace(PTRACE_TRACEME, 0, NULL, NULL) != 0)
            _exit(1);
        raise(SIGSTOP);
        calls();
        _exit(0);
    }
    if (waitpid(child, &status, 0) != child || !WIFSTOPPED(status))
        return 1; /* it may not be traced here */
    ptrace(PTRACE_CONT, child, NULL, NULL);
    while (waitpid(child, &status, 0) == child && WIFSTOPPED(status)) {
        siginfo_t info;
        ptrace(PTRACE_GETSIGINFO, child, NULL, &info);
        if (info.si_code == TRAP_TRACE) {
            counted++;
            ptrace(PTRACE_SINGLESTEP, child, NULL, NULL);
            continue;
        }
        if (seen % 2 == 1) /* the second mark of a pair */
            counts[seen / 2 / DRAWS][seen / 2 % DRAWS] = counted;
        counted = 0;
        seen++;
        ptrace(seen % 2 == 1 ? PTRACE_SINGLESTEP : PTRACE_CONT, child, NULL, NULL);
    }
    printf("| call | min | median | mean | 99 %% | max |\n|---|---|---|---|---|---|\n");
    for (kind = 0; kind < KINDS; kind++) {
        double sum = 0.0;
        qsort(counts[kind], DRAWS, sizeof(int), ascending);
        for (k = 0; k < DRAWS; k++)
            sum += counts[kind][k];
        printf("| %s | %d | %d | %.0f | %d | %d |\n", names[kind], counts[kind][0],
               counts[kind][DRAWS / 2], sum / DRAWS, counts[kind][DRAWS * 99 / 100], counts[kind][DRAWS - 1]);
    }
    return 0;
}
