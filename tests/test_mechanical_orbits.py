"""Periodic orbits of mechanical systems, against references of other formulations."""

import copy
import pickle

import numpy as np
import pytest

import zivi
from inside import PRECISE, Frame, flow_of, of_segments, parsed, recent
from orbit_systems import (
    REFERENCES,
    chain2,
    chain3,
    chain4,
    duffing2,
    listed,
    multipliers,
    numbers,
    rest2,
    sym2,
    vdp2,
)
from zivi import LinearGap


def settled(system, period, periods=150, q0=None):
    n = len(system.M)
    start = np.zeros(n) if q0 is None else q0
    return zivi.simulate(system, (0, periods * period), (start, np.zeros(n)))


def assert_multipliers(found, known, tolerance=1e-8):
    """Each of the known ones is found, and nothing else but zeros."""
    left = list(found)
    for value in known:
        k = int(np.argmin([abs(it - value) for it in left]))
        assert abs(left.pop(k) - value) < tolerance
    assert all(abs(it) < tolerance for it in left)


def phases(times, period):
    return np.sort(np.asarray(times) % period)


@pytest.mark.parametrize(
    ("name", "system"),
    [("three_dof_w1.1", chain3), ("four_dof_w0.95", chain4), ("four_dof_w1.2", chain4)],
)
def test_orbits_of_chains_from_a_run(name, system):
    given = numbers(name)
    period = 2 * np.pi / given["w"]
    made = system(**given)
    orbit = zivi.periodic_orbit(made, settled(made, period))
    assert orbit.success
    assert orbit.admissible
    assert orbit.iterations <= 4
    times = phases(listed(name, "t"), period)
    assert np.max(np.abs(phases(orbit.impacts["t"], period) - times)) < 1e-12
    impulses = np.sort(listed(name, "P"))
    assert np.max(np.abs(np.sort(orbit.impacts["impulse"]) - impulses)) < 1e-12
    assert_multipliers(orbit.multipliers, multipliers(name))
    assert_multipliers(np.linalg.eigvals(orbit.monodromy()), multipliers(name))
    assert sorted(orbit.word) == sorted(f"I {'ab'[k]}" for k in REFERENCES[name]["word"])


def test_a_system_whose_period_is_not_known_asks_for_it():
    drop = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[LinearGap([1])], e=0.5)
    with pytest.raises(ValueError, match=r"give period=\.\.\., or period='free'"):
        zivi.periodic_orbit(drop, [(0.6, 2.1)])


def test_an_unstable_orbit_from_a_word_with_times():
    name = "two_dof_four_impacts"
    near = listed(name, "t") + 0.02 * np.array([1, -1, 1, -1])
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, near))
    assert orbit.success
    assert not orbit.stable
    period = 2 * np.pi / 0.9
    assert orbit.period == pytest.approx(period, abs=1e-15)
    times = phases(listed(name, "t"), period)
    assert np.max(np.abs(phases(orbit.impacts["t"], period) - times)) < 1e-12
    assert_multipliers(orbit.multipliers, multipliers(name))
    # and from the states after the impacts, from the orbit, and from its own simulation
    own = orbit.trajectory
    states = [np.append(t, own(t + 1e-9).ravel()) for t in orbit.impacts["t"][:-1]]
    states.append(np.append(orbit.impacts["t"][-1], own(own.t[0] + 1e-9).ravel()))
    again = zivi.periodic_orbit(chain2(), orbit)
    assert np.max(np.abs(again.impacts["t"] - orbit.impacts["t"])) < 1e-12
    run = zivi.periodic_orbit(chain2(), own)
    assert np.max(np.abs(run.impacts["t"] - orbit.impacts["t"])) < 1e-11


def test_an_orbit_that_rests_has_live_multipliers():
    known = REFERENCES["rest2_A1.25"]
    orbit = zivi.periodic_orbit(rest2(), settled(rest2(), 2 * np.pi, 40, [2.0, 2.0]))
    assert orbit.kind == "resting"
    assert orbit.success
    assert orbit.word == ("L road", "Z road")
    assert abs(orbit.zeno_times[0] - float(known["t_inf"])) < 1e-10
    assert abs(orbit.liftoff_times[0] - float(known["t_liftoff"])) < 1e-10
    assert abs(orbit.impacts["t"][0] - float(known["t_first_impact"])) < 1e-10
    live = [float(it) for it in known["mult"][:2]]
    assert_multipliers(orbit.multipliers, live)
    assert np.count_nonzero(orbit.multipliers) == 2
    assert_multipliers(np.linalg.eigvals(orbit.monodromy()), live)
    begin, end = orbit.contacts[0][["t0", "t1"]]
    assert begin == orbit.zeno_times[0]
    assert end == pytest.approx(orbit.liftoff_times[0] + 2 * np.pi)
    state = orbit.trajectory(float(known["t_liftoff"]))
    assert state[0, 1] == pytest.approx(float(known["y"]), abs=1e-10)
    assert state[1, 1] == pytest.approx(float(known["ydot"]), abs=1e-10)


