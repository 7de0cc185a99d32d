"""Impact laws of gaps: one mass, parabolas, complementarity, differences, friction, files."""

import dataclasses
import itertools
import math
import pickle

import numpy as np
import pytest

import zivi
from inside import FileError, prepare_simulate
from zivi.mechanics import Body, PlaneGap

G = 9.81
PLASTIC = zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25)
CAPPED = zivi.SpeedDependentImpact(e0=0.7, v0=2.0, k=0.2, e_max=0.9)
FALLING = zivi.SpeedDependentImpact(e0=0.6, v0=1.0, k=-0.3)
LAWS = {"plastic": PLASTIC, "capped": CAPPED, "falling": FALLING}
TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
FLOOR, WALL = zivi.LinearGap([0, 1], name="floor"), zivi.LinearGap([-1, 0], 0.8, name="wall")


def after(law, v):
    """Give the speed after an impact as the law is stated."""
    return min(law.e0 * (v / law.v0) ** -law.k, law.e_max) * v


def box(e, mass=None, gaps=(FLOOR, WALL)):
    mass = np.eye(2) if mass is None else mass
    return zivi.MechanicalSystem(mass=mass, force=[2.0, -G], gaps=gaps, e=e)


def impacts_of_one(law, distance, acceleration, until):
    """Give times and speeds before and after, where a mass falls from rest onto a wall."""
    v = math.sqrt(2.0 * acceleration * distance)
    t, rows = v / acceleration, []
    while t < until and v > 1e-6:
        rows.append((t, v, after(law, v)))
        v = rows[-1][2]
        t += 2.0 * v / acceleration
    return np.array(rows)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_one_coordinate_is_one_mass(law):
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)
    ball = zivi.MechanicalSystem(mass=2.0, force=[-2.0 * G], gaps=[zivi.LinearGap([1])], e=law)
    many = zivi.simulate(ball, (0, 6), ([1.0], [0.3]), method)
    one = zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 6), (1.0, 0.3), method)
    n = min(len(one.impacts), len(many.impacts))
    assert n >= 9
    assert np.allclose(many.impacts["t"][:n], one.impacts["t"][:n], rtol=0, atol=1e-11)
    assert many.rest_time == (
        None if one.rest_time is None else pytest.approx(one.rest_time, abs=1e-11)
    )
    assert many.q[-1, 0] == pytest.approx(one.x[-1], abs=1e-9)


def test_each_gap_has_its_own_law():
    sol = zivi.simulate(box([CAPPED, PLASTIC]), (0, 2.5), ([0.0, 1.0], [0.0, 0.0]), TIGHT)
    for gap, law, distance, acceleration in ((0, CAPPED, 1.0, G), (1, PLASTIC, 0.8, 2.0)):
        expected = impacts_of_one(law, distance, acceleration, 2.5)
        own = sol.impacts[sol.impacts["gap"] == gap][: len(expected)]
        assert len(own) == len(expected) >= 4
        found = np.column_stack([own["t"], -own["speed_before"], own["speed_after"]])
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-10)


def solved(D, q):
    """Solve ``0 <= P, D P + q >= 0, P.(D P + q) = 0`` by trying all sets."""
    for size in range(len(q) + 1):
        for chosen in map(list, itertools.combinations(range(len(q)), size)):
            P = np.zeros(len(q))
            if chosen:
                P[chosen] = np.linalg.solve(D[np.ix_(chosen, chosen)], -q[chosen])
            if np.all(P >= -1e-13) and np.all(D @ P + q >= -1e-13):
                return P
    raise AssertionError


