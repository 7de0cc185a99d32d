"""The list of mutations, as data, and what can be wrong with it."""

import hashlib
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

LIST = Path(__file__).parent / "list"
KEYS = {"name", "file", "find", "replace", "tests", "equivalent"}


@dataclass(frozen=True)
class Mutant:
    """One mutation.

    Attributes
    ----------
    name, area : str
        What it breaks, and the file of the list that has it.
    file : str
        The file to change, from the root of the repository.
    find, replace : str
        The text, which the file must have exactly once, and what takes its place.
    tests : tuple of str
        ``tests/test_x.py``, ``tests/test_x.py::test_name``, or for Rust ``package target
        name``, where the target is ``lib`` or a file or folder in ``tests`` (without a name: all).
    equivalent : str
        Why no test can fail; empty where one must.
    """

    name: str
    area: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]
    equivalent: str

    @property
    def digest(self):
        """A result belongs to one wording of an entry."""
        wording = "\0".join((self.file, self.find, self.replace, self.equivalent, *self.tests))
        return hashlib.sha256(wording.encode()).hexdigest()[:16]

    def mutated(self, text):
        """Give `text` with the mutation."""
        return text.replace(self.find, self.replace)


def read(folder=LIST):
    """Read every entry of the list."""
    return [
        entry(path.stem, given)
        for path in sorted(folder.glob("*.toml"))
        for given in tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    ]


def entry(area, given):
    """Make a mutation of one table of the list."""
    unknown = given.keys() - KEYS
    missing = {"name", "file", "find", "replace"} - given.keys()
    if unknown or missing:
        raise ValueError(f"{area}: {given.get('name')}: unknown {unknown}, missing {missing}")
    tests = tuple(given.get("tests", ()))
    texts = {key: given[key] for key in ("name", "file", "find", "replace")}
    return Mutant(area=area, tests=tests, equivalent=given.get("equivalent", ""), **texts)


def faults(root, mutants):
    """List what is wrong with `mutants` for the tree at `root`, one line each."""
    names = [mutant.name for mutant in mutants]
    found = [
        f"{name}: a name used twice" for name in sorted({n for n in names if names.count(n) > 1})
    ]
    for mutant in mutants:
        found += [f"{mutant.name}: {fault}" for fault in faults_of(root, mutant)]
    return found


def faults_of(root, mutant):
    """Say why one entry does not apply."""
    path = root / mutant.file
    if not path.is_file():
        return [f"there is no {mutant.file}"]
    count = path.read_text(encoding="utf-8").count(mutant.find)
    found = []
    if count != 1:
        found.append(f"the text is {count} times in {mutant.file}, not once")
    if mutant.find == mutant.replace:
        found.append("it changes nothing")
    if bool(mutant.tests) == bool(mutant.equivalent):
        found.append("it needs either tests that must fail or the reason why it is equivalent")
    return found + [fault for test in mutant.tests if (fault := fault_of_test(root, test))]


def fault_of_test(root, test):
    """Say what is wrong with the name of one test."""
    if test.startswith("tests/"):
        file, _, name = test.partition("::")
        texts = [root / file]
        definition = f"def {name.partition('[')[0]}(" if name else "def test_"
    elif re.fullmatch(r"zivi(-core)? \w+( [\w:]+)?", test):
        package, _, *name = test.split(" ")
        texts = (root / "crates" / package).rglob("*.rs")
        definition = f"fn {name[0].rpartition('::')[2]}(" if name else "#[test]"
    else:
        return f"{test!r} is neither tests/test_x.py[::name] nor 'package target [name]'"
    if not any(path.is_file() and definition in path.read_text(encoding="utf-8") for path in texts):
        return f"there is no test {test!r}"
    return None
