"""Flights by power series: against references, the Runge-Kutta pair and closed forms."""

import math
import pickle
from random import Random

import numpy as np
import pytest

import flight_draws
import zivi
from references import REFERENCES

ROUNDING = 2e-14
"""Of times up to 65 s and of the references' own 17 digits."""
OSCILLATOR = zivi.LinearForce(stiffness=1, damping=0.1, gravity=-1, amplitude=0.6, omega=0.9)


def series(tol=1e-14, **more):
    return zivi.SwitchedRK(rtol=tol, atol=tol, flights="series", **more)


def nearest(times, others):
    """Largest distance of one of `others` from the nearest of `times`."""
    return np.abs(np.subtract.outer(times, others)).min(axis=0).max() if len(others) else 0.0


@pytest.mark.parametrize("name", REFERENCES)
def test_references(name):
    case = REFERENCES[name]
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])
    span, state = (case["t0"], case["t_end"]), (case["x0"], case["xdot0"])
    sol = zivi.simulate(system, span, state, method=series())
    assert sol.success
    assert sol.nfev == 0
    assert sol.n_rejected == 0
    assert (len(sol.zeno_times), len(sol.liftoff_times)) == (len(case["zeno"]), len(case["lift"]))
    assert nearest(sol.zeno_times, case["zeno"]) <= ROUNDING
    assert nearest(sol.liftoff_times, case["lift"]) <= ROUNDING
    skipped = sol.impacts_down_to(1e-3)["t"]
    followed = [
        t for t, _ in case["impacts"] if nearest(sol.resolved_impacts["t"], [t]) <= ROUNDING
    ]
    assert len(followed) >= min(3, len(case["impacts"]))
    assert nearest(skipped, [t for t, u in case["impacts"] if u > 1e-3]) <= 1e-11
    assert sol.x[-1] == pytest.approx(case["x_end"], abs=ROUNDING)
    assert sol.xdot[-1] == pytest.approx(case["xdot_end"], abs=ROUNDING)
    for t, state in case["samples"].items():
        assert np.abs(sol(float(t)) - state).max() <= 1e-11  # samples within tails are among them


def test_random_runs_are_those_of_the_pair():
    random = Random(5)
    for _ in range(40):
        system, state, t0 = flight_draws.run(random)
        span = (t0, t0 + 2.0)
        runs = [
            zivi.simulate(
                system, span, state, method=zivi.SwitchedRK(1e-12, 1e-12, flights=flights)
            )
            for flights in ("series", "rk")
        ]
        ours, other = runs
        assert ours.status == other.status
        assert ours.nfev == 0 < other.nfev
        assert len(ours.liftoff_times) == len(other.liftoff_times)
        times = np.linspace(*span, 50)
        assert np.abs(ours(times)[0] - other(times)[0]).max() < 1e-9


def test_a_plastic_impact_under_a_push_after_a_lift_off():
    # rest, a lift-off that grows from zero, then an impact from which the mass is pushed at once
    wall = zivi.HarmonicWall(amplitude=0.0747, omega=18.07, phase=-0.822, offset=-0.066)
    system = zivi.ImpactSystem(zivi.LinearForce(damping=-0.2256, gravity=7.433), e=0.0, wall=wall)
    ours, other = (
        zivi.simulate(
            system, (0, 3), (1.493, 2.545), method=zivi.SwitchedRK(1e-12, 1e-12, flights=flights)
        )
        for flights in ("series", "rk")
    )
    assert len(ours.resolved_impacts) == len(other.resolved_impacts) >= 4
    assert np.abs(ours.resolved_impacts["t"] - other.resolved_impacts["t"]).max() < 1e-10
    assert len(ours.liftoff_times) == len(other.liftoff_times)


def test_flights_do_not_depend_on_the_tolerances():
    system = zivi.ImpactSystem(OSCILLATOR, e=0.8)
    coarse, fine = (
        zivi.simulate(system, (0, 60), (1, 0), method=series(tol)) for tol in (1e-4, 1e-12)
    )
    assert np.array_equal(coarse.resolved_impacts, fine.resolved_impacts)
    assert np.array_equal(coarse.x, fine.x)
    # neither on what is asked for
    steps = zivi.simulate(
        system, (0, 60), (1, 0), method=series(max_step=0.1), t_eval=[60.0], dense_output=False
    )
    assert np.array_equal(steps.resolved_impacts, fine.resolved_impacts)


def test_a_pure_bounce_is_exact():
    # x'' = -k x: half a turn between impacts
    system = zivi.ImpactSystem(zivi.LinearForce(stiffness=4.0), e=1.0)
    sol = zivi.simulate(system, (0, 100), (0, 3.0), method=series())
    expected = np.arange(1, len(sol.resolved_impacts) + 1) * (math.pi / 2)
    assert len(sol.resolved_impacts) == 63
    assert np.abs(sol.resolved_impacts["t"] - expected).max() < 3e-14
    assert np.abs(sol.resolved_impacts["xdot_after"] - 3.0).max() < 2e-14


def test_dense_output_is_exact():
    # x'' = -x + cos t, resonance: x = (t/2) sin t + cos t, above the wall up to 2.4
    force = zivi.LinearForce(stiffness=1.0, amplitude=1.0, omega=1.0)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 2), (1, 0), method=series())
    t = np.linspace(0, 2, 400)
    x, xdot = sol(t)
    assert np.abs(x - (0.5 * t * np.sin(t) + np.cos(t))).max() < 5e-16
    assert np.abs(xdot - (0.5 * t * np.cos(t) - 0.5 * np.sin(t))).max() < 1e-15


