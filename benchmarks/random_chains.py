"""Random chains and stacks of bodies: runs that fail, and how far ends are from a reference.

    python benchmarks/random_chains.py [chains] [seed]

Every run is looked at (`check` of tests/test_mechanics_chains.py): it ends, no gap is negative, no
energy is won, each impact obeys the law. Its end is compared with a reference (tests/chains.py)
that follows impact by impact, up to `MOST` of them. An end elsewhere is no fault where the
reference is no surer of its own, that is where one of these moves it by a tenth as far:

- gaps that count as closed from 1e-17 m to 1e-13 m. A light body that two others squeeze hits both
  in turn, and the next gap is about the square of the last: 1e-9, 1e-18, 1e-35, while the speeds
  fall by a fifth a hit. Positions in double precision know nothing of such gaps, but whether one is
  closed or just not when the other hits decides where that impulse goes. Many of these ends are
  those of the reference with its small gaps closed; that of chain 73 of seed 4 is between them;
- masses that are changed by 1e-12 of themselves: bodies between elastic walls forget their start;
- slow impacts made plastic, 1e-8 m/s or 1e-7 m/s: accumulations whose last impacts decide.
"""

import dataclasses
import sys
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from chains import Chain, Followed
from test_mechanics_chains import check

MOST = 4000
"""Impacts that the reference follows."""
FAR = 1e-4
"""How far an end may be from the reference's."""


def end(chain, slow=1e-9, near=0.0):
    """Give the end by the reference, or None if it has too many impacts."""
    run = Followed(chain, slow, near)
    return np.concatenate([run.q, run.v]) if run.until(chain.end, MOST) else None


def distance(one, other):
    """Give the largest difference of two ends; infinite if one is not known."""
    return np.inf if one is None or other is None else abs(one - other).max()


def compared(chain, found):
    """Say how an end compares with the reference's, and how far from it."""
    exact = end(chain)
    if exact is None:
        return f"more than {MOST} impacts", 0.0
    far = distance(found, exact)
    if far < FAR:
        return f"within {FAR:g}", far
    closed = [end(chain, near=10.0**-k) for k in (17, 16, 15, 14, 13)]
    if min(distance(found, other) for other in closed) < FAR:
        return f"within {FAR:g} with gaps below rounding closed", far
    pattern = np.where(np.arange(len(chain.mass)) % 2, 1.0, -1.0)
    ways = {
        "decided by gaps below rounding": closed,
        "moved as far by masses that are changed by 1e-12": [
            end(dataclasses.replace(chain, mass=chain.mass * (1 + change)))
            for change in (1e-12 * pattern, -1e-12 * pattern)
        ],
        "decided by slow impacts": [end(chain, slow=slow) for slow in (1e-8, 1e-7)],
    }
    for reason, ends in ways.items():
        if max(distance(other, exact) for other in ends) > 0.1 * far:
            return reason, far
    return "elsewhere", far


def main(chains=5000, seed=1):
    random, count = Random(seed), Counter()
    for number in range(chains):
        chain = Chain.random(random)
        try:
            sol = check(chain)
        except AssertionError as wrong:
            count["wrong"] += 1
            print(f"{number}: {wrong}", flush=True)
            continue
        told, far = compared(chain, np.concatenate([sol.q[-1], sol.qdot[-1]]))
        count[told] += 1
        if far >= FAR:
            print(f"{number}: {far:.2g} from the reference: {told}", flush=True)
    print(dict(count))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
