"""Kicks: impulses at given times against closed forms and runs that are split by hand."""

import math
import pickle

import numpy as np
import pytest

import zivi
from example_scripts import example
from zivi.mechanics import Body

G = 9.81
TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
STANDARD_MAP = [
    (1.354624247993607490126385, 1.054624247993607490126385),
    (3.581319291822857630987565, 2.22669504382925014086118),
    (5.297183786082585702630819, 1.715864494259728071643254),
    (6.012457828540486429250072, 0.7152740424579007266192535),
    (24.81902496342050096480916, 0.6785940287320680220163002),
]
"""Kicks 1, 2, 3, 4 and 20 of ``p += 1.2 sin(theta)`` from (0.3, 0.7), by mpmath."""


def ball(e=0.5):
    return zivi.ImpactSystem(-G, e=e)


def body(e=0.5):
    return zivi.MechanicalSystem(mass=[[1.0]], force=[-G], gaps=[zivi.LinearGap([1.0])], e=e)


def test_a_kicked_rotor_is_the_standard_map():
    rotor = zivi.LinearSystem([[1.0]], [[0.0]], [[0.0]], gaps=[])
    kick = zivi.Kick(every=1.0, impulse=lambda t, q, v: 1.2 * np.sin(q))
    sol = zivi.simulate(rotor, (0, 20), ([0.3], [0.7]), TIGHT, kicks=kick)
    assert sol.success
    assert np.array_equal(sol.kicks["t"], np.arange(20.0))
    before = [(sol.kicks["t"][k], sol.kicks["qdot_before"][k, 0]) for k in range(1, 5)]
    for (t, p), (theta, momentum) in zip(before, STANDARD_MAP[:4], strict=True):
        assert abs(sol(t)[0][0] - theta) < 1e-12
        assert abs(p - momentum) < 1e-12
    assert abs(sol.q[-1, 0] - STANDARD_MAP[-1][0]) < 1e-12
    assert abs(sol.qdot[-1, 0] - STANDARD_MAP[-1][1]) < 1e-12


@pytest.mark.parametrize(
    ("dv", "after", "rest"), [(-2.0, 1.0, 1.407747196738022), (2.0, 2.0, 1.815494393476045)]
)
@pytest.mark.parametrize("of", [ball, body])
def test_a_kick_on_a_mass_at_rest(of, dv, after, rest):
    start = (0.0, 0.0) if of is ball else ([0.0], [0.0])
    sol = zivi.simulate(of(), (0, 3), start, TIGHT, kicks=[zivi.Kick(t=1.0, dv=dv)])
    assert sol.success
    last = sol.zeno_times[-1]
    assert abs(last - rest) < 1e-12
    v = sol.xdot if of is ball else sol.qdot[:, 0]
    assert np.any(np.abs(v[sol.t == 1.0] - after) < 1e-14)
    if of is ball:
        assert sol.rest_time == last
        assert len(sol.kicks) == 1
        assert sol.kicks["dv"][0] == dv
    assert "1 kick:" in repr(sol)
    assert sol.message.endswith(" 1 kick.")


def random_run(seed):
    """Draw a mass, its kicks and a start."""
    rng = np.random.default_rng(seed)
    e = rng.uniform(0.1, 0.9)
    k, c, g = rng.uniform(0.0, 20.0), rng.uniform(0.0, 0.5), rng.uniform(0.5, 10.0)
    force = zivi.LinearForce(stiffness=k, damping=c, gravity=g)
    times = np.sort(rng.uniform(0.1, 2.9, rng.integers(1, 5)))
    return (
        e,
        force,
        times,
        rng.uniform(-3.0, 3.0, len(times)),
        (rng.uniform(0.0, 1.0), rng.uniform(-1, 1)),
    )


@pytest.mark.parametrize("block", range(4))
def test_runs_are_those_that_are_split_at_the_kicks(block):
    for seed in range(50 * block, 50 * (block + 1)):
        e, force, times, dv, (x, xdot) = random_run(seed)
        system = zivi.ImpactSystem(force, e=e)
        kicks = [zivi.Kick(t=t, dv=change) for t, change in zip(times, dv, strict=True)]
        sol = zivi.simulate(system, (0, 3), (x, xdot), kicks=kicks)
        assert sol.success
        t = 0.0
        for end, change in zip([*times, 3.0], [*dv, 0.0], strict=True):
            part = zivi.simulate(system, (t, end), (x, xdot))
            t, x, xdot = end, part.x[-1], part.xdot[-1] + change
        assert abs(sol.x[-1] - x) < 3e-5
        assert abs(sol.xdot[-1] - xdot) < 3e-5


