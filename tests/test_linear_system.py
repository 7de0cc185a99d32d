"""Linear systems from matrices and from modal data, against matrix exponentials."""

import itertools
import pickle

import numpy as np
import pytest
from scipy import linalg, optimize

import zivi

TIGHT = zivi.SwitchedRK(rtol=1e-13, atol=1e-15)


def matrices(n, seed=0):
    """Mass, damping that is not proportional, stiffness."""
    rng = np.random.default_rng(seed)
    a, b, c = (rng.normal(size=(n, n)) for _ in range(3))
    mass = np.eye(n) + 0.2 * a @ a.T / n
    stiffness = 30.0 * (b @ b.T / n + 0.3 * np.eye(n))
    return mass, 0.3 * c @ c.T / n, stiffness


class Oracle:
    """Flights between impacts on one gap by matrix exponentials of ``(q, q', 1, cos, sin)``."""

    def __init__(self, mass, damping, stiffness, load, wave, normal, offset, e):
        n = len(mass)
        inverse = np.linalg.inv(mass)
        self.n, self.e, self.omega = n, e, wave[1]
        self.a = np.zeros((2 * n + 3, 2 * n + 3))
        self.a[:n, n : 2 * n] = np.eye(n)
        self.a[n : 2 * n, :n] = -inverse @ stiffness
        self.a[n : 2 * n, n : 2 * n] = -inverse @ damping
        self.a[n : 2 * n, 2 * n] = inverse @ load
        self.a[n : 2 * n, 2 * n + 1] = inverse @ wave[0]
        self.a[2 * n + 1, 2 * n + 2], self.a[2 * n + 2, 2 * n + 1] = -self.omega, self.omega
        self.gap = np.concatenate([normal, np.zeros(n), [offset, 0, 0]])
        self.rate = np.concatenate([np.zeros(n), normal, [0, 0, 0]])
        self.kick = np.concatenate([np.zeros(n), inverse @ normal, [0, 0, 0]])

    def run(self, end, q, qdot, dt=0.005):
        """Times and speeds of the impacts, and the last state."""
        step, t = linalg.expm(self.a * dt), 0.0
        y = np.concatenate([q, qdot, [1.0, 1.0, 0.0]])
        hits = []
        while t < end:
            if t + dt > end:
                step = linalg.expm(self.a * (end - t))
            ahead = step @ y
            if self.gap @ ahead >= 0 or (self.gap @ y <= 1e-13 and self.rate @ y < 0):
                t, y = min(t + dt, end), ahead
                continue

            def value(s, y=y):
                return self.gap @ linalg.expm(self.a * s) @ y

            low = 1e-7 if abs(self.gap @ y) < 1e-12 else 0.0
            s = optimize.brentq(value, low, min(dt, end - t), xtol=1e-15, rtol=1e-15)
            t, y = t + s, linalg.expm(self.a * s) @ y
            speed = self.rate @ y
            y = y - (1 + self.e) * speed / (self.rate @ self.kick) * self.kick
            hits.append((t, -self.e * speed))
            y[2 * self.n + 1 :] = np.cos(self.omega * t), np.sin(self.omega * t)
        return np.array(hits), y[: self.n], y[self.n : 2 * self.n]


@pytest.mark.parametrize(("n", "seed"), [(1, 4), (2, 1), (3, 2), (7, 3)])
def test_impacts_are_those_of_matrix_exponentials(n, seed):
    mass, damping, stiffness = matrices(n, seed)
    rng = np.random.default_rng(seed + 50)
    load, amplitude, normal = rng.normal(size=(3, n))
    omega, offset, e = 3.3, 0.15, 0.8
    start = np.zeros(n), 2 * rng.normal(size=n)
    oracle = Oracle(mass, damping, stiffness, load, (8 * amplitude, omega), normal, offset, e)
    hits, q, qdot = oracle.run(6.0, *start)
    system = zivi.LinearSystem(
        mass,
        damping,
        stiffness,
        excitation=[load, zivi.Harmonic(8 * amplitude, omega)],
        gaps=[zivi.LinearGap(normal, offset)],
        e=e,
    )
    sol = zivi.simulate(system, (0, 6), start, TIGHT)
    assert len(hits) == len(sol.impacts) > 3
    assert np.max(np.abs(sol.impacts["t"] - hits[:, 0])) < 1e-10
    assert np.allclose(sol.impacts["speed_after"], hits[:, 1], rtol=1e-8, atol=1e-10)
    assert np.allclose(sol.q[-1], q, atol=1e-9)
    assert np.allclose(sol.qdot[-1], qdot, atol=1e-8)


