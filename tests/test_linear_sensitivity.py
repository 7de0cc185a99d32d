"""Derivatives along the flights of linear systems, against complex steps of matrix exponentials."""

import numpy as np
import pytest
from scipy import linalg, optimize

import zivi

STEP = 1e-30
BASE = {"k": 1.0, "c": 1.0, "m": 1.0, "omega": 3.3, "phase": 0.4, "F": 8.0, "offset": 0.15}
BASE |= {"wall": 0.02, "wall_omega": 2.1, "wall_phase": 0.3, "tilt": 0.0, "load": 1.0}


def numbers(n, seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, n, n))
    mass = np.eye(n) + 0.2 * a @ a.T / n
    damping = 0.3 * c @ c.T / n + 0.2 * np.subtract.outer(np.arange(n), np.arange(n))
    stiffness = 30.0 * (b @ b.T / n + 0.3 * np.eye(n))
    return (mass, damping, stiffness, *rng.normal(size=(4, n)))


class Oracle:
    """A system of parameters that may be complex: first, flight; then contact with its one gap."""

    def __init__(self, n, seed, **moved):
        p = BASE | moved
        mass, damping, stiffness, load, amplitude, normal, other = numbers(n, seed)
        mass, damping, stiffness = p["m"] * mass, p["c"] * damping, p["k"] * stiffness
        self.n, self.p, normal = n, p, normal + p["tilt"] * other
        inverse = np.linalg.inv(mass)
        self.rows = np.zeros((n, 2 * n + 5), complex)
        self.rows[:, :n], self.rows[:, n : 2 * n] = -inverse @ stiffness, -inverse @ damping
        self.rows[:, 2 * n] = inverse @ (p["load"] * load)
        self.rows[:, 2 * n + 1] = inverse @ (p["F"] * amplitude)
        wall = np.zeros(2 * n + 5, complex)
        wall[2 * n + 3] = p["wall"]
        self.gap = -wall
        self.gap[:n], self.gap[2 * n] = normal, p["offset"]
        self.kick = inverse @ normal / (normal @ inverse @ normal)
        self.normal = normal
        self.free = self.matrix(self.rows)
        bend = self.gap @ self.free @ self.free
        self.force = -bend
        self.held = self.matrix(self.rows - np.outer(self.kick, bend))

    def matrix(self, rows):
        n, p = self.n, self.p
        a = np.zeros((2 * n + 5, 2 * n + 5), complex)
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n] = rows
        for place, omega in ((2 * n + 1, p["omega"]), (2 * n + 3, p["wall_omega"])):
            a[place, place + 1], a[place + 1, place] = -omega, omega
        return a

    def start(self, q, v, t=0.0):
        p = self.p
        turns = p["omega"] * t + p["phase"], p["wall_omega"] * t + p["wall_phase"]
        waves = [f(turn) for turn in turns for f in (np.cos, np.sin)]
        return np.concatenate([q, v, [1.0], waves])

    def until(self, a, row, y, end):
        """When what falls first reaches zero."""
        value = lambda s: (row @ linalg.expm(a.real * s) @ y.real).real  # noqa: E731
        grid = np.arange(1e-6, end, 2e-3)
        step, z = linalg.expm(a.real * 2e-3), linalg.expm(a.real * 1e-6) @ y.real
        for low in grid:
            ahead = step @ z
            if (row.real @ ahead) < 0 <= (row.real @ z):
                return optimize.brentq(value, low, low + 2e-3, xtol=1e-15)
            z = ahead
        return None

    def run(self, q, v, end, e, t=0.0, roots=None):
        """Times of impacts, speeds after them, time of lift-off, the end; plastic ones hold.

        The lengths of the pieces may be known to rounding, from the run of a real system.
        """
        lengths = []
        y, hits, lifts = self.start(np.asarray(q), np.asarray(v), t), [], []
        n, closed = self.n, False
        while True:
            a, row = (self.held, self.force) if closed else (self.free, self.gap)
            if roots is None:
                lengths.append(self.until(a, row, y, end - t))
            s = lengths[-1] if roots is None else roots[len(hits) + len(lifts)]
            if s is None:
                y = linalg.expm(a * (end - t)) @ y
                self.lengths = lengths
                return np.array(hits), np.array(lifts), np.concatenate([y[:n], y[n : 2 * n]])
            for _ in range(3):
                there = linalg.expm(a * s) @ y
                s -= (row @ there) / (row @ a @ there)
            y = linalg.expm(a * s) @ y
            if roots is None:
                s, y = s.real, y.real.astype(complex)
            t = t + s
            if closed:
                lifts.append(t)
                closed = False
                continue
            speed = self.gap @ self.free @ y
            y[n : 2 * n] -= (1 + e) * speed * self.kick
            hits.append((t, -e * speed))
            closed = e == 0 and (self.force @ y).real > 0

    @staticmethod
    def system(n, seed, e, **moved):
        p = BASE | moved
        mass, damping, stiffness, load, amplitude, normal, other = numbers(n, seed)
        wall = zivi.HarmonicWall(p["wall"], p["wall_omega"], p["wall_phase"])
        return zivi.LinearSystem(
            p["m"] * mass,
            p["c"] * damping,
            p["k"] * stiffness,
            excitation=[
                p["load"] * load,
                zivi.Harmonic(p["F"] * amplitude, p["omega"], p["phase"]),
            ],
            gaps=[zivi.LinearGap(normal + p["tilt"] * other, p["offset"], wall, name="stop")],
            e=e,
        )


