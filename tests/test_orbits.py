"""Periodic orbits and their branches, against references of high precision and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import orbit_data
import zivi
from inside import chatter_exponent
from oscillator import Oscillator

OSCILLATORS = [Oscillator(0.05, 0.9, 0.8), Oscillator(0.02, 1.2, 0.7), Oscillator(0.05, 2.8, 0.8)]
DONE = zivi.OrbitStatus.COMPLETED
CRITICAL_03 = 1.946938480312789
"""Where the resting orbit of e = 0.3 ends: flights in closed form with 50 digits, bisected."""


def table(amplitude: float, e: float = 0.5) -> zivi.ImpactSystem:
    """A ball on a table, in the frame of the table."""
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2)
    return zivi.ImpactSystem(force, e=e)


def single(amplitude: float, e: float = 0.5) -> tuple[float, float]:
    """Time and speed of its orbit with one impact in one period."""
    return math.acos(math.pi * (1 - e) / ((1 + e) * amplitude)), 2 * math.pi * e / (1 + e)


FOLD = math.pi / 3
DOUBLING = math.hypot(FOLD, 10 / 9)


def found(name: str, off: float = 0.01) -> tuple[dict, np.ndarray, zivi.PeriodicOrbit, dict]:
    it = orbit_data.references()[name]
    system, names = orbit_data.system_of(it["parameters"])
    y = np.array([float(value) for value in it["y"]]).reshape(-1, 2)
    period = 2 * math.pi / float(it["parameters"]["w"])
    orbit = zivi.periodic_orbit(system, y * (1 + off), it["forcing_periods"], period=period)
    return it, y, orbit, names


@pytest.mark.parametrize("name", orbit_data.of_kind("orbit"))
def test_orbits_are_those_of_high_precision(name):
    it, y, orbit, names = found(name)
    assert orbit.status is DONE
    assert orbit.iterations <= 6
    rows = np.column_stack([orbit.impacts["t"], orbit.impacts["u"]])
    np.testing.assert_allclose(rows, y, rtol=1e-10)
    exact = [complex(*(float(part) for part in pair)) for pair in it["multipliers"]]
    assert np.max(np.abs(np.sort_complex(orbit.multipliers) - np.sort_complex(exact))) < 1e-10
    # the monodromy of a whole simulation has the same
    other = np.sort_complex(np.linalg.eigvals(orbit.monodromy()))
    assert np.max(np.abs(other - np.sort_complex(exact))) < 1e-9
    if "dy" in it:
        by = orbit.derivative(names[it["dpar"]])
        np.testing.assert_allclose(by, [float(value) for value in it["dy"]], rtol=1e-9)


def test_the_derivative_by_the_frequency_moves_the_period():
    # by the closed form, t in the phase of the excitation of each frequency
    oscillator, h = OSCILLATORS[0], 1e-4
    t, amplitude = oscillator.orbit(0.4)
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(t, 0.4)], 1)
    rows = []
    for w in (0.9 - h, 0.9 + h):
        moved = zivi.periodic_orbit(Oscillator(0.05, w, 0.8).system(amplitude), orbit)
        rows.append([moved.impacts["t"][0], moved.impacts["u"][0]])
    slope = np.diff(rows, axis=0)[0] / (2 * h)
    np.testing.assert_allclose(orbit.derivative("omega"), slope, rtol=1e-5)


def test_an_orbit_that_rests():
    it = orbit_data.references()["R1_rest_e0.5"]
    system, names = orbit_data.system_of(it["parameters"])
    orbit = zivi.periodic_orbit(system, (0.0, (0.5, 0.0)))
    assert (orbit.kind, orbit.multiple, orbit.status) == ("resting", 1, DONE)
    lift, first, speed, zeno = (float(value) for value in it["values"])
    assert abs(orbit.liftoff_time - lift) < 1e-12
    assert abs(orbit.zeno_time - zeno) < 1e-10
    assert abs(orbit.impacts["t"][0] - first) < 1e-11
    assert abs(orbit.impacts["u"][0] - speed) < 1e-11
    assert not orbit.multipliers.any()
    for q, name in names.items():
        if q in it["d"]:
            by_zeno, by_lift = orbit.derivative(name)
            exact = [float(value) for value in it["d"][q]]
            assert abs(by_zeno - exact[3]) < 1e-9 * abs(exact[3])
            assert abs(by_lift - exact[0]) < 1e-11


@pytest.mark.parametrize("m", range(3), ids=["w=0.9", "w=1.2", "w=2.8"])
def test_starts_near_a_grazing_converge(m):
    # the guess is the orbit at u0, the parameter that of an orbit much nearer to the grazing
    oscillator, steps = OSCILLATORS[m], []
    for u0 in (0.3, 0.1, 0.03):
        for part in np.linspace(0.9, 0.0, 7):
            guess = oscillator.orbit(u0)[0]
            u = part * u0
            t, amplitude = oscillator.orbit(u)
            orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(guess, u0)], 1)
            apart = abs((orbit.impacts["t"][0] - t + 1) % oscillator.period - 1)
            assert orbit.status is not zivi.OrbitStatus.NOT_CONVERGED
            assert apart + abs(orbit.impacts["u"][0] - u) < 1e-9
            steps.append(orbit.iterations)
    assert max(steps) <= 6


def strobe(system: zivi.ImpactSystem, span: tuple[float, float], z: np.ndarray) -> np.ndarray:
    """Newton's iteration on the state once a period: it has no idea of a grazing."""
    for _ in range(12):
        if not (np.all(np.isfinite(z)) and 0.0 <= z[0] < 1e3):
            break
        s = zivi.sensitivity(system, span, z, method=zivi.SwitchedRK(rtol=1e-11, atol=1e-12))
        end = np.array([s.trajectory.x[-1], s.trajectory.xdot[-1]])
        z = z - np.linalg.solve(s.final - np.eye(2), end - z)
    return z


