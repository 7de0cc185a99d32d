"""Equality rows: closed chains, prescribed motion, dependent rows, impacts with them."""

import copy
import itertools
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi

G = 9.81
TOLERANCES = (1e-6, 1e-9, 1e-12)


def method(tol, **more):
    return zivi.SwitchedRK(rtol=tol, atol=tol, **more)


def distance(a, b, n, length=1.0, name="rod"):
    """The row of a rod between the points of coordinates `a` and `b`, the origin if None."""

    def apart(q):
        far = np.zeros(2) if b is None else q[list(b)]
        return q[list(a)] - far

    def gradient(t, q):
        row, d = np.zeros(n), apart(q)
        row[list(a)] = d
        if b is not None:
            row[list(b)] = -d
        return row

    return zivi.Equality(
        lambda t, q: 0.5 * (apart(q) @ apart(q) - length**2),
        gradient,
        curvature=lambda t, q, v: apart(v) @ apart(v),
        name=name,
    )


def double_pendulum(extra=(), **more):
    rows = [distance((0, 1), None, 4, name="upper"), distance((2, 3), (0, 1), 4, name="lower")]
    return zivi.MechanicalSystem(
        mass=np.eye(4), force=[0, -G, 0, -G], equalities=[*rows, *extra], **more
    )


def angles(gaps=(), **more):
    def mass(t, q):
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    def force(t, q, w):
        s = np.sin(q[0] - q[1])
        one = -s * w[1] ** 2 - 2 * G * np.sin(q[0])
        return np.array([one, s * w[0] ** 2 - G * np.sin(q[1])])

    return zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, **more)


def points(q):
    (s, c), (s2, c2) = (np.sin(q[0]), np.cos(q[0])), (np.sin(q[1]), np.cos(q[1]))
    return np.array([s, -c, s + s2, -c - c2])


def speeds(q, w):
    one, two = np.array([np.cos(q), np.sin(q)]).T * np.asarray(w)[:, None]
    return np.concatenate([one, one + two])


def drift(q):
    upper, lower = q[:, :2], q[:, 2:] - q[:, :2]
    return max(np.abs(0.5 * ((it**2).sum(axis=1) - 1.0)).max() for it in (upper, lower))