def test_the_monodromy_at_rest_is_that_of_a_run():
    orbit = zivi.periodic_orbit(rest2(), settled(rest2(), 2 * np.pi, 40, [2.0, 2.0]))
    run = orbit.trajectory
    t, state = float(run.t[0]), (run.q[0], run.qdot[0])
    tight = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
    s = zivi.sensitivity(rest2(), (t, t + 2 * np.pi), state, method=tight)
    # of the inner oscillator; the road gives no choice to the other mass
    inner = [1, 3]
    assert np.max(np.abs((s.monodromy - orbit.monodromy(t))[np.ix_(inner, inner)])) < 1e-9


def test_plastic_impacts_hold():
    known = REFERENCES["stick_e0"]
    system = chain2(w=0.7, e=0.0)
    orbit = zivi.periodic_orbit(system, settled(system, 2 * np.pi / 0.7, 40))
    assert orbit.word == ("S stop", "L stop")
    period = 2 * np.pi / 0.7
    assert abs(orbit.liftoff_times[0] - float(known["t_liftoff"])) < 1e-10
    hit = (float(known["t_impact"]) - orbit.impacts["t"][0]) / period
    assert abs(hit - round(hit)) < 1e-11
    pair = complex(*(float(it) for it in known["mult"][0]))
    assert_multipliers(orbit.multipliers, [pair, pair.conjugate()])


@pytest.mark.slow
def test_an_orbit_of_a_nonlinear_system():
    given = numbers("duffing")
    rows = np.array([[float(it) for it in row] for row in REFERENCES["duffing"]["state_after"]])
    times = listed("duffing", "t")
    guess = np.column_stack([times, rows])[:3] + 1e-3
    period = 2 * np.pi / given["w"]
    orbit = zivi.periodic_orbit(duffing2(**given), (["I stop"] * 3, guess), period=period)
    assert orbit.success
    assert np.max(np.abs(orbit.impacts["t"] - times[:3])) < 1e-10
    assert_multipliers(orbit.multipliers, multipliers("duffing"))
    again = copy.deepcopy(orbit)  # by its state: its force is no name of a module
    np.testing.assert_allclose(again.monodromy(), orbit.monodromy(), rtol=1e-12)


def test_an_orbit_of_a_compiled_system():
    """Its flights are compiled, too: of the system that has no gaps."""
    given = numbers("duffing")
    compiled = zivi.symbolic.system(
        "x y",
        T="xdot**2/2 + 0.8*ydot**2/2",
        V="(0.5 + kc)*x**2/2 - kc*x*y + kc*y**2/2 + a*x**4/4 + 0.2*a*y**4/4",
        Q=["-0.15*xdot + 0.05*ydot + F*cos(w*t)", "0.05*xdot - 0.1*ydot"],
        gaps={"stop": "d - x"},
        parameters={name: given[name] for name in ("kc", "a", "F", "w", "d")},
        e=given["e"],
    )
    rows = np.array([[float(it) for it in row] for row in REFERENCES["duffing"]["state_after"]])
    times = listed("duffing", "t")
    guess = np.column_stack([times, rows])[:3] + 1e-3
    period = 2 * np.pi / given["w"]
    orbit = zivi.periodic_orbit(compiled, (["I stop"] * 3, guess), period=period)
    assert orbit.success
    assert np.max(np.abs(orbit.impacts["t"] - times[:3])) < 1e-12
    assert_multipliers(orbit.multipliers, multipliers("duffing"))
    free = orbit._frame.flow.without_gaps(())
    assert type(free) is type(compiled)
    assert free.m == 0
    state = ([0.1, -0.2], [0.3, 0.4])
    one, other = compiled.at(0.7, *state), free.at(0.7, *state)
    assert np.array_equal(one.mass, other.mass)
    assert np.array_equal(one.force, other.force)
    # the parameters are those of the orbit, along a branch too
    slope = orbit.derivative("F")
    h = 1e-6
    sides = [
        zivi.periodic_orbit(compiled.replace(F=given["F"] + sign * h), orbit, period=period)
        for sign in (1, -1)
    ]
    moved = (sides[0].impacts["t"] - sides[1].impacts["t"]) / (2 * h)
    assert np.max(np.abs(slope - moved)) < 1e-6 * np.max(np.abs(moved))
    branch = zivi.continue_orbit(orbit, "F", (1.18, 1.22), step=0.1)
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert branch.admissible.all()