def test_the_strobe_alone_does_not_follow_a_branch_through_a_grazing():
    # from the orbits at 2 u, 4 u, ..., towards that of u near the grazing: a sequence has no
    # trouble, the state once a period does not get there
    oscillator, wanted = OSCILLATORS[0], 1e-3
    t, amplitude = oscillator.orbit(wanted)
    system = oscillator.system(amplitude)
    start = t + 0.5 * oscillator.period
    misses = 0
    for u0 in (0.03, 0.1, 0.3):
        t0, other = oscillator.orbit(u0)
        state = zivi.simulate(oscillator.system(other), (t0, start), (0.0, u0))(start)
        with np.errstate(all="ignore"):
            z = strobe(system, (start, start + oscillator.period), state)
        if not (np.all(np.isfinite(z)) and 0.0 <= z[0] < 1e3):
            misses += 1
            continue
        run = zivi.simulate(system, (start, start + oscillator.period), z)
        hit = len(run.impacts) == 1 and abs(run.impacts["xdot_after"][0] - wanted) < 1e-6
        misses += not hit
        assert zivi.periodic_orbit(system, [(t0, u0)], 1).impacts["u"][0] == pytest.approx(wanted)
    assert misses >= 2


def test_fold_and_doubling_of_the_table():
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 2.4))
    (fold,), (doubling,) = branch.of_kind("fold"), branch.of_kind("period_doubling")
    assert abs(fold.value / FOLD - 1) < 1e-11
    assert abs(doubling.value / DOUBLING - 1) < 1e-11
    assert branch.n_flights <= 10 * len(branch)
    assert branch.status is zivi.OrbitStatus.RANGE_END
    stable = branch.values[branch.stable]
    assert FOLD < stable.min() < 1.1
    assert 1.4 < stable.max() < DOUBLING
    for point in branch.orbits:
        t, u = single(parameter := point.system.force.amplitude)
        away = abs(point.impacts["t"][0]) - t
        assert abs(math.sin(away)) < 1e-9 or abs(parameter - FOLD) < 1e-6
        assert abs(point.impacts["u"][0] - u) < 1e-10