def test_a_box_with_two_gaps_and_friction_slips_after_a_kick():
    joint = zivi.DryFriction([1.0], limit=2.0)
    system = zivi.MechanicalSystem(mass=[[2.0]], force=[1.0], gaps=[], friction=[joint])
    sol = zivi.simulate(
        system, (0, 4), ([0.0], [0.0]), TIGHT, kicks=[zivi.Kick(t=1.0, impulse=3.0)]
    )
    # sticks, slips with v = 1.5 - 0.5 (t - 1), sticks from t = 4 on; x = 1.5^2/(2*0.5)
    assert abs(sol.q[-1, 0] - 2.25) < 1e-9
    start = sol.qdot[sol.t == 1.0, 0]
    assert start[0] == 0.0
    assert start[-1] == 1.5


def test_an_impulse_acts_through_the_mass_matrix():
    mass = np.array([[2.0, 0.5], [0.5, 1.0]])
    system = zivi.MechanicalSystem(mass=mass, force=[0.0, 0.0], gaps=[])
    sol = zivi.simulate(
        system, (0, 2), ([0, 0], [0, 0]), kicks=zivi.Kick(t=1.0, impulse=[1.0, -2.0])
    )
    assert np.abs(sol.qdot[-1] - np.linalg.solve(mass, [1.0, -2.0])).max() < 1e-14
    assert np.abs(sol.kicks["dv"][0] - sol.qdot[-1]).max() < 1e-14


def test_an_impulse_on_a_point_of_a_tree():
    arm = Body("arm", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    tree = zivi.Tree([arm], gravity=(0, 0, 0))
    q = 0.4
    kick = zivi.Kick(t=1.0, impulse=[3.0, 5.0, -1.0], body="arm", point=[0, 0, -0.5])
    sol = zivi.simulate(tree, (0, 2), ([q], [0.0]), kicks=kick)
    # the torque of the impulse at r = -0.5 (sin q, 0, cos q) about the y axis
    r = -0.5 * np.array([np.sin(q), 0.0, np.cos(q)])
    torque = np.cross(r, [3.0, 5.0, -1.0])[1]
    assert abs(sol.qdot[-1, 0] - torque / (0.01 + 2.0)) < 1e-12
    kick = zivi.Kick(t=1.0, impulse=[1, 0, 0], body="leg")
    with pytest.raises(ValueError, match="body must be one of arm, got 'leg'"):
        zivi.simulate(tree, (0, 2), ([q], [0.0]), kicks=kick)


def test_kicks_are_kept_with_a_result():
    sol = zivi.simulate(ball(), (0, 3), (0, 0), kicks=[zivi.Kick(every=1.0, start=0.5, dv=1.0)])
    assert np.array_equal(sol.kicks["t"], [0.5, 1.5, 2.5])
    again = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(again.kicks, sol.kicks)
    assert sol.trusted_until == 3.0
    assert len(zivi.simulate(ball(), (0, 3), (0, 0)).kicks) == 0


def test_a_kick_at_the_start_changes_the_initial_velocity():
    sol = zivi.simulate(ball(), (0, 0.1), (1.0, 0.0), kicks=zivi.Kick(t=[0.0, 0.1], dv=3.0))
    assert sol.xdot[0] == 3.0
    assert len(sol.kicks) == 1


def test_what_a_function_of_a_kick_raises_reaches_the_caller():
    def fails(t, x, v):
        raise RuntimeError("no kick")

    with pytest.raises(RuntimeError, match="no kick"):
        zivi.simulate(ball(), (0, 3), (1, 0), kicks=zivi.Kick(t=1.0, dv=fails))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"t": 1.0}, "exactly one of dv and impulse"),
        ({"dv": 1.0}, "exactly one of t and every"),
        ({"t": 1.0, "every": 1.0, "dv": 1.0}, "exactly one of t and every"),
        ({"every": 0.0, "dv": 1.0}, "every must be > 0"),
        ({"t": np.nan, "dv": 1.0}, "t must be"),
        ({"t": 1.0, "dv": np.inf}, "dv must be finite"),
        ({"t": 1.0, "dv": 1.0, "body": "arm"}, "body must be None with dv"),
    ],
)
def test_wrong_kicks_are_named(given, message):
    with pytest.raises(ValueError, match=message):
        zivi.Kick(**given)


