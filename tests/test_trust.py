"""Until when a run is near the motion."""

import pickle

import numpy as np
import pytest

import zivi
from chaotic_runs import FAMILIES, problems

TABLE = zivi.ImpactSystem(zivi.LinearForce(gravity=1, amplitude=3, omega=1), e=0.8)
"""A ball on a table that vibrates with three times its weight: near motions part."""


def chaotic(end=300, **settings):
    return zivi.simulate(TABLE, (0, end), (1, 0), zivi.SwitchedRK(**settings))


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_that_leave_the_motion_say_so_before_and_no_others(family):
    far = 0
    for problem in problems(96, 3):
        if problem.family != family:
            continue
        sol = problem.run()
        times, errors = problem.errors(sol)
        if errors.max() > 1e3:
            far += 1
            assert sol.trusted_until < times[errors > 1e3][0], problem
        elif errors.max() < 100:
            assert sol.trusted_until == sol.t[-1], problem
    assert far > 2 or family != "table"


def test_exact_flights_are_trusted_until_rounding_shows():
    """Their own error is rounding, which grows, too."""
    exact = chaotic(2000)
    assert 150 < exact.trusted_until < 2000
    # another run with errors of rounding agrees until then, and not for long after
    moved = zivi.simulate(TABLE, (0, 2000), (1 + 1e-15, 0))
    times = np.linspace(0, 2000, 20001)
    apart = np.abs(exact(times)[0] - moved(times)[0])
    assert apart[times < 0.7 * exact.trusted_until].max() < 1e-2
    assert apart.max() > 1


def test_it_is_told_where_it_is_known():
    sol = chaotic(flights="rk")
    assert "trusted" not in repr(sol)
    until = sol.trusted_until
    assert f"trusted until {until:.6g} s" in repr(sol)
    assert pickle.loads(pickle.dumps(sol)).trusted_until == until
    whole = chaotic(5, flights="rk")
    assert whole.trusted_until == 5
    assert "trusted" not in repr(whole)


def test_samples_events_and_stops_do_not_matter():
    def high(t, x, xdot):
        return x - 4

    high.terminal = 3
    method = zivi.SwitchedRK(flights="rk")
    ended = zivi.simulate(TABLE, (0, 300), (1, 0), method, events=high)
    assert ended.trusted_until == ended.t[-1] < 60
    sparse = zivi.simulate(
        TABLE, (0, 300), (1, 0), method, t_eval=np.linspace(0, 300, 500), dense_output=False
    )
    dense = chaotic(flights="rk")
    assert sparse.trusted_until == pytest.approx(dense.trusted_until, abs=10)

    def held(t, x, xdot):
        return -9.81 if t < 0.2 else -5.0

    stopped = zivi.simulate(zivi.ImpactSystem(held, e=0.5), (0, 3), (1, 0), tstops=[0.2])
    assert stopped.trusted_until == 3


def test_what_does_not_know_its_system_says_so():
    for sol in (
        pickle.loads(pickle.dumps(chaotic(5))),
        zivi.simulate(TABLE, (0, 5), (1, 0), zivi.ThetaGamma(h=1e-2)),
    ):
        with pytest.raises(ValueError, match="of another method or from a file"):
            _ = sol.trusted_until


def test_contacts_of_a_mechanical_system_stay_closed():
    system = zivi.MechanicalSystem(
        mass=np.eye(2), force=[0.5, -9.81], gaps=[zivi.LinearGap([0, 1])], e=0.5
    )
    sol = zivi.simulate(system, (0, 2), ([0, 0], [1, 0]))
    assert sol.trusted_until == 2