def test_a_system_without_gaps_moves_as_its_matrix_exponential():
    mass, damping, stiffness = matrices(4, 9)
    load, amplitude = np.random.default_rng(1).normal(size=(2, 4))
    # in resonance of an undamped mode, and one coordinate that nothing holds
    stiffness[:, 3] = stiffness[3, :] = 0.0
    omega = float(np.sqrt(linalg.eigh(stiffness, mass, eigvals_only=True)[1]))
    oracle = Oracle(mass, 0 * damping, stiffness, load, (amplitude, omega), np.ones(4), 1e9, 1)
    _, q, qdot = oracle.run(10.0, np.ones(4), np.zeros(4))
    system = zivi.LinearSystem(
        mass, None, stiffness, excitation=(load, zivi.Harmonic(amplitude, omega))
    )
    sol = zivi.simulate(system, (0, 10), (np.ones(4), np.zeros(4)), TIGHT)
    scale = np.max(np.abs(q))
    assert np.max(np.abs(sol.q[-1] - q)) < 1e-11 * scale
    assert np.max(np.abs(sol.qdot[-1] - qdot)) < 1e-10 * scale


def test_the_motion_within_steps_is_that_of_matrix_exponentials(tmp_path):
    mass, damping, stiffness = matrices(3, 2)
    load, amplitude = np.random.default_rng(8).normal(size=(2, 3))
    oracle = Oracle(mass, damping, stiffness, load, (amplitude, 2.0), np.ones(3), 1e9, 1)
    system = zivi.LinearSystem(
        mass, damping, stiffness, excitation=(load, zivi.Harmonic(amplitude, 2.0))
    )
    sol = zivi.simulate(system, (0, 4), (np.ones(3), np.zeros(3)))
    at = np.linspace(0, 4, 23)
    q, qdot = sol(at)
    for t, *state in zip(at, q, qdot, strict=True):
        exact = linalg.expm(oracle.a * t) @ np.concatenate([np.ones(3), np.zeros(3), [1, 1, 0]])
        assert np.max(np.abs(np.concatenate(state) - exact[:6])) < 1e-12
    pytest.importorskip("xarray")
    zivi.files.save(sol, tmp_path / "run.nc")
    again = zivi.files.load(tmp_path / "run.nc")
    assert np.array_equal(again(at)[0], q)
    few = zivi.simulate(system, (0, 4), (np.ones(3), np.zeros(3)), t_eval=at)
    assert np.allclose(few.q, q, atol=1e-13)


def chain(n, frequency, **more):
    """Masses between springs, 2 % damping, stops on both sides of the last one."""
    stiffness = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness[-1, -1] = 1.0
    first = np.sqrt(np.linalg.eigvalsh(stiffness)[0])
    stiffness *= (2 * np.pi / first) ** 2
    load = np.zeros(n)
    load[-1] = 1.0
    gaps = [zivi.LinearGap(s * load, 2e-3, name=name) for s, name in ((1, "left"), (-1, "right"))]
    return zivi.LinearSystem(
        np.eye(n),
        0.04 / (2 * np.pi) * stiffness,
        stiffness,
        excitation=zivi.Harmonic(load, 2 * np.pi * frequency),
        gaps=gaps,
        e=0.5,
        **more,
    )


def rest(n):
    return np.zeros(n), np.zeros(n)


def as_mechanism(system):
    """The same system as functions of the interpreter."""
    return zivi.MechanicalSystem(mass=system.M, force=system._force, gaps=system.gaps, e=system.e)


def test_rests_and_lift_offs_are_those_of_the_general_method():
    system = chain(3, 0.5)
    sol = zivi.simulate(system, (0, 4), rest(3), TIGHT)
    again = zivi.simulate(as_mechanism(system), (0, 4), rest(3), TIGHT)
    for name in ("zeno", "liftoffs"):
        mine, other = getattr(sol, name), getattr(again, name)
        assert len(mine) == len(other) >= 2
        assert np.array_equal(mine["gap"], other["gap"])
        assert np.max(np.abs(mine["t"] - other["t"])) < 1e-9
    assert np.max(np.abs(sol.q[-1] - again.q[-1])) < 1e-11
    at = np.linspace(0, 4, 400)
    assert np.max(np.abs(sol(at)[0] - again(at)[0])) < 1e-10


