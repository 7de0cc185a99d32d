"""MoreauJean, the baseline: first order, rest, and how far it passes the wall."""

import math

import numpy as np
import pytest

import event_simulation
import zivi
from closed_form import Ball
from scheme import fitted_order, jittered

G = 9.81
STEPS = (1e-2, 1e-3, 1e-4)
SPRING = {"stiffness": 4.0, "damping": 0.2, "gravity": 2.0, "amplitude": 1.0, "omega": 2.0}


def run(force, e, h, span, state, theta=0.5):
    method = zivi.MoreauJean(h=h, theta=theta)
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, state, method=method)


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.7, 1.0])
def test_first_order_away_from_impacts(e, theta):
    """States in flight and the first impact, over two decades and jittered steps."""
    exact = event_simulation.simulate(
        event_simulation.Linear(**SPRING, e=e), (0, 3), (1, 0), slow=1e-4
    )
    events = np.array([t for t, *_ in exact.impacts])
    times = [t for t in np.linspace(0.2, 2.9, 28) if np.abs(events - t).min() > 0.06]
    times = [t for t in times if exact.state(t) is not None and exact.state(t)[0] > 0.02]
    assert len(times) >= 5
    truth = np.array([exact.state(t) for t in times]).T
    errors = []
    for middle in STEPS:
        runs = [
            run(zivi.LinearForce(**SPRING), e, h, (0, 3), (1, 0), theta)
            for h in jittered(middle, 5)
        ]
        errors.append(np.sqrt(np.mean([(sol(times)[0] - truth[0]) ** 2 for sol in runs])))
        first = [abs(sol.resolved_impacts["t"][0] - events[0]) for sol in runs]
        assert max(first) < 2.1 * middle * 1.5
    # with e = 0 all of them are before the only impact, where the midpoint rule is of second order
    order = 2 if (e, theta) == (0.0, 0.5) else 1
    assert order - 0.25 < fitted_order(STEPS, errors) < order + 0.3
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("e", [0.0, 0.3, 0.8, 1.0])
@pytest.mark.parametrize("h", [1e-2, 1e-3, 1e-4])
def test_the_wall_is_passed_by_a_step_at_most(e, h):
    """An impact acts where x + h x'/2 <= 0: x may be -h |x'| / 2 before it, and in its step
    goes on with half of the velocity before and half of that after it."""
    sol = run(-G, e, h, (0, 2), (1, 0))
    speed = math.sqrt(2 * G)
    assert sol.x.min() >= -(1 - 0.5 * e) * h * (speed + G * h)
    assert sol.resolved_impacts["xdot_before"][0] == pytest.approx(-speed, abs=2 * G * h)
    np.testing.assert_allclose(
        sol.resolved_impacts["xdot_after"],
        -e * sol.resolved_impacts["xdot_before"],
        rtol=1e-12,
        atol=2 * G * h,
    )


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
def test_rest(e):
    """After the accumulation the velocity is zero to rounding, and the position stays."""
    for h in jittered(1e-3, 5):
        sol = run(-G, e, h, (0, 8), (1, 0))
        zeno = Ball(1, 0, e=e, g=G).zeno
        late = sol.t > zeno + 0.05
        assert np.abs(sol.xdot[late]).max() < 2 * G * h
        assert np.ptp(sol.x[late]) < 2 * G * h * h
        assert np.abs(sol.x[late]).max() < 5 * h


def test_elastic_energy():
    """e = 1 at theta = 1/2: no loss in flight, and at impacts what the penetration is worth."""
    for h in (1e-3, 1e-4):
        sol = run(-G, 1.0, h, (0, 5), (1, 0))
        energy = 0.5 * sol.xdot**2 + G * sol.x
        assert len(sol.resolved_impacts) == 6
        assert np.abs(energy - G).max() < 6 * G * h * math.sqrt(2 * G)


def test_lift_off():
    """From rest under f = -g + c t at t = g/c, to a step."""
    sol = run(lambda t, x, xdot: -2.0 + 4.0 * t, 0.5, 1e-3, (0, 1.5), (0, 0))
    assert np.all(sol.x[sol.t < 0.49] <= 0)
    exact = 4.0 * np.maximum(sol.t - 0.5, 0) ** 3 / 6
    assert np.abs(sol.x - exact).max() < 5e-3


@pytest.mark.parametrize(
    ("given", "error", "name"),
    [
        *(({"h": v}, ValueError, "h") for v in (0, -1, math.nan, math.inf)),
        *(({"h": v}, TypeError, "h") for v in ("a", None, 1j)),
        *(({"h": 0.1, "theta": v}, ValueError, "theta") for v in (-0.1, 1.1, math.nan)),
        *(({"h": 0.1, "theta": v}, TypeError, "theta") for v in ("a", None)),
    ],
)
def test_settings_are_named(given, error, name):
    with pytest.raises(error, match=rf"(?<![\w.]){name}(?!\w)"):
        zivi.MoreauJean(**given)


def test_a_force_that_raises():
    def force(t, x, xdot):
        if t > 0.2:
            raise KeyError("mine")
        return -G

    with pytest.raises(KeyError) as caught:
        run(force, 0.5, 1e-2, (0, 1), (1, 0))
    assert caught.value.trajectory.status == zivi.Status.RAISED
    assert caught.value.trajectory.t[-1] == pytest.approx(0.2, abs=2e-2)
