"""Periodic orbits with dry friction in joints against closed forms, mpmath and SciPy."""

import functools
import math
import pickle

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from inside import evaluate, friction_flow_of

L, LS, V, DAMPING = 0.8, 1.2, 0.2, 0.05


def belt(damping=0.0, limit=L, static=LS, velocity=V):
    joint = zivi.DryFriction(limit=limit, static=static, velocity=velocity, name="belt")
    return zivi.LinearSystem(1.0, damping, 1.0, friction=[joint], coordinates=["x"])


def oscillator(load, omega, limit=1.0):
    joint = zivi.DryFriction(limit=limit, name="guide")
    load = zivi.Harmonic([load], omega)
    return zivi.LinearSystem(1.0, None, 1.0, excitation=load, friction=[joint])


def cycle(system, span=80.0):
    run = zivi.simulate(system, (0, span), ([0.0], [V]))
    return zivi.periodic_orbit(system, run, period="free")


def forced(load, omega, limit=1.0):
    system = oscillator(load, omega, limit)
    run = zivi.simulate(system, (0, 120 * math.pi / omega), ([0.0], [0.0]))
    return zivi.periodic_orbit(system, run)


def slip(v, damping, t):
    """Give position from its equilibrium and speed in a slip from the static limit, and rates."""
    a, w = LS - L - damping * v, mp.sqrt(1 - damping**2 / 4)
    b = (v + damping * a / 2) / w
    decay, c, s = mp.exp(-damping * t / 2), mp.cos(w * t), mp.sin(w * t)
    y = decay * (a * c + b * s)
    speed = decay * ((b * w - damping * a / 2) * c - (a * w + damping * b / 2) * s)
    return y, speed, -damping * speed - y


def damped_cycle(v, damping, guess):
    """Give the duration of slip and the period."""
    with mp.workdps(30):
        end = mp.findroot(lambda t: slip(v, damping, t)[1] - v, guess)
        start, left = LS - L - damping * v, slip(v, damping, end)[0]
        return float(end), float(end + (start - left) / v)


def test_the_cycle_on_a_belt_has_the_period_of_its_closed_form():
    orbit, a = cycle(belt()), LS - L
    exact = 2 * a / V + 2 * math.pi - 2 * math.atan2(a, V)
    assert orbit.success
    assert orbit.kind == "sticking"
    assert sorted(orbit.word) == ["B belt", "K belt"]
    assert abs(orbit.period - exact) < 1e-11
    assert orbit.multipliers.tolist() == [0.0]
    (stick,) = orbit.contacts
    assert abs(stick["t1"] - stick["t0"] - 2 * a / V) < 1e-11
    by_speed = -2 * a / V**2 + 2 * a / (a * a + V * V)
    assert abs(orbit.derivative("belt.velocity")[-1] - by_speed) < 1e-8


def test_the_damped_cycle_ends_where_its_slip_only_touches_the_speed_of_the_belt():
    orbit = cycle(belt(DAMPING))
    branch = zivi.continue_orbit(orbit, "belt.velocity", (0.05, 2.0), step=0.05)
    assert [it.kind for it in branch.events] == ["slip_grazing"]
    assert "slip grazes" in [it.get_label() for it in zivi.plot.branch(branch).get_lines()]
    assert branch.status.name == "LEFT_ADMISSIBLE"
    assert np.all(branch.multipliers == 0.0)
    with mp.workdps(30):

        def touches(v, t):
            _, speed, rate = slip(v, DAMPING, t)
            return speed - v, rate

        end = mp.findroot(touches, (0.66, 5.0))
    assert abs(branch.events[0].value - float(end[0])) < 1e-10
    assert branch.events[0].gap == "belt"
    for value, found in list(zip(branch.values, branch.orbits, strict=True))[::8]:
        slips = found.segments["t1"] - found.segments["t0"]
        guess = float(slips[~found.segments["contacts"][:, 0]][0])
        if value < 0.66:  # at its end the root is double
            length, period = damped_cycle(value, DAMPING, guess)
            assert abs(guess - length) < 1e-10
            assert abs(found.period - period) < 1e-10


@pytest.mark.parametrize(("load", "omega"), [(2.5, 0.6), (2.0, 1.5), (4.0, 0.8)])
def test_slips_that_only_turn_are_those_of_den_hartog(load, omega):
    orbit = forced(load, omega)
    ratio, wide = 1 / (1 - omega**2), math.tan(math.pi / (2 * omega)) / omega
    amplitude = math.sqrt((ratio * load) ** 2 - wide**2)
    assert orbit.word == ("T guide", "T guide")
    assert orbit.kind == "slipping"
    assert np.abs(np.abs(orbit._starts[:, 1]) - amplitude).max() < 1e-11
    half = math.pi / omega
    c, s = math.cos(half), math.sin(half)
    turned = (amplitude * omega**2 - 1) / (amplitude * omega**2 + 1)
    own = np.linalg.eigvals(np.diag([1.0, turned]) @ [[c, s], [-s, c]]) ** 2
    for it in orbit.multipliers:
        assert np.abs(own - it).min() < 1e-10


