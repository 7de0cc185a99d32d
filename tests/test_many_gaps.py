"""Systems of some hundred coordinates and gaps: closed forms, sums of modes, Siconos."""

import pickle
import subprocess
from pathlib import Path

import numpy as np
import pytest

import zivi
from example_scripts import example
from inside import paper_step_solvers as step_solvers
from zivi.mechanics import BallGap, Body, PlaneGap

MANY, CLOSED = 200, 80


def test_two_hundred_gaps_of_equal_elastic_masses_exchange_their_motions():
    # each impact exchanges two velocities: the masses are the sorted straight lines
    random = np.random.default_rng(3)
    n = MANY + 1
    x, v = np.cumsum(random.uniform(0.5, 1.5, n)), random.normal(size=n)
    gaps = [zivi.LinearGap(b - a) for a, b in zip(np.eye(n), np.eye(n)[1:], strict=False)]
    series = zivi.LinearSystem(np.eye(n), None, np.zeros((n, n)), gaps=gaps, e=1.0)
    pair = zivi.MechanicalSystem(
        mass=np.eye(n), force=lambda t, q, w: np.zeros(n), gaps=gaps, e=1.0
    )
    for system in (series, pair):
        sol = zivi.simulate(system, (0, 1), (x, v))
        assert sol.success
        ends = x + v
        crossings = sum(int(np.sum(ends[:i] > ends[i])) for i in range(n))
        assert len(sol.impacts) == crossings > 50
        assert max(sol.impacts["gap"]) > 128
        np.testing.assert_allclose(sol.q[-1], np.sort(ends), rtol=0, atol=1e-11)


def balls(heights, e):
    """Give balls above floors of their own."""
    n = len(heights)
    gaps = [zivi.LinearGap(row, name=f"floor {i}") for i, row in enumerate(np.eye(n))]
    return zivi.LinearSystem(
        np.eye(n), None, np.zeros((n, n)), excitation=-9.81 * np.ones(n), gaps=gaps, e=e
    )


def test_eighty_balls_come_to_rest_when_their_series_end(tmp_path):
    heights = np.linspace(0.1, 0.5, CLOSED)
    e = np.linspace(0.1, 0.5, CLOSED)
    sol = zivi.simulate(balls(heights, e), (0, 2), (heights, np.zeros(CLOSED)))
    fall = np.sqrt(2 * heights / 9.81)
    ends = fall * (1 + e) / (1 - e)
    zeno = sol.zeno["t"][np.argsort(sol.zeno["gap"])]
    np.testing.assert_allclose(zeno, ends, rtol=1e-12)
    assert np.all(sol.contacts[-1])
    assert not np.any(sol.q[-1])
    # which are closed at a time in between, from the motion, its pickle and its file
    t = 0.5 * (ends.min() + ends.max())
    np.testing.assert_array_equal(np.abs(sol(t)[0]) < 1e-12, ends < t)
    assert np.array_equal(pickle.loads(pickle.dumps(sol))(t), sol(t))
    pytest.importorskip("xarray")
    zivi.files.save(sol, tmp_path / "run.nc")
    assert np.array_equal(zivi.files.load(tmp_path / "run.nc")(t), sol(t))


def test_contacts_beyond_the_first_word_open_where_their_force_vanishes():
    # plates that are pressed on their floors until a load that grows with the time lifts them
    n = CLOSED
    lifts = np.linspace(0.2, 0.9, n)
    load = zivi.Table([0.0, 1.0], np.array([np.zeros(n), 9.81 / lifts]))
    floors = [zivi.LinearGap(row) for row in np.eye(n)]
    system = zivi.LinearSystem(
        np.eye(n), None, np.zeros((n, n)), excitation=(-9.81 * np.ones(n), load), gaps=floors
    )
    sol = zivi.simulate(system, (0, 1), (np.zeros(n), np.zeros(n)))
    order = np.argsort([gap for _, gap in sol.liftoffs])
    times = np.array([t for t, _ in sol.liftoffs])[order]
    np.testing.assert_allclose(times, lifts, rtol=1e-12)
    # g (t - t_i)^3 / (6 t_i) after that
    np.testing.assert_allclose(sol.q[-1], 9.81 * (1 - lifts) ** 3 / (6 * lifts), rtol=1e-10)


def test_more_than_256_are_refused():
    n = 257
    with pytest.raises(ValueError, match="gaps must be at most 256, got 257"):
        zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1.0])] * n)
    with pytest.raises(ValueError, match="mass must be for at most 256 coordinates"):
        balls(np.ones(n), 0.5)
    free = zivi.MechanicalSystem(mass=lambda t, q: np.eye(n), force=lambda t, q, w: q, gaps=[])
    with pytest.raises(ValueError, match="q0 must have from 1 to 256 entries, got 257"):
        zivi.simulate(free, (0, 1), (np.ones(n), np.ones(n)))


