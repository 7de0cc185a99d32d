"""Random branches of mechanical systems: multipliers by another map, words by simulations.

``python benchmarks/orbit_branches.py [branches] [seed]``. Chains of 2 to 4 masses between springs
and dampers, one or two gaps (to a wall, or between neighbours) and a harmonic load settle on an
orbit, which is followed over the frequency of the load. At every point of every branch

* the multipliers are those of a product of SciPy's matrix exponentials and saltation matrices,
  built of `M`, `C`, `K` and the impacts alone, and the gaps of that motion vanish at the impacts;
* a simulation over one period of the motion, from the middle of a flight, has its word.

Points at events, or with an impact of a depth below 1e-9, are on the edge of two words, and are
left out of both. Impacts slower than those of a depth of 1e-6 make rounding of either map larger,
and are counted apart.
"""

from __future__ import annotations

import dataclasses
import sys
import time

import numpy as np
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

import zivi

SPAN = 0.12
"""The range of the frequency to both sides, relative."""
SMOOTH = ("fold", "period_doubling", "neimark_sacker")
"""Events that change no word."""


def draw(rng: np.random.Generator) -> zivi.LinearSystem:
    """Draw a chain, its load and its gaps."""
    n = int(rng.integers(2, 5))

    def chained(values: np.ndarray) -> np.ndarray:
        inner = values[1:-1]
        return np.diag(values[:-1] + values[1:]) - np.diag(inner, 1) - np.diag(inner, -1)

    load = np.zeros(n)
    load[rng.integers(n)] = 1.0
    gaps = []
    for name in ("a", "b")[: int(rng.integers(1, 3))]:
        normal = np.zeros(n)
        i = int(rng.integers(n))
        normal[i] = rng.choice([-1.0, 1.0])
        if rng.random() < 0.3 and i + 1 < n:
            normal[i], normal[i + 1] = -1.0, 1.0
        if not any(np.array_equal(gap.normal, normal) for gap in gaps):
            gaps.append(zivi.LinearGap(normal, rng.uniform(0.1, 0.7), name=name))
    return zivi.LinearSystem(
        np.diag(rng.uniform(0.5, 1.5, n)),
        chained(rng.uniform(0.03, 0.12, n + 1)),
        chained(rng.uniform(0.6, 2.0, n + 1)),
        excitation=zivi.Harmonic(load, rng.uniform(0.6, 1.6)),
        gaps=gaps,
        e=rng.uniform(0.3, 0.85, len(gaps)),
    )


def settled(rng: np.random.Generator) -> zivi.MechanicalOrbit:
    """Draw until a run settles on an orbit with a few impacts, and nothing else."""
    while True:
        system = draw(rng)
        period = 2 * np.pi / system.excitation[0].omega
        run = zivi.simulate(system, (0, 150 * period), ([0] * system._n, [0] * system._n))
        if not run.success or not len(run.impacts):
            continue
        orbit = zivi.periodic_orbit(system, run)
        if orbit.success and orbit.kind == "impacting" and len(orbit.impacts) <= 8:
            return orbit


@dataclasses.dataclass
class OwnMap:
    """The motion by exponentials of ``(q, qdot, cos, sin)``."""

    system: zivi.LinearSystem

    def __post_init__(self) -> None:
        system, n = self.system, self.system._n
        wave = system.excitation[0]
        self.omega, self.inverse = wave.omega, np.linalg.inv(system.M)
        whole = np.zeros((2 * n + 2, 2 * n + 2))
        whole[:n, n : 2 * n] = np.eye(n)
        whole[n : 2 * n, : 2 * n] = -self.inverse @ np.hstack([system.K, system.C])
        whole[n : 2 * n, 2 * n] = self.inverse @ wave.amplitude
        whole[-2, -1], whole[-1, -2] = -self.omega, self.omega
        self.whole = whole

    def multipliers(self, orbit: zivi.MechanicalOrbit) -> tuple[np.ndarray, float, float]:
        """Give the multipliers, how far gaps are from 0 at impacts, and how far it closes."""
        n, hits = self.system._n, orbit.impacts
        t = float(hits["t"][-1])
        start = np.append(orbit.trajectory(t + 1e-9).ravel(), [np.cos(self.omega * t), 0.0])
        start[-1] = np.sin(self.omega * t)
        # the state right after the last impact: the fixed point of the affine map
        period = orbit.multiple * orbit.period
        state, jacobian, off = self._around(start, t - period, hits)
        for _ in range(3):
            move = np.linalg.solve(np.eye(2 * n) - jacobian, (state - start)[: 2 * n])
            start[: 2 * n] += move
            state, jacobian, off = self._around(start, t - period, hits)
        closes = float(np.max(np.abs((state - start)[: 2 * n])))
        return np.linalg.eigvals(self._saltated(start, t - period, hits)), off, closes

    def _steps(self, start, t, hits):
        """Fly from impact to impact: the state before it and what the flight does to states."""
        state, n = start.copy(), self.system._n
        for row in hits:
            flight = expm(self.whole * (row["t"] - t))
            before = flight @ state
            normal = self.system.gaps[row["gap"]].normal
            push = self.inverse @ normal / (normal @ self.inverse @ normal)
            jump = np.eye(2 * n + 2)
            jump[n : 2 * n, n : 2 * n] -= (1 + float(self.system.e[row["gap"]])) * np.outer(
                push, normal
            )
            yield row, before, flight, jump, normal
            state, t = jump @ before, row["t"]

    def _around(self, start, t, hits):
        product, off, state = np.eye(len(start)), 0.0, start
        for row, before, flight, jump, normal in self._steps(start, t, hits):
            gap = normal @ before[: len(normal)] + self.system.gaps[row["gap"]].offset
            off, state = max(off, abs(gap)), jump @ before
            product = jump @ flight @ product
        return state, product[:-2, :-2], off

    def _saltated(self, start, t, hits):
        product, n = np.eye(2 * self.system._n), self.system._n
        for _, before, flight, jump, normal in self._steps(start, t, hits):
            slope = np.append(normal, np.zeros(n))
            rates = self.whole @ before, self.whole @ jump @ before
            change = (rates[1] - jump @ rates[0])[: 2 * n]
            saltation = jump[:-2, :-2] + np.outer(change, slope) / (normal @ before[n : 2 * n])
            product = saltation @ flight[:-2, :-2] @ product
        return product


