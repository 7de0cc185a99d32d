"""Campaigns of random loops of arms: landings, positions only, a batch against its loops.

python benchmarks/control_campaigns.py [table] [--runs 200]: arms, positions, batch
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import zivi

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mechanical_arms import bouncing_error, positions_only, tapping, tracker, two_links
from random_arms import closed_since, land


def arms(runs: int) -> None:
    """Land random arms of two to four links on one or two planes, with right and wrong models."""
    for wrong in (0.0, 1.0):
        times = [closed_since(land(seed, wrong)) for seed in range(runs)]
        late = [seed for seed, it in enumerate(times) if np.isnan(it)]
        what = "wrong" if wrong else "right"
        print(f"arms, {what} models: {runs - len(late)} of {runs} closed, open {late}, ", end="")
        print(f"time median {np.nanmedian(times):.3f}, worst {np.nanmax(times):.3f} s")


def positions(runs: int) -> None:
    """Run the arm of two links by its measured angles alone, with everything wrong at once."""
    found = [positions_only(seed) for seed in range(runs)]
    errors = [bouncing_error(run) for run in found]
    forces = np.concatenate([run.reactions[-100:] for run in found])
    print(f"positions: {sum(bool(run.contacts[-1].all()) for run in found)} of {runs} in contact, ")
    print(f"    rms g median {np.median(errors):.1e}, worst {max(errors):.1e}, ", end="")
    print(f"force {forces.min():.2f} ... {forces.max():.2f}")


def batch(runs: int) -> None:
    """Compare a batch of loops with the same loops one by one, bit for bit."""
    source, arm = np.random.default_rng(0), two_links()
    starts = tapping().q[0] + source.uniform(-0.1, 0.1, (runs, 2)), np.zeros((runs, 2))
    masses, seeds = source.uniform(0.7, 0.9, runs), list(range(runs))
    asked = {"reference": tapping(), "method": zivi.RKPeriod()}
    begun = time.perf_counter()
    many = zivi.simulate_closed_loop_batch(
        arm,
        tracker(),
        (0, 1.5),
        starts,
        noise=(1e-5, 1e-3),
        seed=seeds,
        parameters={"m2": masses},
        **asked,
    )
    took, other = time.perf_counter() - begun, 0
    for i in range(runs):
        run = zivi.simulate_closed_loop(
            arm.replace(m2=masses[i]),
            tracker(),
            (0, 1.5),
            (starts[0][i], starts[1][i]),
            noise=(1e-5, 1e-3),
            seed=i,
            **asked,
        )
        last = {name: getattr(run, name)[-1] for name in ("q", "qdot", "gaps", "reactions", "u")}
        other += not all(np.array_equal(getattr(many, name)[i], it) for name, it in last.items())
    print(f"batch: {other} of {runs} loops differ from single ones; the batch took {took:.1f} s")


TABLES = {"arms": (arms, 200), "positions": (positions, 50), "batch": (batch, 1000)}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tables", nargs="*", default=list(TABLES))
    parser.add_argument("--runs", type=int)
    given = parser.parse_args()
    for table in given.tables:
        run, usual = TABLES[table]
        run(given.runs or usual)