def exact(start, T):
    def rhs(t, y):
        c, s = np.cos(y[0] - y[1]), np.sin(y[0] - y[1])
        right = [-s * y[3] ** 2 - 2 * G * np.sin(y[0]), s * y[2] ** 2 - G * np.sin(y[1])]
        return [*y[2:], *np.linalg.solve([[2.0, c], [c, 1.0]], right)]

    run = solve_ivp(rhs, (0, T), [*start, 0.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-14)
    return points(run.y[:2, -1])


def test_a_double_pendulum_in_cartesian_coordinates_is_that_in_angles():
    rows, minimal = double_pendulum(), angles()
    evaluations = np.zeros((3, 2))
    starts = [(1.5, 2.0), (np.pi / 2, np.pi / 2), (1.0, 2.0), (2.5, 2.5)]
    for start, (k, tol) in itertools.product(starts, enumerate(TOLERANCES)):
        end = exact(start, 3.0)
        sol = zivi.simulate(rows, (0, 3), (points(start), np.zeros(4)), method(tol))
        assert np.abs(sol.q[-1] - end).max() < 20 * tol + 1e-11
        assert drift(sol.q) <= 1e-14
        other = zivi.simulate(minimal, (0, 3), (start, np.zeros(2)), method(tol))
        evaluations[k] += [sol.nfev, other.nfev]
        energy = 0.5 * (sol.qdot**2).sum(axis=1) + G * (sol.q[:, 1] + sol.q[:, 3])
        assert np.abs(energy - energy[0]).max() < 300 * tol + 1e-11
    assert (evaluations[:, 0] <= evaluations[:, 1]).all()


def test_dependent_rows_change_nothing_and_share_their_forces():
    start = (1.5, 2.0)
    doubled = zivi.Equality(
        lambda t, q: q[0] ** 2 + q[1] ** 2 - 1.0,
        lambda t, q: np.array([2 * q[0], 2 * q[1], 0.0, 0.0]),
        curvature=lambda t, q, v: 2 * (v[0] ** 2 + v[1] ** 2),
        name="doubled",
    )
    again = distance((2, 3), (0, 1), 4, name="again")
    at, t = (points(start), np.zeros(4)), np.linspace(0, 3, 11)
    for tol in TOLERANCES:
        sol = zivi.simulate(double_pendulum(), (0, 3), at, method(tol), t_eval=t)
        more = double_pendulum([doubled, again])
        more = zivi.simulate(more, (0, 3), at, method(tol), t_eval=t)
        assert abs(more.nfev - sol.nfev) <= 0.02 * sol.nfev
        assert np.abs(more.q[-1] - sol.q[-1]).max() < 1e-12
        assert list(more.flags["kind"]) == ["undetermined_forces"]
        upper, lower, twice, other = more.constraint_forces.T
        # the row that is twice the first has half the multiplier at equal work
        assert np.abs(upper - 2 * twice).max() < 1e-9 * np.abs(upper).max()
        assert np.abs(lower - other).max() < 1e-9 * np.abs(lower).max()
        forces = np.column_stack([upper + 2 * twice, lower + other])
        assert np.abs(forces - sol.constraint_forces).max() < (tol + 1e-9) * np.abs(forces).max()
    assert len(sol.flags) == 0


def test_rows_that_contradict_each_other_end_the_run():
    other = zivi.Equality(
        lambda t, q: q[0] - 0.6,
        lambda t, q: np.array([1.0, 0.0]),
        curvature=0.0,
        name="post",
    )
    moving = zivi.Equality(
        lambda t, q: q[0] - 0.6 - t**2,
        lambda t, q: np.array([1.0, 0.0]),
        curvature=-2.0,
        rate=lambda t, q: -2.0 * t,
        name="moving",
    )
    bead = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], equalities=[other, moving])
    sol = zivi.simulate(bead, (0, 1), ([0.6, 0.0], [0.0, 0.0]))
    assert sol.status is zivi.Status.INCONSISTENT_CONSTRAINTS
    assert sol.t[-1] < 1.0


def slider_crank(**more):
    """A crank of 1 that turns with 3 rad/s, a rod of 2.5: coordinates th, ph, x."""

    def pin(t, q):
        return np.cos(q[0]) + 2.5 * np.cos(q[1]) - q[2]

    rows = [
        zivi.Equality(
            pin,
            lambda t, q: np.array([-np.sin(q[0]), -2.5 * np.sin(q[1]), -1.0]),
            lambda t, q, v: -np.cos(q[0]) * v[0] ** 2 - 2.5 * np.cos(q[1]) * v[1] ** 2,
            name="along",
        ),
        zivi.Equality(
            lambda t, q: np.sin(q[0]) + 2.5 * np.sin(q[1]),
            lambda t, q: np.array([np.cos(q[0]), 2.5 * np.cos(q[1]), 0.0]),
            lambda t, q, v: -np.sin(q[0]) * v[0] ** 2 - 2.5 * np.sin(q[1]) * v[1] ** 2,
            name="across",
        ),
        zivi.Equality(
            lambda t, q: q[0] - 3.0 * t,
            [1.0, 0.0, 0.0],
            curvature=0.0,
            rate=-3.0,
            name="drive",
        ),
    ]
    return zivi.MechanicalSystem(
        mass=np.diag([0.3, 0.2, 1.0]), force=np.zeros(3), equalities=rows, **more
    )


def test_a_prescribed_crank_moves_the_slider_exactly():
    # sin ph = -sin th/2.5, x = cos th + 2.5 cos ph at th = 30
    ph, x = 0.40629933532052935081, 2.4507255973128107503
    system = slider_crank()
    start = zivi.consistent(system, [0.0, 0.0, 3.5])
    assert np.abs(start[1] - [3.0, -1.2, 0.0]).max() < 1e-14
    for tol in TOLERANCES:
        sol = zivi.simulate(system, (0, 10), start, method(tol))
        assert abs(sol.q[-1, 1] - ph) < 1e-14
        assert abs(sol.q[-1, 2] - x) < 1e-14
        assert abs(sol.q[-1, 0] - 30.0) < 1e-14


