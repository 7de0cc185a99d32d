"""The mutations that are tried: what is listed applies, and the switch has what it should."""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMES = ("chosen", "mutant", "plugin", "rust", "scratch", "suite", "table", "trial")
RUST = """\
const LIMIT: f64 = 2.0;

impl Ball {
    pub(crate) const fn far(x: [f64; 2]) -> bool {
        x[0] - x[1] < LIMIT
    }

    fn shape() -> f64;
}
"""


@pytest.fixture(scope="module")
def tool():
    """Import the modules of the tool, and forget them again: their names are plain ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "tools" / "mutants")
        import chosen
        import mutant
        import rust
        import table

        class Tool:
            pass

        Tool.chosen, Tool.mutant, Tool.rust, Tool.table = chosen, mutant, rust, table
        yield Tool
    for name in NAMES:
        sys.modules.pop(name, None)


def made(tool, find, replace):
    entry = tool.chosen.Entry("name", "crates/zivi-core/src/ball.rs", find, replace)
    return tool.chosen.in_functions(entry, RUST)


def switched(tool, mutants):
    switch = tool.rust.Switched(None, ROOT, mutants)
    return switch, switch.switched("crates/zivi-core/src/ball.rs", RUST, mutants)


def test_every_chosen_mutation_applies(tool):
    entries = tool.chosen.read()
    assert tool.chosen.faults(ROOT, entries) == []
    rust = [entry for entry in entries if entry.file.endswith(".rs")]
    for entry in rust:
        text = (ROOT / entry.file).read_text(encoding="utf-8")
        assert tool.chosen.in_functions(entry, text), f"{entry.name} is in no function"


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"find": "no such text"}, "0 times"),
        ({"find": "e"}, "not once"),
        ({"file": "crates/none.rs"}, "0 times"),
    ],
)
def test_an_entry_that_does_not_apply_is_told(tool, changed, fault):
    first = tool.chosen.read()[0]
    entry = tool.chosen.Entry(**vars(first) | changed)
    (told,) = tool.chosen.faults(ROOT, [entry])
    assert told.startswith(f"{first.name}: ")
    assert fault in told


def test_an_entry_that_changes_nothing_or_is_there_twice_is_told(tool):
    first = tool.chosen.read()[0]
    same = tool.chosen.Entry(**vars(first) | {"replace": first.find})
    assert "changes nothing" in tool.chosen.faults(ROOT, [same])[0]
    assert "used twice" in tool.chosen.faults(ROOT, [first, first])[0]


def test_a_mutation_is_one_arm_of_its_function(tool):
    mutants = made(tool, "x[0] - x[1]", "x[0] + x[1]")
    switch, text = switched(tool, mutants)
    assert [mutant.function for mutant in mutants] == ["far"]
    assert "fn far(x: [f64; 2]) -> bool { match crate::mutants::on(0) {" in text
    assert "const fn" not in text
    assert text.count("x[0] + x[1] < LIMIT") == text.count("x[0] - x[1] < LIMIT") == 1
    assert switch.reached() == {"0": {"crates/zivi-core/src/ball.rs::far"}}


def test_a_constant_is_changed_where_it_is_used(tool):
    _, text = switched(tool, made(tool, "f64 = 2.0", "f64 = 3.0"))
    assert "1 => { { const LIMIT: f64 = 3.0;" in text
    assert text.count("const LIMIT: f64 = 2.0;") == 1


def test_what_does_not_compile_is_blamed_on_its_arm(tool):
    mutants = made(tool, "x[0] - x[1]", "x[0] + nothing")
    switch, text = switched(tool, mutants)
    line = text[: text.index("nothing")].count("\n") + 1
    span = {"is_primary": True, "file_name": mutants[0].file, "line_start": line}
    message = {"message": {"level": "error", "spans": [span]}}
    assert switch.blamed(json.dumps(message)) == set(mutants)


def test_a_draw_keeps_its_order_when_other_mutations_come(tool):
    one = [*made(tool, "x[0] -", "x[0] +"), *made(tool, "x[1] <", "x[1] >")]
    other = made(tool, "x[1] < LIMIT", "true")
    for seed in range(8):
        longer = tool.mutant.drawn(tool.mutant.numbered(one + other), seed)
        assert [mutant for mutant in longer if mutant in one] == tool.mutant.drawn(one, seed)
    assert len({tool.mutant.drawn(one, seed)[0] for seed in range(20)}) == 2


def test_the_page_keeps_the_areas_that_were_not_run(tool):
    (mutant,) = made(tool, "x[0] -", "x[0] +")
    old = tool.table.section(
        [], ["a", "b"], {name: tool.table.rows(name, 1, [(mutant, "survived")], 0) for name in "ab"}
    )
    new = tool.table.section(
        old, ["a", "b"], {"b": tool.table.rows("b", 2, [(mutant, "killed")], 3)}
    )
    assert "| a | 1 | 0 | 0 | 0 | 1 | 0 | 1 | all |" in new
    assert "| b | 1 | 1 | 0 | 0 | 0 | 3 | 2 | all |" in new
    assert [line[:4] for line in new if line.startswith("- ")] == ["- a:"]


def test_an_equivalent_mutation_is_known_by_its_lines(tool, tmp_path):
    (mutant,) = made(tool, "x[0] -", "x[0] +")
    path = tmp_path / "equivalent.toml"
    path.write_text(tool.table.entry(mutant).replace('""', '"a reason"'), encoding="utf-8")
    assert tool.table.reason(mutant, tool.table.equivalents(path)) == "a reason"
    assert all(reason for reason in tool.table.equivalents().values())