def test_gaps_hit_at_once_solve_the_complementarity_problem_of_their_laws():
    """``0 <= P, g'+ + e_i(-g'-) g'- >= 0`` orthogonal, with ``e_i`` at the speed before."""
    rng = np.random.default_rng(7)
    together = 0
    for _ in range(60):
        root = rng.normal(size=(2, 2))
        mass = root @ root.T + 0.3 * np.eye(2)
        angles = rng.uniform(0.2, 1.3), rng.uniform(1.8, 2.9)
        normals = np.array([[np.cos(a), np.sin(a)] for a in angles])
        laws = [rng.choice([PLASTIC, CAPPED, FALLING]) for _ in angles]
        gaps = [zivi.LinearGap(normal) for normal in normals]
        velocity = -np.linalg.solve(normals, rng.uniform(0.2, 4.0, 2))
        start = -0.1 * velocity  # reaches the corner at t = 0.1 without force
        system = zivi.MechanicalSystem(mass=mass, force=[0.0, 0.0], gaps=gaps, e=laws)
        sol = zivi.simulate(system, (0, 0.15), (start, velocity), TIGHT)
        before = normals @ velocity
        D = normals @ np.linalg.solve(mass, normals.T)
        e = np.array([after(law, -u) / -u for law, u in zip(laws, before, strict=True)])
        P = solved(D, before + e * before)
        if len(set(np.round(sol.impacts["t"], 9))) > 1 or not np.all(D @ P + before > 1e-6):
            continue  # one was hit a rounding before the other, or another impact follows
        together += 1
        expected = velocity + np.linalg.solve(mass, normals.T @ P)
        assert np.allclose(sol.qdot[-1], expected, rtol=1e-7, atol=1e-8)
        energy = [w @ mass @ w for w in (velocity, sol.qdot[-1])]
        assert energy[1] <= energy[0] * (1 + 1e-12)
    assert together >= 20


def test_no_run_gains_energy():
    rng = np.random.default_rng(3)
    for _ in range(12):
        root = rng.normal(size=(2, 2))
        mass = root @ root.T + 0.3 * np.eye(2)
        laws = [rng.choice([PLASTIC, CAPPED, FALLING]), float(rng.uniform(0, 1))]
        start = rng.uniform(0.1, 0.7, 2), rng.normal(size=2)
        sol = zivi.simulate(box(laws, mass), (0, 2), start, TIGHT)
        energy = 0.5 * np.einsum("ki,ij,kj->k", sol.qdot, mass, sol.qdot) - sol.q @ np.array(
            [2.0, -G]
        )
        assert np.all(np.diff(energy) <= 1e-9 * np.ptp(energy) + 1e-9)


@pytest.mark.parametrize("law", [CAPPED, FALLING], ids=["capped", "falling"])
def test_impacts_accumulate_at_the_time_of_the_parabolas(law):
    sol = zivi.simulate(box([law, 0.2]), (0, 30), ([0.0, 1.0], [0.0, 0.0]), TIGHT)
    rows = impacts_of_one(law, 1.0, G, 30)
    e = {"capped": 0.9, "falling": 0.0}["capped" if law is CAPPED else "falling"]
    rest = rows[-1, 0] + 2.0 * rows[-1, 2] / G / (1.0 - e)
    own = sol.zeno_times[np.argmin(np.abs(sol.zeno_times - rest))]
    assert own == pytest.approx(rest, abs=3e-7 if law is FALLING else 1e-9)
    assert sol.q[-1, 1] == pytest.approx(0.0, abs=1e-15)


def test_with_friction_the_law_is_taken_at_the_speed_before():
    """A point slides into a floor with friction: ``du = mu (1 + e(v)) v``, as long as it slides."""
    mu, v, u = 0.3, 3.0, 8.0
    for impact_law in ("newton", "poisson", "stronge"):
        floor = zivi.LinearGap([0, 1], name="floor", tangent=[1, 0], mu=mu)
        system = zivi.MechanicalSystem(
            mass=np.eye(2), force=[0, 0], gaps=[floor], e=PLASTIC, impact_law=impact_law
        )
        sol = zivi.simulate(system, (0, 0.2), ([0, 0.3], [u, -v]), TIGHT)
        rebound = after(PLASTIC, v)
        assert np.allclose(sol.qdot[-1], [u - mu * (v + rebound), rebound], rtol=1e-12)


WRT = ("q0", "qdot0", "e.floor", "law.wall.e0", "law.wall.v0", "law.wall.k", "law.wall.e_max")


