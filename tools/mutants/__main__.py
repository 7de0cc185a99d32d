"""Mutations drawn by tools, and whether the tests notice: ``make mutants``.

    make mutants                    60 mutations in every area, into benchmarks/results/mutants.md
    make mutants MUTANTS='mechanics vi --draw 100 --seed 7'
    .venv/bin/python tools/mutants mechanics --resume --entries
                                    again what was not killed in the last run, for new tests

cargo-mutants (Rust) and mutmut (Python) list every mutation that they know; a seed puts them into
an order, and the first of each area that compile are drawn. They are built into one copy of the
tree, in ``target/mutants``, behind a switch that is read at run time. A first run without mutation
notes which test reaches which of the changed functions; then each mutation is switched on, and the
tests that reach it run, those in Rust first, until one fails or takes ten times as long.

The area ``chosen`` has those of ``list``, which no tool draws. What survives needs a test, or a
reason in ``equivalent.toml`` (``--entries`` prints the form).
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import chosen as by_hand
import python
import rust
from mutant import Area, Mutant, areas, drawn
from scratch import Scratch
from suite import Suite, binaries, record_python, record_rust, tests_of
from table import entry, equivalents, reason, rows, write_section
from trial import EQUIVALENT, SURVIVED, trial

ROOT = Path(__file__).parents[2]
Recorder = Callable[[Suite, Sequence[Area]], None]
SPARE = 1.3  # some of those drawn do not compile


def arguments() -> argparse.Namespace:
    """Read the command line."""
    known = areas()
    known[by_hand.NAME] = by_hand.area(by_hand.read())
    parser = argparse.ArgumentParser(prog="mutants", description=__doc__.split("\n\n")[0])
    parser.add_argument("areas", nargs="*", help=f"of {', '.join(known)} (default: all)")
    parser.add_argument("--draw", type=int, default=60, metavar="N", help="in each area (60)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (1)")
    parser.add_argument("--resume", action="store_true", help="leave out what was killed before")
    parser.add_argument("--only", default="", help="mutants whose line has this text")
    parser.add_argument("--only-rust", action="store_true", help="leave out the tests in Python")
    parser.add_argument(
        "--tests", default="", metavar="GLOB", help="only these files of tests in Python"
    )
    parser.add_argument("--list", action="store_true", help="only list what is drawn")
    parser.add_argument("--entries", action="store_true", help="print survivors as entries")
    parser.add_argument("--into", type=Path, default=ROOT / "target" / "mutants", help="the copy")
    parser.add_argument("--report", type=Path, metavar="PAGE", help="write the table into PAGE")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="mutations at a time")
    parser.add_argument(
        "--budget", type=float, default=60, metavar="S", help="of tests for one mutation (60)"
    )
    given = parser.parse_args()
    if unknown := set(given.areas) - set(known):
        parser.error(f"unknown areas {sorted(unknown)}")
    given.areas = [known[name] for name in given.areas or known]
    return given


@dataclass
class Draw:
    """What is tried, by area, and how each is switched on."""

    mutants: dict[str, list[Mutant]] = field(default_factory=dict)
    unviable: dict[str, int] = field(default_factory=dict)
    switches: dict[Mutant, dict[str, str]] = field(default_factory=dict)
    places: dict[str, set[str]] = field(default_factory=dict)


def choose(given: argparse.Namespace, found: Sequence[Mutant], number: int) -> list[Mutant]:
    """Draw `number` of the mutations in each area."""
    chosen = []
    for area in given.areas:
        of_area = drawn([mutant for mutant in found if mutant.area == area.name], given.seed)
        most = len(of_area) if area.name == by_hand.NAME else number
        chosen += [mutant for mutant in of_area if given.only in str(mutant)][:most]
    return chosen


def prepare(given: argparse.Namespace, scratch: Scratch) -> Draw:
    """Draw, and write the copy of the tree with everything drawn."""
    entries = by_hand.read() if any(a.name == by_hand.NAME for a in given.areas) else []
    listed = by_hand.in_rust(ROOT, entries)
    if any(area.files and area.rust for area in given.areas):
        program = rust.installed(given.into / "tools")
        listed += rust.list_mutants(program, ROOT, list(areas().values()))
    scripts = python.Switched(
        ROOT, [area for area in given.areas if area.files and not area.rust], entries
    )
    spare = choose(given, listed, round(given.draw * SPARE))
    core = rust.Switched(scratch, ROOT, spare)
    draw = Draw()
    chosen = choose(given, scripts.mutants, given.draw)
    if given.list:
        print(*spare, *chosen, sep="\n")
        sys.exit()
    scratch.copy(but={mutant.file for mutant in (*spare, *chosen)} | rust.WRITTEN | python.WRITTEN)
    if spare:
        core.drop_unviable()
    scripts.write(scratch, chosen)
    for area in given.areas:
        inside = [mutant for mutant in (*spare, *chosen) if mutant.area == area.name]
        viable = [mutant for mutant in inside if mutant not in core.unviable]
        if area.name != by_hand.NAME:
            viable = viable[: given.draw]
        draw.mutants[area.name] = viable
        tried = inside[: inside.index(viable[-1]) + 1] if viable else inside
        draw.unviable[area.name] = len(tried) - len(viable)
        for mutant in viable:
            if mutant in core.numbers:
                draw.switches[mutant] = {"ZIVI_MUTANT": str(core.numbers[mutant])}
            else:
                draw.switches[mutant] = {"MUTANT_UNDER_TEST": scripts.names[mutant]}
    draw.places = core.reached() | scripts.reached()
    return draw


class Trials:
    """The mutants of a draw, tried: first with the tests in Rust, then with those in Python."""

    def __init__(self, given: argparse.Namespace, scratch: Scratch, draw: Draw):
        self.given, self.scratch, self.draw = given, scratch, draw
        self.path = given.into / "results.json"
        self.results: dict[str, str] = {}
        if self.path.is_file():
            self.results = json.loads(self.path.read_text(encoding="utf-8"))
        self.start = time.monotonic()

    def of(self, mutants: Sequence[Mutant]) -> list[tuple[Mutant, str]]:
        """Give the results of `mutants`."""
        return [(mutant, self.results[mutant.digest]) for mutant in mutants]

    def run(self) -> None:
        """Try everything; what was found so far is kept if it is interrupted."""
        known = equivalents()
        left = [mutant for inside in self.draw.mutants.values() for mutant in inside]
        for mutant in left:
            if reason(mutant, known):
                self.results[mutant.digest] = EQUIVALENT
            elif not self.given.resume or mutant.digest not in self.results:
                self.results[mutant.digest] = SURVIVED
        for stage, record in (("rust", self.record_rust), ("python", self.record_python)):
            left = [mutant for mutant in left if self.results[mutant.digest] == SURVIVED]
            areas = [area for area in self.given.areas if area.name in {m.area for m in left}]
            if stage == "rust":
                tried = [mutant for mutant in left if mutant.file.endswith(".rs")]
            else:
                tried = left
            if tried and not (self.given.only_rust and stage == "python"):
                suite = self.recorded(stage, record, areas)
                with ThreadPoolExecutor(self.given.jobs) as pool:
                    list(pool.map(lambda mutant, suite=suite: self.one(suite, mutant), tried))

    def one(self, suite: Suite, mutant: Mutant) -> None:
        """Try one mutant."""
        switch = self.draw.switches[mutant]
        found, how = trial(self.scratch, suite, mutant, switch, self.given.budget)
        self.results[mutant.digest] = found
        seconds = time.monotonic() - self.start
        print(f"{seconds:6.0f} s {found:8s} {mutant.area}: {mutant} [{how}]", flush=True)
        self.path.write_text(json.dumps(self.results, indent=0, sort_keys=True), encoding="utf-8")

    def recorded(self, stage: str, record: Recorder, areas: Sequence[Area]) -> Suite:
        """Find which test reaches what; with --resume only of tests that were not there."""
        path = self.given.into / f"suite.{stage}.json"
        suite = Suite.load(path)
        places = {place for inside in self.draw.places.values() for place in inside}
        if not self.given.resume or not places <= suite.known:
            suite = Suite(known=places)
        record(suite, areas)
        if not suite.seconds:
            raise RuntimeError("no test passes in the copy")
        suite.save(path)
        if suite.failed:
            names = sorted(test.name for test in suite.failed)
            print("left out, they fail in the copy:", *names, sep="\n  ")
        return suite

    def record_rust(self, suite: Suite, areas: Sequence[Area]) -> None:
        """Run the tests in Rust that are new."""
        targets = {target for area in areas for target in area.rust}
        found = binaries(self.scratch, targets)
        tests = [test for binary in found for test in tests_of(self.scratch, *binary)]
        old = suite.names()
        suite.rename(tests)
        new = [test for test in tests if test.key not in old]
        print(f"{len(new)} tests in Rust", flush=True)
        record_rust(self.scratch, suite, new, self.draw.places, self.given.jobs)

    def record_python(self, suite: Suite, areas: Sequence[Area]) -> None:
        """Run the files of tests in Python that are new or were changed."""
        self.scratch.extension(built=not any(area.rust for area in self.given.areas))
        patterns = {pattern for area in areas for pattern in area.tests}
        paths = {path for pattern in patterns for path in ROOT.glob(pattern)}
        if self.given.tests:
            paths &= set(ROOT.glob(self.given.tests))
        files = {path.relative_to(ROOT).as_posix(): path.read_bytes() for path in paths}
        new = suite.new_files(files)
        print(f"{len(new)} files of tests in Python", flush=True)
        record_python(self.scratch, suite, new, self.draw.places, self.given.jobs)


def main() -> int:
    """Draw, try, tell; the exit status is 0 where nothing survived."""
    given = arguments()
    scratch = Scratch(ROOT, given.into)
    draw = prepare(given, scratch)
    trials = Trials(given, scratch, draw)
    trials.run()
    tests = f"in Rust, {given.tests}" if given.tests else "all"
    tests = "in Rust" if given.only_rust else tests
    made = {
        area: rows(area, given.seed, trials.of(inside), draw.unviable[area], tests)
        for area, inside in draw.mutants.items()
    }
    mutants = [mutant for inside in draw.mutants.values() for mutant in inside]
    survived = [mutant for mutant, result in trials.of(mutants) if result == SURVIVED]
    if given.entries:
        print(*(entry(mutant) for mutant in survived), sep="\n\n")
    for row, lines in made.values():
        print(row, *lines, sep="\n")
    if given.report:
        write_section(given.report, [*areas(), by_hand.NAME], made)
    return 1 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
