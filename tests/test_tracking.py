"""The paper's tracker on its data: when it has caught up, and how exactly it then follows."""

import numpy as np
import pytest

import zivi
from scheme import fitted_order

BRANCHES = ["positive", "nearest"]
F, F_REF = -9.81, -19.81


def track(
    branch="positive",
    *,
    h=1e-3,
    end=2.0,
    true=F,
    model=F,
    force_ref=F_REF,
    kappa_ref=None,
    paper=False,
    gains=(30, 17),
    y0=(6, 5),
    y_ref0=(3, 3),
    landing=False,
):
    tracker = zivi.TwistingTracker(
        *gains, h=h, kappa=0.5, kappa_ref=kappa_ref, branch=branch, landing=landing
    )
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(true, kappa=0.5),
        tracker,
        (0, end),
        y0,
        y_ref0=y_ref0,
        force_ref=force_ref,
        force_model=model,
        method=zivi.ThetaGamma(h) if paper else None,
    )


def last_above(run, bound):
    return run.t[np.flatnonzero(np.abs(run.error) > bound)[-1]]


# the last sample with an error above 1 cm; one sample of slack for other rounding
CAUGHT_UP = {
    ("positive", False): 1.21,
    ("nearest", False): 1.195,
    ("positive", True): 1.199,
    ("nearest", True): 1.118,
}


@pytest.mark.parametrize("paper", [False, True], ids=["sampled", "paper's loop"])
@pytest.mark.parametrize("branch", BRANCHES)
def test_the_reference_is_caught_and_then_followed_exactly(branch, paper):
    run = track(branch, end=4.0, paper=paper)
    assert run.success
    assert abs(last_above(run, 1e-2) - CAUGHT_UP[branch, paper]) < 1.5e-3
    assert abs(run.error[0]) == 3
    late = run.t >= 1.5
    assert np.count_nonzero(late) > 2000
    assert np.all(run.error[late] == 0)
    assert np.all(run.xdot[late] == 0)
    assert np.all(run.x_ref[late] == 0)
    assert np.all(run.u[late] == 9.81)
    # the reference's Zeno time is 1.2930358; implicit Euler's is earlier by O(h log 1/h)
    moving = run.t[np.flatnonzero(run.x_ref)[-1]]
    assert 1.2930358 - 0.03 < moving < 1.2930358
    # alone the plant would bounce until 2.945
    assert run.rest_time < 1.4


@pytest.mark.parametrize("branch", BRANCHES)
def test_the_first_control_is_the_law(branch):
    """Both errors positive, R = R_r = 1/2: -(30 + 17 + 19.81/R)/2 + 9.81."""
    run = track(branch, end=0.1)
    assert abs(run.u[0] + 33.5) < 1e-12
    np.testing.assert_array_equal(run.signs[0], [1, 1, 1, 1, 1, 1])


DISTURBED = {"positive": (0.81e-3, 6.69, 9.95), "nearest": (1.09e-3, 6.1, 10.5)}


@pytest.mark.parametrize("branch", BRANCHES)
def test_an_unmodelled_force_is_rejected(branch):
    """1.5 more than the model: millimetres per second, and the control moves by a few units."""
    run = track(branch, true=F + 1.5, end=4.0)
    late = run.t >= 1.5
    speed, low, high = DISTURBED[branch]
    assert 1e-9 < np.abs(run.error[late]).max() < 1e-6
    assert abs(np.abs(run.xdot[late]).max() - speed) < 0.05e-3
    assert np.abs(run.xdot[late]).max() < 2e-3
    assert low <= run.u[late].min() < 9.81 - 1.5 < run.u[late].max() <= high
    # on average it balances the true force
    assert abs(run.u[late].mean() - (9.81 - 1.5)) < 0.05
    # an explicit controller with the same gains swings by the gains instead
    explicit = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F + 1.5, kappa=0.5),
        zivi.ExplicitTwisting(30, 17, h=1e-3, kappa=0.5),
        (0, 4),
        (6, 5),
        y_ref0=(3, 3),
        force_ref=F_REF,
        force_model=F,
    )
    assert np.ptp(explicit.u[late]) > 20 > 5 > np.ptp(run.u[late])