@pytest.mark.parametrize(
    ("force", "end"),
    [
        (zivi.LinearForce(gravity=-1.0), (50.0, 10.0)),  # away from the wall for good
        (zivi.LinearForce(damping=1e-12), (10.0, 1.0)),
        (zivi.LinearForce(), (10.0, 1.0)),
    ],
)
def test_flights_that_never_return_end_with_the_run(force, end):
    state = (0.0, 0.0) if force.gravity else (0.0, 1.0)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 10), state, method=series())
    assert sol.success
    assert not len(sol.resolved_impacts)
    assert (sol.x[-1], sol.xdot[-1]) == pytest.approx(end, rel=1e-10)


@pytest.mark.parametrize("force", [-1e-200, -1e-300, 5e-324, 1e-160, -1e-17])
def test_forces_that_hardly_act(force):
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 3), (1, -0.2), method=series())
    assert sol.success
    assert sol.n_steps < 20
    assert (sol.x[-1], sol.xdot[-1]) == (pytest.approx(0.4, abs=1e-15), pytest.approx(-0.2))


def test_what_grows_without_bounds_ends_at_the_largest_numbers():
    system = zivi.ImpactSystem(zivi.LinearForce(stiffness=-100.0), e=0.5)
    sol = zivi.simulate(system, (0, 1e3), (0, 1), method=series())
    assert sol.status is zivi.Status.STATE_NOT_FINITE
    assert sol.x[-1] > 1e290
    assert np.isfinite(sol.x[-1])


def test_stiff_damping_takes_many_steps_at_once():
    # terminal velocity -g/c after 1e-4 s; 1 m takes 1000 s, 5 million steps
    system = zivi.ImpactSystem(zivi.LinearForce(damping=1e4, gravity=10.0), e=0.5)
    sol = zivi.simulate(system, (0, 1100), (1, 0), method=series(), dense_output=False)
    first = sol.resolved_impacts[0]
    assert first["t"] == pytest.approx(1000 + 1e-4, rel=1e-12)
    assert first["xdot_before"] == pytest.approx(-1e-3, rel=1e-9)
    assert sol.n_steps < 100_000
    # the motion between the ends of such steps is there too, where it is asked for
    part = zivi.simulate(system, (0, 2), (1, 0), method=series(), samples="steps")
    assert part.n_steps < 300
    assert part(1.234)[0] == pytest.approx(1 - 1.2339e-3, abs=1e-13)
    budget = zivi.simulate(system, (0, 1100), (1, 0), method=series(max_steps=10_000))
    assert budget.status is zivi.Status.STEP_BUDGET
    assert budget.t[-1] < 10
    assert budget(budget.t[-1])[0] == budget.x[-1]


def test_events_and_t_eval_along_series():
    system = zivi.ImpactSystem(OSCILLATOR, e=0.8)

    def level(t, x, xdot):
        return x - 1.3

    times = np.linspace(0, 30, 77)
    sol = zivi.simulate(system, (0, 30), (1, 0), method=series(), events=level, t_eval=times)
    whole = zivi.simulate(system, (0, 30), (1, 0), method=series())
    assert np.array_equal(sol.x, whole(times)[0])
    at = sol.t_events[0]
    assert len(at) > 4
    assert np.abs(whole(at)[0] - 1.3).max() < 1e-14


def test_the_longest_step_bounds_the_looks_of_events():
    # two zeros 0.2 ms apart at the apex of a flight that is one step, between looks 3 ms apart
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    apex, half = 3.0 / 9.81, 0.0001
    height = 0.5 * 9.81 * (apex**2 - half**2)
    functions = [lambda t, x, xdot: x - height, zivi.Level(x=height)]
    seen, fine = (
        zivi.simulate(ball, (0, 0.6), (0, 3), zivi.SwitchedRK(max_step=step), events=functions)
        for step in (math.inf, 0.00015)
    )
    assert np.array_equal(seen.t, fine.t)
    assert len(seen.t_events[0]) == 0
    for times in (fine.t_events[0], fine.t_events[1], seen.t_events[1]):
        assert times == pytest.approx([apex - half, apex + half], abs=1e-12)


def test_a_motion_is_stored_and_comes_back(tmp_path):
    system = zivi.ImpactSystem(OSCILLATOR, e=0.8)
    sol = zivi.simulate(system, (0, 30), (1, 0), method=series())
    times = np.linspace(0, 30, 200)
    again = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(again(times), sol(times))
    assert again.config["method"]["flights"] == "series"
    # at the samples it is the samples, to the last bit
    assert np.array_equal(again(sol.t), (sol.x, sol.xdot))


def test_series_are_refused_where_the_force_is_no_linear_one():
    system = zivi.ImpactSystem(lambda t, x, xdot: -9.81, e=0.5)
    with pytest.raises(ValueError, match="flights must be"):
        zivi.simulate(system, (0, 1), (1, 0), method=series())
    sol = zivi.simulate(system, (0, 1), (1, 0))
    assert sol.success
    assert sol.nfev > 0


@pytest.mark.parametrize("tol", [1e-6, 1e-8, 1e-10, 1e-12])
def test_long_accumulations_near_elastic_impacts(tol):
    # e near 1 with a little drag: thousands of impacts
    force = zivi.LinearForce(damping=0.01, gravity=9.81)
    system = zivi.ImpactSystem(force, e=0.999)
    sol = zivi.simulate(system, (0, 2000), (1, 0), method=series(tol), dense_output=False)
    fine = zivi.simulate(system, (0, 2000), (1, 0), method=series(1e-14), dense_output=False)
    assert abs(sol.rest_time - fine.rest_time) <= tol * fine.rest_time