@pytest.mark.parametrize("until", [1.3, 6.0], ids=["through impacts", "to rest"])
@pytest.mark.parametrize("coupling", [0.0, 0.3])
def test_derivatives_are_differences(coupling, until):
    mass = np.array([[1.0, coupling], [coupling, 1.5]])
    start = np.array([0.1, 1.0]), np.array([0.2, -0.1])

    def run(name=None, step=0.0):
        e, wall, state = 0.5, CAPPED, [part.copy() for part in start]
        if name is not None and name.startswith("law."):
            of = name.rsplit(".", 1)[1]
            wall = dataclasses.replace(CAPPED, **{of: getattr(CAPPED, of) + step})
        elif name == "e.floor":
            e += step
        elif name is not None:
            state[0 if name.startswith("q0") else 1][int(name[-1])] += step
        return zivi.simulate(box([e, wall], mass), (0, until), tuple(state), TIGHT)

    found = zivi.sensitivity(box([0.5, CAPPED], mass), (0, until), start, WRT, TIGHT)
    plain = run()
    assert len(plain.impacts) >= 3
    assert np.allclose(found.trajectory.q[-1], plain.q[-1], rtol=1e-9, atol=1e-10)
    moves = np.max(np.abs(found.final))
    for column, name in enumerate(found.wrt):
        h = 1e-6
        high, low = run(name, h), run(name, -h)
        moved = high.q[-1] - low.q[-1], high.qdot[-1] - low.qdot[-1]
        difference = np.concatenate(moved) / (2 * h)
        error = np.abs(np.ravel(found.final[:, :, column]) - difference)
        assert np.all(error <= 2e-6 * (1.0 + moves)), name
    assert until > 2 or moves > 0.1


def test_parameters_have_the_names_of_gap_and_law():
    with pytest.raises(ValueError, match=r"unknown parameter 'e'; .*e\.floor, law\.wall\.e0"):
        zivi.sensitivity(box([0.5, CAPPED]), (0, 1), ([0.0, 1.0], [0.0, 0.0]), wrt=("e",))
    plain = box([zivi.NewtonImpact(0.5), 0.3])
    assert plain.e.tolist() == [0.5, 0.3]
    assert plain.laws == (zivi.NewtonImpact(0.5), zivi.NewtonImpact(0.3))
    assert box(CAPPED).laws == (CAPPED, CAPPED)


def test_batches_take_laws():
    systems = [box([0.5, CAPPED]), box(FALLING), box(0.4)]
    start = ([0.0, 1.0], [0.0, 0.0])
    batch = zivi.simulate_batch(
        systems, (0, 3), (np.tile(start[0], (3, 1)), np.tile(start[1], (3, 1)))
    )
    for i, system in enumerate(systems):
        sol = zivi.simulate(system, (0, 3), start)
        assert np.array_equal(batch.q[i], sol.q[-1])
        assert np.array_equal(batch.qdot[i], sol.qdot[-1])


def test_closed_loops_take_laws_of_the_plant():
    class Nothing:
        h = 0.01

        def step(self, t, q, qdot):
            return [0.0, 0.0]

    start = ([0.0, 1.0], [0.0, 0.0])
    plain = zivi.simulate(box([0.5, CAPPED]), (0, 1), start, TIGHT)
    loop = zivi.simulate_closed_loop(box([0.5, CAPPED]), Nothing(), (0, 1), start, method=TIGHT)
    assert np.allclose(loop.q[-1], plain.q[-1], rtol=0, atol=1e-9)


REFUSING = {
    "MoreauJean": lambda it: zivi.simulate(it, (0, 1), ([0, 1], [0, 0]), zivi.MoreauJean(h=1e-2)),
    "ThetaGamma": lambda it: zivi.simulate(it, (0, 1), ([0, 1], [0, 0]), zivi.ThetaGamma(h=1e-2)),
    "orbit": lambda it: zivi.periodic_orbit(it, (0.0, ([0.0, 1.0], [0.0, 0.0])), period=1.0),
    "tracker": lambda it: zivi.GapTracker(it, h=1e-3, gains=dict.fromkeys(it.gap_names, (4, 2))),
    "e": lambda it: it.e,
}


