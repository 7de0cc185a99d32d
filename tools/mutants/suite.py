"""The tests, in Rust and Python: how long each takes and which mutated functions it reaches."""

import hashlib
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from plugin import HEAD
from rust import PACKAGES
from scratch import Scratch


@dataclass(frozen=True)
class Test:
    """One test: of a binary (Rust; the folder to run it in), or of pytest."""

    binary: str
    name: str
    folder: str = "."

    @property
    def key(self) -> tuple[str, str]:
        """Names it in every build."""
        return self.binary.rpartition("/")[2].rpartition("-")[0] or self.binary, self.name


@dataclass
class Suite:
    """The tests that pass in the copy without any mutation.

    Attributes
    ----------
    seconds : dict
        How long each takes.
    reached : dict
        The places (`Mutant.place`) that each reaches.
    failed : list
        Tests that fail in the copy: they can tell nothing.
    known : set
        The places for which this was recorded.
    files : dict
        What the files of tests in Python were (digests).
    """

    seconds: dict[Test, float] = field(default_factory=dict)
    reached: dict[Test, set[str]] = field(default_factory=dict)
    failed: list[Test] = field(default_factory=list)
    known: set[str] = field(default_factory=set)
    files: dict[str, str] = field(default_factory=dict)

    def reaching(self, place: str) -> list[Test]:
        """Give the tests that reach `place`, the fastest first."""
        found = [test for test, places in self.reached.items() if place in places]
        return sorted(found, key=lambda test: self.seconds[test])

    def names(self) -> set[tuple[str, str]]:
        """Name the tests, whatever their binaries are called."""
        return {test.key for test in self.seconds}

    def new_files(self, files: Mapping[str, bytes]) -> list[str]:
        """Give the files of tests in Python that changed; the tests that they had are forgotten."""
        now = {name: hashlib.sha256(text).hexdigest() for name, text in files.items()}
        new = [name for name in sorted(now) if self.files.get(name) != now[name]]
        for test in list(self.seconds):
            if test.binary == "pytest" and test.name.partition("::")[0] in new:
                del self.seconds[test], self.reached[test]
        self.files |= now
        return new

    def rename(self, tests: Sequence[Test]) -> None:
        """Take the binaries of a new build; what it does not have is forgotten."""
        now = {test.key: test for test in tests}
        for test in list(self.seconds):
            if test.binary != "pytest":
                seconds, reached = self.seconds.pop(test), self.reached.pop(test)
                if new := now.get(test.key):
                    self.seconds[new], self.reached[new] = seconds, reached

    def save(self, path: Path) -> None:
        """Keep it in a file."""
        tests = [
            [test.binary, test.name, test.folder, seconds, sorted(self.reached[test])]
            for test, seconds in self.seconds.items()
        ]
        kept = {"tests": tests, "known": sorted(self.known), "files": self.files}
        path.write_text(json.dumps(kept), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "Suite":
        """Read what was kept, if anything."""
        suite = cls()
        if path.is_file():
            given = json.loads(path.read_text(encoding="utf-8"))
            suite.known, suite.files = set(given["known"]), given["files"]
            for binary, name, folder, seconds, places in given["tests"]:
                test = Test(binary, name, folder)
                suite.seconds[test], suite.reached[test] = seconds, set(places)
        return suite


def binaries(scratch: Scratch, targets: Iterable[str]) -> list[tuple[str, str]]:
    """Build tests in Rust, as an area names them: each binary, and the folder to run it in."""
    found = []
    for package in PACKAGES:
        chosen = {target.partition(" ")[2] for target in targets if target.split()[0] == package}
        options = [f"--test={target}" for target in sorted(chosen) if target not in ("lib", "")]
        options += ["--lib"] if "lib" in chosen or "" in chosen else []
        options += ["--tests"] if "" in chosen else []
        if chosen:
            found += built(scratch, f"--package={package}", *options)
    return found


def built(scratch: Scratch, *options: str) -> list[tuple[str, str]]:
    """Build tests of one package."""
    code, output = scratch.cargo("test", *options, "--no-run", "--message-format=json")
    if code != 0:
        raise RuntimeError(f"the tests do not compile:\n{output[-3000:]}")
    messages = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    return [
        (message["executable"], str(Path(message["manifest_path"]).parent))
        for message in messages
        if message.get("executable") and message["profile"]["test"]
    ]


def tests_of(scratch: Scratch, binary: str, folder: str) -> list[Test]:
    """List the tests of a binary that are not ignored."""
    listed, ignored = (
        {
            line.removesuffix(": test")
            for line in scratch.run(binary, "--list", "--format=terse", *more)[1].splitlines()
            if line.endswith(": test")
        }
        for more in ([], ["--ignored"])
    )
    return [Test(binary, name, folder) for name in sorted(listed - ignored)]


def record_rust(
    scratch: Scratch, suite: Suite, tests: Sequence[Test], places: dict[str, set[str]], jobs: int
) -> None:
    """Run each test on its own."""
    numbers = count()

    def one(test: Test) -> None:
        log = scratch.build / f"reached.{next(numbers)}"
        log.unlink(missing_ok=True)
        start = time.monotonic()
        code, _ = scratch.run(
            *(test.binary, "--exact", test.name, "--test-threads=1"),
            cwd=test.folder,
            timeout=300,
            environment={"ZIVI_MUTANT": "record", "ZIVI_REACHED": str(log)},
        )
        seconds = time.monotonic() - start
        if code == 0:
            reached = log.read_text(encoding="utf-8").split() if log.is_file() else []
            suite.seconds[test] = seconds
            suite.reached[test] = {place for line in reached for place in places[line]}
        else:
            suite.failed.append(test)
        log.unlink(missing_ok=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, tests))


def pytest(*options: str) -> list[str]:
    """Give the command that runs tests in Python."""
    return [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:randomly",
        *options,
    ]


def record_python(
    scratch: Scratch, suite: Suite, files: Iterable[str], places: dict[str, set[str]], jobs: int
) -> None:
    """Run each file with the plugin that notes what its tests reach."""
    here = str(Path(__file__).parent)

    def one(file: str) -> None:
        log = scratch.build / f"reached.{Path(file).stem}"
        log.unlink(missing_ok=True)
        path = f"{scratch.environment['PYTHONPATH']}:{here}"
        scratch.run(
            *pytest("-p", "plugin", file),
            timeout=1800,
            environment={
                "ZIVI_MUTANT": "record",
                "MUTANT_UNDER_TEST": "stats",
                "ZIVI_REACHED": str(log),
                "PYTHONPATH": path,
            },
        )
        if log.is_file():
            read_log(suite, log.read_text(encoding="utf-8"), places)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, sorted(files)))


def read_log(suite: Suite, log: str, places: dict[str, set[str]]) -> None:
    """Read what the plugin and the switches noted; what runs at import, every test reaches."""
    seconds: dict[str, float] = defaultdict(float)
    reached: dict[str, set[str]] = defaultdict(set)
    bad, name = set(), ""
    for line in log.splitlines():
        if line.startswith(HEAD):
            what, _, rest = line.removeprefix(HEAD).partition(" ")
            if what == "start":
                name = rest
                continue
            took, _, name = rest.partition(" ")
            seconds[name] += float(took)
            if what != "passed":
                bad.add((what, name))
        elif line in places:
            reached[name] |= places[line]
    for name, took in seconds.items():
        test = Test("pytest", name)
        if ("failed", name) in bad:
            suite.failed.append(test)
        elif ("skipped", name) not in bad:
            suite.seconds[test], suite.reached[test] = took, reached[name] | reached[""]
