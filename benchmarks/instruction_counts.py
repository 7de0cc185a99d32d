"""Instructions of the innermost loops, beside those of the last release (callgrind).

    python benchmarks/instruction_counts.py            counts, and says what rose by more than 3 %
    python benchmarks/instruction_counts.py --write    makes them the numbers to compare with

They are the same on every run of one build, and differ between compilers: a rise that comes with
another one is that of the compiler. Needs valgrind and cargo.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import instructions

STORED = Path(__file__).with_name("results") / "instructions.json"
LARGEST = 0.03
"""A rise of more than this part is said."""


class Case(NamedTuple):
    """An example that is run twice, for the difference.

    Parameters
    ----------
    package, example : str
        What is run.
    arguments : str
        With which arguments, ``{}`` in the place of the number of repetitions.
    few, many : int
        How many these are.
    """

    package: str
    example: str
    arguments: str
    few: int
    many: int


CASES = {
    "fixed step, recorded": Case("zivi", "step_cost", "recorded {}", 2000, 12000),
    "runs of a mass by the pair": Case("zivi", "switched_cost", "{}", 1, 3),
    "period of an oscillator by series": Case("zivi", "flight_cost", "oscillator {}", 200, 1200),
    "the same, times and positions that draw it": Case(
        "zivi", "flight_cost", "positions {}", 200, 1200
    ),
    "the same, drawn": Case("zivi", "flight_cost", "drawn {}", 200, 1200),
    "sampled loop, a period": Case("zivi", "flight_cost", "sampled {}", 2000, 12000),
    "sensitivity, two columns": Case("zivi", "sensitivity_cost", "2 {}", 2, 12),
    "runs of a mechanism": Case("zivi", "mechanics_cost", "{}", 1, 3),
    "period of two links, tracked": Case("zivi", "gap_tracker_cost", "2 {}", 100, 300),
    "period of three links, two gaps": Case("zivi", "gap_tracker_cost", "3 {}", 100, 300),
    "tick of the tracker": Case("zivi-core", "tick_cost", "loop {}", 2000, 12000),
    "tick with an observer": Case("zivi-core", "tick_cost", "observer {}", 2000, 12000),
}


def count(case: Case) -> float:
    """Count the instructions of one repetition."""
    program = instructions.example(case.package, case.example)

    def refs(number: int) -> int:
        return instructions.refs(program, *case.arguments.format(number).split())

    return (refs(case.many) - refs(case.few)) / (case.many - case.few)


def compiler() -> str:
    """Give the compiler and the processor."""
    told = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True)
    return f"{told.stdout.split(' (')[0]}, {platform.machine()}"


def main() -> int:
    """Count all, compare, perhaps write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="compare with these from now on")
    arguments = parser.parse_args()
    if (reason := instructions.missing()) is not None:
        print(f"not counted: {reason}")
        return 77
    before = json.loads(STORED.read_text()) if STORED.exists() else {"counts": {}}
    found = {"compiler": compiler(), "counts": {name: count(it) for name, it in CASES.items()}}
    if found["compiler"] != before.get("compiler", found["compiler"]):
        print(f"counted with {found['compiler']}, the numbers before with {before['compiler']}")
    rose = []
    for name, now in found["counts"].items():
        then = before["counts"].get(name)
        change = "" if then is None else f"{now / then - 1.0:+.1%}"
        print(f"{name:36} {now:12.0f} {change}")
        if then is not None and now > (1.0 + LARGEST) * then:
            rose.append(f"{name}: {then:.0f} -> {now:.0f} instructions, {change}")
    mark = "::warning::" if os.environ.get("GITHUB_ACTIONS") else "rose: "
    for line in rose:
        print(f"{mark}{line}")
    if arguments.write:
        found["counts"] = {name: round(value, 1) for name, value in found["counts"].items()}
        STORED.write_text(json.dumps(found, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
