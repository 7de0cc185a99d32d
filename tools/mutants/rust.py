"""Mutations of the Rust code, drawn by cargo-mutants, all behind one switch at run time.

A build for each mutation would take a minute or more. So the body of a function that has mutations
becomes `match on(place) { 17 => { one }, 18 => { another }, _ => { as it was } }` in the copy, and
one build has them all.
"""

import json
import os
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mutant import HERE, Area, Mutant, area_of, changed_lines, joined, numbered
from scratch import Scratch

VERSION = "27.1.0"
PACKAGES = ("zivi-core", "zivi")
LIB, SWITCH = "crates/zivi-core/src/lib.rs", "crates/zivi-core/src/mutants.rs"
WRITTEN = {LIB, SWITCH}


def installed(folder: Path) -> Path:
    """Give the program cargo-mutants, built first where it is missing."""
    if found := shutil.which("cargo-mutants"):
        return Path(found)
    program = folder / "bin" / "cargo-mutants"
    if not program.is_file():
        command = ["cargo", "install", "cargo-mutants", "--version", VERSION, "--locked"]
        subprocess.run([*command, "--quiet", "--root", str(folder)], check=True)
    return program


def list_mutants(program: Path, root: Path, areas: Sequence[Area]) -> list[Mutant]:
    """List every mutation that cargo-mutants knows in the files of `areas`."""
    packages = [option for package in PACKAGES for option in ("--package", package)]
    command = [str(program), "mutants", "--list", "--json", *packages, "--dir", str(root)]
    environment = {key: value for key, value in os.environ.items() if key != "CARGO_TARGET_DIR"}
    given = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found = []
    files: dict[str, tuple[str | None, str, list[int]]] = {}
    for entry in json.loads(given.stdout):
        name = entry["file"]
        if name not in files:
            text = (root / name).read_text(encoding="utf-8")
            files[name] = area_of(name, root, areas), text, line_starts(text)
        area, text, lines = files[name]
        if entry["function"]:
            found.append(mutant(entry, area or "", text, lines))
    return numbered(found)


