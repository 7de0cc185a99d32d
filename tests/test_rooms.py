"""The rooms of the package know each other one way only, and no two files know each other."""

import ast
import functools
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from rust_imports import Crate

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python" / "zivi"
CRATES = sorted(path.parent.name for path in ROOT.glob("crates/*/src"))

ROOMS = {
    "base": set(),
    "vi": {"base"},
    "system": {"base"},
    "simulation": {"base", "system"},
    "derivatives": {"base", "system", "simulation"},
    "study": {"base", "system", "simulation"},
    "control": {"base", "system", "simulation", "study"},
    "orbits": {"base", "system", "simulation", "derivatives", "study"},
    "estimation": {"base", "system", "simulation", "derivatives"},
    "plot": {"base", "system", "simulation", "control", "orbits"},
    "interop": {"base", "vi", "system", "simulation", "control", "derivatives"},
}
"""What each room of the library may know; faces, programs and files are above them."""


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imported(path: Path) -> set[str]:
    """Name the modules of zivi that a file imports, at its top, for types or in a function."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "zivi":
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in FILES or inner == "zivi._zivi" else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.split(".")[0] == "zivi"}
    return {name for name in found if name in FILES} - {module_of(path)}


@functools.cache
def all_imports() -> dict[str, set[str]]:
    """Name for each module those that it imports, when it is asked: every worker collects this."""
    return {module: imported(path) for module, path in FILES.items()}


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else module


def test_no_files_import_each_other():
    try:
        TopologicalSorter(all_imports()).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_knows_those_below_it_only(room):
    imports = [known for module, known in all_imports().items() if room_of(module) == room]
    known = {room_of(it) for modules in imports for it in modules}
    assert known - {room} <= ROOMS[room]


def test_the_house_is_small():
    boxes = {room_of(module) for module in FILES}
    arrows = {(room_of(one), room_of(it)) for one, known in all_imports().items() for it in known}
    arrows = {(one, other) for one, other in arrows if one != other}
    below = {box: {other for one, other in arrows if one == box} for box in boxes}
    floor = {}
    for box in TopologicalSorter(below).static_order():
        floor[box] = 1 + max((floor[other] for other in below[box]), default=0)
    assert len(boxes) <= 20
    assert len(arrows) <= 77  # with the room of fits
    assert max(floor.values()) <= 9, sorted(floor.items(), key=lambda it: it[1])


def test_no_file_hides_in_a_room():
    names = [path.stem for path in FILES.values() if not path.stem.startswith("__")]
    assert [name for name in names if name.startswith("_")] == ["_siconos_steps"]


@pytest.mark.parametrize("name", CRATES)
def test_no_files_of_a_crate_import_each_other(name):
    try:
        TopologicalSorter(Crate(ROOT / "crates" / name).imports()).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join("::".join(module) or "lib" for module in error.args[1]))


def test_imports_in_rust_are_seen_through_those_that_hand_on(tmp_path):
    files = {
        "lib.rs": "mod a;\nmod b;\npub use a::{one, Two as Three};\n",
        "a/mod.rs": "mod inner;\npub use inner::{one, Two};\n",
        "a/inner.rs": "use crate::b::four;\npub fn one() { four() }\npub struct Two;\n",
        "b.rs": "use crate::{one, Three};\n// use crate::a::x;\npub fn four() { one() }\n",
    }
    for file, text in files.items():
        (tmp_path / "src" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "src" / file).write_text(text)
    imports = Crate(tmp_path).imports()
    assert imports == {(): set(), ("a",): set(), ("b",): {("a", "inner")}, ("a", "inner"): {("b",)}}
