"""A mutation, where it is, and which ones are drawn."""

import hashlib
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Area:
    """A part of the library: where mutations are drawn, and the tests that fit."""

    name: str
    files: tuple[str, ...]
    tests: tuple[str, ...]
    rust: tuple[str, ...] = ()


@dataclass(frozen=True)
class Mutant:
    """One change of one function.

    Attributes
    ----------
    area, file, function : str
        Where it is; the file from the root of the repository.
    before, after : str
        The lines that change, without their indents; `before` is empty where a whole body goes.
    nth : int
        Counts changes of one function that read the same.
    start, end : int
        What of the file goes (offsets in characters).
    text : str
        What takes its place.
    body : tuple of int
        The body of the function, with its braces (Rust).
    """

    area: str
    file: str
    function: str
    before: str
    after: str
    start: int
    end: int
    text: str
    body: tuple[int, int] = (0, 0)
    nth: int = 0

    @property
    def digest(self) -> str:
        """Names it, wherever its lines move to."""
        parts = (self.file, self.function, self.before, self.after, str(self.nth))
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]

    @property
    def place(self) -> str:
        """Where tests reach it."""
        return f"{self.file}::{self.function}"

    @property
    def change(self) -> str:
        """What changes, in one line."""
        return f"`{self.before or 'body'}` -> `{self.after}`"

    def __str__(self) -> str:
        return f"{self.digest} {self.file} {self.function}: {self.before or 'body'} -> {self.after}"


def areas() -> dict[str, Area]:
    """Read `areas.toml`."""
    with (HERE / "areas.toml").open("rb") as file:
        given = tomllib.load(file)
    return {
        name: Area(name, **{key: tuple(value) for key, value in area.items()})
        for name, area in given.items()
    }


def area_of(file: str, root: Path, known: Iterable[Area]) -> str | None:
    """Give the first area that has `file`."""
    for area in known:
        if any(root / file in root.glob(pattern) for pattern in area.files):
            return area.name
    return None


def numbered(mutants: Iterable[Mutant]) -> list[Mutant]:
    """Tell changes apart that read the same."""
    seen: Counter[tuple[str, ...]] = Counter()
    found = []
    for mutant in mutants:
        key = (mutant.file, mutant.function, mutant.before, mutant.after)
        found.append(replace(mutant, nth=seen[key]))
        seen[key] += 1
    return found


def drawn(mutants: Sequence[Mutant], seed: int) -> list[Mutant]:
    """Put `mutants` into the order of the draw, whatever others there are."""
    return sorted(
        mutants, key=lambda mutant: hashlib.sha256(f"{seed} {mutant.digest}".encode()).digest()
    )


def changed_lines(text: str, start: int, end: int, new: str) -> tuple[str, str]:
    """Give the lines that a change touches, before and after, each as one line."""
    first = text.rfind("\n", 0, start) + 1
    last = text.find("\n", end)
    last = len(text) if last < 0 else last
    after = text[first:start] + new + text[end:last]
    return joined(text[first:last]), joined(after)


def joined(text: str) -> str:
    """Put `text` into one line."""
    return " ".join(text.split())
