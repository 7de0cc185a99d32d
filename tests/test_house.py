"""The budget of the library: files and lines of code of each room, and one file of tests inside it.

Lines of code are without documentation, comments, blank lines and tests beside the code.
"""

import ast
import io
import re
import subprocess
import tokenize
import tomllib
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUDGET = tomllib.loads((ROOT / "tests" / "house.toml").read_text("utf-8"))
SEVERAL = BUDGET.pop("names with several meanings")
SPARE = 1.01
"""A room may have so many times the lines of its budget before that is raised."""
SKIPPED = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
    *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
}
TYPES = re.compile(r"(?m)^(?:pub(?:\([\w:]+\))? )?(?:struct|enum|trait) (\w+)")
TESTS = re.compile(r"(?m)^#\[cfg\(test\)\]\n(?:pub(?:\(\w+\))? )?mod \w+ \{\n.*?^\}\n", re.DOTALL)


def python_lines(source):
    docs, code = set(), set()
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        first = body[0] if isinstance(body, list) and body else None
        if isinstance(first, ast.Expr) and isinstance(getattr(first.value, "value", None), str):
            docs |= set(range(first.lineno, first.end_lineno + 1))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SKIPPED:
            code |= set(range(token.start[0], token.end[0] + 1))
    return len(code - docs)


def rust_lines(source):
    lines = (line.strip() for line in TESTS.sub("", source).splitlines())
    return sum(bool(line) and not line.startswith("//") for line in lines)


def room_of(path):
    parts = path.split("/")
    if parts[:2] == ["python", "zivi"]:
        return "/".join(parts[:3]) if len(parts) > 3 else "python/zivi"
    if parts[0] == "crates" and parts[2] == "src" and "tests" not in Path(path).stem:
        return "/".join(parts[:4]) if len(parts) > 4 else "/".join(parts[:3])
    return None


def listed():
    """The files of the library that git knows."""
    known = subprocess.run(
        ["git", "ls-files", "python", "crates"], cwd=ROOT, capture_output=True, text=True
    )
    if known.returncode:
        pytest.skip("not a clone of git")
    return [path for path in known.stdout.split() if (ROOT / path).exists()]


def test_every_room_keeps_its_budget():
    files, lines = Counter(), Counter()
    for path in listed():
        if path.endswith((".py", ".rs")) and (room := room_of(path)):
            source = (ROOT / path).read_text("utf-8")
            files[room] += 1
            lines[room] += python_lines(source) if path.endswith(".py") else rust_lines(source)
    assert files.keys() == BUDGET.keys(), "each room has a line in tests/house.toml"
    assert max(files.values()) <= 15
    large = {
        room: f"{files[room]} files, {lines[room]} lines; the budget is {budget}"
        for room, budget in BUDGET.items()
        if files[room] > budget["files"] or lines[room] > SPARE * budget["lines"]
    }
    assert large == {}


def definitions(path):
    """Names of functions and classes of a module in Python, of types of one in Rust."""
    source = (ROOT / path).read_text("utf-8")
    if path.endswith(".rs"):
        return set(TYPES.findall(source))
    found = ast.parse(source).body
    return {it.name.lstrip("_") for it in found if isinstance(it, ast.FunctionDef | ast.ClassDef)}


@pytest.mark.parametrize("suffix", [".py", ".rs"])
def test_few_names_have_several_meanings(suffix):
    sources = [path for path in listed() if path.endswith(suffix) and room_of(path)]
    places = Counter(name for path in sources for name in definitions(path))
    several = sorted(name for name, count in places.items() if count > 1)
    assert len(several) <= SEVERAL[suffix.removeprefix(".")], several


def test_only_one_file_of_tests_names_the_inside():
    # what is public though it is in a module of a room
    public = r"simulation\.methods|study\.experiments|interop\.\w"
    inside = re.compile(
        rf"^\s*(?:from zivi\.(?!{public})\w+\.\w+[\w.]* import|import zivi\.(?!{public})\w+\.\w+)",
        re.MULTILINE,
    )
    those = {it.name for it in ROOT.glob("tests/*.py") if inside.search(it.read_text("utf-8"))}
    assert those <= {"inside.py", "test_vi_factorisation.py"}  # its programs have no tests beside