@pytest.mark.slow
@pytest.mark.skipif(step_solvers.interpreter() is None, reason="no Python with siconos was found")
def test_the_steps_of_siconos_come_near_the_bar(tmp_path):
    bar = example("mechanics_bar")
    mass, stiffness = bar.matrices()
    np.savez(tmp_path / "bar.npz", mass=mass, stiffness=stiffness)
    sol = bar.run()
    errors = []
    for h in (4e-7, 1e-7):
        numbers = (bar.HEIGHT, bar.SPEED, bar.END, bar.GRAVITY, h)
        script = Path(__file__).with_name("siconos_bar.py")
        done = subprocess.run(
            [step_solvers.interpreter(), script, tmp_path / "bar.npz", *map(str, numbers)],
            capture_output=True,
            text=True,
            check=True,
        )
        t, *q = map(float, done.stdout.split()[-len(mass) - 1 :])
        errors.append(np.max(np.abs(sol(t)[0] - q)))
    # the bar moves 15 um; the steps are of the first order
    assert errors[1] < 0.4 * errors[0]
    assert errors[1] < 1e-7


class Pile:
    """Fifty discs without friction in a box of seven: the pairs that can meet are gaps."""

    def __init__(self):
        largest, loose, rows = 0.1, 1.02, (7, 6, 7, 6, 7, 6, 7, 4)
        side = largest * loose
        x = [side * (1 + k % 2 + 2 * i) for k, count in enumerate(rows) for i in range(count)]
        z = [
            loose * largest + k * side * 3**0.5
            for k, count in enumerate(rows)
            for _ in range(count)
        ]
        self.start = np.column_stack([x, z])
        self.radii = largest * np.random.default_rng(1).uniform(0.9, 1.0, len(x))
        self.masses = (self.radii / largest) ** 2
        bodies, gaps, width = [], [], 14 * side
        for i, (place, r) in enumerate(zip(self.start, self.radii, strict=True)):
            bodies.append(Body(f"x{i}", kind="slide", axis=[1, 0, 0]))
            bodies.append(Body(f"disc{i}", f"x{i}", "slide", mass=self.masses[i]))
            if place[1] < 4 * largest:
                gaps.append(PlaneGap(f"disc{i}", radius=r, name=f"floor {i}"))
            way = 1 if place[0] < width / 2 else -1
            offset, name = (0.0 if way == 1 else -width), f"wall {i}"
            wall = {"normal": [way, 0, 0], "offset": offset, "radius": r, "name": name}
            gaps.append(PlaneGap(f"disc{i}", **wall))
            for j in range(i):
                both = r + self.radii[j]
                if np.hypot(*(place - self.start[j])) < both + 0.7 * largest:
                    pair = {"other": f"disc{j}", "radius": both, "name": f"{j}-{i}"}
                    gaps.append(BallGap(f"disc{i}", **pair))
        self.system = zivi.Tree(bodies, gaps=gaps)

    def run(self, end, method):
        rest = np.zeros(2 * len(self.radii))
        return zivi.simulate(self.system, (0, end), (self.start.ravel(), rest), method)

    def overlap(self, q):
        """Of all pairs, those that are no gaps too."""
        at = q.reshape(-1, 2)
        i, j = np.triu_indices(len(at), 1)
        return np.max(self.radii[i] + self.radii[j] - np.hypot(*(at[i] - at[j]).T))


@pytest.mark.slow
def test_a_pile_of_fifty_discs_is_carried_by_the_floor():
    pile, h = Pile(), 1e-3
    assert len(pile.system.gap_names) == 185
    sol = pile.run(1.0, zivi.MoreauJean(h))
    assert sol.success
    assert sol.contacts[-1].sum() > 80
    assert max(pile.overlap(q) for q in sol.q[::50]) < 2e-3
    # what the floor gives is the weight and the change of the momentum
    on_floor = [name.startswith("floor") for name in pile.system.gap_names]
    given = h * sol.reactions[:, on_floor].sum()
    weight = 9.81 * pile.masses.sum()
    momentum = pile.masses @ sol.qdot[-1, 1::2]
    assert given == pytest.approx(weight * 1.0 + momentum, rel=1e-10)
    assert np.max(np.abs(sol.qdot[-1])) < 0.1


def test_the_discs_of_a_pile_never_overlap_nor_gain_energy():
    pile = Pile()
    sol = pile.run(0.1, zivi.SwitchedRK())
    assert sol.success
    assert len(sol.zeno) > 50
    assert max(pile.overlap(q) for q in sol.q) < 1e-12
    masses = np.repeat(pile.masses, 2)
    energy = 0.5 * sol.qdot**2 @ masses + 9.81 * sol.q[:, 1::2] @ pile.masses
    assert np.all(np.diff(energy) < 1e-9 * energy[0])
    assert energy[-1] < 0.99 * energy[0]
