"""Functions that stored objects name: their texts are digested and must stay as they are."""

import zivi


def gravity(t, x, xdot):
    return -9.81 - 0.1 * xdot


def height(t):
    return 0.01 * t


def speed(t):
    return 0.01


def acceleration(t):
    return 0.0


def rest_time(e, x0, *, system, method, start, t_span):
    ball = zivi.ImpactSystem(system.force, e=e, wall=system.wall)
    return zivi.simulate(ball, t_span, (x0, start[1]), method=method).rest_time


def apex(k, *, oscillator, mechanism, controller, grid):
    run = zivi.simulate(mechanism, (0, 0.5), ([0.2 + 0.1 * k], [0.0]))
    return float(run.q[:, 0].max() + oscillator.amplitude + controller.h + grid.sum())