def test_what_takes_no_kicks_says_so():
    kick = zivi.Kick(t=1.0, dv=1.0)
    with pytest.raises(ValueError, match="kicks are not supported by ThetaGamma"):
        zivi.simulate(ball(), (0, 2), (1, 0), zivi.ThetaGamma(h=1e-2), kicks=kick)
    with pytest.raises(TypeError, match=r"kicks\[0\] must be a zivi.Kick"):
        zivi.simulate(ball(), (0, 2), (1, 0), kicks=[(1.0, 2.0)])
    with pytest.raises(ValueError, match="dv must be finite with shape"):
        zivi.simulate(body(), (0, 2), ([1], [0]), kicks=zivi.Kick(t=1.0, dv=[1.0, 2.0]))
    with pytest.raises(ValueError, match="body must be None for a MechanicalSystem"):
        zivi.simulate(
            body(), (0, 2), ([1], [0]), kicks=zivi.Kick(t=1.0, impulse=[1, 0, 0], body="a")
        )


def test_samples_at_a_kick_have_the_state_after_it():
    for of, start in ((ball, (1.0, 0.0)), (body, ([1.0], [0.0]))):
        sol = zivi.simulate(of(), (0, 1), start, TIGHT, [0.1, 0.2], kicks=zivi.Kick(t=0.2, dv=3.0))
        v = np.ravel(sol.xdot if of is ball else sol.qdot)
        assert np.abs(v - [-0.1 * G, 3.0 - 0.2 * G]).max() < 1e-12


def test_batches_have_the_kicks_of_runs():
    kicks = [zivi.Kick(every=0.4, start=0.0, dv=1.5), zivi.Kick(t=0.8, dv=-0.5)]
    starts = np.array([[1.0, 0.0], [0.3, -1.0], [0.0, 0.0]])
    batch = zivi.simulate_batch(ball(), (0, 2), starts, kicks=kicks)
    several = zivi.simulate_batch(body(), (0, 2), (starts[:, :1], starts[:, 1:]), kicks=kicks)
    for i, start in enumerate(starts):
        sol = zivi.simulate(ball(), (0, 2), start, kicks=kicks)
        assert (batch.x[i], batch.xdot[i]) == (sol.x[-1], sol.xdot[-1])
        assert abs(several.q[i, 0] - sol.x[-1]) < 1e-4
    with pytest.raises(ValueError, match="kicks must be numbers for batches"):
        zivi.simulate_batch(ball(), (0, 2), starts, kicks=zivi.Kick(t=1, dv=lambda t, x, v: 1.0))


def test_a_closed_loop_is_kicked():
    class Nothing:
        h = 0.01

        def step(self, t, q, qdot):
            return [0.0]

    system = body().replace(inputs=[[1.0]])
    kicks = [zivi.Kick(t=0.3, dv=2.0), zivi.Kick(t=0.605, impulse=lambda t, q, v: -3.0 * v)]
    start = ([1.0], [0.0])
    loop = zivi.simulate_closed_loop(system, Nothing(), (0, 1), start, method=TIGHT, kicks=kicks)
    plain = zivi.simulate(body(), (0, 1), start, TIGHT, kicks=kicks)
    assert len(loop.kicks) == 2
    assert np.abs(loop.q[-1] - plain.q[-1]).max() < 1e-9


class Idle:
    h = 0.01

    def step(self, x, xdot, force):
        return 0.0


@pytest.mark.parametrize(
    "force", [-9.81, zivi.LinearForce(gravity=9.81, stiffness=2.0), lambda t, x, v: -9.81 - 0.2 * v]
)
@pytest.mark.parametrize("start", [(1.0, 0.0), (0.0, 0.0)])
def test_a_closed_loop_of_a_mass_is_kicked(force, start):
    system = zivi.ImpactSystem(force, e=0.5)
    # at the start, at a sample, between samples, into the wall, at the end
    times = [0.0, 0.3, 0.605, 0.6051, 0.9, 1.4]
    kicks = [
        zivi.Kick(t=times, dv=1.5),
        zivi.Kick(t=[0.305, 1.2], dv=lambda t, x, xdot: -2.0 - xdot),
    ]
    loop = zivi.simulate_closed_loop(system, Idle(), (0, 1.4), start, method=TIGHT, kicks=kicks)
    plain = zivi.simulate(system, (0, 1.4), start, TIGHT, kicks=kicks)
    assert loop.kicks["t"].tolist() == plain.kicks["t"].tolist()
    assert np.abs(loop.kicks["xdot_after"] - plain.kicks["xdot_after"]).max() < 1e-8
    assert np.abs(loop.impacts["t"][:4] - plain.impacts["t"][:4]).max() < 1e-9
    assert abs(loop.x[-1] - plain.x[-1]) < 1e-8
    t = np.linspace(0.0, 1.399, 113)
    assert np.abs(loop(t)[0] - plain(t)[0]).max() < 1e-8
    assert len(loop.liftoffs) == len(plain.liftoffs)


