"""Compliant gaps: contact forces that are laws of depth and rate."""

import copy
import pickle

import numpy as np
import pytest
import scipy.integrate

import zivi

G = 9.81
METHOD = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
# of 1 kg from 1 m on k = 1e4, c = 20 that opens where its force vanishes: exact solution by pieces
SWITCHES = (
    *(0.4515236409857309, 0.4816061607828570, 1.1484275599147260),
    *(1.1786983090193296, 1.6682045045451377, 1.6987358286637114),
)
AT_TWO = 0.08253845440712225, -1.1920205349830490


def drop(law, tolerance=1e-10, y0=((1.0,), (0.0,)), span=(0.0, 2.0), mass=1.0, force=-G):
    floor = zivi.LinearGap([1.0], contact=law)
    ball = zivi.MechanicalSystem(mass=mass, force=[force], gaps=[floor])
    return zivi.simulate(ball, span, y0, zivi.SwitchedRK(rtol=tolerance, atol=tolerance))


def switches(sol):
    return np.sort(np.concatenate([sol.touchdowns["t"], sol.liftoffs["t"]]))


def spring_and_damper(depth, rate):
    return 1e4 * depth + 20 * rate


@pytest.mark.parametrize(("tolerance", "most"), [(1e-6, 440), (1e-8, 500), (1e-11, 910)])
@pytest.mark.parametrize("law", [zivi.SpringDamper(1e4, 20.0), spring_and_damper])
def test_a_ball_on_a_spring_and_damper(law, tolerance, most):
    sol = drop(law, tolerance)
    assert sol.success
    assert sol.nfev <= most
    assert np.abs(switches(sol) - SWITCHES).max() < 10 * tolerance
    assert np.abs([sol.q[-1, 0] - AT_TWO[0], sol.qdot[-1, 0] - AT_TWO[1]]).max() < 10 * tolerance


@pytest.mark.parametrize(
    ("zeta", "e"),
    [
        (0.05, 0.8587581017750918),
        (0.1, 0.7440793977217797),
        (0.3, 0.4509754528931284),
        (0.7, 0.2102845643784784),
    ],
)
def test_restitution_of_a_spring_and_damper(zeta, e):
    k, mass = 1e4, 2.3
    law = zivi.SpringDamper(k, 2 * zeta * np.sqrt(k * mass))
    sol = drop(law, 1e-11, ((0.1,), (-2.0,)), (0.0, 0.5), mass, 0.0)
    assert sol.qdot[-1, 0] == pytest.approx(2 * e, abs=1e-10)
    assert sol.gaps[np.searchsorted(sol.t, sol.liftoffs["t"][0]), 0] < 0.0  # it opens below zero


@pytest.mark.parametrize(("k", "p", "mass"), [(1e5, 1.5, 0.4), (3e3, 2.2, 5.0)])
@pytest.mark.parametrize(
    ("av", "e"),
    [
        (0.1, 0.9374755799499051),
        (0.5, 0.7484349315974342),
        (1.0, 0.5936242600400401),
        (3.0, 0.3068967982909621),
    ],
)
def test_restitution_of_hunt_and_crossley(av, e, k, p, mass):
    sol = drop(zivi.HuntCrossley(k, p, av / 1.7), 1e-11, ((0.1,), (-1.7,)), (0.0, 1.0), mass, 0.0)
    assert sol.qdot[-1, 0] == pytest.approx(1.7 * e, abs=1e-9)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-12])
def test_switches_that_are_located_cost_less_than_a_kink_in_the_force(tolerance):
    def kinked(t, q, w):
        pushed = max(0.0, spring_and_damper(-q[0], -w[0])) if q[0] < 0.0 else 0.0
        return [pushed - G]

    method = zivi.SwitchedRK(rtol=tolerance, atol=tolerance)
    system = zivi.MechanicalSystem(mass=1.0, force=kinked)
    other = zivi.simulate(system, (0, 2), ([1.0], [0.0]), method)
    sol = drop(zivi.SpringDamper(1e4, 20.0), tolerance)
    errors = [abs(it.q[-1, 0] - AT_TWO[0]) for it in (sol, other)]
    assert other.nfev > 4 * sol.nfev
    assert errors[1] > 20 * errors[0]


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
def test_a_contact_after_hertz_takes_two_to_three_times_the_evaluations_of_a_spring(tolerance):
    counts = []
    for law in (zivi.Hertz(1e6), zivi.SpringDamper(1e4)):
        arguments = law, tolerance, ((0.0,), (-2.0,))
        end = drop(*arguments, (0.0, 1.0), 1.0, 0.0).liftoffs["t"][0]
        counts.append(drop(*arguments, (0.0, end * (1 + 1e-7)), 1.0, 0.0).nfev)
    assert 1.8 < counts[0] / counts[1] < 3.3


