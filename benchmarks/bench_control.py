"""Measure the controllers, write `benchmarks/results/control.md`; with --quick, print less only."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import control_counts
import control_report
import control_siconos
import control_times

PAGE = Path(__file__).resolve().parent / "results" / "control.md"


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    ticks: int = 10_000
    counted: int = 2_000
    problems: int = 5_000
    """Random problems for each speed beside Siconos."""
    rounds: int = 51
    rounds_beside: int = 5


QUICK = Effort(ticks=2_000, counted=100, problems=200, rounds=5, rounds_beside=2)


def _say(what: str) -> None:
    print(f"bench: {what} ...", file=sys.stderr, flush=True)


def measure(effort: Effort) -> control_report.Figures:
    """Measure everything; what needs Siconos or callgrind only where they are."""
    _say("timing ticks")
    ticks = control_times.ticks(effort.ticks, effort.rounds)
    calls = control_times.calls(effort.rounds)
    _say("timing closed loops")
    loops = control_times.loops(effort.rounds)
    foreign = control_times.written_in_python(effort.rounds)
    _say("timing ticks beside Siconos, if there is one")
    beside = control_siconos.measure(effort.problems, effort.rounds_beside)
    _say("counting instructions of ticks")
    counts = control_counts.measure(effort.counted)
    return control_report.Figures(
        ticks=ticks,
        counts=counts,
        beside=beside,
        calls=calls,
        loops=loops,
        foreign=foreign,
    )


def write(effort: Effort | None = None) -> str:
    """Measure all of it and write the page; returns it."""
    page = control_report.page(measure(effort or Effort()))
    PAGE.write_text(page)
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a smaller run, printed only")
    if parser.parse_args().quick:
        print(control_report.page(measure(QUICK)))
    else:
        print(write())


if __name__ == "__main__":
    main()
