"""The page of results, and what is known to be equivalent."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from mutant import HERE, Mutant
from trial import EQUIVALENT, KILLED, SURVIVED, TIMEOUT

BEGIN, END = "<!-- written by make mutants -->", "<!-- end -->"
HEAD = [
    "| area | drawn | killed | by time | equivalent | survived | no program | seed | tests |",
    "|---|---|---|---|---|---|---|---|---|",
]


def equivalents(path: Path = HERE / "equivalent.toml") -> dict[tuple[str, ...], str]:
    """Read the reasons why nothing can tell a mutation from the original."""
    given = tomllib.loads(path.read_text(encoding="utf-8")).get("mutant", [])
    return {
        (entry["file"], entry["function"], entry["before"], entry["after"]): entry["reason"].strip()
        for entry in given
    }


def reason(mutant: Mutant, known: Mapping[tuple[str, ...], str]) -> str | None:
    """Say why `mutant` is equivalent, None if it is not known to be."""
    return known.get((mutant.file, mutant.function, mutant.before, mutant.after))


def entry(mutant: Mutant) -> str:
    """Write `mutant` as `equivalent.toml` has it."""
    keys = ("file", "function", "before", "after")
    lines = [f"{key} = '''{getattr(mutant, key)}'''" for key in keys]
    return "\n".join(["[[mutant]]", *lines, 'reason = ""'])


def rows(
    area: str, seed: int, found: Sequence[tuple[Mutant, str]], unviable: int, tests: str = "all"
) -> tuple[str, list[str]]:
    """Give the row of an area, and a line for each mutant that survived."""
    results = [result for _, result in found]
    killed, late = (results.count(result) for result in (KILLED, TIMEOUT))
    cells = [area, len(found), killed + late, late, results.count(EQUIVALENT)]
    cells += [results.count(SURVIVED), unviable, seed, tests]
    lines = [
        f"- {area}: `{mutant.file}`, `{mutant.function}`: {mutant.change}"
        for mutant, result in found
        if result == SURVIVED
    ]
    return "| " + " | ".join(str(cell) for cell in cells) + " |", lines


def section(old: Iterable[str], areas: Sequence[str], made: Mapping[str, tuple[str, list[str]]]):
    """Put the areas that were run into the lines of the page; the others stay."""
    old = list(old)
    table, survived = [], []
    for area in areas:
        if area in made:
            row, lines = made[area]
            table.append(row)
            survived += lines
        else:
            table += [line for line in old if line.startswith(f"| {area} |")]
            survived += [line for line in old if line.startswith(f"- {area}: ")]
    return [*HEAD, *table] + (["", "Survived:", "", *survived] if survived else [])


def write_section(
    page: Path, areas: Sequence[str], made: Mapping[str, tuple[str, list[str]]]
) -> None:
    """Write between the two marks of `page`."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    old, _, after = rest.partition(END)
    text = section(old.splitlines(), areas, made)
    page.write_text("\n".join([before + BEGIN, "", *text, "", END + after]), encoding="utf-8")
