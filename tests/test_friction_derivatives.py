"""Derivatives through dry friction: closed forms of belts, differences of random runs."""

import itertools

import mpmath as mp
import numpy as np
import pytest
import scipy.integrate

import friction_derivatives
import zivi
from interrupting import in_own_process

EXACT = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)

# of a mass on a belt, k = 1, v = 0.2, limits 0.8 in slip and 1.2 in stick, that sticks at x = 0
# first, after 30 s: differences of an integration with 48 digits
RELAXATION = {
    "k": (3.38066636147742, 0.0, [-6.0, -7.63444393579571, -11.6344439357957]),
    "c": (2.92133272295484, 0.0, [-1.0, 0.217221967897852, -5.86888787159141]),
    "belt.velocity": (15.3933363852258, 1.0, [-30.0, -26.0, -46.0]),
    "belt.limit": (4.8, 0.0, [0.0, 2.0, -8.0]),
    "belt.static": (-4.8, 0.0, [5.0, 3.0, 13.0]),
    "q0.x": (1.0, 0.0, [-5.0, -5.0, -5.0]),
}


def relaxation(k, c):
    belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
    return zivi.MechanicalSystem(
        mass=1.0, force=lambda t, q, v: -k * q - c * v, friction=[belt], coordinates=["x"]
    )


def test_the_relaxation_belt_has_the_derivatives_of_its_reference():
    system = zivi.ParametricSystem(relaxation, {"k": 1.0, "c": 0.0})
    s = zivi.sensitivity(system, (0, 30), ([0.0], [0.2]), wrt=tuple(RELAXATION), method=EXACT)
    assert s.success
    assert len(s.transition_times) == len(s.trajectory.transitions)
    for j, (x, v, times) in enumerate(RELAXATION.values()):
        np.testing.assert_allclose(s.final[0, 0, j], x, rtol=1e-10)
        # it sticks: the row is written
        assert s.final[1, 0, j] == v
        np.testing.assert_allclose(s.transition_times[1:4, j], times, rtol=1e-10, atol=1e-11)


def test_sticking_forgets_the_speed():
    """A multiplier is exactly zero: whatever the start was, it moves with the belt."""
    s = zivi.sensitivity(relaxation(1.0, 0.0), (0, 9), ([1.7], [-0.5]), method=EXACT)
    assert s.trajectory.transitions["after"].tolist()[-1] == 0
    assert np.all(s.monodromy[1] == 0.0)
    assert np.all(s.monodromy[0] != 0.0)


STRIBECK = {"k": 1.0, "belt.velocity": 0.2, "limit": 0.9, "fall": 1.5, "q0.x": 0.3}


def stribeck_end(k, v, limit, fall, x0):
    """The place after 12 s of a mass that sticks, slips back once and sticks again."""
    most = 1.0

    def rates(_, y):
        return [y[1], -k * y[0] + limit / (1 + fall * abs(y[1] - v))]

    def stops(_, y):
        return y[1] - v

    stops.terminal, stops.direction = True, 1.0
    slip = scipy.integrate.solve_ivp(
        rates, (0, 9), [most / k, v], "DOP853", events=stops, rtol=3e-14, atol=1e-15
    )
    return slip.y[0, -1] + v * (12.0 - (most / k - x0) / v - slip.t[-1])


def test_a_belt_whose_friction_falls_with_the_speed_has_its_derivatives():
    def build(k, limit, fall):
        def held(t, q, v):
            return limit / (1 + fall * abs(v[0] - 0.2))

        belt = zivi.DryFriction(limit=held, static=1.0, velocity=0.2, name="belt")
        return zivi.MechanicalSystem(
            mass=1.0, force=lambda t, q, v: -k * q, friction=[belt], coordinates=["x"]
        )

    system = zivi.ParametricSystem(build, {name: STRIBECK[name] for name in ("k", "limit", "fall")})
    wrt = ("k", "limit", "fall", "q0.x", "belt.static")
    s = zivi.sensitivity(system, (0, 12), ([0.3], [0.2]), wrt=wrt, method=EXACT)
    assert s.trajectory.transitions["after"].tolist() == [0, -1, 0]
    base = np.array(list(STRIBECK.values()))
    for j, name in enumerate(wrt[:-1]):
        place, found = list(STRIBECK).index(name), []
        for h in (4e-3, 2e-3, 1e-3):
            way = np.eye(len(base))[place] * h
            found.append((stribeck_end(*(base + way)) - stribeck_end(*(base - way))) / (2 * h))
        first = [(4 * b - a) / 3 for a, b in itertools.pairwise(found)]
        known = (16 * first[1] - first[0]) / 15
        np.testing.assert_allclose(s.final[0, 0, j], known, rtol=1e-9, err_msg=name)
    assert np.all(s.final[1] == 0.0)