def test_constraint_forces_are_those_of_a_pendulum():
    # tension: m (w^2 + g cos), with w^2 = 2 g cos from the horizontal; mu = -tension/l, l = 1
    rod = distance((0, 1), None, 2)
    system = zivi.MechanicalSystem(mass=2.0 * np.eye(2), force=[0, -2 * G], equalities=[rod])
    t = np.linspace(0, 2, 41)
    sol = zivi.simulate(system, (0, 2), ([1, 0], [0, 0]), method(1e-11), t_eval=t)
    tension = 2.0 * 3 * G * -sol.q[:, 1]
    assert np.abs(sol.constraint_forces[:, 0] + tension).max() < 1e-8
    dense = zivi.simulate(system, (0, 2), ([1, 0], [0, 0]), method(1e-11), dense_output=True)
    assert np.abs(dense.resample(t).constraint_forces - sol.constraint_forces).max() < 1e-8


# Impacts and contact.


def skewed(rng, n):
    """Coordinates that are neither orthogonal nor scaled alike."""
    return (
        np.linalg.qr(rng.normal(size=(n, n)))[0]
        * rng.uniform(0.3, 3.0, n)
        @ (np.eye(n) + 0.3 * rng.normal(size=(n, n)))
    )


@pytest.mark.parametrize("dependent", [False, True])
def test_impacts_with_rows_are_those_in_minimal_coordinates(dependent):
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(100):
        n, k, m = 5, 2, int(rng.integers(1, 4))
        A = rng.normal(size=(n, n))
        mass, rows = A @ A.T + np.eye(n), rng.normal(size=(k, n))
        free = np.linalg.svd(rows)[2][k:].T @ skewed(rng, n - k)
        normals, e = rng.normal(size=(m, n)), rng.uniform(0, 1, m)
        s = rng.normal(size=n - k)
        v = free @ s
        normals[normals @ v > 0] *= -1.0
        given = np.vstack([rows, rng.normal(size=(2, k)) @ rows]) if dependent else rows
        equal = [zivi.Equality(0.0, row, name=f"row{i}") for i, row in enumerate(given)]
        ours = zivi.MechanicalSystem(
            mass=mass,
            force=np.zeros(n),
            gaps=[zivi.LinearGap(row) for row in normals],
            e=e,
            equalities=equal,
        )
        other = zivi.MechanicalSystem(
            mass=free.T @ mass @ free,
            force=np.zeros(n - k),
            gaps=[zivi.LinearGap(row @ free) for row in normals],
            e=e,
        )
        one = zivi.simulate(ours, (0, 1e-3), (np.zeros(n), v))
        two = zivi.simulate(other, (0, 1e-3), (np.zeros(n - k), s))
        assert len(one.impacts) == len(two.impacts) > 0
        change = np.abs(one.qdot[-1] - free @ two.qdot[-1]).max() / np.abs(v).max()
        worst = max(worst, change)
        assert np.abs(rows @ one.qdot[-1]).max() < 1e-13 * np.abs(v).max() * np.abs(rows).sum()
    assert worst < 1e-12


def floor(q_of, h, mu):
    """The floor below the tip of a double pendulum, in points or in angles."""
    if q_of == "points":
        more = {"tangent": [0, 0, 1.0, 0], "mu": mu} if mu else {}
        return zivi.LinearGap([0, 0, 0, 1.0], h, name="floor", **more)
    more = {}
    if mu:
        more = {
            "tangent": lambda t, q: np.cos(q),
            "tangent_curvature": lambda t, q, v: -np.sin(q) @ v**2,
            "mu": mu,
        }
    return zivi.Gap(
        lambda t, q: h - np.cos(q).sum(),
        lambda t, q: np.sin(q),
        lambda t, q, v: np.cos(q) @ v**2,
        name="floor",
        **more,
    )