def test_duration_of_a_contact_after_hertz():
    sol = drop(zivi.Hertz(1e6), 1e-11, ((0.1,), (-2.0,)), (0.0, 0.2), 1.0, 0.0)
    assert sol.liftoffs["t"][0] - sol.touchdowns["t"][0] == pytest.approx(
        0.0111529273917, abs=1e-11
    )
    assert -sol.gaps.min() <= 0.00757858283255200 + 1e-12


def penalised(mass, force, normals, offsets, laws):
    """Accelerations with every contact force as `max(0, law)` below zero."""
    inverse = np.linalg.inv(mass)

    def rate(t, z):
        q, w = np.split(z, 2)
        total = np.array(force(t, q, w), dtype=float)
        for normal, offset, law in zip(normals, offsets, laws, strict=True):
            depth, speed = -(normal @ q + offset), -(normal @ w)
            if depth > 0.0:
                total += normal * max(0.0, law(depth, speed))
        return np.concatenate([w, inverse @ total])

    return rate


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 8, 9, 11])
def test_random_systems_beside_an_integrator_that_knows_no_switches(seed):
    draw = np.random.default_rng(seed)
    skew = draw.normal(size=(2, 2)) + 2 * np.eye(2)
    mass, stiffness = skew.T @ np.diag(draw.uniform(0.5, 2, 2)) @ skew, 30 * np.eye(2)
    normals = [row / np.linalg.norm(row) for row in draw.normal(size=(2, 2))]
    offsets = draw.uniform(0.0, 0.1, 2)
    kinds = [
        zivi.SpringDamper(draw.uniform(1e3, 1e4), draw.uniform(0, 60)),
        zivi.HuntCrossley(draw.uniform(1e4, 1e5), 1.5, draw.uniform(0, 1)),
        zivi.Hertz(draw.uniform(1e4, 1e5), 2.0),
    ]
    laws = [kinds[i] for i in draw.integers(0, 3, 2)]
    start = np.zeros(2), draw.normal(size=2)

    def force(t, q, w):
        return -stiffness @ q + 3 * np.sin(7 * t)

    gaps = [
        zivi.LinearGap(n, c, contact=law) for n, c, law in zip(normals, offsets, laws, strict=True)
    ]
    system = zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps)
    sol = zivi.simulate(system, (0, 1), start, METHOD)
    rate = penalised(mass, force, normals, offsets, laws)
    other = scipy.integrate.solve_ivp(
        rate, (0, 1), np.concatenate(start), "DOP853", rtol=1e-10, atol=1e-12, max_step=2e-3
    )
    assert sol.success
    assert len(sol.touchdowns) >= 2
    assert np.abs(np.concatenate([sol.q[-1], sol.qdot[-1]]) - other.y[:, -1]).max() < 1e-6
    # the equation of motion, with the reactions of dense output put back
    times = draw.uniform(0, 1, 40)
    there = sol.resample(np.sort(times))
    for t, q, w, forces in zip(there.t, there.q, there.qdot, there.reactions, strict=True):
        near = min(abs(switches(sol) - t))
        if near > 1e-4:
            h = 1e-6
            slope = (sol(t + h)[1] - sol(t - h)[1]) / (2 * h)
            balance = mass @ slope - force(t, q, w) - forces @ np.array(normals)
            assert np.abs(balance).max() < 1e-3 * (1 + np.abs(forces).max())
    assert (there.reactions >= 0.0).all()


