"""Loops for the tests of the sampled closed loop, and controllers that are not ours."""

import numpy as np

import zivi
from control_oracle import Flights

PAPER = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "kappa": 0.5}
PLANT = zivi.ImpactSystem(-9.81, kappa=0.5)
TRACKING = {"y_ref0": (3, 3), "force_ref": -19.81}


class Scripted:
    """A controller that gives prepared controls and notes what it is told."""

    def __init__(self, controls, h=0.1):
        self.h, self.controls, self.seen = h, [float(u) for u in controls], []

    def step(self, x, xdot, force):
        u = self.controls[len(self.seen) % len(self.controls)]
        self.seen.append((x, xdot, force))
        return u


class Foreign:
    """Our tracker behind an interface of its own: a duck-typed controller with a reference."""

    def __init__(self, inner):
        self.inner, self.h = inner, inner.h

    def reset(self, x_ref, xdot_ref):
        self.inner.reset(x_ref, xdot_ref)

    @property
    def x_ref(self):
        return self.inner.x_ref

    @property
    def xdot_ref(self):
        return self.inner.xdot_ref

    def step(self, x, xdot, force, force_ref):
        return self.inner.step(x, xdot, force, force_ref)

    def step_to(self, *tick):
        return self.inner.step_to(*tick)


class ForeignRegulator:
    def __init__(self, inner):
        self.inner, self.h = inner, inner.h

    def step(self, x, xdot, force):
        return self.inner.step(x, xdot, force)


def loop(controller=None, *, system=PLANT, t_span=(0, 1), y0=(6, 5), **more):
    if controller is None:
        controller = zivi.TwistingTracker(**PAPER)
    if not isinstance(controller, (Scripted, ForeignRegulator, zivi.TwistingRegulator)):
        more = TRACKING | more
    return zivi.simulate_closed_loop(system, controller, t_span, y0, **more)


SAMPLED = ("t", "x", "xdot", "x_ref", "xdot_ref", "u", "signs", "tick_status")


def assert_equal_runs(one, other, until=None, names=SAMPLED):
    for name in names:
        np.testing.assert_array_equal(
            getattr(one, name)[:until], getattr(other, name)[:until], err_msg=name
        )


def follow(controls, h, x0, xdot0, *, e, f=0.0):
    """The independent motion: states at the samples, and the flights themselves."""
    flights = Flights(x0, xdot0, e)
    states = [(x0, xdot0)]
    for k, u in enumerate(controls):
        flights.hold(f + u, (k + 1) * h)
        states.append((flights.x, flights.v))
    return np.transpose(states), flights
