"""Mutations that people chose: ``list/*.toml``, for what the tools cannot draw.

Each replaces a piece of text that its file has once, within a function; a constant of a file in
Rust is replaced in one function after the other that uses it.
"""

import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mutant import HERE, Area, Mutant, changed_lines, numbered
from rust import opening_brace

NAME = "chosen"
KEYS = {"name", "file", "find", "replace"}
FUNCTION = re.compile(r"^( *)(?:pub(?:\([\w: ]+\))? )?(?:const )?(?:extern \"C\" )?fn (\w+)", re.M)
CONSTANT = re.compile(r"\s*(?:pub(?:\([\w: ]+\))? )?const (\w+)")


@dataclass(frozen=True)
class Entry:
    """One entry: `find` becomes `replace` in `file`; `tests` are those in Python that may fail."""

    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...] = ()


def read(folder: Path = HERE / "list") -> list[Entry]:
    """Read every entry of the list."""
    found = []
    for path in sorted(folder.glob("*.toml")):
        for given in tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]:
            if not KEYS <= given.keys() <= KEYS | {"tests"}:
                raise ValueError(f"{path.name}: {given.get('name')}: wrong keys")
            found.append(Entry(**given | {"tests": tuple(given.get("tests", ()))}))
    return found


def faults(root: Path, entries: Sequence[Entry]) -> list[str]:
    """List what is wrong with `entries` for the tree at `root`, one line each."""
    found = []
    for entry in entries:
        path = root / entry.file
        count = path.read_text(encoding="utf-8").count(entry.find) if path.is_file() else 0
        if count != 1:
            found.append(f"{entry.name}: the text is {count} times in {entry.file}, not once")
        if entry.find == entry.replace:
            found.append(f"{entry.name}: it changes nothing")
        if [other.name for other in entries].count(entry.name) > 1:
            found.append(f"{entry.name}: a name used twice")
    return found


def area(entries: Iterable[Entry]) -> Area:
    """Make the area of the chosen mutations."""
    tests = {test.partition("::")[0] for entry in entries for test in entry.tests}
    return Area(NAME, (), tuple(sorted(tests)), ("zivi-core", "zivi"))


def in_rust(root: Path, entries: Iterable[Entry]) -> list[Mutant]:
    """Make the mutants of the entries in Rust."""
    return numbered(
        mutant
        for entry in entries
        if entry.file.endswith(".rs")
        for mutant in in_functions(entry, (root / entry.file).read_text(encoding="utf-8"))
    )


def in_functions(entry: Entry, text: str) -> list[Mutant]:
    """Make the mutants of one entry: one, or one for each function that uses a constant."""
    start = text.index(entry.find)
    end = start + len(entry.find)
    before, after = changed_lines(text, start, end, entry.replace)
    bodies = functions(text)

    def mutant(body: tuple[int, int], start: int, end: int, new: str) -> Mutant:
        return Mutant(NAME, entry.file, bodies[body], before, after, start, end, new, body)

    around = [body for body in bodies if body[0] < start < body[1]]
    if around:
        return [mutant(max(around), start, end, entry.replace)]
    constant = CONSTANT.match(before)
    if not constant:
        return []
    new = f" {after.removeprefix('pub ')} "
    uses = [body for body in bodies if re.search(rf"\b{constant[1]}\b", text[slice(*body)])]
    return [mutant(body, body[0] + 1, body[0] + 1, new) for body in uses]


def functions(text: str) -> dict[tuple[int, int], str]:
    """Find the bodies of functions, with their braces, in a text that rustfmt wrote."""
    found = {}
    for head in FUNCTION.finditer(text):
        first = opening_brace(text, head.start())
        if first is None:
            continue
        end = text.find("\n", first)
        if not text[first:end].endswith("}"):
            end = text.index(f"\n{head[1]}}}", first) + len(head[1]) + 2
        found[first, end] = head[2]
    return found
