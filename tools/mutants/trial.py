"""One mutation switched on, and the tests that reach it."""

import tempfile
from collections import defaultdict
from collections.abc import Sequence

from mutant import Mutant
from scratch import LATE, Scratch
from suite import Suite, Test, pytest

KILLED, TIMEOUT, SURVIVED, EQUIVALENT = "killed", "timeout", "survived", "equivalent"
QUICK = 0.3  # s; the tests below this run first
PATIENCE = 10  # times as long as without mutation, and some seconds
NO_TESTS = 5  # pytest's exit code


def trial(
    scratch: Scratch, suite: Suite, mutant: Mutant, switch: dict[str, str], budget: float
) -> tuple[str, str]:
    """Give what became of `mutant`, and the tests that told (or how many did not).

    `switch` is the environment that switches it on; the tests take `budget` s of time at most, as
    measured without mutations.
    """
    spent, number = 0.0, 0
    reaching = suite.reaching(mutant.place)
    golden = [test for test in reaching if is_golden(test) and mutant.file.endswith(".rs")]
    others = within(suite, [test for test in reaching if test not in golden], budget)
    for tests in groups(suite, golden) + groups(suite, others):
        seconds = sum(suite.seconds[test] for test in tests)
        spent += seconds
        number += len(tests)
        code = run(scratch, tests, switch, 30 + PATIENCE * seconds)
        if code == LATE:
            return TIMEOUT, tests[0].binary
        if code not in (0, NO_TESTS):
            first = tests[0]
            return KILLED, first.binary.rpartition("/")[2].partition("-")[0] + f" ({len(tests)})"
    return SURVIVED, f"{number} tests, {spent:.1f} s"


def is_golden(test: Test) -> bool:
    """Whether it compares every bit of many results: the first to tell a change in Rust."""
    return test.name.startswith("tests/test_golden")


def within(suite: Suite, tests: Sequence[Test], budget: float) -> list[Test]:
    """Leave out the slowest tests, beyond `budget` seconds together."""
    kept, spent = [], 0.0
    for test in tests:
        spent += suite.seconds[test]
        if kept and spent > budget:
            break
        kept.append(test)
    return kept


def groups(suite: Suite, tests: Sequence[Test]) -> list[list[Test]]:
    """Put tests together that one command runs: in Rust first, there the fast ones first."""
    found: dict[tuple[bool, bool, str], list[Test]] = defaultdict(list)
    for test in tests:
        python = test.binary == "pytest"
        found[python, not python and suite.seconds[test] > QUICK, test.binary].append(test)
    return [found[key] for key in sorted(found)]


def run(scratch: Scratch, tests: Sequence[Test], switch: dict[str, str], timeout: float) -> int:
    """Run tests of one binary or of pytest: the exit code."""
    names = [test.name for test in tests]
    if tests[0].binary != "pytest":
        command = (tests[0].binary, "--exact", *names)
        return scratch.run(*command, cwd=tests[0].folder, timeout=timeout, environment=switch)[0]
    with tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8") as file:
        file.write("\n".join(names))
        file.flush()
        return scratch.run(*pytest("-x", f"@{file.name}"), timeout=timeout, environment=switch)[0]