@pytest.mark.parametrize(
    ("mu", "e", "h"), [(0.0, 0.5, 1.5), (0.0, 0.0, 1.5), (0.2, 0.5, 1.5), (0.1, 0.0, 1.6)]
)
def test_bounces_rest_and_friction_with_rows_are_those_in_angles(mu, e, h):
    start = (1.3, 1.0)
    ours = double_pendulum(gaps=[floor("points", h, mu)], e=e)
    other = angles(gaps=[floor("angles", h, mu)], e=e)
    for tol in (1e-7, 1e-10):
        one = zivi.simulate(ours, (0, 3), (points(start), np.zeros(4)), method(tol))
        two = zivi.simulate(other, (0, 3), (start, np.zeros(2)), method(tol))
        assert np.abs(one.q[-1] - points(two.q[-1])).max() < 20 * tol
        assert np.abs(one.qdot[-1] - speeds(two.q[-1], two.qdot[-1])).max() < 20 * tol
        assert np.abs(one.zeno["t"] - two.zeno["t"]).max() < 20 * tol
        assert len(one.liftoffs) == len(two.liftoffs)
        assert np.array_equal(one.modes[-1], two.modes[-1])
        assert np.abs(one.reactions[-1] - two.reactions[-1]).max() < 2e3 * tol
        assert drift(one.q) <= 1e-14


def test_rest_with_rows_is_exact():
    ours = double_pendulum(gaps=[floor("points", 1.5, 0.5)], e=0.3)
    sol = zivi.simulate(ours, (0, 5), (points((1.3, 1.0)), np.zeros(4)))
    assert sol.rest_time is not None
    after = sol.t > sol.rest_time
    assert np.abs(sol.qdot[after]).max() < 1e-60
    assert np.abs(np.diff(sol.q[after], axis=0)).max() < 2e-14


def in_coordinates(row, S):
    """The same row where the coordinates are S times others."""
    return zivi.Equality(
        lambda t, q: row.value(t, S @ q),
        lambda t, q: S.T @ row.gradient(t, S @ q),
        lambda t, q, v: row.curvature(t, S @ q, S @ v),
        name=row.name,
    )


def test_a_family_of_chains_in_skewed_coordinates_is_one_motion():
    rng = np.random.default_rng(11)
    at = points((1.2, 0.4))
    plain = zivi.simulate(double_pendulum(), (0, 2), (at, np.zeros(4)), method(1e-11))
    for _ in range(4):
        S = skewed(rng, 4)
        inverse = np.linalg.inv(S)
        rows = [in_coordinates(row, S) for row in double_pendulum().equalities]
        turned = zivi.MechanicalSystem(mass=S.T @ S, force=S.T @ [0, -G, 0, -G], equalities=rows)
        sol = zivi.simulate(turned, (0, 2), (inverse @ at, np.zeros(4)), method(1e-11))
        assert np.abs(sol.q[-1] @ S.T - plain.q[-1]).max() < 1e-9
        assert drift(sol.q @ S.T) < 1e-13


@pytest.mark.parametrize("t", [0.0, 0.5])
def test_a_kick_leaves_what_the_rows_allow(t):
    # at the lowest point the row takes the vertical part
    rod = distance((0, 1), None, 2)
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], equalities=[rod])
    kick = zivi.Kick(t=t, dv=[0.3, 1.0])
    sol = zivi.simulate(system, (0, t + 0.5), ([0, -1], [0, 0]), method(1e-10), kicks=[kick])
    at = np.arange(len(sol.t)) >= np.flatnonzero(sol.t == t)[-1]
    assert np.abs(sol.qdot[at][0] - [0.3, 0.0]).max() < 1e-14
    energy = 0.5 * (sol.qdot[at] ** 2).sum(axis=1) + G * sol.q[at][:, 1]
    assert np.abs(energy - (0.045 - G)).max() < 1e-9