def stop_end(k, v, limit, e, place, x0):
    """A mass that a belt carries to a stop, which throws it back again and again: it slips then."""
    omega, middle = mp.sqrt(k), limit / k
    t, u = (place - x0) / v, v
    while True:
        u = -e * u
        size = mp.hypot(place - middle, u / omega)
        half = mp.acos((place - middle) / size)
        if t + (2 * mp.pi - 2 * half) / omega > 12:
            angle = omega * (12 - t) + half
            return middle + size * mp.cos(angle), -size * omega * mp.sin(angle)
        t, u = t + (2 * mp.pi - 2 * half) / omega, -u


def test_a_belt_with_a_stop_has_the_derivatives_of_its_closed_form():
    values = {"k": 1.0, "belt.velocity": 0.5, "belt.limit": 0.8, "e": 0.6}
    values |= {"place": 1.0, "q0.x": 0.1}

    def build(k, place):
        belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.5, name="belt")
        return zivi.MechanicalSystem(
            mass=1.0,
            force=lambda t, q, v: -k * q,
            gaps=[zivi.LinearGap([-1.0], offset=place, name="stop")],
            e=0.6,
            friction=[belt],
            coordinates=["x"],
        )

    system = zivi.ParametricSystem(build, {"k": 1.0, "place": 1.0})
    wrt = (*values, "belt.static")
    s = zivi.sensitivity(system, (0, 12), ([0.1], [0.5]), wrt=wrt, method=EXACT)
    assert s.success
    assert len(s.trajectory.impacts) == 3
    with mp.workdps(40):
        base, h = [mp.mpf(repr(it)) for it in values.values()], mp.mpf("1e-13")
        np.testing.assert_allclose(s.trajectory.q[-1, 0], float(stop_end(*base)[0]), atol=1e-10)
        for j in range(len(base)):
            ends = []
            for side in (1, -1):
                moved = list(base)
                moved[j] += side * h
                ends.append(stop_end(*moved))
            known = [float((one - other) / (2 * h)) for one, other in zip(*ends, strict=True)]
            np.testing.assert_allclose(s.final[:, 0, j], known, rtol=1e-9, err_msg=s.wrt[j])
    assert np.all(s.final[:, 0, -1] == 0.0)


def test_random_runs_have_the_derivatives_of_their_differences():
    """Belts, guides, discs, boxes, stacks in skewed coordinates; the module has a campaign."""
    kinds = ("friction", "corners", "feeder", "disc", "belt2", "beltstop", "servo", "stack")
    found, worst = friction_derivatives.campaign(16, 9, kinds)
    assert found["compared"] >= 10
    assert worst < 1e-8


def test_a_coefficient_that_falls_with_the_speed_has_its_own_derivatives_in_impacts():
    """They were extrapolated from faster slips, to 4e-5: a feeder whose impacts slide."""
    outcome, error, _ = friction_derivatives.verdict("feeder", np.random.default_rng([5, 15]))
    assert outcome == "compared"
    assert error < 1e-8


PUSHES, ENDS = [3.0, 0.5, 0.2, -0.5], np.arange(5.0)


def block():
    joint = zivi.DryFriction(limit=1.0, name="floor")

    def build(u):
        return zivi.MechanicalSystem(mass=1.0, force=[u], friction=[joint])

    return zivi.ParametricSystem(build, {"u": 0.0})


def test_controls_through_friction_have_the_derivatives_of_the_parabolas():
    f = zivi.interop.controlled_function(block(), ENDS, ([0.0], [0.0]), "u", method=EXACT)
    value, derivative = f(PUSHES)
    speed, brake = 0.7, 1.5  # before the last interval, and in it until the block sticks
    np.testing.assert_allclose(np.ravel(value), [3.85 + speed**2 / (2 * brake), 0.0], atol=1e-12)
    by_speed = speed / brake
    exact = [2.5 + by_speed, 1.5 + by_speed, 0.5 + by_speed, speed**2 / (2 * brake**2)]
    np.testing.assert_allclose(derivative[0].ravel(), exact, rtol=1e-11)
    assert np.all(derivative[1] == 0.0)


