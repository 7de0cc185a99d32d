"""Which file of a crate takes names from which other, by its ``use`` lines and paths."""

from __future__ import annotations

import re
from pathlib import Path

Module = tuple[str, ...]
DEFINES = re.compile(r"\b(?:fn|struct|enum|trait|const|static|type|union|macro_rules!)\s+(\w+)")
USE = re.compile(r"^\s*(?:pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", re.MULTILINE)
PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")


def code_of(path: Path) -> str:
    """The code of a file without comments and without its tests."""
    text = re.sub(r"//[^\n]*", "", path.read_text(encoding="utf-8"))
    return re.split(r"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)?mod (?:\w+_)?tests\b", text)[0]


def paths_of(use: str) -> list[tuple[Module, str]]:
    """The paths of one ``use``, each with the name that it gives."""
    head, brace, rest = use.partition("{")
    if not brace:
        path, _, alias = " ".join(use.split()).partition(" as ")
        parts = tuple(part for part in re.sub(r"\s", "", path).split("::") if part != "self")
        return [(parts, alias or parts[-1])] if parts else []
    entries, depth, current = [], 0, ""
    for character in rest[: rest.rindex("}")] + ",":
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "," and depth == 0:
            entries, current = [*entries, current], ""
        else:
            current += character
    return [found for entry in entries if entry.strip() for found in paths_of(head + entry)]


class Crate:
    """The files of a crate, by their modules."""

    def __init__(self, folder: Path):
        source = folder / "src"
        self.files: dict[Module, str] = {}
        for path in source.rglob("*.rs"):
            parts = path.relative_to(source).with_suffix("").parts
            self.files[parts[:-1] if parts[-1] in ("mod", "lib") else parts] = code_of(path)
        self.uses = {
            module: [found for use in USE.findall(code) for found in paths_of(use)]
            for module, code in self.files.items()
        }
        self.defined = {module: set(DEFINES.findall(code)) for module, code in self.files.items()}

    def absolute(self, module: Module, path: Module) -> Module | None:
        """A path of this crate from its root; None for one of another crate."""
        if path[0] == "crate":
            return path[1:]
        ups = next((i for i, part in enumerate(path) if part != "super"), len(path))
        if ups:
            return module[: len(module) - ups] + path[ups:]
        return module + path if module + path[:1] in self.files else None

    def home(self, path: Module, seen: frozenset[Module] = frozenset()) -> Module | None:
        """The file that defines what a path names, through those that hand it on."""
        known = next(n for n in range(len(path), -1, -1) if path[:n] in self.files)
        module, names = path[:known], path[known:]
        if not names or path in seen or names[0] in self.defined[module]:
            return module
        for inner, name in self.uses[module]:
            if name in (names[0], "*"):
                full = inner if name != "*" else (*inner[:-1], names[0])
                there = self.absolute(module, full)
                if there is not None and there != path:
                    return self.home(there, seen | {path})
        return module

    def imports(self) -> dict[Module, set[Module]]:
        """The files that each file takes names from; what only hands on has none."""
        found: dict[Module, set[Module]] = {module: set() for module in self.files}
        for module, code in self.files.items():
            body = USE.sub("", code)
            inline = [tuple(path.split("::")) for path in PATH.findall(body)]
            taken = [path for path, name in self.uses[module] if self.is_used(name, body)]
            for path in taken + inline:
                there = self.absolute(module, path)
                home = self.home(there) if there is not None else None
                if home is not None:
                    found[module] |= {home} - {module}
        return found

    @staticmethod
    def is_used(name: str, body: str) -> bool:
        return name == "*" or re.search(rf"(?<!::)\b{name}\b", body) is not None