def test_coordinates_do_not_matter():
    turn = np.array([[1.0, 2.0], [-0.7, 0.4]])
    ends = []
    for T in (np.eye(2), turn):
        law, rigid = zivi.SpringDamper(5e3, 10.0), zivi.LinearGap([-1.0, 0.0] @ T, 0.5)
        soft = zivi.LinearGap([0.0, 1.0] @ T, contact=law, tangent=[1.0, 0.0] @ T, mu=0.2)
        system = zivi.MechanicalSystem(
            mass=T.T @ T, force=T.T @ [0.0, -G], gaps=[soft, rigid], e=[0.0, 0.6]
        )
        start = np.linalg.solve(T, [0.0, 0.3]), np.linalg.solve(T, [1.5, 0.0])
        sol = zivi.simulate(system, (0, 2), start, METHOD)
        assert sol.success
        assert len(sol.impacts)
        ends.append((sol.q[-1] @ T.T, sol.qdot[-1] @ T.T))
    assert np.abs(np.subtract(*ends)).max() < 1e-8


def test_a_contact_that_is_loaded_again_before_it_is_open():
    # overdamped, unloaded by a pull of 10 ms and pushed back before its surface returns
    def force(t, q, w):
        return [-10.0 + (200.0 if 0.5 < t < 0.51 else 0.0) - (300.0 if 0.52 < t < 0.56 else 0.0)]

    law = zivi.SpringDamper(100.0, 60.0)
    system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[zivi.LinearGap([1], contact=law)])
    stops = [0.5, 0.51, 0.52, 0.56]
    sol = zivi.simulate(system, (0, 1), ([0.0], [-1.0]), METHOD, tstops=stops)
    rate = penalised(np.eye(1), force, [np.ones(1)], [0.0], [law])
    z = np.array([0.0, -1.0])
    for a, b in zip([0.0, *stops], [*stops, 1.0], strict=True):
        z = scipy.integrate.solve_ivp(
            rate, (a, b), z, "DOP853", rtol=1e-11, atol=1e-13, max_step=1e-4
        ).y[:, -1]
    assert sol.q[-1, 0] == pytest.approx(z[0], abs=1e-8)
    assert len(sol.touchdowns) == len(sol.liftoffs) == 1  # it began in contact
    assert sol.gaps[np.searchsorted(sol.t, sol.touchdowns["t"][0]), 0] < 0.0


def test_friction_of_a_compliant_floor():
    floor = zivi.LinearGap([0, 1], contact=zivi.SpringDamper(1e4, 200.0), tangent=[1, 0], mu=0.3)
    box = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], gaps=[floor])
    sol = zivi.simulate(box, (0, 3), ([0.0, -G / 1e4], [2.0, 0.0]), METHOD)
    assert sol.q[-1, 0] == pytest.approx(4 / (2 * 0.3 * G), abs=1e-9)
    assert sol.qdot[-1, 0] == 0.0
    assert sol.stick["t_start"][0] == pytest.approx(2 / (0.3 * G), abs=1e-9)
    thrown = zivi.simulate(box, (0, 1), ([0.0, 0.5], [2.0, 0.0]), METHOD)
    there = thrown.resample(np.linspace(0, 1, 300))
    slides = (there.modes[:, 0] == 1) & there.contacts[:, 0]
    assert slides.sum() > 20
    assert np.allclose(
        there.friction_forces[slides, 0], -0.3 * there.reactions[slides, 0], rtol=1e-9
    )
    in_air = ~there.contacts[:, 0]
    assert in_air.any()
    assert not there.friction_forces[in_air].any()
    assert set(there.modes[in_air, 0]) == {2}


def test_rest_a_start_below_zero_and_dense_output():
    law = zivi.SpringDamper(1e4, 200.0)
    for start in (1.0, -0.01):
        sol = drop(law, 1e-9, ((start,), (0.0,)), (0.0, 20.0))
        assert sol.success
        assert sol.q[-1, 0] == pytest.approx(-G / 1e4, abs=1e-9)
        assert sol.reactions[-1, 0] == pytest.approx(G, abs=1e-4)
    sol = drop(law)
    t = 0.5 * (sol.touchdowns["t"][0] + sol.liftoffs["t"][0])
    there = sol.resample([t])
    assert there.gaps[0, 0] == pytest.approx(sol(t)[0, 0], abs=1e-9)
    assert there.gaps[0, 0] < 0
    assert there.reactions[0, 0] == pytest.approx(-1e4 * there.q[0, 0] - 200 * there.qdot[0, 0])
    assert there.contacts[0, 0]