def test_a_cascade_to_period_16():
    orbit = zivi.periodic_orbit(table(1.5), [single(1.5)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.4, 1.8))
    values = []
    for periods in (2, 4, 8, 16):
        event = branch.of_kind("period_doubling")[0]
        values.append(event.value)
        # the multiplier is -1 in a simulation too, which knows nothing of the sequence
        assert np.min(np.abs(np.linalg.eigvals(event.orbit.monodromy()) + 1)) < 1e-5
        orbit = branch.switch(event)
        assert orbit.multiple == periods
        assert orbit.status is DONE
        branch = zivi.continue_orbit(orbit, "amplitude", (1.4, 1.8), max_points=60)
    values.append(branch.of_kind("period_doubling")[0].value)
    second = float(orbit_data.references()["PD2_ball"]["value"])
    assert abs(values[0] / DOUBLING - 1) < 1e-9
    assert abs(values[1] / second - 1) < 1e-9
    np.testing.assert_allclose(values[2:], [1.6968, 1.7032, 1.7046], atol=6e-5)
    gaps = np.diff(values)
    np.testing.assert_allclose(gaps[:-1] / gaps[1:], [4.73, 4.63, 4.65], atol=0.01)


@pytest.mark.parametrize("m", range(3), ids=["w=0.9", "w=1.2", "w=2.8"])
def test_grazings_and_folds_of_an_oscillator(m):
    oscillator = OSCILLATORS[m]
    t, amplitude = oscillator.orbit(0.3)
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(t, 0.3)], 1)
    grazes = math.sqrt(oscillator.quadratic[0])
    span = (0.3 * min(amplitude, grazes), 1.5 * max(amplitude, grazes))
    branch = zivi.continue_orbit(orbit, "amplitude", span)
    (grazing,) = branch.of_kind("grazing")
    d, _, b = oscillator.quadratic
    assert abs(grazing.value / grazes - 1) < 1e-10
    # it passes the grazing, regularly
    assert min(orbit.impacts["u"][0] for orbit in branch.orbits) < -1e-3
    by = 2 / (math.sqrt(d) * b)
    assert abs(grazing.orbit.derivative("amplitude")[1] / by - 1) < 1e-6
    if (fold := oscillator.fold)[0] > 0:
        assert abs(branch.of_kind("fold")[0].value / fold[1] - 1) < 1e-10
    # from the other side: the smooth orbit meets the wall there, and an impact begins
    smooth = branch.switch(grazing)
    assert (smooth.kind, smooth.status) == ("flight", DONE)
    other = zivi.continue_orbit(smooth, "amplitude", span)
    begins = other.of_kind("interior_impact")[0]
    assert abs(begins.value / math.sqrt(d) - 1) < 1e-10
    back = other.switch(begins)
    assert (back.kind, back.status) == ("impacting", DONE)
    u = back.impacts["u"][0]
    assert abs(back.system.force.amplitude - oscillator.amplitude(u)) < 1e-10


def test_a_doubling_before_the_grazing():
    it = orbit_data.references()["osc_graze_w0.9"]
    oscillator = OSCILLATORS[0]
    t, amplitude = oscillator.orbit(0.8)
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(t, 0.8)], 1)
    # one step from far above both: the doubling lies between two points
    branch = zivi.continue_orbit(orbit, "amplitude", (0.1, 1.5), step=0.1)
    (doubling,) = branch.of_kind("period_doubling")
    assert abs(doubling.value / float(it["F_pd"]) - 1) < 1e-9
    limit = float(it["multiplier_times_u_limit"])
    for u, near in ((1e-2, 2e-2), (1e-3, 2e-3)):
        t, amplitude = oscillator.orbit(u)
        close = zivi.periodic_orbit(oscillator.system(amplitude), [(t, u)], 1)
        lam = np.real(close.multipliers[np.argmax(np.abs(close.multipliers))])
        assert abs(lam * u / limit - 1) < near