def test_flights_do_not_depend_on_tolerances():
    system, start = chain(3, 1.1), (np.zeros(3), np.array([0.0, 0.1, 0.0]))
    runs = [
        zivi.simulate(system, (0, 1.0), start, zivi.SwitchedRK(rtol=rtol, atol=1e-3 * rtol))
        for rtol in (1e-4, 1e-12)
    ]
    first = [run.resolved_impacts[:4] for run in runs]
    assert np.array_equal(first[0]["t"], first[1]["t"])
    assert np.array_equal(first[0]["speed_before"], first[1]["speed_before"])
    by_steps = zivi.simulate(system, (0, 1.0), start, zivi.SwitchedRK(flights="rk"))
    assert by_steps.nfev > 3 * runs[0].nfev


def drawn(seed):
    """Two to five coordinates, one to three gaps, damping of any kind, resonance, free motions."""
    rng = np.random.default_rng(seed)
    n, kind = int(rng.integers(2, 6)), seed % 4
    mass, damping, stiffness = matrices(n, seed)
    damping = damping + rng.choice([0.0, 0.5]) * np.subtract.outer(np.arange(n), np.arange(n))
    if kind == 1:
        stiffness[:, -1] = stiffness[-1, :] = 0.0
    omega = np.sqrt(np.abs(linalg.eigh(stiffness, mass, eigvals_only=True)))[n // 2]
    if kind == 2:
        damping = np.zeros((n, n))
    else:
        omega *= rng.uniform(0.5, 1.5)
    gaps = [
        zivi.LinearGap(
            rng.normal(size=n),
            rng.uniform(0.05, 0.4),
            zivi.HarmonicWall(0.01, 0.7 * omega) if rng.random() < 0.3 else None,
        )
        for _ in range(rng.integers(1, 4))
    ]
    load, amplitude = rng.normal(size=n), 4 * rng.normal(size=n)
    system = zivi.LinearSystem(
        mass,
        damping,
        stiffness,
        excitation=[load, zivi.Harmonic(amplitude, omega, rng.uniform(0, 6))],
        gaps=gaps,
        e=rng.uniform(0, 0.8, len(gaps)),
    )
    return system, (np.zeros(n), rng.normal(size=n)), 3 * np.pi / omega


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 10, 20, 30])
def test_drawn_systems_move_as_by_small_steps(first):
    rests = 0
    for seed in range(first, first + 10):
        system, start, end = drawn(seed)
        sol = zivi.simulate(system, (0, end), start, TIGHT, dense_output=False)
        by_steps = zivi.SwitchedRK(rtol=1e-13, atol=1e-15, flights="rk")
        again = zivi.simulate(system, (0, end), start, by_steps, dense_output=False)
        counts = [[len(it.zeno), len(it.liftoffs), len(it.corners)] for it in (sol, again)]
        assert counts[0] == counts[1], seed
        scale = 1 + np.max(np.abs(again.q))
        assert np.max(np.abs(sol.q[-1] - again.q[-1])) < 1e-8 * scale, seed
        rests += counts[0][0]
    assert rests > 0


@pytest.mark.slow
def test_no_gap_is_passed():
    """A root that was missed would show: gaps are those of the coordinates."""
    rests = 0
    for seed in range(1000, 1150):
        system, start, end = drawn(seed)
        sol = zivi.simulate(system, (0, end), start)
        assert sol.success
        t = np.linspace(0, end, 3001)
        q = sol(t)[0]
        for gap in system.gaps:
            wall = 0.0 if gap.motion is None else 0.01 * np.cos(gap.motion.omega * t)
            size = np.abs(gap.normal) @ np.max(np.abs(q), axis=0) + gap.offset
            assert np.min(q @ gap.normal + gap.offset - wall) > -1e-13 * size, seed
        rests += len(sol.zeno)
    assert rests > 30