@pytest.mark.parametrize("branch", BRANCHES)
def test_the_error_under_a_disturbance_shrinks_with_the_period(branch):
    """Position like h^2, velocity like h: what a wrong acceleration does in a period.

    The pattern that the samples settle into differs from h to h, its size by a factor of about
    two: over a range of 32 in h that moves the fitted powers by up to 0.3 and 0.2.
    """
    steps = 4e-3 / 2.0 ** np.arange(6)
    runs = [track(branch, h=h, true=F + 1.5, end=2.5) for h in steps]
    late = [run.t >= 1.8 for run in runs]
    x = [np.abs(run.error[k]).max() for run, k in zip(runs, late, strict=True)]
    xdot = [np.abs(run.xdot[k]).max() for run, k in zip(runs, late, strict=True)]
    assert abs(fitted_order(steps, x) - 2) < 0.3
    assert abs(fitted_order(steps, xdot) - 1) < 0.2
    assert np.all(x < 1.5 * steps**2)  # the wrong acceleration itself
    assert np.all(xdot < 1.5 * steps)


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("h", [4e-3, 2e-3, 5e-4])
def test_other_periods_catch_up_at_the_same_time(branch, h):
    """Sliding begins when it does, give or take some periods; exact rest for every h."""
    run = track(branch, h=h, end=3.0)
    assert abs(last_above(run, 1e-2) - CAUGHT_UP[branch, False]) < 0.015
    late = run.t >= 1.7
    assert np.all(run.error[late] == 0)
    assert np.all(run.u[late] == 9.81)


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("paper", [False, True], ids=["sampled", "paper's loop"])
def test_units_do_not_matter(branch, paper):
    """Lengths times L, times times T: powers of two scale every number without rounding."""
    plain = track(branch, h=2.0**-10, paper=paper)
    length, time = 4.0, 2.0**-10
    acceleration, speed = length / time**2, length / time
    scaled = track(
        branch,
        h=2.0**-10 * time,
        end=2.0 * time,
        true=F * acceleration,
        model=F * acceleration,
        force_ref=F_REF * acceleration,
        paper=paper,
        gains=(30 * acceleration, 17 * acceleration),
        y0=(6 * length, 5 * speed),
        y_ref0=(3 * length, 3 * speed),
    )
    np.testing.assert_array_equal(scaled.t, time * plain.t)
    np.testing.assert_array_equal(scaled.x, length * plain.x)
    np.testing.assert_array_equal(scaled.xdot, speed * plain.xdot)
    np.testing.assert_array_equal(scaled.u, acceleration * plain.u)
    np.testing.assert_array_equal(scaled.signs, plain.signs)


def test_larger_gains_catch_up_sooner():
    times = [last_above(track(gains=gains), 1e-2) for gains in ((20, 11), (30, 17), (60, 34))]
    assert times[0] > times[1] > times[2]


@pytest.mark.parametrize("branch", BRANCHES)
def test_equal_walls_are_needed_for_exact_tracking(branch):
    """A reference that meets its wall at 2.73 s with 5.2 m/s: unequal walls throw the plant off.

    In flight the plant keeps the distance ``h^2 |Fr|/2`` that the exact parabola has from the
    implicit Euler steps of the reference.
    """
    h, impact, speed = 1e-3, 2.732, 5.2
    errors = {}
    for kappa_ref in (0.5, 0.6, 0.3):
        run = track(branch, kappa_ref=kappa_ref, force_ref=-3.0, end=6.0)
        flight = (run.t > 2.55) & (run.t < impact - 0.03)
        np.testing.assert_allclose(np.abs(run.error[flight]), 1.5 * h**2, rtol=1e-6)
        errors[kappa_ref] = np.abs(run.error[run.t > impact - 0.03]).max()
        # bounded: the plant comes back before the next impact, whatever the wall
        again = (run.t > 3.55) & (run.t < 3.56) if kappa_ref != 0.6 else run.t > 5.0
        assert np.abs(run.error[again]).max() < 2e-3
    # equal walls: the impacts fall within one period of each other
    assert errors[0.5] < speed * h
    assert errors[0.6] > speed * h
    assert 0.2 > errors[0.3] > 10 * speed * h * 0.9


def test_a_reference_that_lifts_off_is_followed():
    """Rest, then a force away from the wall: the plant leaves with the reference."""
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, kappa=0.5),
        tracker,
        (0, 3),
        (0.5, 0),
        y_ref0=(0, 0),
        force_ref=lambda t, x, xdot: 1.0 if t > 1.5 else -1.0,
        force_model=F,
    )
    resting = (run.t > 1.0) & (run.t < 1.5)
    assert np.all(run.x[resting] == 0)
    up = run.t > 1.6
    np.testing.assert_allclose(run.x_ref[-1], 0.5 * 1.5**2, rtol=1e-2)
    assert np.abs(run.error[up]).max() < 1e-3
    assert len(run.liftoff_times) == 1
    assert abs(run.liftoff_times[0] - 1.5) < 2.5e-3


def test_on_the_reference_the_control_is_that_of_the_forces_through_the_apex():
    """`u = F_r - F` in the paper's loop: nothing ripples where the velocity vanishes."""
    for h in (1e-2, 1e-3):
        for speed in np.linspace(1.0, 2.0, 7):
            start = (1.0, speed)
            run = track(h=h, end=0.12, paper=True, y0=start, y_ref0=start, gains=(60, 33))
            assert run.xdot_ref[0] > 0 > run.xdot_ref[-1]
            np.testing.assert_allclose(run.u, F_REF - F, rtol=0, atol=1e-7)
