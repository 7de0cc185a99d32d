"""The pages as a whole: code that runs, statuses that exist, how much is said, and what twice."""

import importlib
import re
import tomllib
from pathlib import Path

import matplotlib.pyplot
import pytest

import zivi
from page_blocks import DOCS, agrees, blocks, missing, run

STATUSES = {
    "troubleshooting": [zivi.Status],
    "troubleshooting_analyses": [
        zivi.OrbitStatus,
        zivi.VIStatus,
        zivi.TickStatus,
        zivi.StudyStatus,
    ],
}
WITHOUT_EXAMPLE = {"INTERNAL", "MODE_CHATTER", "REDUNDANT_STICK"}
"""Ends that no model is known to reach; `test_friction.py` looks for one."""

RUN_ELSEWHERE = {
    "tutorial": "test_docs_site",
    "tutorial_control": "test_docs_site",
    "tutorial_forces": "test_docs_site",
    "tutorial_studies": "test_docs_site",
    "tutorial_target": "test_c_library",
}
PAGES = sorted(path.stem for path in DOCS.glob("*.md") if blocks(path.stem))
RUN_HERE = [page for page in PAGES if page not in RUN_ELSEWHERE]


INSTEAD = {
    # what a page imports is a file: here it is not
    'executor="processes"': 'executor="threads"',
}


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN_HERE)
@pytest.mark.filterwarnings("ignore")
def test_the_code_of_a_page_runs_and_prints_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if page == "files":
        ball = zivi.ImpactSystem(-9.81, e=0.5)
        zivi.simulate(ball, (0, 2), (1, 0)).to_xarray().to_netcdf("ball.nc")
        zivi.sweep(lambda e: e, {"e": [0.1]}, out="study.zarr")
    names = {"__name__": "__main__"}
    for _, code in blocks(page):
        lacking = list(missing(code))
        if lacking:
            pytest.skip(f"needs {', '.join(lacking)}")
        for text, replacement in INSTEAD.items():
            code = code.replace(text, replacement)
        run(code, names)
    matplotlib.pyplot.close("all")


def test_pages_that_are_run_elsewhere_are():
    for page, test in RUN_ELSEWHERE.items():
        text = (Path(__file__).parent / f"{test}.py").read_text()
        assert re.search(rf'"{page}(\.md)?"', text), page


@pytest.mark.parametrize(
    ("line", "comment", "agreed"),
    [
        ("2", "2: two", True),
        ("1.35457092", "1.354571 = 3 sqrt(2/9.81): at rest", True),
        ("1.35467092", "1.354571 = 3 sqrt(2/9.81): at rest", False),
        ("[0.1 0.26]", "0.1, 0.2", False),
        ("[0.1 0.25]", "0.1, 0.25", True),
        ("FAILED", "COMPLETED", False),
        ("[1 2]", "times of impacts", True),
        ("0.00531337", "5.3e-3", True),
    ],
)
def test_what_is_printed_is_compared_by_its_digits(line, comment, agreed):
    assert agrees(line, comment) is agreed