@pytest.mark.slow
def test_an_orbit_that_nothing_excites():
    known = REFERENCES["autonomous"]
    system = vdp2(**numbers("autonomous"))
    run = zivi.simulate(system, (0, 200), ([0.5, 0.5], [0, 0]))
    orbit = zivi.periodic_orbit(system, run, period="free")
    assert orbit.success
    assert abs(orbit.period - float(known["period"])) < 1e-10
    assert_multipliers(orbit.multipliers, multipliers("autonomous"))
    assert len(orbit.multipliers) == 3
    with_shift = np.append(multipliers("autonomous"), 1.0)
    assert_multipliers(np.linalg.eigvals(orbit.monodromy()), with_shift, 1e-7)


def test_half_of_a_symmetric_orbit_is_solved_for():
    given = numbers("pitchfork_F") | {"F": 3.0}
    system = sym2(**given)
    period = 2 * np.pi / given["w"]
    run = zivi.simulate(system, (0, 150 * period), ([0, 0], [0, 0.1]))
    half = zivi.periodic_orbit(system, run, symmetry=-np.eye(2))
    whole = zivi.periodic_orbit(system, run)
    assert half.success
    assert half.symmetric
    assert not whole.symmetric
    assert len(half.impacts) == len(whole.impacts) == 2
    times = [phases(it.impacts["t"], period) for it in (half, whole)]
    assert np.max(np.abs(times[0] - times[1])) < 1e-12
    assert_multipliers(half.multipliers, whole.multipliers, 1e-10)
    # half of another period, where another frequency excites
    faster = sym2(**given | {"w": 1.01 * given["w"]})
    again = [zivi.periodic_orbit(faster, it) for it in (half, whole)]
    assert again[0].symmetric
    assert again[0].period == pytest.approx(period / 1.01, rel=1e-14)
    times = [phases(it.impacts["t"], period / 1.01) for it in again]
    assert np.max(np.abs(times[0] - times[1])) < 1e-12
    late = 0.75 * period + half.impacts["t"][0]
    assert np.max(np.abs(half.monodromy(late) - whole.monodromy(late))) < 1e-10
    with pytest.raises(ValueError, match="is not a gap"):
        zivi.periodic_orbit(system, run, symmetry=[[0, 1], [1, 0]])


@pytest.mark.slow
def test_jacobians_are_differences():
    rng = np.random.default_rng(5)
    resting = zivi.periodic_orbit(rest2(), settled(rest2(), 2 * np.pi, 40, [2.0, 2.0]))
    two_gaps = sym2(k=1, ka=0.5, d=0.8, e=0.7, w=2.2, F=3)
    word = parsed(["I right", "I left"], two_gaps.gap_names)
    method = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
    frame = Frame(two_gaps, flow_of(two_gaps, method), word, method, 2 * np.pi / 2.2)
    x = rng.normal(size=(2, 6))
    x[:, 0], x[:, -1] = [0, 1.5], [1.4, 2.8]
    for own, y, h in ((frame, x.ravel(), 1e-5), (resting._frame, resting._y, 3e-5)):
        at = of_segments(own, y, y.reshape(-1, 6), own.length)

        def residual(y, own=own):
            return of_segments(own, y, y.reshape(-1, 6), own.length, slopes=False).residual

        columns = [
            (residual(y + h * row) - residual(y - h * row)) / (2 * h) for row in np.eye(len(y))
        ]
        off = np.abs(np.array(columns).T - at.matrix())
        assert np.max(off) < (1e-5 if own is resting._frame else 1e-8)


def test_derivatives_by_parameters_are_those_of_other_orbits():
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    h = 1e-6
    for name, make in (("F", "F"), ("omega", "w"), ("e", "e"), ("stop.offset", "d")):
        value = {"F": 1.0, "omega": 0.9, "e": 0.8, "stop.offset": 0.3}[name]
        sides = [zivi.periodic_orbit(chain2(**{make: value + s * h}), orbit) for s in (1, -1)]
        slope = (sides[0].impacts["t"] - sides[1].impacts["t"]) / (2 * h)
        assert np.max(np.abs(slope - orbit.derivative(name))) < 1e-5 * np.max(np.abs(slope))
    with pytest.raises(ValueError, match="omega"):
        orbit.derivative("mass")