def apart(own: np.ndarray, found: np.ndarray) -> float:
    """Give how far two sets of multipliers are apart, relative to the largest."""
    cost = np.abs(own[:, None] - found[None, :])
    return float(cost[linear_sum_assignment(cost)].max() / max(1.0, np.abs(own).max()))


def run_differs(orbit: zivi.MechanicalOrbit) -> bool:
    """Whether a simulation of one period has other impacts than the orbit."""
    run, length = orbit.trajectory, orbit.multiple * orbit.period
    # an impact may change the speeds of other gaps at once; those of accumulations are listed, too
    rows = run.resolved_impacts
    rows = rows[rows["speed_before"] < 0.0]
    times = run.t[0] + (orbit.impacts["t"] - run.t[0]) % length
    order = np.argsort(times)
    times = times[order]
    if not run.success or len(rows) != len(times):
        return True
    if list(rows["gap"]) != list(orbit.impacts["gap"][order]):
        return True
    # what an unstable orbit makes of the tolerance of the run
    near = 1e-7 * max(1.0, float(np.max(np.abs(orbit.multipliers)))) * length
    return bool(np.max(np.abs(rows["t"] - times)) > near)


@dataclasses.dataclass
class Seen:
    """What was found on the branches."""

    branches: int = 0
    points: int = 0
    grazings: int = 0
    steps: int = 0
    """Most steps of Newton's iteration at the start of an arc."""
    worst: float = 0.0
    """Of multipliers."""
    slow: float = 0.0
    """Of those with an impact that nearly grazes."""
    off: float = 0.0
    """Of gaps at impacts."""
    other_words: int = 0
    statuses: dict[str, int] = dataclasses.field(default_factory=dict)

    def add(self, branch: zivi.MechanicalBranch) -> None:
        """Look at all points of a branch."""
        self.branches += 1
        self.statuses[branch.status.name] = self.statuses.get(branch.status.name, 0) + 1
        self.grazings += len(branch.of_kind("grazing")) + len(branch.of_kind("interior_impact"))
        edges = {it.value for it in branch.events if it.kind not in SMOOTH}
        for number, arc in enumerate(branch.arcs):
            if number:
                self.steps = max(self.steps, arc.orbits[0].iterations)
            for value, orbit in zip(arc.values, arc.orbits, strict=True):
                if orbit.kind != "impacting" or value in edges or orbit.depth < 1e-9:
                    continue
                self.points += 1
                own, off, _ = OwnMap(orbit.system).multipliers(orbit)
                off_by = apart(own, orbit.multipliers)
                if orbit.depth < 1e-6:
                    self.slow = max(self.slow, off_by)
                else:
                    self.worst = max(self.worst, off_by)
                self.off = max(self.off, off)
                self.other_words += run_differs(orbit)


def campaign(branches: int, seed: int = 1, points: int = 60) -> Seen:
    """Follow random branches."""
    rng, seen = np.random.default_rng(seed), Seen()
    while seen.branches < branches:
        orbit = settled(rng)
        omega = orbit.system.excitation[0].omega
        span = (omega * (1 - SPAN), omega * (1 + SPAN))
        seen.add(zivi.continue_orbit(orbit, "omega", span, step=0.05, max_points=points))
    return seen


if __name__ == "__main__":
    began = time.process_time()
    found = campaign(*(int(it) for it in (sys.argv[1:] or ["50"])))
    print(found)
    print(f"{time.process_time() - began:.0f} s of a processor")
