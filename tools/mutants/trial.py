"""One mutation made, its tests run, the mutation taken back."""

import sys
import time

from results import BROKEN, KILLED, SURVIVED
from scratch import LATE

VERDICTS = {0: SURVIVED, 1: KILLED, LATE: KILLED}  # by pytest's exit code


class CannotFailError(Exception):
    """Without any mutation the tests fail, or do not run: that they fail would say nothing."""


def baseline(scratch, mutants):
    """See that the tests that `mutants` name pass before anything is changed."""
    tests = list(dict.fromkeys(test for mutant in mutants for test in mutant.tests))
    found, output = outcome(scratch, tests, compiled=True)
    if found != SURVIVED:
        raise CannotFailError(output[-3000:])


def trial(scratch, mutant):
    """Give what became of `mutant`, and how long it took (s)."""
    start = time.monotonic()
    path = scratch.tree / mutant.file
    original = path.read_text(encoding="utf-8")
    compiled = path.suffix == ".rs"
    path.write_text(mutant.mutated(original), encoding="utf-8")
    try:
        found, _ = outcome(scratch, mutant.tests, compiled=compiled)
    finally:
        path.write_text(original, encoding="utf-8")
    if compiled and any(is_python(test) for test in mutant.tests):
        scratch.extension()  # of the code as it was, for the next mutation in Python
    return found, time.monotonic() - start


def is_python(test):
    """Tell a test of pytest from one of cargo."""
    return test.startswith("tests/")


def binaries(tests):
    """Group tests in Rust by their binary: the options of `cargo test`, and the names."""
    groups = {}
    for test in tests:
        package, target, *names = test.split(" ")
        binary = ("--lib",) if target == "lib" else ("--test", target)
        groups.setdefault(("-p", package, *binary), []).append(names)
    return {
        binary: [] if [] in tests else [name for names in tests for name in names]
        for binary, tests in groups.items()
    }


def outcome(scratch, tests, *, compiled):
    """Run `tests`: killed where one fails, broken where they cannot run, else survived.

    The extension is compiled first if the mutation is in what it is `compiled` from. Also gives the
    output of the command that decided.
    """
    for options, names in binaries([test for test in tests if not is_python(test)]).items():
        code, output = scratch.cargo("test", *options, "--no-run")
        if code != 0:
            return BROKEN, output
        code, output = scratch.cargo("test", *options, tests=names)
        if code != 0:
            return KILLED, output
        if "running 0 tests" in output:
            return BROKEN, output
    scripts = [test for test in tests if is_python(test)]
    if not scripts:
        return SURVIVED, ""
    if compiled and (complaint := scratch.extension()):
        return BROKEN, complaint
    options = ("-x", "-q", "-p", "no:cacheprovider")
    code, output = scratch.run(sys.executable, "-m", "pytest", *options, *scripts)
    return VERDICTS.get(code, BROKEN), output