def test_what_is_no_motion_is_said():
    system = chain2(w=0.9)
    found = zivi.periodic_orbit(system, (["I stop"], [4.7]))
    assert found.status is not zivi.OrbitStatus.COMPLETED
    assert not found.admissible
    assert "<" in found.message
    # an orbit without impacts, where there are some
    free = zivi.periodic_orbit(system, (["P"], [[0.0, 0.1, 0.1, 0.0, 0.0]]))
    assert free.status is zivi.OrbitStatus.LEFT_ADMISSIBLE
    assert "in flight" in free.message


def test_orbits_are_reduced_to_their_least_period():
    name = "three_dof_w1.1"
    made = chain3(**numbers(name))
    period = 2 * np.pi / 1.1
    run = settled(made, period)
    for multiple in (1, 2, 3, 4, 6):
        orbit = zivi.periodic_orbit(made, run, multiple)
        assert orbit.multiple == 1
        assert len(orbit.impacts) == 2
    twice = zivi.periodic_orbit(made, orbit, 2)
    assert twice.multiple == 1


def test_bad_arguments_are_named():
    system = chain2()
    with pytest.raises(ValueError, match="symbol"):
        zivi.periodic_orbit(system, (["X stop"], [1.0]))
    with pytest.raises(ValueError, match="closed"):
        zivi.periodic_orbit(system, (["S stop", "I stop"], [1.0, 2.0]))
    with pytest.raises(ValueError, match="rows"):
        zivi.periodic_orbit(system, (["I stop"], [[1.0, 2.0, 3.0]]))
    with pytest.raises(ValueError, match="'free'"):
        zivi.periodic_orbit(system, (["I stop"], [1.0]), period="free")
    with pytest.raises(ValueError, match="period"):
        zivi.periodic_orbit(duffing2(**numbers("duffing")), (["I stop"], [1.0]))
    with pytest.raises(TypeError, match="start"):
        zivi.periodic_orbit(system, 3.0)
    with pytest.raises(TypeError, match="symmetry"):
        zivi.periodic_orbit(zivi.ImpactSystem(-1.0, e=0.5), [(1.0, 1.0)], symmetry=np.eye(1))
    short = zivi.simulate(system, (0, 1), ([0, 0], [0, 0]))
    with pytest.raises(ValueError, match="last a period"):
        zivi.periodic_orbit(system, short)


def test_orbits_are_stored_and_labelled():
    pytest.importorskip("xarray")
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    again = pickle.loads(pickle.dumps(orbit))
    assert np.array_equal(again.impacts, orbit.impacts)
    assert np.array_equal(again.monodromy(), orbit.monodromy())
    table = orbit.to_xarray()
    assert table.attrs["word"] == "I stop I stop I stop I stop"
    assert np.array_equal(table.t, orbit.impacts["t"])
    assert "4I stop" in repr(orbit)


def test_rigid_bodies_without_damping_have_orbits():
    # a free mass between two walls of a driven frame: no eigenvectors to sum, two impacts a period
    walls = [
        LinearGap([1.0], 0.5, zivi.HarmonicWall(0.2, 2.0), name="left"),
        LinearGap([-1.0], 0.5, zivi.HarmonicWall(-0.2, 2.0), name="right"),
    ]
    system = zivi.LinearSystem([[1.0]], None, [[0.0]], gaps=walls, e=0.7)
    run = zivi.simulate(system, (0, 400), ([0.1], [0.3]))
    orbit = zivi.periodic_orbit(system, run)
    assert orbit.success
    # flights at constant speed from wall to wall, and Newton's law at each
    t, gap = orbit.impacts["t"], orbit.impacts["gap"]
    wall = [zivi.HarmonicWall(0.2, 2.0, offset=(-0.5, 0.5)[k]) for k in gap]
    x = np.array([float(w(s)[0]) for w, s in zip(wall, t, strict=True)])
    rate = np.array([float(w(s)[1]) for w, s in zip(wall, t, strict=True)])
    length = orbit.multiple * orbit.period
    ahead = np.append(t[1:], t[0] + length)
    speed = (np.roll(x, -1) - x) / (ahead - t)
    before = np.roll(speed, 1)
    assert np.max(np.abs((speed - rate) + 0.7 * (before - rate))) < 1e-12