def in_jax():
    """Check derivatives through friction in JAX, which is to be alone in its process."""
    import jax

    start, names = ([0.0], [2.0]), ("floor.limit", "qdot0.q0")
    with jax.enable_x64(True):
        f = zivi.interop.jax_function(
            zivi.interop.run_function(block(), (0, 5), start, names, method=EXACT)
        )
        found = np.asarray(jax.jacobian(f)(jax.numpy.array([1.0, 2.0])))
        # it stops after v^2/(2 L)
        np.testing.assert_allclose(found[:, 0], [[-2.0, 2.0], [0.0, 0.0]], atol=1e-11)


@pytest.mark.slow
def test_jax_differentiates_through_friction():
    in_own_process("jax", "import test_friction_derivatives; test_friction_derivatives.in_jax()")


def test_what_derivatives_do_not_support_is_said():
    floor = zivi.LinearGap([0, 1], tangent=[1, 0], mu=0.3, name="floor")
    parts = {"mass": np.eye(2), "force": [0.0, -9.81], "gaps": [floor]}
    start = ([0.0, 1.0], [0.0, 0.0])
    with pytest.raises(NotImplementedError, match="need impact_law='newton', got 'poisson'"):
        zivi.sensitivity(zivi.MechanicalSystem(**parts, impact_law="poisson"), (0, 1), start)
    system = zivi.MechanicalSystem(**parts)
    with pytest.raises(ValueError, match=r"unknown parameter 'floor.mu_s'.*did you mean 'floor.mu"):
        zivi.sensitivity(system, (0, 1), start, wrt="floor.mu_s")
    cone = zivi.LinearGap([0, 0, 1], tangent=[[1, 0, 0], [0, 1, 0]], mu=0.3, name="plane")
    space = zivi.MechanicalSystem(mass=np.eye(3), force=[0, 0, -9.81], gaps=[cone])
    with pytest.raises(NotImplementedError, match="'plane', which has two tangents"):
        zivi.sensitivity(space, (0, 1), ([0, 0, 1], [0, 0, 0]))
    block = zivi.ImpactSystem(-9.81, e=0.5, friction=zivi.DryFriction(limit=1.0))
    with pytest.raises(NotImplementedError, match=r"use a zivi\.MechanicalSystem"):
        zivi.sensitivity(block, (0, 1), (1, 0))


def test_an_impact_between_stick_and_slip_has_no_derivatives():
    """With ``mu (1 + e) u = w`` the impact just stops the slip."""
    floor = zivi.LinearGap([0, 1], tangent=[1, 0], mu=0.5, name="floor")
    box = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, 0.0], gaps=[floor], e=0.5)
    s = zivi.sensitivity(box, (0, 2), ([0.0, 1.0], [0.75, -1.0]), wrt=("q0", "floor.mu"))
    assert s.status.name == "NOT_DIFFERENTIABLE"
    assert s.lost_at == 1.0
    assert np.isnan(s.final).all()


def test_a_fit_finds_a_coefficient_of_friction_with_exact_derivatives():
    floor = zivi.LinearGap([0, 1, 0], tangent=[1, 0, 0.1], mu=0.25, name="floor")
    ball = zivi.MechanicalSystem(
        mass=np.diag([1, 1, 0.004]),
        force=[0, -9.81, 0],
        gaps=[floor],
        e=0.6,
        coordinates=["x", "y", "r"],
    )
    y0, t = ([0.0, 0.5, 0.0], [12.0, 0.0, 0.0]), np.linspace(0.05, 0.9, 30)
    x = zivi.simulate(ball, (0, 1), y0)(t)[0][:, 0]
    start = ball.replace(
        gaps=[zivi.LinearGap([0, 1, 0], tangent=[1, 0, 0.1], mu=0.2, name="floor")]
    )
    data = zivi.Record(t, x, sigma=1e-3, of="x")
    fit = zivi.fit(start, data, "floor.mu", y0=y0, starts=1, bounds={"floor.mu": (0.05, 0.9)})
    assert abs(fit.values["floor.mu"] - 0.25) < 1e-6
    assert not fit.differenced