def test_sticks_vanish_where_the_force_at_the_turn_is_that_of_friction():
    omega = 0.6
    orbit = forced(1.7, omega)
    assert orbit.word == ("K guide", "B guide") * 2
    assert abs(orbit.multipliers[1]) == 0.0 < abs(orbit.multipliers[0])
    branch = zivi.continue_orbit(orbit, "F", (1.6, 2.2), step=0.1)
    ratio, wide = 1 / (1 - omega**2), math.tan(math.pi / (2 * omega)) / omega
    exact = math.sqrt(omega**-4 + wide**2) / ratio
    (event,) = branch.events
    assert event.kind == "stick_vanishes"
    assert abs(event.value - exact) < 1e-10
    assert [arc.word[0] for arc in branch.arcs] == ["K guide", "T guide"]
    back = zivi.continue_orbit(branch.arcs[1].orbits[-1], "F", (1.6, 2.2), step=0.1)
    (event,) = back.events
    assert event.kind == "turn_sticks"
    assert abs(event.value - exact) < 1e-10
    assert len(back.arcs) == 2
    assert all(it.admissible for it in back.orbits)


def test_two_stops_a_period_against_mpmath():
    omega, load = 0.6, 1.7
    orbit = forced(load, omega)
    stuck = orbit.segments["contacts"][:, 0]
    k = next(k for k in np.flatnonzero(~stuck) if orbit._starts[k, 1] < 0.0)
    begin, end = orbit.segments["t0"][k], orbit.segments["t1"][k]
    with mp.workdps(30):
        w, p = mp.mpf("0.6"), mp.mpf("1.7")
        gain = p / (1 - w**2)

        def equations(a, t0, t1):
            """Give the break from -a, and the end of the slip at a."""
            c = -a - gain * mp.cos(w * t0) + 1
            s = gain * w * mp.sin(w * t0)
            d = t1 - t0
            x = c * mp.cos(d) + s * mp.sin(d) + gain * mp.cos(w * t1) - 1
            v = -c * mp.sin(d) + s * mp.cos(d) - gain * w * mp.sin(w * t1)
            return p * mp.cos(w * t0) + a - 1, x - a, v

        exact = mp.findroot(equations, (-orbit._starts[k, 1], begin, end))
    found = np.array([-orbit._starts[k, 1], begin, end])
    assert np.abs(found - np.array([float(it) for it in exact])).max() < 1e-10


def test_the_jacobian_is_that_of_differences():
    for orbit in (cycle(belt(DAMPING)), forced(1.7, 0.6), forced(2.5, 0.6)):
        frame, y = orbit._frame, orbit._y
        whole = evaluate(frame, y).matrix()
        for k, step in enumerate(1e-6 * np.eye(len(y))):
            ends = [evaluate(frame, y + it).residual for it in (step, -step)]
            assert np.abs(whole[:, k] - (ends[0] - ends[1]) / 2e-6).max() < 1e-8


def pull(linear, t, q, qdot):
    return -linear.K @ q - linear.C @ qdot


@pytest.mark.parametrize("contacts", [(), (-1,), (0,), (-2, 0), (0, 1)])
def test_the_flows_of_linear_and_general_systems_agree(contacts):
    joints = [
        zivi.DryFriction([1.0, 0.0], limit=0.5, static=0.8, velocity=0.3, name="a"),
        zivi.DryFriction([-1.0, 1.0], limit=0.3, static=0.35, velocity=0.1, name="b"),
    ]
    linear = zivi.LinearSystem(
        [[1.0, 0.2], [0.2, 2.0]], [[0.1, 0], [0, 0.2]], [[2, -1], [-1, 3]], friction=joints
    )
    general = zivi.MechanicalSystem(
        mass=linear.M, force=functools.partial(pull, linear), friction=joints
    )
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)
    one, two = (friction_flow_of(it, method) for it in (linear, general))
    two = pickle.loads(pickle.dumps(two))
    z, t = np.random.default_rng(1).normal(size=(1, 4)), np.array([0.1])
    for t1 in (0.8, -0.3):  # a stick of negative duration is flown backwards
        a, b = (it.fly(contacts, t, z, np.array([t1])) for it in (one, two))
        assert np.abs(a.z - b.z).max() < 1e-10
        assert np.abs(a.phi - b.phi).max() < 1e-9
        assert np.abs(a.first - b.first).max() < 1e-12
        assert np.abs(a.last - b.last).max() < 1e-10
    for a, b in zip(one.gaps(t, z, contacts), two.gaps(t, z, contacts), strict=True):
        assert np.abs(a - b).max() < 1e-12
    for i in (it for it in contacts if it >= 0):
        a, b = (it.reaction(contacts, i, 0.1, z[0]) for it in (one, two))
        assert abs(a.value - b.value) < 1e-12
        assert np.abs(a.by_z - b.by_z).max() < 1e-9
        a, b = (it.gap(i, 0.1, z[0]) for it in (one, two))
        assert abs(a.value - b.value) < 1e-12
        assert np.abs(a.by_z - b.by_z).max() < 1e-11