def test_wheels_that_never_part_move_as_one():
    inertia, damping, stiffness = np.array([1.0, 1.5]), np.array([0.2, 0.3]), 4.0
    wheels = zivi.LinearSystem(
        np.diag(inertia),
        np.diag(damping),
        np.diag([stiffness, 0.0]),
        excitation=[np.array([0.0, -0.5]), zivi.Harmonic([0.3, 0.0], 2.0)],
        gaps=[LinearGap([-1, 1], 0, name="front"), LinearGap([1, -1], 0.2, name="back")],
        e=0.5,
    )
    at = -0.5 / stiffness
    run = zivi.simulate(wheels, (0, 100), ([at, at], [0, 0]))
    orbit = zivi.periodic_orbit(wheels, run)
    assert orbit.word == ("P",)
    assert orbit.kind == "resting"
    rates = np.roots([inertia.sum(), damping.sum(), stiffness])
    assert_multipliers(orbit.multipliers, np.exp(rates * np.pi))
    assert np.count_nonzero(orbit.multipliers) == 2
    branch = zivi.continue_orbit(orbit, "F", (0.1, 0.6), step=0.1)
    # the force between them is 0.5 + Re(Z F e^(2 i t))
    Z = (-4 * 1.5 + 2j * 0.3) / (stiffness - 4 * 2.5 + 2j * 0.5)
    assert branch.of_kind("contact_ends")[0].value == pytest.approx(0.5 / abs(Z), abs=1e-10)
    assert branch.words == ["P", "L front Z front"]
    ends = zivi.continue_orbit(orbit, "F", (0.1, 0.8), through=False)
    assert ends.status is zivi.OrbitStatus.LEFT_ADMISSIBLE


def test_a_motion_without_events_has_its_least_period():
    system = zivi.LinearSystem(
        1.0, 0.1, 1.0, excitation=zivi.Harmonic([0.2], 0.8), gaps=[zivi.LinearGap([-1.0], 1.0)]
    )
    orbit = zivi.periodic_orbit(system, (["P"], [[0.0, 0.0, 0.0]]), 6)
    assert (orbit.kind, orbit.multiple) == ("flight", 1)
    assert orbit.period == pytest.approx(2 * np.pi / 0.8)


@pytest.mark.parametrize("multiple", [None, 3])
def test_a_rest_in_three_periods_is_found_wherever_the_run_ends(multiple):
    soft = zivi.LinearSystem(
        [[1.0]],
        [[0.02]],
        [[0.0245]],
        excitation=zivi.Harmonic([3.2624], 1.0),
        gaps=[LinearGap([1.0], -1 / 0.0245, name="floor")],
        e=0.4379,
    )
    turn = 2 * np.pi
    # the first two end within an accumulation
    for periods in (12, 12.3, 13, 14, 14.6):
        run = zivi.simulate(soft, (0, periods * turn), ([1 / 0.0245 + 1], [0.0]))
        orbit = zivi.periodic_orbit(soft, run, multiple)
        assert (orbit.success, orbit.multiple) == (True, 3)
        assert sorted(orbit.word) == ["L floor", "Z floor"]
        for own, seen in (
            (orbit.zeno_times, run.zeno["t"]),
            (orbit.liftoff_times, run.liftoffs["t"]),
        ):
            turns = (own[0] - seen[-1]) / turn
            assert abs(turns - round(turns)) < 1e-8


def test_a_rest_of_a_motion_that_nothing_excites_is_found_wherever_the_run_ends():
    def force(t, q, v):
        x, y = q
        return np.array([(1 - x * x) * v[0] - x, 0.8 * (x - y) - 0.1 * v[1] - 1.0])

    gap = LinearGap([0, 1], name="floor")
    lifted = zivi.MechanicalSystem(mass=np.diag([1, 0.6]), force=force, gaps=[gap], e=0.5)
    run = zivi.simulate(lifted, (0, 38), ([2.0, 0], [0, 0]), dense_output=False)
    length = float(np.diff(run.zeno["t"])[-1])
    first, zeno = 35.2, float(run.zeno["t"][-1])
    for end in (first + 0.3, zeno - 0.1, zeno - 1e-3):
        run = zivi.simulate(lifted, (0, end), ([2.0, 0], [0, 0]))
        frame, _, count, _ = recent(lifted, run, None, np.nan, True, PRECISE)
        assert sorted(it.kind for it in frame.word) == ["L", "Z"]
        assert count == 1
        assert abs(frame.length - length) < 1e-4


def test_an_orbit_that_a_run_does_not_show_says_what_it_shows():
    system = chain2(F=1.9)
    run = zivi.simulate(system, (0, 20), (np.zeros(2), np.zeros(2)))
    orbit = zivi.periodic_orbit(system, run, 1)
    assert not orbit.success
    assert "The last period of the run holds " in orbit.message
    assert orbit.message.endswith(" events; give multiple=, or a longer run.")
