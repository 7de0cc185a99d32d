"""How many of the motions that runs settle on are found as orbits.

``python benchmarks/orbits_found.py [systems] [seed]``. Of the random chains of `orbit_branches`,
half of them with a plastic gap, those count whose run repeats: states once a period, up to `MOST`
of them apart, agree to `SAME`. Each is to be found from the run, as a motion of the least multiple;
what is found must return to its own start in a run of its own.
"""

from __future__ import annotations

import dataclasses
import sys
import time

import numpy as np

import zivi
from orbit_branches import draw

PERIODS, MOST, SAME = 200, 8, 1e-8


def repeats(run: zivi.MechanicalTrajectory, period: float) -> int:
    """Give after how many periods the states of a run repeat, 0 if they do not."""
    times = run.t[-1] - period * np.arange(4 * MOST)
    states = np.concatenate(run(times), axis=1)
    size = np.max(np.abs(states), axis=0) + 1e-300
    for m in range(1, MOST + 1):
        apart = np.abs(states[m:] - states[:-m]) / size
        if np.max(apart) < SAME:
            return m
    return 0


@dataclasses.dataclass
class Seen:
    """What was found."""

    settled: int = 0
    touching: int = 0
    """Of these with impacts or contacts in the last periods."""
    found: int = 0
    unreduced: int = 0
    other_states: int = 0
    """Found, but a run from it does not return."""
    missed: list[int] = dataclasses.field(default_factory=list)


def campaign(systems: int, seed: int = 1) -> Seen:
    """Look for the orbits that runs of random chains show."""
    rng, seen = np.random.default_rng(seed), Seen()
    for number in range(systems):
        system = draw(rng)
        if number % 2:
            e = system.e
            e[0] = 0.0
            system = zivi.LinearSystem(
                system.M, system.C, system.K, excitation=system.excitation, gaps=system.gaps, e=e
            )
        n, period = system._n, 2 * np.pi / system.excitation[0].omega
        run = zivi.simulate(system, (0, PERIODS * period), (np.zeros(n), np.zeros(n)))
        m = repeats(run, period) if run.success else 0
        if not m:
            continue
        seen.settled += 1
        late = run.t[-1] - m * period
        seen.touching += bool(np.any(run.impacts["t"] > late) or run.contacts[-1].any())
        orbit = zivi.periodic_orbit(system, run)
        if not orbit.success:
            seen.missed.append(number)
            continue
        seen.found += 1
        seen.unreduced += orbit.multiple != m
        own = orbit.trajectory
        ends = np.concatenate([own.q[[0, -1]], own.qdot[[0, -1]]], axis=1)
        off = np.max(np.abs(ends[1] - ends[0])) / np.max(np.abs(ends))
        seen.other_states += bool(off > 1e-8)
    return seen


if __name__ == "__main__":
    began = time.process_time()
    print(campaign(*(int(it) for it in (sys.argv[1:] or ["250"]))))
    print(f"{time.process_time() - began:.0f} s of a processor")
