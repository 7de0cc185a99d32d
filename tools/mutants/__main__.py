"""Mutations of the code, one at a time, and whether the tests notice: ``make mutants``.

Each entry of ``list/*.toml`` replaces one piece of text in one file and names the tests that must
fail then, or says why nothing can. The entries are applied in a copy of the tree under
``target/mutants``, never in the tree itself.
"""

import argparse
import sys
from fnmatch import fnmatch
from pathlib import Path

from entries import faults, read
from results import EQUIVALENT, KILLED, Results
from scratch import Scratch
from table import lines, write_section
from trial import baseline, trial

ROOT = Path(__file__).parents[2]


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="mutants", description=__doc__.split("\n\n")[0])
    parser.add_argument("names", nargs="*", help="only these, e.g. 'step-*' (default: all)")
    parser.add_argument("--check", action="store_true", help="only see that every entry applies")
    parser.add_argument("--list", action="store_true", help="only name the entries")
    parser.add_argument("--resume", action="store_true", help="leave out what was killed before")
    parser.add_argument(
        "--into",
        type=Path,
        default=ROOT / "target" / "mutants",
        help="where the copy and builds go",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE", help="write the table into PAGE")
    parser.add_argument(
        "--timeout", type=float, default=600, metavar="S", help="for one command (default 600)"
    )
    return parser.parse_args()


def main():
    """Apply the chosen entries; the exit status is 0 where every one was killed."""
    given = arguments()
    mutants = read()
    wrong = faults(ROOT, mutants)
    if wrong:
        print(*wrong, sep="\n", file=sys.stderr)
        return 2
    if given.check:
        print(f"{len(mutants)} entries apply")
        return 0
    results = Results(given.into / "results.json")
    chosen = [
        mutant
        for mutant in mutants
        if (not given.names or any(fnmatch(mutant.name, name) for name in given.names))
        and not (given.resume and results.of(mutant) == KILLED)
    ]
    if given.list:
        print(*(mutant.name for mutant in chosen), sep="\n")
        return 0
    tried = [mutant for mutant in chosen if not mutant.equivalent]
    if tried:
        run(Scratch(ROOT, given.into, given.timeout), tried, results)
    if given.report:
        write_section(given.report, lines(mutants, results))
    else:
        print(*lines(chosen, results), sep="\n")
    return 0 if all(results.of(mutant) in (KILLED, EQUIVALENT) for mutant in chosen) else 1


def run(scratch, mutants, results):
    """Try `mutants` one by one; what was found so far is kept if it is interrupted."""
    baseline(scratch, mutants)
    for number, mutant in enumerate(mutants, 1):
        found, took = trial(scratch, mutant)
        results.keep(mutant, found)
        print(f"{number:4d}/{len(mutants)} {found:9s} {took:5.0f} s  {mutant.name}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
