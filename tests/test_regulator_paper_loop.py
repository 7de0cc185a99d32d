"""The regulator in the paper's loop is (12)-(13): against an enumeration of its cases, iterated."""

import numpy as np
import pytest

import zivi

H, END = 1e-3, 4.0


def lifted_step(s, v, h, kappa, mu1, mu2, f):
    """Every solution of (12)-(13) from ``(s, v)``, case by case.

    ``v+ = v + h (ls (F - mu1) - mu2 lv)/R``, ``s+ = s + h R v+``, ``R = 1 - kappa ls lv``.
    """
    found = []
    push = f - mu1
    for ls in (1.0, -1.0):
        for lv in (1.0, -1.0):
            r = 1 - kappa * ls * lv
            v_next = v + h * (ls * push - mu2 * lv) / r
            s_next = s + h * r * v_next
            if s_next * ls >= 0 and v_next * lv > 0:
                found.append((s_next, v_next))
        # v+ = 0: R v + h (ls (F - mu1) - mu2 lv) = 0, linear in lv
        slope, right = kappa * ls * v + h * mu2, v + h * ls * push
        if abs(right) <= abs(slope) and s * ls > 0:
            found.append((s, 0.0))
    for lv in (1.0, -1.0):
        # s+ = 0: R v + h (ls (F - mu1) - mu2 lv) = -s/h, linear in ls
        slope, right = h * push - kappa * lv * v, -s / h - v + h * mu2 * lv
        if s != 0 and abs(right) <= abs(slope):
            v_next = -s / h / (1 - kappa * lv * right / slope)
            if v_next * lv >= 0:
                found.append((0.0, v_next))
    # at the origin v+ = 0: some ls, lv in [-1, 1] with v - h mu2 lv = ls (kappa lv v - h push)
    if s == 0 and abs(v) <= h * mu2 + abs(kappa * abs(v) - h * push):
        found.append((0.0, 0.0))
    return found


def iterated(start, steps, kappa, *data):
    """Positions and velocities of the iteration, by the paper's lift of the start."""
    x, xdot = start
    s, v = x, xdot / (1 - kappa * np.sign(xdot))
    out = [(x, xdot)]
    for _ in range(steps):
        found = lifted_step(s, v, H, kappa, *data)
        # unique under the condition on the gains
        assert np.ptp(found, axis=0).max() <= 1e-14
        s, v = found[0]
        side = np.sign(s) if s != 0 else np.sign(v)
        out.append((abs(s), side * v * (1 - kappa * side * np.sign(v))))
    return np.transpose(out)


def draws(n=12):
    rng = np.random.default_rng(7)
    yield (1.0, 0.0), 0.5, 3.0, 2.0, 0.0  # figure 5
    for _ in range(n):
        bound = rng.uniform(0.1, 5)
        mu2 = bound * rng.uniform(1.1, 3)
        mu1 = (mu2 + bound) * rng.uniform(1.1, 2)
        start = rng.uniform(0, 2), rng.uniform(-3, 3)
        yield start, rng.uniform(0.05, 0.9), mu1, mu2, rng.uniform(-bound, bound)


def test_the_papers_loop_is_its_own_iteration():
    """To 1e-12 over 4000 steps, and with it exact rest at the same step."""
    steps = round(END / H)
    for start, kappa, mu1, mu2, f in draws():
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(f, kappa=kappa),
            zivi.TwistingRegulator(mu1, mu2, h=H, kappa=kappa, landing=False),
            (0, END),
            start,
            method=zivi.ThetaGamma(H),
        )
        x, xdot = iterated(start, steps, kappa, mu1, mu2, f)
        assert np.abs(run.x - x).max() <= 1e-12
        # a step that ends on the wall has v+ = -s/(h R): the rounding of s counts 1/h times
        assert np.abs(run.xdot - xdot).max() <= 2e-14 / H
        still = (x == 0) & (xdot == 0)
        assert still.any()
        assert run.rest_time == pytest.approx(run.t[np.flatnonzero(~still)[-1] + 1], abs=1e-12)


def test_what_stands_between_leaves_the_plants_own_step():
    """A plan that is not what happens: the plant takes the control, and rests a little later."""
    given = {"method": zivi.ThetaGamma(H)}
    regulator = zivi.TwistingRegulator(3, 2, h=H, kappa=0.5, landing=False)

    def rest(**settings):
        force = settings.pop("force", 0.0)
        plant = zivi.ImpactSystem(force, kappa=0.5)
        settings = given | settings
        controller = settings.pop("controller", regulator)
        return zivi.simulate_closed_loop(plant, controller, (0, 2.5), (1, 0), **settings).rest_time

    assert rest() == pytest.approx(1.766)
    limited = zivi.TwistingRegulator(3, 2, h=H, kappa=0.5, landing=False, u_limits=(-4.99, 0))
    for other in (
        {"force": -0.05, "force_model": 0.0},
        {"delay": 1},
        {"noise": (1e-15, 0.0), "seed": 1},
        {"controller": limited},
        {"method": zivi.ThetaGamma(H, theta=0.9)},
    ):
        assert rest(**other) != pytest.approx(1.766, abs=2e-4)