@pytest.mark.parametrize("name", REFUSING)
def test_what_needs_newtons_law_says_so(name):
    with pytest.raises(ValueError, match=r"^e must be .*Newton's impact law"):
        REFUSING[name](box([0.5, CAPPED]))


def test_what_is_out_of_range_is_named():
    with pytest.raises(ValueError, match=r"^e must be one law or one for each of the 2 gaps"):
        box([CAPPED])
    with pytest.raises(ValueError, match=r"^e must be a number from 0 to 1"):
        box([CAPPED, 1.5])
    with pytest.raises(TypeError, match=r"^e\[1\] must be a real number"):
        box([CAPPED, "a"])


def test_laws_are_kept_in_what_keeps_a_system():
    system = box([0.5, CAPPED])
    again = pickle.loads(pickle.dumps(system))
    assert again.laws == system.laws
    assert repr(again) == repr(system)
    assert f"e=(NewtonImpact(e=0.5), {CAPPED!r})" in repr(system)
    start = ([0.0, 1.0], [0.0, 0.0])
    sol = zivi.simulate(system, (0, 3), start)
    assert sol.config["e"][1]["name"] == "SpeedDependentImpact"
    twin = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(twin(1.234)[0], sol(1.234)[0])
    assert sol.trusted_until == 3.0

    def build(mass):
        return box([0.5, CAPPED], mass=mass * np.eye(2))

    parametric = zivi.ParametricSystem(build, {"mass": 1.0})
    wrt = ("mass", "law.wall.e0")
    found = zivi.sensitivity(parametric, (0, 1.3), start, wrt=wrt, method=TIGHT)
    high, low = (zivi.simulate(build(1 + h), (0, 1.3), start, TIGHT) for h in (1e-6, -1e-6))
    assert np.allclose(found.final[0, :, 0], (high.q[-1] - low.q[-1]) / 2e-6, rtol=1e-4, atol=1e-5)
    moved = zivi.ParametricSystem(
        lambda k: box([0.5, dataclasses.replace(CAPPED, k=k)]), {"k": 0.2}
    )
    by_build = zivi.sensitivity(moved, (0, 1.3), start, wrt=("k",), method=TIGHT)
    by_name = zivi.sensitivity(box([0.5, CAPPED]), (0, 1.3), start, ("law.wall.k",), TIGHT)
    assert np.allclose(by_build.final, by_name.final, rtol=1e-9, atol=1e-10)


# Derivatives by tables and functions.

NODES, RATIOS = [0.0, 1.0, 2.0, 4.0], [0.8, 0.6, 0.5, 0.4]


def rest_of_a_drop(ratios, height=1.0, g=9.81):
    """Sum of the times of flight of a ball whose restitution is linear between the nodes."""
    v = math.sqrt(2 * g * height)
    t = v / g
    while v > 1e-9:
        v *= np.interp(v, NODES, ratios)
        t += 2 * v / g
    return t + 2 * v / g * ratios[0] / (1 - ratios[0])


def test_values_of_a_table():
    table = zivi.RestitutionTable(NODES, RATIOS)
    ball = zivi.ImpactSystem(-9.81, e=table)
    names = tuple(f"law.e[{i}]" for i in range(4))
    s = zivi.sensitivity(ball, (0, 3), (1, 0), names, TIGHT)
    wanted = []
    for i in range(4):
        ends = [
            rest_of_a_drop([e + h * (j == i) for j, e in enumerate(RATIOS)])
            for h in (1e-5, -1e-5, 2e-5, -2e-5)
        ]
        wanted.append((8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / 12e-5)
    assert s.trajectory.rest_time == pytest.approx(rest_of_a_drop(RATIOS), abs=1e-9)
    assert np.allclose(s.zeno_times[0], wanted, rtol=1e-7, atol=1e-8)
    floor = zivi.LinearGap([1.0], name="floor")
    same = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[floor], e=[table])
    names = tuple(f"law.floor.e[{i}]" for i in range(4))
    found = zivi.sensitivity(same, (0, 3), ([1.0], [0.0]), names, TIGHT)
    assert np.allclose(found.zeno_times, s.zeno_times, rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match=r"did you mean 'law\.e\[3\]'"):
        zivi.sensitivity(ball, (0, 3), (1, 0), ("law.e[4]",))