def test_a_controller_measures_before_a_kick_at_its_sample():
    seen = []

    class Spy(Idle):
        def step(self, x, xdot, force):
            seen.append(xdot)
            return 0.0

    spy = Spy()
    ball = zivi.ImpactSystem(0.0, e=0.5)
    run = zivi.simulate_closed_loop(ball, spy, (0, 0.05), (1, 0), kicks=zivi.Kick(t=0.02, dv=1.0))
    assert seen == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert run.x[-1] == pytest.approx(1.03, abs=1e-12)


def test_the_twisting_regulator_recovers_from_kicks():
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.5)
    kicks = zivi.Kick(every=1.0, start=1.0, dv=2.0)
    run = zivi.simulate_closed_loop(plant, regulator, (0, 3.9), (0.5, 0), kicks=kicks)
    assert len(run.kicks) == 3
    assert (run.kicks["xdot_before"] == 0.0).all()
    assert run.rest_time > 3.0
    assert (run.x[-1], run.xdot[-1]) == (0.0, 0.0)


def test_loops_on_the_grid_of_a_scheme_refuse_kicks():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    with pytest.raises(ValueError, match="kicks are not supported by ThetaGamma"):
        zivi.simulate_closed_loop(
            ball, Idle(), (0, 1), (1, 0), method=zivi.ThetaGamma(h=0.01), kicks=zivi.Kick(t=1, dv=1)
        )


def test_a_kicked_rotor_between_elastic_stops_moves_as_the_standard_map():
    rotor = example("mechanics_kicked_rotor")
    batch = rotor.kicked(1.0, 30)
    assert np.abs(batch.sample_q[:, :, 0] - rotor.standard_map(30)).max() < 1e-10
    # with losses all motions end at the stop where kicks push towards it
    inelastic = rotor.kicked(0.9, 150)
    assert np.abs(math.pi - inelastic.sample_q[:, -1, 0]).max() < 0.1


# Derivatives: the stretches between kicks, and the kicks.

VARIED = [
    zivi.Kick(t=[0.1, 0.9], dv=lambda t, x, v: 0.3 * np.sin(x) - 0.1 * v),
    zivi.Kick(t=1.3, dv=-2.0),
]


def differenced(of, p, h=1e-3):
    """Differences of fourth order, of shape (values, parameters)."""
    columns = []
    for step in h * np.eye(len(p)):
        wide, narrow = of(p + step) - of(p - step), of(p + step / 2) - of(p - step / 2)
        columns.append((8 * narrow - wide) / (6 * h))
    return np.array(columns).T


def test_derivatives_of_a_kicked_mass_are_those_of_differences():
    def run(p):
        sol = zivi.simulate(ball(p[2]), (p[3], 1.6), p[:2], TIGHT, kicks=VARIED)
        return np.array([sol.x[-1], sol.xdot[-1], *sol.impacts["t"]])

    point = np.array([1.0, 0.2, 0.8, 0.0])
    wrt = ("x0", "xdot0", "e", "t0")
    s = zivi.sensitivity(ball(0.8), (0, 1.6), point[:2], wrt, TIGHT, kicks=VARIED)
    found = np.concatenate([s.final, s.impacts["dt"]])
    assert s.success
    assert len(found) == 5
    assert np.max(np.abs(found - differenced(run, point, 2.5e-4))) < 1e-10
    assert np.array_equal(s.impacts["t"], s.trajectory.impacts["t"])
    assert np.max(np.abs(s(1.6) - s.final)) < 1e-12
    assert np.max(np.abs(s.monodromy - s.final[:, :2])) < 1e-12
    # at a kick the derivatives after it: d(v + .3 sin x - .1 v)
    before, after = s(np.nextafter(0.9, 0)), s(0.9)
    x = float(s.trajectory(0.9)[0])
    assert np.max(np.abs(after[1] - 0.9 * before[1] - 0.3 * np.cos(x) * before[0])) < 1e-9
    assert np.array_equal(pickle.loads(pickle.dumps(s)).final, s.final)