def test_the_resting_orbit_ends_where_its_exponent_says():
    it = orbit_data.references()["C1_critical_chatter_e0.5"]
    assert abs(chatter_exponent(0.5) - float(it["beta"])) < 1e-12
    orbit = zivi.periodic_orbit(table(1.3), (0.0, (0.5, 0.0)))
    branch = zivi.continue_orbit(orbit, "amplitude", (0.9, 2.0), step=0.1)
    (end,), (begin,) = branch.of_kind("end_of_rest"), branch.of_kind("end_of_liftoff")
    assert abs(end.value / float(it["F_c"]) - 1) < 1e-9
    assert abs(begin.value - 1) < 1e-9  # the table just does not throw the ball
    for value, margin in list(it["margins"].items())[:3]:
        near = zivi.periodic_orbit(table(float(value)), orbit)
        assert abs(near.margin / float(margin) - 1) < 1e-6
    # from its start to the stable orbit beside it, both are there
    beside = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    assert beside.stable
    assert FOLD < 1.3 < end.value


@pytest.mark.parametrize(
    ("e", "start", "critical"),
    [(0.5, 1.3, None), (0.3, 1.5, CRITICAL_03)],
    ids=["e=0.5", "e=0.3"],
)
def test_the_end_of_rest_takes_few_flights(e, start, critical):
    exact = critical or float(orbit_data.references()["C1_critical_chatter_e0.5"]["F_c"])
    orbit = zivi.periodic_orbit(table(start, e), (0.0, (0.5, 0.0)))
    branch = zivi.continue_orbit(orbit, "amplitude", (start, 2.1), step=0.2)
    (end,) = branch.of_kind("end_of_rest")
    assert abs(end.value / exact - 1) < 1e-10
    assert branch.n_flights <= 200


def test_orbits_beyond_the_end_of_rest_gain_impacts_at_the_universal_rate():
    # their grazings come closer by mu, the repelling multiplier of critical chatter
    it = orbit_data.references()["C1_critical_chatter_e0.5"]
    critical, mu = float(it["F_c"]), float(it["mu"])
    rests = zivi.periodic_orbit(table(1.5), (0.0, (0.5, 0.0)))
    branch = zivi.continue_orbit(rests, "amplitude", (1.5, 1.7), step=0.4)
    orbit = branch.switch(branch.of_kind("end_of_rest")[0])
    distances = []
    for k in range(8, 12):
        assert (orbit.kind, len(orbit.impacts), orbit.status) == ("impacting", k, DONE)
        branch = zivi.continue_orbit(orbit, "amplitude", (1.5, 1.7))
        (more,) = branch.of_kind("interior_impact")
        distances.append(more.value - critical)
        # the end of rest is seen from here too
        (appears,) = branch.of_kind("rest_appears")
        assert abs(appears.value / critical - 1) < 1e-10
        orbit = branch.switch(more)
    assert branch.switch(appears).kind == "resting"
    a, b, c = (distances[i] / distances[i + 1] for i in range(3))
    assert a > b > c > mu
    assert abs(c - (c - b) ** 2 / ((c - b) - (b - a)) - mu) < 0.03  # their limit, by Aitken