def test_linear_systems_and_batches_have_them():
    floor = zivi.LinearGap([1.0], contact=zivi.SpringDamper(1e4, 20.0))
    linear = zivi.LinearSystem([[1.0]], [[0.0]], [[0.0]], excitation=[-G], gaps=[floor])
    sol = zivi.simulate(linear, (0, 2), ([1.0], [0.0]), METHOD)
    assert np.abs(switches(sol) - SWITCHES).max() < 1e-9
    # waves and tables hide no pulses: their flights are not probed
    assert sol.nfev == drop(floor.contact).nfev
    batch = zivi.simulate_batch(
        [linear, linear], (0, 2), ([[1.0], [0.5]], [[0.0], [0.0]]), method=METHOD
    )
    assert batch.q[0, 0] == sol.q[-1, 0]
    assert batch.q[1, 0] != sol.q[-1, 0]


def test_they_are_kept(tmp_path):
    law = zivi.HuntCrossley(1e5, alpha=0.3)
    gap = zivi.LinearGap([1.0], contact=law, name="mat")
    system = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[gap])
    sol = zivi.simulate(system, (0, 1), ([0.5], [0.0]))
    for other in (pickle.loads(pickle.dumps(system)), copy.deepcopy(system)):
        assert other.gaps[0].contact == law
        assert zivi.simulate(other, (0, 1), ([0.5], [0.0])).q[-1] == sol.q[-1]
    assert "contact=HuntCrossley(k=100000.0, p=1.5, alpha=0.3)" in repr(gap)
    zivi.files.save(sol, tmp_path / "run.nc")
    back = zivi.files.load(tmp_path / "run.nc")
    assert (back.touchdowns["t"] == sol.touchdowns["t"]).all()
    t = np.linspace(0, 1, 30)
    assert (back.resample(t).gaps == sol.resample(t).gaps).all()
    assert "touchdowns" in repr(sol)


@pytest.mark.parametrize(
    ("make", "kind", "told"),
    [
        (lambda: zivi.SpringDamper(0.0), ValueError, "k must be > 0"),
        (lambda: zivi.SpringDamper(1.0, -1.0), ValueError, "c must be >= 0"),
        (lambda: zivi.Hertz(1.0, 0.5), ValueError, "p must be from 1 to 10"),
        (lambda: zivi.HuntCrossley(1.0, alpha=-1.0), ValueError, "alpha must be >= 0"),
        (lambda: zivi.LinearGap([1.0], contact=3.0), TypeError, "contact of gap must be"),
        (
            lambda: zivi.LinearGap(
                [1.0, 0], contact=zivi.Hertz(1.0), tangent=[0, 1.0], mu=0.1, e_t=0.5
            ),
            ValueError,
            "e_t of gap must be 0",
        ),
        (
            lambda: zivi.MechanicalSystem(
                mass=1.0, force=[-G], gaps=[zivi.LinearGap([1.0], contact=zivi.Hertz(1.0))], e=0.5
            ),
            ValueError,
            "e of gap 'gap0' must be 0",
        ),
    ],
)
def test_what_is_wrong_is_told(make, kind, told):
    with pytest.raises(kind, match=told):
        make()


def test_what_does_not_take_them_says_so():
    floor = zivi.LinearGap([1.0], contact=zivi.Hertz(1e5))
    ball = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[floor])
    start = (0, 1), ([0.5], [0.0])
    for call in (
        lambda: zivi.simulate(ball, *start, zivi.MoreauJean(1e-3)),
        lambda: zivi.lyapunov_exponents(ball, *start),
        lambda: zivi.periodic_orbit(ball, start=start[1], period=1.0),
    ):
        with pytest.raises(NotImplementedError, match="gap0"):
            call()