def sections(page):
    text = (DOCS / f"{page}.md").read_text()
    return re.findall(r"^### (\w+)\n(.*?)(?=^##|\Z)", text, re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", STATUSES)
def test_every_status_has_a_section_that_shows_it(page):
    members = [member for kind in STATUSES[page] for member in kind]
    found = sections(page)
    # one example above the three shows them all
    studies = {(text, name) for name, text in found[-3:]} if page != "troubleshooting" else set()
    assert sorted(name for name, _ in found) == sorted(member.name for member in members)
    for name, text in found:
        assert len(re.sub(r"```.*?```", "", text, flags=re.DOTALL).split()) >= 4, name
        if name in WITHOUT_EXAMPLE:
            assert re.search(r"\((No|None)\s[^)]*\)", text), name
        elif (text, name) not in studies:
            assert re.search(rf"# {name}$|TickStatus\.{name} in", text, re.MULTILINE), name


def test_the_tables_of_migration_name_what_exists():
    for page in ("from_scipy", "from_siconos", "from_mujoco", "performance", "cheat_sheet"):
        for name in re.findall(r"\bzivi((?:\.\w+)+)\b", (DOCS / f"{page}.md").read_text()):
            thing = zivi
            for part in name[1:].split("."):
                thing = getattr(thing, part)


RESULTS = DOCS.parent / "benchmarks" / "results"
FIGURE = re.compile(r"\d[\d.]*(?:e-?\d+)?(?: / \d+)?")


def test_the_benchmarks_page_quotes_its_results():
    page = (DOCS / "benchmarks.md").read_text()
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (\w+) \|$", page, re.MULTILINE)[1:]
    assert len(rows) >= 12
    for question, answer, name in rows:
        measured = (RESULTS / f"{name}.md").read_text()
        figures = FIGURE.findall(answer)
        assert figures, question
        for figure in figures:
            pattern = rf"(?<![\d.]){re.escape(figure)}(?!\.?\d)"
            assert re.search(pattern, measured), (question, figure)


def test_what_a_call_costs_is_of_the_results():
    page = (DOCS / "target_cost.md").read_text()
    measured = (RESULTS / "target.md").read_text()
    figures = re.findall(
        r"(?<![\d.])\d{3,}(?![\d.])", re.sub(r"At 168 MHz.*?cycles\.", "", page, flags=re.DOTALL)
    )
    assert len(figures) > 20
    for figure in figures:
        assert re.search(rf"(?<![\d.]){figure}(?![\d.])", measured), figure


def test_results_are_listed_where_they_are_written():
    listed = set(re.findall(r"\]\((\w+)\.md\)", (RESULTS / "README.md").read_text()))
    assert listed == {path.stem for path in RESULTS.glob("*.md")} - {"README"}
    writers = [*RESULTS.parent.glob("*.py"), DOCS.parent / "tests" / "validation" / "table.py"]
    written = "".join(path.read_text() for path in writers)
    makefile = (DOCS.parent / "Makefile").read_text()
    for name in listed:
        page = (RESULTS / f"{name}.md").read_text()
        if page.partition("\n\n")[2].startswith("Written by hand"):
            programs = re.findall(r"`python ((?:benchmarks|examples)/\w+\.py)\b", page)
            targets = re.findall(r"`make ([\w-]+)`", page)
            assert programs or targets or "`zivi paper" in page, name
            assert all((DOCS.parent / it).exists() for it in programs), name
            assert all(re.search(rf"^{it}:", makefile, re.MULTILINE) for it in targets), name
        else:
            assert f'"{name}.md"' in written or f"results/{name}.md" in makefile, name


def test_extras_and_commands_are_named():
    package = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())
    extras = set(package["project"]["optional-dependencies"])
    assert extras == set(re.findall(r"`(\w+)`", page_of_extras()))
    typer = pytest.importorskip("typer")
    cli = importlib.import_module("zivi.cli")
    commands = set(typer.main.get_command(cli.app).commands)
    told = (DOCS / "command_line.md").read_text()
    assert commands == set(re.findall(r"^\| `zivi (\w+)", told, re.MULTILINE))
    # nothing on any page names an extra or a command that there is not
    for path in [*DOCS.glob("*.md"), DOCS.parent / "README.md"]:
        text = path.read_text()
        for names in re.findall(r"pip install '?zivi\[([\w,]+)\]", text):
            assert set(names.split(",")) <= extras, path.name
        shell = "".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL))
        assert set(re.findall(r"^zivi (\w+)", shell, re.MULTILINE)) <= commands, path.name


def page_of_extras():
    """First column of the table of extras, and the sentence on those of developers."""
    text = (DOCS / "install.md").read_text()
    table = re.findall(r"^\| (`\w+`) \|", text, re.MULTILINE)
    developers = re.search(r"The extras (.*?) are for work", " ".join(text.split()))
    return " ".join([*table, developers[1]])


def test_every_page_is_in_a_toctree():
    texts = [path.read_text() for path in DOCS.glob("*.md")]
    trees = [
        tree for text in texts for tree in re.findall(r"```\{toctree\}.*?```", text, re.DOTALL)
    ]
    listed = {line.strip() for tree in trees for line in tree.splitlines()}
    pages = {path.stem for path in DOCS.glob("*.md")} - {"index", "_package"}
    assert pages <= listed