def test_the_zeno_time_after_a_kick_from_rest():
    # t = t_k + 4 e/(g (1 - e)): dt/de = 4/(g (1 - e)^2)
    for of, start in [(ball, (0.0, 0.0)), (body, ([0.0], [0.0]))]:
        kick = zivi.Kick(t=1.0, dv=-2.0)
        s = zivi.sensitivity(of(), (0, 3), start, ("e",), TIGHT, kicks=kick)
        assert s.success
        assert abs(s.zeno_times[-1, 0] - 4 / (G * 0.25)) < 1e-10
        assert np.all(s.final == 0.0)


def test_derivatives_of_a_kicked_mechanism_are_those_of_differences():
    # coupled masses that depend on the configuration and on parameters
    inertia = "(m + M*sin(x)**2)*xdot**2/2 + m*ydot**2/2 + c*xdot*ydot"
    given = {"m": 1.0, "M": 0.4, "g": G, "k": 3.0, "c": 0.2}
    potential, gaps = "m*g*y + k*x**2/2", {"floor": "y"}
    of = zivi.symbolic.system("x y", T=inertia, V=potential, gaps=gaps, e=0.7, parameters=given)
    kicks = [
        zivi.Kick(t=[0.2, 0.7], impulse=[0.3, -0.2]),
        zivi.Kick(every=0.45, start=0.1, impulse=lambda t, q, v: [0.1 * q[1], 0.2 * v[0]]),
    ]

    def run(p):
        system = of.replace(m=p[4], k=p[5])
        sol = zivi.simulate(system, (0, 1.1), (p[:2], p[2:4]), TIGHT, kicks=kicks)
        return np.concatenate([sol.q[-1], sol.qdot[-1], sol.impacts["t"]])

    point = np.array([0.3, 0.4, 0.1, 0.0, 1.0, 3.0])
    wrt = ("q0", "qdot0", "m", "k")
    s = zivi.sensitivity(of, (0, 1.1), (point[:2], point[2:4]), wrt, TIGHT, kicks=kicks)
    found = np.concatenate([s.final.reshape(4, -1), s.impacts["dt"]])
    assert s.success
    assert len(s.impacts) == 3
    assert np.max(np.abs(found - differenced(run, point, 2.5e-4))) < 1e-10
    within = s([0.05, 0.3, 1.1])
    assert within.shape == (2, 2, 6, 3)
    assert np.max(np.abs(within[..., 2] - s.final)) < 1e-12


def test_a_kick_at_the_start_moves_the_velocity_not_the_start():
    kick = zivi.Kick(t=0.0, dv=lambda t, x, v: 0.5 * v)
    s = zivi.sensitivity(ball(), (0, 0.1), (1, 2), ("xdot0",), TIGHT, kicks=kick)
    assert np.max(np.abs(s.final[:, 0] - [0.15, 1.5])) < 1e-12
    with pytest.raises(ValueError, match="wrt must not have 't0' with a kick at the start t = 0"):
        zivi.sensitivity(ball(), (0, 1), (1, 2), ("t0",), TIGHT, kicks=kick)
    with pytest.raises(ValueError, match="unknown parameter 'ee'"):
        zivi.sensitivity(ball(), (0, 1), (1, 2), ("ee",), TIGHT, kicks=kick)


@pytest.mark.parametrize("of", [ball, body])
def test_a_file_keeps_the_kicks(of, tmp_path):
    pytest.importorskip("h5netcdf", reason="the extra 'files' is not installed")
    start = (0.0, 0.0) if of is ball else ([0.0], [0.0])
    kicks = [zivi.Kick(t=[1.0, 2.0], dv=-2.0), zivi.Kick(t=1.5, impulse=lambda t, q, v: v - 1)]
    sol = zivi.simulate(of(), (0, 3), start, kicks=kicks)
    zivi.files.save(sol, tmp_path / "run.nc")
    found = zivi.files.load(tmp_path / "run.nc")
    assert len(found.kicks) == 3
    assert found.kicks.dtype == sol.kicks.dtype
    assert np.array_equal(found.kicks, sol.kicks)
    assert repr(found) == repr(sol)
