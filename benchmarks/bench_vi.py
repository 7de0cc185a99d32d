"""Measure the box-VI solver and write `benchmarks/results/vi.md`; with --quick, print less only."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import vi_counts
import vi_growth
import vi_peer
import vi_report
import vi_times

PAGE = Path(__file__).resolve().parent / "results" / "vi.md"


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    random: int = 10
    """Random starts for each problem."""
    rounds: int = 5
    sides: tuple[int, ...] = vi_growth.SIDES
    solves: int = vi_growth.SOLVES
    peer_solves: int = 50_000


QUICK = Effort(random=2, rounds=1, sides=(10, 15), solves=50_000, peer_solves=5_000)


def _say(what: str) -> None:
    print(f"bench: {what} ...", file=sys.stderr, flush=True)


def measure(effort: Effort) -> vi_report.Figures:
    """Measure everything; what needs Siconos only where it is."""
    peer = vi_peer.find()
    listed, random = vi_counts.listed(), vi_counts.random(effort.random)
    unsolvable = vi_counts.listed(vi_counts.UNSOLVABLE)
    counts = {}
    for name, solve in vi_counts.solvers(peer).items():
        _say(f"counting, {name}")
        counts[name] = tuple(vi_counts.count(solve, it) for it in (listed, random, unsolvable))
    ratios, pivots, lost = {}, {}, None
    if peer is not None:
        _say("timing beside Siconos")
        ratios = vi_times.ratios(peer, effort.rounds)
        pivots = vi_times.pivots(peer, effort.rounds)
        lost = vi_times.lost_by(peer, effort.peer_solves)
        peer.close()
    _say("growing the obstacle problem")
    sizes = vi_growth.growth(effort.sides)
    _say("solving again and again")
    return vi_report.Figures(
        counts=counts,
        ratios=ratios,
        pivots=pivots,
        sizes=sizes,
        leak=vi_growth.leak(effort.solves),
        lost=lost,
    )


def write(effort: Effort | None = None) -> str:
    """Measure all of it and write the page; returns it."""
    page = vi_report.page(measure(effort or Effort()))
    PAGE.write_text(page)
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a smaller run, printed only")
    if parser.parse_args().quick:
        print(vi_report.page(measure(QUICK)))
    else:
        print(write())


if __name__ == "__main__":
    main()