def test_determinant_and_trace_of_the_return_map():
    # det e^2, trace 1 + e^2 - (1 + e)^2 F sin t1
    e, amplitude = 0.5, 1.3
    t, u = single(amplitude)
    orbit = zivi.periodic_orbit(table(amplitude), [(t, u)])
    trace = 1 + e * e - (1 + e) ** 2 * amplitude * math.sin(t)
    m = orbit.monodromy()
    assert abs(np.linalg.det(m) - e * e) < 1e-10
    assert abs(np.trace(m) - trace) < 1e-10
    assert abs(np.sum(orbit.multipliers) - trace) < 1e-10
    # the saltation matrix without the pull before the impact: the determinant does not see it
    v, pull = -u / e, -1 + amplitude * math.sin(t)
    flow = np.array([[1.0, 2 * math.pi], [0.0, 1.0]])
    for part, right in ((1.0, True), (0.0, False)):
        salt = np.array([[-e, 0.0], [(pull + part * e * pull) / v, -e]])
        product = salt @ flow
        assert abs(np.linalg.det(product) - e * e) < 1e-12
        off = abs(float(np.trace(product)) - trace)
        assert off < 1e-9 if right else off > 0.1


@pytest.mark.parametrize("multiple", [None, 2])
def test_from_a_run_a_state_and_an_orbit(multiple):
    e, amplitude = 0.5, 1.6
    run = zivi.simulate(table(amplitude, e), (0, 800), (0.1, 2.0))
    orbit = zivi.periodic_orbit(table(amplitude), run, multiple)
    it = orbit_data.references()["P2_ball_G1.6"]
    np.testing.assert_allclose(orbit.impacts["u"], [float(it["y"][1]), float(it["y"][3])])
    assert (orbit.multiple, orbit.status) == (2, DONE)
    moved = zivi.periodic_orbit(table(1.61), orbit)
    assert (moved.multiple, moved.status) == (2, DONE)
    state = zivi.periodic_orbit(table(1.3), (0.5, (0.05, 2.0)))
    np.testing.assert_allclose(state.impacts["u"], single(1.3)[1])
    np.testing.assert_array_equal(state.trajectory.t[0], state.impacts["t"][0])


def test_what_is_no_motion_says_so():
    oscillator = OSCILLATORS[0]
    t, amplitude = oscillator.orbit(-0.05)
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(t, -0.05)], 1)
    assert orbit.status is zivi.OrbitStatus.LEFT_ADMISSIBLE
    assert not orbit.admissible
    assert "would leave the wall at -0.05" in orbit.message
    far = zivi.periodic_orbit(table(0.9), [single(1.3)])  # below the fold there is none
    assert far.status is zivi.OrbitStatus.NOT_CONVERGED
    assert "residual" in far.message
    still = zivi.periodic_orbit(table(0.5), (0.0, (0.2, 0.0)))
    assert still.status is zivi.OrbitStatus.RESTS


def test_a_mass_that_never_lifts_off_is_an_orbit_too():
    still = zivi.periodic_orbit(table(0.5), (0.0, (0.2, 0.0)))
    assert (still.kind, still.residual, still.stable) == ("resting", 0.0, True)
    np.testing.assert_array_equal(still.trajectory.x, 0.0)
    np.testing.assert_array_equal(still.monodromy(), np.zeros((2, 2)))
    assert still.derivative("amplitude").size == 0
    with pytest.raises(ValueError, match="never lifts off"):
        zivi.continue_orbit(still, "amplitude", (0.4, 0.6))


def test_bad_input():
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    with pytest.raises(ValueError, match="period"):
        zivi.periodic_orbit(ball, [(0.6, 2.1)])
    with pytest.raises(ValueError, match="multiple must be >= 1"):
        zivi.periodic_orbit(table(1.3), [(0.6, 2.1)], 0)
    with pytest.raises(ValueError, match=r"rows \(t, u\)"):
        zivi.periodic_orbit(table(1.3), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="span must contain amplitude"):
        zivi.continue_orbit(orbit, "amplitude", (2.0, 3.0))
    with pytest.raises(ValueError, match="unknown parameter 'mass'"):
        zivi.continue_orbit(orbit, "mass", (2.0, 3.0))
    with pytest.raises(TypeError, match="PeriodicOrbit"):
        zivi.continue_orbit(ball, "amplitude", (2.0, 3.0))


