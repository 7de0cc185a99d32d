"""Arrays are copied at the door: what is written into them later changes nothing."""

import numpy as np
import pytest

import zivi

TIMES = np.linspace(0, 1, 11)
METHODS = pytest.mark.parametrize(
    "method", [zivi.SwitchedRK(), zivi.ThetaGamma(h=1e-2), zivi.MoreauJean(h=1e-2)], ids=repr
)


def writing(*arrays):
    """Give a force that overwrites arrays when it is asked."""

    def force(t, *state):
        for array in arrays:
            array[:] = np.nan
        return -9.81

    return force


@METHODS
def test_a_force_may_write_into_the_times_of_a_run(method):
    given = TIMES.copy()
    system = zivi.ImpactSystem(writing(given), e=0.5)
    sol = zivi.simulate(system, (0, 1), (1, 0), method, t_eval=given)
    assert np.isnan(given).all()
    assert (sol.t == TIMES).all()
    plain = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0), method, t_eval=TIMES)
    assert sol.x == pytest.approx(plain.x, abs=1e-8)


def test_an_event_may_write_into_the_stops():
    stops = np.array([0.3, 0.6])

    def event(t, x, xdot):
        stops[:] = -1.0
        return x - 0.5

    sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0), tstops=stops, events=event)
    assert {0.3, 0.6} <= set(sol.t)


@METHODS
def test_the_force_of_a_mechanical_system_may_write_into_what_it_was_given(method):
    q0, qdot0, times = np.array([1.0]), np.array([0.0]), TIMES.copy()
    force = writing(q0, qdot0, times)
    system = zivi.MechanicalSystem(
        mass=1.0, force=lambda *at: [force(*at)], gaps=[zivi.LinearGap([1])], e=0.5
    )
    sol = zivi.simulate(system, (0, 1), (q0, qdot0), method, t_eval=times)
    assert np.isnan(q0).all()
    assert (sol.t == TIMES).all()
    assert sol.q[0] == 1


def test_the_arrays_of_a_system_are_its_own():
    force, mass, e = np.array([-9.81]), np.array([[1.0]]), np.array([0.5])
    system = zivi.MechanicalSystem(mass=mass, force=force, gaps=[zivi.LinearGap([1])], e=e)
    for array in (force, mass, e):
        array[:] = 7.0
    sol = zivi.simulate(system, (0, 2), ([1], [0]))
    assert sol.zeno["t"] == pytest.approx([3 * np.sqrt(2 / 9.81)])


def test_the_plant_of_a_closed_loop_may_write_into_times_and_reference():
    times, reference = TIMES.copy(), np.zeros((101, 2))
    force = writing(times, reference)
    controller = zivi.TwistingTracker(mu1=30, mu2=17, h=1e-2, e=0.5)
    runs = [
        zivi.simulate_closed_loop(
            zivi.ImpactSystem(law, e=0.5), controller, (0, 1), (1, 0), t_eval=t, reference=r
        )
        for law, t, r in ((force, times, reference), (-9.81, TIMES, np.zeros((101, 2))))
    ]
    assert np.isnan(reference).all()
    assert (runs[0].t == runs[1].t).all()
    assert runs[0].x == pytest.approx(runs[1].x, abs=1e-6)


@METHODS
@pytest.mark.parametrize("times", [[0.2, 0.1], [0.5, 1.5], [0.1, np.nan]])
def test_times_must_increase_within_the_span_for_every_method(method, times):
    match = "t_eval must be increasing"
    with pytest.raises(ValueError, match=match):
        zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0), method, t_eval=times)
    system = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5)
    with pytest.raises(ValueError, match=match):
        zivi.simulate(system, (0, 1), ([1], [0]), method, t_eval=times)