def starts(n, seed):
    return np.zeros(n), 2 * np.random.default_rng(seed + 50).normal(size=n)


def derivative(name, n, seed, end, e, roots):
    """By a complex step: no difference is taken."""
    q, v = (np.asarray(it, complex) for it in starts(n, seed))
    moved, t, shift = {}, 0.0, 1j * STEP
    if name == "e":
        e = e + shift
    elif name == "t0":
        t = shift
    elif name.startswith("q0["):
        q[int(name[3:-1])] += shift
    elif name.startswith("qdot0["):
        v[int(name[6:-1])] += shift
    else:
        moved[name] = BASE[name] + shift
    return [it.imag / STEP for it in Oracle(n, seed, **moved).run(q, v, end, e, t, roots)]


@pytest.mark.parametrize(
    ("n", "seed", "e"), [(1, 2, 0.75), (3, 5, 0.75), (4, 5, 0.75), (3, 8, 0.0), (4, 4, 0.0)]
)
def test_derivatives_are_those_of_matrix_exponentials(n, seed, e):
    end = 3.0
    made = zivi.ParametricSystem(lambda **p: Oracle.system(n, seed, e, **p), BASE)
    wrt = [*BASE, "t0", "q0[0]", f"qdot0[{n - 1}]", *(["e"] if e else [])]
    s = zivi.sensitivity(made, (0, end), starts(n, seed), wrt)
    assert s.status is zivi.OrbitStatus.COMPLETED
    oracle = Oracle(n, seed)
    plain = oracle.run(*starts(n, seed), end, e)
    assert len(plain[0]) == len(s.resolved_impacts) > 2
    assert len(plain[1]) == len(s.liftoff_times) >= (0 if e else 1)
    for column, name in enumerate(wrt):
        hits, lifts, last = derivative(name, n, seed, end, e, oracle.lengths)
        for found, exact in (
            (s.resolved_impacts["dt"][:, column], hits[:, 0]),
            (s.resolved_impacts["du"][:, column], hits[:, 1]),
            (s.liftoff_times[:, column], lifts),
            (s.final[..., column].ravel(), last),
        ):
            scale = 1.0 + np.max(np.abs(exact), initial=0.0)
            assert np.max(np.abs(found - exact), initial=0.0) < 3e-10 * scale, name


def quantities(s):
    return np.concatenate([s.final.reshape(-1, len(s.wrt)), s.zeno_times, s.liftoff_times])