def test_a_function_that_fails_ends_the_run_with_what_was_computed():
    def law(depth, rate):
        if depth > 0.01:
            raise RuntimeError("too deep")
        return 1e4 * depth

    with pytest.raises(RuntimeError, match="too deep") as caught:
        drop(law)
    assert caught.value.trajectory.t[-1] > 0.4
    with pytest.raises(TypeError, match="must return a float"):
        drop(lambda depth, rate: "hard")


@pytest.mark.parametrize("law", [zivi.SpringDamper(1e4), zivi.Hertz(1e4), zivi.HuntCrossley(1e4)])
def test_they_are_not_coefficients_of_restitution(law):
    with pytest.raises(TypeError, match="a compliant contact is the contact= of a gap"):
        zivi.ImpactSystem(-G, e=law)


def test_symbolic_systems_have_them():
    pytest.importorskip("sympy")
    law = zivi.SpringDamper(1e4, 20.0)
    given = {"T": "m*xdot**2/2", "V": "m*g*x", "gaps": {"floor": "x"}}
    ball = zivi.symbolic.system("x", **given, parameters={"m": 1.0, "g": G}, contact={"floor": law})
    for system in (ball, ball.replace(g=G), pickle.loads(pickle.dumps(ball))):
        sol = zivi.simulate(system, (0, 2), ([1.0], [0.0]), METHOD)
        assert np.abs(switches(sol) - SWITCHES).max() < 1e-9
    with pytest.raises(ValueError, match=r"contact\['roof'\] must be of a gap: there are floor"):
        zivi.symbolic.system("x", **given, parameters={"m": 1.0, "g": G}, contact={"roof": law})
    with pytest.raises(ValueError, match="e of gap 'floor' must be 0"):
        ball.replace(e=0.5)


class Idle:
    """A controller that does nothing, ten times in a contact."""

    h = 3e-3

    def step(self, t, q, qdot):
        return [0.0]


@pytest.mark.parametrize("law", [zivi.SpringDamper(1e4, 20.0), spring_and_damper])
def test_closed_loops_have_them(law):
    floor = zivi.LinearGap([1.0], contact=law)
    ball = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[floor], inputs=[[1.0]])
    run = zivi.simulate_closed_loop(ball, Idle(), (0, 1.998), ([1.0], [0.0]), method=METHOD)
    assert np.abs(switches(run) - SWITCHES).max() < 1e-8
    assert run.contacts.sum() > 25


def test_trees_have_them():
    # a pendulum that falls from the horizontal on a rubber stop, and a ball on a mat
    stop = zivi.mechanics.JointLimit("arm", lower=-0.5, contact=zivi.SpringDamper(40.0, 0.5))
    arm = zivi.mechanics.Body(
        "arm",
        kind="hinge",
        axis=[0, -1, 0],
        mass=1.0,
        com=[0.5, 0, 0],
        inertia=[1e-9, 1e-9, 1e-9],
    )
    pendulum = zivi.Tree([arm], gaps=[stop])
    sol = zivi.simulate(pendulum, (0, 2), ([0.0], [0.0]), METHOD)

    def rate(t, z):
        depth = -0.5 - z[0]
        stopped = max(0.0, 40.0 * depth - 0.5 * z[1]) if depth > 0 else 0.0
        return [z[1], (-G * 0.5 * np.cos(z[0]) + stopped) / (0.25 + 1e-9)]

    other = scipy.integrate.solve_ivp(
        rate, (0, 2), [0, 0], "DOP853", rtol=1e-10, atol=1e-12, max_step=1e-3
    )
    assert len(sol.touchdowns) >= 1
    assert np.abs([sol.q[-1, 0] - other.y[0, -1], sol.qdot[-1, 0] - other.y[1, -1]]).max() < 1e-6
    with pytest.raises(ValueError, match=r"e of gap 'arm.lower' must be 0"):
        pendulum.replace(e=0.5)
    ball = zivi.mechanics.Body("ball", kind="slide", axis=[0, 0, 1], mass=1.0)
    mat = zivi.mechanics.PlaneGap("ball", contact=zivi.SpringDamper(1e4, 20.0))
    sol = zivi.simulate(zivi.Tree([ball], gaps=[mat]), (0, 2), ([1.0], [0.0]), METHOD)
    assert np.abs(switches(sol) - SWITCHES).max() < 1e-8