@pytest.mark.parametrize("kind", ["function", "table", "newton"])
def test_laws_that_a_parameter_moves(kind):
    def build(c, m):
        laws = {
            "function": lambda v: 1 / (1 + c * v**0.6),
            "table": zivi.RestitutionTable([0.0, 1.0 + c, 4.0], [0.8 - c, 0.5, 0.3]),
            "newton": 0.5 + 0.3 * c,
        }
        walls = [
            zivi.LinearGap([1.0], name="floor"),
            zivi.LinearGap([-1.0], 1.5, name="roof"),
        ]
        return zivi.MechanicalSystem(mass=m, force=[-9.81], gaps=walls, e=[laws[kind], 0.7])

    start, values = ([1.0], [4.0]), {"c": 0.2, "m": 1.2}
    system = zivi.ParametricSystem(build, values)
    s = zivi.sensitivity(system, (0, 1.2), start, ("c", "m"), TIGHT)
    assert s.status is zivi.OrbitStatus.COMPLETED
    assert len(s.trajectory.impacts) >= 2

    def final(h, name):
        sol = zivi.simulate(build(**(values | {name: values[name] + h})), (0, 1.2), start, TIGHT)
        return np.array([sol.q[-1], sol.qdot[-1]])

    for j, name in enumerate(values):
        one, two = ((final(h, name) - final(-h, name)) / (2 * h) for h in (1e-4, 2e-4))
        assert np.allclose(s.final[:, :, j], (4 * one - two) / 3, rtol=1e-6, atol=1e-6)


def test_other_systems_take_laws():
    linear = zivi.LinearSystem(
        [[1.0]], None, [[4.0]], gaps=[zivi.LinearGap([1.0], 0.0, name="stop")], e=CAPPED
    )
    sol = zivi.simulate(linear, (0, 3), ([1.0], [0.0]), TIGHT)
    first = sol.impacts[0]
    assert first["t"] == pytest.approx(np.pi / 4, rel=1e-9)
    assert first["speed_after"] == pytest.approx(after(CAPPED, 2.0), rel=1e-9)
    again = pickle.loads(pickle.dumps(linear))
    assert again.laws == (CAPPED,)


FILE = """
t_span = [0, 2]
y0 = [[0.0, 1.0], [0.0, 0.0]]

[system]
q = ["x", "y"]
T = "(xdot**2 + ydot**2)/2"
V = "9.81*y - 2*x"
gaps = { floor = "y", wall = "0.8 - x" }
e = [0.5, { law = "SpeedDependentImpact", e0 = 0.7, v0 = 2.0, k = 0.2, e_max = 0.9 }]
"""


def test_a_file_gives_laws(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text(FILE)
    sol = prepare_simulate(path).run(False)
    plain = zivi.simulate(box([0.5, CAPPED]), (0, 2), ([0.0, 1.0], [0.0, 0.0]))
    assert np.allclose(sol.q[-1], plain.q[-1], rtol=0, atol=1e-6)
    path.write_text(FILE.replace("k = 0.2", "k = 1.2"))
    with pytest.raises(FileError, match=r"system\.e\[1\]\.k must be"):
        prepare_simulate(path).run(False)


def test_a_tree_is_written_with_its_laws(tmp_path):
    bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    tree = zivi.Tree([bob], gaps=[PlaneGap("bob", [0, 0, -1], offset=-0.8)], e=CAPPED)
    path = tmp_path / "run.toml"
    path.write_text(zivi.files.tree_text(tree, (0, 2), ([1.5], [0.0])))
    sol = prepare_simulate(path).run(False)
    plain = zivi.simulate(tree, (0, 2), ([1.5], [0.0]))
    assert np.allclose(sol.q[-1], plain.q[-1], rtol=0, atol=1e-9)
    assert pickle.loads(pickle.dumps(tree)).laws == (CAPPED,)
    assert tree.replace(e=0.5).e.tolist() == [0.5]