def test_rests_have_the_derivatives_that_the_pair_has():
    system = zivi.ParametricSystem(
        lambda omega, stop: chain(omega, stop), {"omega": 3.0, "stop": 0.3}
    )
    start, wrt = (np.zeros(3), np.array([0.1, 0.0, 0.3])), ("q0", "qdot0", "omega", "stop", "e")
    exact, pair = (
        zivi.sensitivity(system, (0, 8), start, wrt, zivi.SwitchedRK(1e-11, 1e-13, flights=flights))
        for flights in ("auto", "rk")
    )
    assert exact.trajectory.nfev < 0.3 * pair.trajectory.nfev
    assert exact.n_slopes < 0.3 * pair.n_slopes
    assert len(exact.zeno_times) == len(pair.zeno_times) >= 2
    assert len(exact.liftoff_times) == len(pair.liftoff_times) >= 2
    wanted = quantities(pair)
    assert np.max(np.abs(quantities(exact) - wanted) / (1 + np.abs(wanted))) < 2e-7
    assert np.allclose(exact.radius, pair.radius, rtol=1e-4)
    assert [it.kind for it in exact.limits] == [it.kind for it in pair.limits]
    times = np.linspace(0.1, 7.9, 40)
    there = exact(times), pair(times)
    assert np.max(np.abs(there[0] - there[1]) / (1 + np.abs(there[1]))) < 2e-7


def chain(omega, stop):
    stiffness = 20.0 * (2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    load = np.array([0.0, 0.0, 3.0])
    gaps = [zivi.LinearGap([0, 0, -1], stop, name="stop"), zivi.LinearGap([1, 0, 0], stop)]
    parts = zivi.Harmonic(6 * load, omega), 4 * load
    return zivi.LinearSystem(
        np.eye(3), 0.02 * stiffness, stiffness, excitation=parts, gaps=gaps, e=0.4
    )


def test_the_radius_up_to_a_minimum():
    """``x = 1 + (1 - d) cos t`` comes as near as ``d`` to the wall, beside another coordinate."""
    depth = 1e-3
    system = zivi.LinearSystem(
        np.eye(2),
        None,
        np.diag([1.0, 4.0]),
        excitation=[1.0, 0.0],
        gaps=[zivi.LinearGap([1.0, 0.0]), zivi.LinearGap([0.0, 1.0], 5.0)],
        e=0.5,
    )
    s = zivi.sensitivity(system, (0, 4), ([2 - depth, 0.3], [0.0, 0.2]), ("q0",))
    assert s.nearest is not None
    assert s.nearest.kind == "minimum"
    assert s.nearest.t == pytest.approx(np.pi, abs=1e-12)
    assert s.radius[0] == pytest.approx(depth, rel=1e-9)


def test_tables_and_walls_of_tables_are_differentiated():
    """By a parameter that they depend on, against differences of runs."""
    times = np.linspace(0.0, 4.0, 9)

    def build(a):
        table = zivi.Table(times, np.outer(np.sin(3 * times), [a, 1.0]), "cubic")
        wall = zivi.Table(times, 0.05 * a * np.cos(2 * times), "cubic")
        gaps = [zivi.LinearGap([1.0, 0.3], 0.2, wall)]
        matrix = np.array([[9.0, -2.0], [-2.0, 5.0]])
        return zivi.LinearSystem(
            np.eye(2), 0.1 * matrix, matrix, excitation=table, gaps=gaps, e=0.6
        )

    system, start = zivi.ParametricSystem(build, {"a": 2.0}), ([0.1, 0.0], [-1.0, 0.5])
    s = zivi.sensitivity(system, (0, 4), start, ("a",))
    assert len(s.impacts) == 2
    ends = [zivi.simulate(build(2.0 + h), (0, 4), start) for h in (1e-6, -1e-6)]
    difference = [
        (up - down) / 2e-6
        for up, down in zip(
            *((sol.q[-1], sol.qdot[-1], sol.impacts["t"]) for sol in ends), strict=True
        )
    ]
    assert np.allclose(s.final[0, :, 0], difference[0], atol=1e-7)
    assert np.allclose(s.final[1, :, 0], difference[1], atol=1e-6)
    assert np.allclose(s.impacts["dt"][:, 0], difference[2], atol=1e-7)