def test_a_linear_system_with_rows_is_the_one_that_they_leave():
    # three masses between springs, the last two welded
    M, K = np.diag([1.0, 2.0, 3.0]), np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    row = zivi.Equality(0.0, [0.0, 1.0, -1.0], name="weld")
    stop = {"normal": [-1.0, 0.0, 0.0], "offset": 0.2}
    ours = zivi.LinearSystem(M, None, K, gaps=[zivi.LinearGap(**stop)], e=0.5, equalities=[row])
    Z = np.array([[1.0, 0], [0, 1], [0, 1]])
    other = zivi.LinearSystem(
        Z.T @ M @ Z, None, Z.T @ K @ Z, gaps=[zivi.LinearGap([-1.0, 0.0], 0.2)], e=0.5
    )
    start = (np.array([0.1, -0.5]), np.array([1.0, 0.3]))
    at = (Z @ start[0], Z @ start[1])
    one = zivi.simulate(ours, (0, 9), at, method(1e-11))
    two = zivi.simulate(other, (0, 9), start, method(1e-11))
    assert len(one.impacts) == len(two.impacts) > 0
    assert np.abs(one.q[-1] - Z @ two.q[-1]).max() < 1e-8
    force = one.constraint_forces[-1, 0]
    a = np.linalg.solve(Z.T @ M @ Z, -Z.T @ K @ Z @ two.q[-1])
    assert abs(force - (2.0 * a[1] + (K @ one.q[-1])[1])) < 1e-7
    assert ours.replace(e=0.2).equality_names == ("weld",)
    assert pickle.loads(pickle.dumps(ours)).equality_names == ("weld",)
    modal = zivi.LinearSystem(M, None, K, modes=3, equalities=[row])
    Phi = modal.shapes
    eta = np.linalg.solve(Phi, at[0]), np.linalg.solve(Phi, at[1])
    free = zivi.LinearSystem(M, None, K, equalities=[row])
    end = zivi.simulate(free, (0, 3), at, method(1e-11)).q[-1]
    assert np.abs(Phi @ zivi.simulate(modal, (0, 3), eta, method(1e-11)).q[-1] - end).max() < 1e-9
    with pytest.raises(ValueError, match="must have an array as gradient"):
        zivi.LinearSystem(M, None, K, equalities=[distance((0, 1), None, 3)])


# Starts, refusals, results.


def test_a_start_off_the_rows_names_the_row_and_the_remedy():
    system = double_pendulum()
    with pytest.raises(ValueError, match=r"equality 'lower'.*zivi\.consistent"):
        zivi.simulate(system, (0, 1), ([1, 0, 2.1, 0], np.zeros(4)))
    with pytest.raises(ValueError, match=r"qdot0 must obey equality 'upper'"):
        zivi.simulate(system, (0, 1), ([1, 0, 2, 0], [1, 0, 1, 0]))
    q, v = zivi.consistent(system, [1, 0, 2.1, 0], [1, 0, 1, 0.5])
    assert np.abs(system.at(0, q, v).equalities).max() < 1e-15
    assert np.abs(system.at(0, q, v).equality_gradients @ v).max() < 1e-15
    assert zivi.simulate(system, (0, 1), (q, v)).status == 0
    near = np.array([1, 0, 2, 0]) + 1e-10
    assert drift(zivi.simulate(system, (0, 1), (near, np.zeros(4))).q) <= 1e-14
    parallel = [zivi.Equality(float(c), [1.0, 0.0], name=f"r{c}") for c in (0, 1)]
    with pytest.raises(ValueError, match="remove rows that contradict each other"):
        zivi.consistent(
            zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], equalities=parallel), [0, 0]
        )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"gradient": lambda t, q: np.array([q[0], 0.5 * q[1]])}, "gradient"),
        ({"curvature": lambda t, q, v: 0.0}, "curvature of equality 'rod'"),
        ({"value": lambda t, q: 0.5 * (q @ q - 1.0) + t}, "depends on time: give its rate"),
    ],
)
def test_wrong_derivatives_of_rows_are_named(change, told):
    given = {
        "value": lambda t, q: 0.5 * (q @ q - 1.0),
        "gradient": lambda t, q: q,
        "curvature": lambda t, q, v: v @ v,
        "name": "rod",
    }
    row = zivi.Equality(**given | change)
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], equalities=[row])
    with pytest.raises(ValueError, match=told):
        zivi.simulate(system, (0, 1), ([0.6, 0.8], [0, 0]))