def test_modal_data_are_the_system_that_they_come_from():
    system = chain(4, 0.9)
    squares, shapes = linalg.eigh(system.K, system.M)
    omega = np.sqrt(squares)
    ratios = np.diag(shapes.T @ system.C @ shapes) / (2 * omega)
    modal = zivi.LinearSystem.modal(
        omega,
        ratios,
        shapes,
        excitation=system.excitation,
        gaps=system.gaps,
        e=system.e,
    )
    reduced = chain(4, 0.9, modes=4)
    assert np.allclose(np.abs(modal.shapes), np.abs(reduced.shapes))
    full = zivi.simulate(system, (0, 3), rest(4), TIGHT)
    for other in (modal, reduced):
        sol = zivi.simulate(other, (0, 3), rest(4), TIGHT)
        assert len(sol.impacts) == len(full.impacts) > 5
        assert np.allclose(sol.q @ other.shapes.T[:, -1:], sol.gaps[:, :1] - 2e-3, atol=1e-12)
        assert np.allclose(other.shapes @ sol.q[-1], full.q[-1], atol=1e-9)
    assert chain(20, 0.9, modes=5).K.shape == (5, 5)


def test_other_frequencies_are_runs_of_a_batch():
    system = chain(3, 0.5)
    omegas = 2 * np.pi * np.array([0.5, 1.1, 3.1])
    batch = zivi.simulate_batch(system.at(omega=omegas), (0, 2), rest(3))
    for i, omega in enumerate(omegas):
        sol = zivi.simulate(system.at(omega=omega), (0, 2), rest(3))
        assert np.array_equal(batch.q[i], sol.q[-1])
        assert batch.n_impacts[i] == len(sol.impacts)
        assert 0 < batch.nfev[i] < sol.nfev  # samples of steps need more
        assert np.array_equal(
            sol.q[-1], zivi.simulate(chain(3, omega / 2 / np.pi), (0, 2), rest(3)).q[-1]
        )
    again = pickle.loads(pickle.dumps(system.at(omega=omegas[1])))
    assert np.array_equal(zivi.simulate(again, (0, 2), rest(3)).q[-1], batch.q[1])
    here = system.at(0.3, np.ones(3), np.zeros(3))
    assert np.allclose(
        here.force, -system.K @ np.ones(3) + system.excitation[0].amplitude * np.cos(np.pi * 0.3)
    )
    with pytest.raises(ValueError, match="of one frequency"):
        zivi.LinearSystem(1.0, 0.1, 1.0).at(omega=2.0)


def test_gaps_that_close_together_to_rounding_are_one_impact():
    """Two masses that move as one, and the gap of one of them in other units."""
    gaps = [zivi.LinearGap([1.0, 0.0], 0.1), zivi.LinearGap([0.0, 3.0], 0.3)]
    load = zivi.Harmonic([3.0, 3.0], 1.3)
    both = np.eye(2)
    system = zivi.LinearSystem(both, 0.02 * both, 0.7 * both, excitation=load, gaps=gaps, e=0.8)
    impacts = zivi.simulate(system, (0, 60), ([1.3, 1.3], [0.1, 0.1])).impacts
    one, other = (impacts[impacts["gap"] == gap] for gap in (0, 1))
    assert len(one) > 10
    assert (one["t"] == other["t"]).all()
    assert (one["group"] == other["group"]).all()


@pytest.mark.parametrize("kind", ["hold", "linear", "cubic"])
def test_tables_excite_as_matrix_exponentials_between_their_knots(kind):
    mass, damping, stiffness = matrices(3, 5)
    rng = np.random.default_rng(2)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.4, 12))])
    table = zivi.Table(times, rng.normal(size=(13, 3)), kind)
    system = zivi.LinearSystem(mass, damping, stiffness, excitation=table)
    sol = zivi.simulate(system, (0, times[-1]), (np.ones(3), np.zeros(3)), TIGHT)
    inverse = np.linalg.inv(mass)
    # (q, q', u, u', u'', u'''): polynomials of the third degree
    a = np.zeros((18, 18))
    a[:3, 3:6] = np.eye(3)
    a[3:6, :3], a[3:6, 3:6], a[3:6, 6:9] = -inverse @ stiffness, -inverse @ damping, inverse
    a[6:15, 9:18] = np.eye(9)
    q, v = np.ones(3), np.zeros(3)
    for start, end in itertools.pairwise(times):
        middle = (start + end) / 2
        half = middle - start
        u2 = table(middle, 2)
        jerk = (table(start + 0.75 * (end - start), 2) - u2) / (0.25 * (end - start))
        u1, u0 = table(middle, 1), table(middle)
        parts = [
            u0 - u1 * half + u2 * half**2 / 2 - jerk * half**3 / 6,
            u1 - u2 * half + jerk * half**2 / 2,
            u2 - jerk * half,
            jerk,
        ]
        y = linalg.expm(a * (end - start)) @ np.concatenate([q, v, *parts])
        q, v = y[:3], y[3:6]
    assert np.allclose(sol.q[-1], q, atol=1e-11)
    assert np.allclose(sol.qdot[-1], v, atol=1e-11)