def test_a_limit_that_falls_with_the_slip_speed_against_scipy():
    def limit(t, q, qdot):
        return 0.6 + 0.4 / (1.0 + 2.0 * abs(qdot[0] - V))

    joint = zivi.DryFriction(limit=limit, velocity=V, name="belt")
    system = zivi.MechanicalSystem(
        mass=1.0, force=lambda t, q, qdot: -q - 0.02 * qdot, friction=[joint]
    )
    run = zivi.simulate(system, (0, 40), ([0.0], [V]))
    orbit = zivi.periodic_orbit(system, run, period="free")
    assert orbit.success
    assert orbit.multipliers.tolist() == [0.0]

    def rates(t, z):
        return [z[1], -z[0] - 0.02 * z[1] + limit(t, [z[0]], [min(z[1], V)])]

    def sticks(t, z):
        return z[1] - V if t > 1.0 else -1.0

    sticks.terminal = True
    start = 1.0 - 0.02 * V
    tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    found = solve_ivp(rates, (0, 20), [start, V], events=sticks, **tight)
    left = found.y_events[0][0][0]
    assert abs(orbit.period - (found.t[-1] + (start - left) / V)) < 1e-9


def test_what_orbits_with_friction_do_not_take_is_named():
    orbit = forced(2.5, 0.6)
    with pytest.raises(ValueError, match="symmetry must be None for a system with dry friction"):
        zivi.periodic_orbit(orbit.system, orbit.trajectory, symmetry=lambda z: -z)
    with pytest.raises(ValueError, match="start must be a run, a state or an orbit"):
        zivi.periodic_orbit(orbit.system, (["P"], [0.0]))
    floor = zivi.LinearGap([0.0, 1.0], tangent=[1.0, 0.0], mu=0.3)
    box = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], gaps=[floor], e=0.5)
    with pytest.raises(NotImplementedError, match="systems with gaps do not support dry friction"):
        zivi.periodic_orbit(box, (0.0, ([0, 1], [0, 0])), period=1.0)


def test_a_linear_system_with_friction_moves_as_the_general_one():
    linear = belt(DAMPING)
    general = zivi.MechanicalSystem(
        mass=1.0, force=lambda t, q, qdot: -q - DAMPING * qdot, friction=linear.friction
    )
    runs = [zivi.simulate(it, (0, 20), ([0.0], [V])) for it in (linear, general)]
    assert np.array_equal(runs[0].q[-1], runs[1].q[-1])
    assert len(runs[0].stick) == 3
    again = pickle.loads(pickle.dumps(linear.replace(K=2.0)))
    assert again.channel_names == ("belt",)
    assert again.K == 2.0
    assert "friction=(belt)" in repr(again)
    assert linear.replace(friction=[]).channel_names == ()


def test_joints_of_a_linear_system_are_given_at_its_points():
    K = [[3.0, -1.0], [-1.0, 2.0]]
    joint = zivi.DryFriction([1.0, 0.0], limit=0.2, name="a")
    whole = zivi.LinearSystem(np.eye(2), None, K, friction=[joint])
    modal = zivi.LinearSystem(np.eye(2), None, K, friction=[joint], modes=2)
    end = zivi.simulate(whole, (0, 5), ([1.0, 0.0], [0.0, 0.0])).q[-1]
    start = np.linalg.solve(modal.shapes, [1.0, 0.0])
    found = zivi.simulate(modal, (0, 5), (start, [0.0, 0.0])).q[-1]
    assert np.abs(modal.shapes @ found - end).max() < 1e-6
    turning = zivi.DryFriction(lambda t, q: [1.0, q[0]], limit=0.2, name="b")
    with pytest.raises(ValueError, match="direction of 'b' must be an array"):
        zivi.LinearSystem(np.eye(2), None, K, friction=[turning], modes=1)