def test_bad_arguments_of_rows_are_named():
    with pytest.raises(TypeError, match="a number needs a gradient that is an array"):
        zivi.Equality(1.0, lambda t, q: q)
    with pytest.raises(ValueError, match="gradient of equality 'pin' must be a vector, not zero"):
        zivi.Equality(1.0, [0.0, 0.0])
    with pytest.raises(TypeError, match=r"equalities\[0\] must be a zivi\.Equality"):
        zivi.MechanicalSystem(mass=1.0, force=[0.0], equalities=[1])
    twice = [zivi.Equality(0.0, [1.0, 0.0]), zivi.Equality(0.0, [0.0, 1.0])]
    with pytest.raises(ValueError, match="names of equalities must differ"):
        zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], equalities=twice)
    with pytest.raises(AttributeError, match="cannot be changed"):
        twice[0].value = 1.0


def test_what_does_not_take_rows_says_so_before_it_computes():
    system, start = double_pendulum(), (points((1.0, 0.5)), np.zeros(4))
    for other in (zivi.MoreauJean(1e-3), zivi.ThetaGamma(1e-3)):
        with pytest.raises(NotImplementedError, match=r"use zivi\.SwitchedRK"):
            zivi.simulate(system, (0, 1), start, other)
    with pytest.raises(NotImplementedError, match="equality rows are not supported"):
        zivi.sensitivity(system, (0, 1), start, wrt=["q0"])
    with pytest.raises(NotImplementedError, match="equality rows are not supported"):
        zivi.lyapunov_exponents(system, (0, 1), start)


def test_results_hold_the_constraint_forces(tmp_path):
    system = double_pendulum(gaps=[floor("points", 1.5, 0.2)], e=0.5)
    sol = zivi.simulate(system, (0, 1), (points((1.3, 1.0)), np.zeros(4)))
    assert sol.constraint_forces.shape == (len(sol.t), 2)
    assert sol.equality_names == ("upper", "lower")
    assert "2 equality rows" in repr(sol)
    assert "equalities=(upper, lower)" in repr(system)
    assert "largest constraint forces" in sol._facts()
    frame = sol.to_pandas()
    assert np.array_equal(frame["force_lower"], sol.constraint_forces[:, 1])
    dataset = sol.to_xarray()
    assert list(dataset["equality"].values) == ["upper", "lower"]
    assert np.array_equal(dataset["constraint_forces"], sol.constraint_forces)
    for other in (pickle.loads(pickle.dumps(sol)), copy.deepcopy(sol)):
        assert np.array_equal(other.constraint_forces, sol.constraint_forces)
    zivi.files.save(sol, tmp_path / "run.nc")
    known = zivi.files.load(tmp_path / "run.nc")
    assert known.equality_names == sol.equality_names
    assert np.array_equal(known.constraint_forces, sol.constraint_forces)
    labels = [line.get_label() for line in zivi.plot.reactions(sol).lines]
    assert {"floor", "upper", "lower"} <= set(labels)
    assert system.replace(e=0.1).equality_names == ("upper", "lower")
    assert sol.config["equalities"] == ["upper", "lower"]


def test_a_system_without_rows_has_none():
    ball = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[zivi.LinearGap([1])], e=0.5)
    sol = zivi.simulate(ball, (0, 1), ([1.0], [0.0]))
    assert sol.constraint_forces.shape == (len(sol.t), 0)
    assert sol.equality_names == ()
    assert "constraint_forces" not in sol.to_xarray()
    assert zivi.consistent(ball, [1.0])[0] == [1.0]