def test_walls_move_as_in_the_general_method():
    motion = zivi.HarmonicWall(0.05, 7.0)
    gaps = [zivi.LinearGap([1.0, 0.0], 0.2, motion), zivi.LinearGap([0.0, -1.0], 0.3)]
    mass, damping, stiffness = matrices(2, 7)
    system = zivi.LinearSystem(mass, damping, stiffness, gaps=gaps, e=0.6)
    start = np.zeros(2), np.array([3.0, 2.0])
    sol = zivi.simulate(system, (0, 3), start, TIGHT)
    again = zivi.simulate(as_mechanism(system), (0, 3), start, TIGHT)
    assert len(sol.impacts) == len(again.impacts) > 4
    assert np.max(np.abs(sol.impacts["t"] - again.impacts["t"])) < 1e-10
    function = zivi.MovingWall(lambda t: 0.0, lambda t: 0.0, lambda t: 0.0)
    still = zivi.LinearSystem(1.0, 0.0, 1.0, gaps=[zivi.LinearGap([1.0], 0.1, function)], e=0.5)
    assert len(zivi.simulate(still, (0, 5), ([0.2], [0.0])).impacts) > 0


def test_derivatives_by_the_start_are_those_by_differences():
    system = chain(2, 0.8)
    start = np.array([1e-3, 0.0]), np.array([0.02, 0.01])
    found = zivi.sensitivity(system, (0, 1), start, method=TIGHT)
    ends = []
    for sign in (1, -1):
        near = start[0] + sign * np.array([1e-8, 0]), start[1]
        sol = zivi.simulate(system, (0, 1), near, TIGHT)
        ends.append(np.concatenate([sol.q[-1], sol.qdot[-1]]))
    difference = (ends[0] - ends[1]) / 2e-8
    assert np.allclose(found.final[:, :, 0].ravel(), difference, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: zivi.LinearSystem(np.eye(2), None, np.eye(3)), "K must have shape"),
        (lambda: zivi.LinearSystem(-np.eye(2), None, np.eye(2)), "positive definite"),
        (lambda: zivi.LinearSystem(1.0, 0.0, 1.0, excitation=[1.0, 2.0]), "each of 1 loads"),
        (lambda: zivi.LinearSystem(1.0, 0.0, 1.0, modes=2), "modes must be from 1 to 1"),
        (lambda: zivi.LinearSystem.modal([1.0, -1.0], 0.1), "frequencies must be finite and >= 0"),
        (lambda: zivi.LinearSystem.modal([1.0], 0.1, [[1.0, 2.0]]), "shapes must be finite"),
        (lambda: zivi.Harmonic([1.0, np.inf], 1.0), "amplitude must be a finite vector"),
    ],
)
def test_what_does_not_fit_is_refused(make, told):
    with pytest.raises(ValueError, match=told):
        make()
    with pytest.raises(TypeError, match=r"must be a zivi\.LinearGap"):
        zivi.LinearSystem(1.0, 0.0, 1.0, gaps=[zivi.Gap(lambda t, q: q[0], [1.0])])


def test_what_is_kept_of_a_run_does_not_change_it():
    """Samples, the dense motion and a batch: every bit of impacts and of the end."""
    mass, damping, stiffness = matrices(5, 8)
    system = zivi.LinearSystem(
        mass,
        damping,
        stiffness,
        excitation=zivi.Harmonic(6.0 * np.ones(5), 2.7),
        gaps=[zivi.LinearGap(np.eye(5)[0], 0.1), zivi.LinearGap(-np.eye(5)[4], 0.2)],
        e=0.6,
    )
    start = np.zeros(5), np.ones(5)
    last = zivi.simulate(system, (0, 20), start, t_eval=[20.0], dense_output=False)
    dense = zivi.simulate(system, (0, 20), start)
    assert len(last.impacts) > 20
    for other in (dense, zivi.simulate(system, (0, 20), start, t_eval=np.linspace(0, 20, 50))):
        np.testing.assert_array_equal(last.impacts, other.impacts)
        np.testing.assert_array_equal(last.q[-1], other.q[-1])
        np.testing.assert_array_equal(last.qdot[-1], other.qdot[-1])
    batch = zivi.simulate_batch([system, system], (0, 20), start)
    np.testing.assert_array_equal(batch.q[1], last.q[-1])