def line_starts(text: str) -> list[int]:
    """Give the offset of each line."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def offsets(span: dict[str, dict[str, int]], lines: list[int]) -> tuple[int, int]:
    """Turn a span of cargo-mutants (lines and columns from 1) into offsets."""
    start, end = (lines[span[at]["line"] - 1] + span[at]["column"] - 1 for at in ("start", "end"))
    return start, end


def mutant(entry: dict, area: str, text: str, lines: list[int]) -> Mutant:
    """Make a mutant of an entry of cargo-mutants."""
    start, end = offsets(entry["span"], lines)
    first, last = offsets(entry["function"]["span"], lines)
    new = entry["replacement"]
    if entry["genre"] == "FnValue":
        before, after = "", joined(new)
    else:
        before, after = changed_lines(text, start, end, new)
    return Mutant(
        area=area,
        file=entry["file"],
        function=entry["function"]["function_name"],
        before=before,
        after=after,
        start=start,
        end=end,
        text=new,
        body=(opening_brace(text, first) or first, last),
    )


def opening_brace(text: str, start: int) -> int | None:
    """Find the brace that opens the body of the function at `start`, if it has one."""
    depth, at = 0, start
    while True:
        if text.startswith("//", at) or text.startswith("#[", at):
            at = text.index("\n", at)
        if text[at] in "([":
            depth += 1
        elif text[at] in ")]":
            depth -= 1
        elif text[at] in "{;" and depth == 0:
            return at if text[at] == "{" else None
        at += 1


@dataclass
class Arm:
    """The lines of the changed file that only one mutation has, or several (None)."""

    first: int
    last: int
    mutant: Mutant | None
    place: list[Mutant]


class Switched:
    """The copy of the tree with mutations behind the switch."""

    def __init__(self, scratch: Scratch, root: Path, mutants: Sequence[Mutant]):
        self.scratch, self.root = scratch, root
        self.mutants = list(mutants)
        self.unviable: set[Mutant] = set()
        self.places: dict[str, int] = {}
        self.numbers = {mutant: number for number, mutant in enumerate(self.mutants, 1)}
        self.arms: dict[str, list[Arm]] = {}

    def reached(self) -> dict[str, set[str]]:
        """Give the places that each number stands for in the log of the switch."""
        found = defaultdict(set)
        for place, number in self.places.items():
            found[str(number)].add(place)
        return dict(found)

    def write(self) -> None:
        """Write the sources with every mutant that is viable."""
        switch = (HERE / "switch.rs").read_text(encoding="utf-8")
        self.scratch.put(self.scratch.tree / SWITCH, switch)
        by_file = defaultdict(list)
        for mutant in self.mutants:
            by_file[mutant.file].append(mutant)
        by_file.setdefault(LIB, [])
        for file, mutants in by_file.items():
            text = (self.root / file).read_text(encoding="utf-8")
            viable = [mutant for mutant in mutants if mutant not in self.unviable]
            new = self.switched(file, text, viable)
            if file == LIB:
                new += "#[doc(hidden)]\npub mod mutants;\n"
            self.scratch.put(self.scratch.tree / file, new)

    def switched(self, file: str, text: str, mutants: Iterable[Mutant]) -> str:
        """Put `mutants` of one file behind the switch."""
        bodies: dict[tuple[int, int], list[Mutant]] = {}
        for mutant in sorted(mutants, key=lambda mutant: (mutant.body[0], -mutant.body[1])):
            outer = next((b for b in bodies if b[0] <= mutant.body[0] < b[1]), mutant.body)
            bodies.setdefault(outer, []).append(mutant)
        crate = "crate" if "zivi-core" in file else "zivi_core"
        out, at, arms = "", 0, []
        for (first, last), inside in bodies.items():
            place = self.places.setdefault(inside[0].place, len(self.places))
            for mutant in inside:
                self.places[mutant.place] = place
            head = text[at:first]
            if (const := head.rfind("const fn ")) > head.rfind("\n"):
                head = head[:const] + head[const + 6 :]
            out += f"{head}{{ match {crate}::mutants::on({place}) {{\n"
            for mutant in inside:
                line = out.count("\n") + 1
                changed = text[first : mutant.start] + mutant.text + text[mutant.end : last]
                out += f"{self.numbers[mutant]} => {{ {changed} }}\n"
                arms.append(Arm(line, out.count("\n"), mutant, inside))
            line = out.count("\n") + 1
            out += f"_ => {text[first:last]} }} }}\n"
            arms.append(Arm(line, out.count("\n"), None, inside))
            at = last
        self.arms[file] = arms
        return out + text[at:]

    def drop_unviable(self) -> None:
        """Compile, and leave out what does not: mutants that are no program of Rust."""
        packages = {mutant.file.split("/")[1] for mutant in self.mutants}
        while True:
            self.write()
            code, output = self.scratch.cargo(
                "check", *(f"--package={package}" for package in packages), "--message-format=json"
            )
            if code == 0:
                return
            found = {mutant for line in output.splitlines() for mutant in self.blamed(line)}
            if not found - self.unviable:
                raise RuntimeError(f"the copy does not compile:\n{output[-3000:]}")
            self.unviable |= found

    def blamed(self, line: str) -> set[Mutant]:
        """Give the mutants to which a message of the compiler points."""
        if not line.startswith("{"):
            return set()
        message = json.loads(line).get("message") or {}
        if message.get("level") != "error":
            return set()
        arms = [
            arm
            for span in message["spans"]
            if span["is_primary"]
            for arm in self.arms.get(span["file_name"], [])
            if arm.first <= span["line_start"] <= arm.last
        ]
        return {mutant for arm in arms for mutant in ([arm.mutant] if arm.mutant else arm.place)}