def test_as_datasets():
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    assert orbit.to_xarray().u.shape == (1,)
    data = zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4)).to_xarray()
    assert data.multiplier_real.shape == (data.sizes["point"], 2)
    assert bool(data.stable.any())


def test_a_pair_passes_the_unit_circle_where_loss_and_gain_are_equal():
    # det M = e^2 exp(-c T), whatever the orbit
    force = zivi.LinearForce(stiffness=1.0, damping=0.05, gravity=0.1, amplitude=1.0, omega=2.6)
    system = zivi.ImpactSystem(force, e=0.8)
    orbit = zivi.periodic_orbit(system, zivi.simulate(system, (0, 400), (0.1, 0.0)))
    branch = zivi.continue_orbit(orbit, "damping", (-0.4, 0.1))
    (event,) = branch.of_kind("neimark_sacker")
    assert abs(event.value - 2 * math.log(0.8) * 2.6 / (2 * math.pi)) < 1e-9
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(event.orbit.monodromy())), 1, atol=1e-8)
    # without loss and gain it lies there all along
    elastic = zivi.LinearForce(stiffness=1.0, gravity=0.1, amplitude=0.2, omega=2.6)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(elastic, e=1.0), [(0.7, 0.9)])
    assert orbit.status is DONE
    assert not zivi.continue_orbit(orbit, "amplitude", (0.1, 0.4)).of_kind("neimark_sacker")


@pytest.mark.parametrize("name", ["w", "T"])
def test_the_period_goes_with_a_frequency_among_the_parameters(name):
    forces = {
        "w": lambda t, x, v, w: -1 + 1.3 * math.sin(w * t),
        "T": lambda t, x, v, T: -1 + 1.3 * math.sin(2 * math.pi * t / T),
    }
    value = {"w": 1.0, "T": 2 * math.pi}[name]
    own = zivi.ImpactSystem(zivi.ParametricForce(forces[name], {name: value}), e=0.5)
    orbit = zivi.periodic_orbit(own, [single(1.3)], period=2 * math.pi)
    branch = zivi.continue_orbit(orbit, name, (0.97 * value, 1.03 * value), step=0.2)
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert len(branch) > 2
    for it, at in zip(branch.orbits, branch.values, strict=True):
        w = at if name == "w" else 2 * math.pi / at
        t, u = single(1.3)
        # times go like 1/w, and so do the speeds of this table
        assert it.period == pytest.approx(2 * math.pi / w, rel=1e-12)
        np.testing.assert_allclose(list(it.impacts[0])[:2], [t / w, u / w], rtol=1e-8)
    np.testing.assert_allclose(
        orbit.derivative(name),
        np.array(single(1.3)) * (-1 if name == "w" else 1 / value),
        rtol=1e-8,
    )


def test_a_branch_over_the_restitution_ends_where_it_is_elastic():
    orbit = zivi.periodic_orbit(table(1.3), [single(1.3)])
    branch = zivi.continue_orbit(orbit, "e", (0.45, 1.4))
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert branch.values.max() == 1.0
    assert max(it.system.e for it in branch.orbits) == 1.0


def test_a_flight_is_followed_with_steps_of_its_motion():
    # it hardly moves where it is looked at, at t = 0
    force = zivi.LinearForce(stiffness=1.0, damping=0.15, gravity=-0.8, amplitude=0.95, omega=1.82)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.7), (0.0, (0.4, 0.1)), 1)
    branch = zivi.continue_orbit(orbit, "omega", (1.46, 2.2))
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert len(branch) < 60
    exact = 0.8 - 0.95 / np.hypot(1 - branch.values**2, 0.15 * branch.values)
    for it, lowest in zip(branch.orbits, exact, strict=True):
        assert it.admissible == (lowest > 0.0)
        times = np.linspace(*it.trajectory.t[[0, -1]], 500)
        assert not it.admissible or min(it.trajectory(times)[0]) == pytest.approx(lowest, abs=1e-4)
