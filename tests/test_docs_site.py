"""The documentation: links and anchors, a reference of all that is public, tutorials, the site."""

import html.parser
import importlib.util
import os
import re
import subprocess
import sys
import types
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import generated
import zivi
import zivi.interop
from page_blocks import blocks, missing, run

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.glob("*.md") if not path.name.startswith("_"))
GALLERY = [f"gallery/{name}" for name in generated.listed()]
"""Pages that are written when the site is built."""
TUTORIAL = ["tutorial", "tutorial_forces", "tutorial_control", "tutorial_studies"]


def named(path):
    return str(path.relative_to(ROOT))


def prose(path):
    """Text of a page without its blocks of code."""
    return re.sub(r"^(```+).*?^\1\s*$", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)


def anchors(path):
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    found: list[str] = []
    for heading in re.findall(r"^#{1,6} (.+)$", prose(path), re.MULTILINE):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
        repeated = sum(it == slug or re.fullmatch(rf"{slug}-\d+", it) is not None for it in found)
        found.append(f"{slug}-{repeated}" if repeated else slug)
    return set(found)


def links(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "``", prose(path))):
        if not urlsplit(target).scheme:
            yield target


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_links_images_and_anchors_exist(path):
    for target in links(path):
        name, _, anchor = target.partition("#")
        file = (path.parent / unquote(name)).resolve() if name else path
        assert file.exists(), target
        assert file.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(file), target


def test_the_link_check_can_fail():
    assert "the-step-and-its-selection-rule" in anchors(DOCS / "control.md")
    assert "nothing-like-it" not in anchors(DOCS / "control.md")
    assert "figures/periodic_reference.png" in set(links(DOCS / "control.md"))


def test_no_two_pages_have_one_title():
    titles = [re.search(r"^# (.+)$", prose(path), re.MULTILINE) for path in PAGES]
    named_pages = [title[1] for title in titles if title]
    assert len(set(named_pages)) == len(named_pages) > 30


def documented():
    """Names that the pages of the reference describe."""
    found = set()
    for path in DOCS.glob("api*.md"):
        found |= {f"zivi.{name}" for name in generated.names(path.read_text())}
    return found


def test_everything_public_is_in_the_reference():
    public = {
        f"{module.__name__}.{name}"
        for module in (zivi, zivi.plot, zivi.interop)
        for name in module.__all__
        if callable(it := getattr(module, name)) and not isinstance(it, types.ModuleType)
    }
    assert public <= documented(), sorted(public - documented())


def test_the_reference_is_made_of_its_names():
    page = "# Any\n\n```{api}\nsimulate\nStatus()\nfiles.FileError\n```\n"
    shown = generated.reference(page)
    assert ".. autofunction:: zivi.simulate\n" in shown
    assert ".. autoclass:: zivi.Status()\n   :members:\n   :undoc-members:\n" in shown
    assert ".. autoexception:: zivi.files.FileError\n" in shown
    assert "   files.FileError\n" in shown
    for path in DOCS.glob("api_*.md"):
        text = generated.reference(path.read_text())
        described = re.findall(r"^\.\. auto(?!summary)\w+:: (\S+?)(?:\(\))?$", text, re.MULTILINE)
        assert described == [f"zivi.{name}" for name in generated.names(path.read_text())]
        assert described


@pytest.mark.parametrize("name", sorted(documented()))
def test_what_the_reference_names_exists(name):
    parts = name.split(".")
    thing = zivi
    for i, part in enumerate(parts[1:], 2):
        if not hasattr(thing, part):
            importlib.import_module(".".join(parts[:i]))
        thing = getattr(thing, part)
    assert isinstance(thing, types.ModuleType) or callable(thing)


def test_every_example_is_on_a_page():
    text = "\n".join(path.read_text() for path in PAGES)
    for script in sorted((ROOT / "examples").glob("*.py")):
        assert f"examples/{script.name}" in text, script.name


def test_every_example_in_the_gallery_has_a_page_that_runs_it(tmp_path):
    generated.gallery(tmp_path)
    made = {f"gallery/{path.stem}" for path in tmp_path.glob("*.md")}
    assert made == {*GALLERY, "gallery/programs"}
    assert len(GALLERY) > 40
    for name, title in generated.listed().items():
        text = (tmp_path / f"{name}.md").read_text()
        assert f"\n# {title}\n" in text
        assert re.search(rf"^%run \.\./_gallery\.py {name}( --no-figure)?$", text, re.MULTILINE)
        # the script from its first line after the docstring
        start = int(re.search(r"^:lines: (\d+)-$", text, re.MULTILINE)[1])
        lines = (ROOT / "examples" / f"{name}.py").read_text().splitlines()
        assert lines[start - 3].endswith('"""')
        assert lines[start - 1].startswith(("import", "from"))


def test_tables_of_keys_have_three_columns_on_the_site():
    page = (DOCS / "command_line.md").read_text()
    shown = generated.shown("command_line", page)
    rows = [line for line in shown.splitlines() if line.startswith("| `") and "zivi " not in line]
    in_six = generated.file_keys.insert(page).splitlines()
    assert len(rows) == sum(line.startswith("| `") and "zivi " not in line for line in in_six) > 100
    assert all(len(line.strip("|").split(" | ")) == 3 for line in rows)
    assert (
        "| `method.h` | a finite number > 0 (s), **required** "
        "| *ThetaGamma, MoreauJean, ExplicitEuler:* step |" in rows
    )
    assert "| `force.omega` | a finite number (rad/s); default 1 | omega |" in rows


def test_links_to_examples_lead_to_their_pages():
    text = "[a](../examples/rocking_block.py) [b](../examples/programs) [c](../examples/files)"
    shown = generated.shown("any", text)
    assert shown == "[a](gallery/rocking_block.md) [b](gallery/programs.md) [c](../examples/files)"
    listed = generated.shown("gallery", (DOCS / "gallery.md").read_text())
    assert "[![](" not in listed
    for name in generated.listed():
        assert (
            len(re.findall(rf"^\| .*\| \[.*?\]\(gallery/{name}\.md\).* \|$", listed, re.MULTILINE))
            == 1
        )


@pytest.mark.parametrize("page", TUTORIAL)
@pytest.mark.filterwarnings("ignore")  # of the cluster: a port that is taken, a socket that is open
def test_the_tutorials_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # functions of the page are sent to workers by value, as from a notebook
    names = {"__name__": "__main__"}
    lacking = []
    for _, code in blocks(page):
        if lack := list(missing(code)):
            lacking += lack
        else:
            run(code, names)
    if lacking:
        pytest.skip(f"all blocks run but those that need {', '.join(lacking)}")


def test_the_tutorial_is_executed_on_the_site():
    for page in TUTORIAL:
        executed = [code for cell, code in blocks(page) if cell]
        assert len(executed) >= 3
        for code in executed:
            compile(code, page, "exec")


def test_the_comparison_can_fail():
    run("print(1 + 1)  # 2: two", {})
    with pytest.raises(AssertionError):
        run("print(1 + 1)  # 3", {})


class Targets(html.parser.HTMLParser):
    """Links, images and anchors of a page of the site."""

    def __init__(self, page):
        super().__init__()
        self.targets, self.anchors = [], set()
        self.feed(page.read_text())

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name == "id":
                self.anchors.add(value)
            elif value and (name == "src" or (name == "href" and tag in ("a", "link"))):
                self.targets.append(value)


EXECUTED = {"gallery/rocking_block", "tutorial"}
"""Pages that the site of the test executes; `make docs` executes all."""
ELSEWHERE = sorted({*TUTORIAL, *GALLERY} - EXECUTED)
"""Code that other tests run: tutorials above, each example of the gallery beside its numbers."""


def test_code_that_the_site_of_the_test_leaves_out_is_run_elsewhere():
    tests = {path: path.read_text() for path in Path(__file__).parent.glob("test_*.py")}
    for page in ELSEWHERE:
        folder, _, name = page.rpartition("/")
        if not folder:
            assert name in TUTORIAL
            continue
        # by its name, or all examples of mechanical systems
        pattern = rf'example\("{name}"\)|"{name}"|glob\("{name.split("_")[0]}_\*\.py"\)'
        assert any("main(" in it and re.search(pattern, it) for it in tests.values()), name
        # the program does what its test calls
        program = (ROOT / "examples" / f"{name}.py").read_text().split('__name__ == "__main__"')[1]
        assert "\n    main(" in program


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    for library in ("sphinx", "furo", "myst_nb", "numpydoc", "control"):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library} is not installed: it comes with the extra docs")
    out = tmp_path_factory.mktemp("site")
    left_out = " ".join(f"{page}.md" for page in ELSEWHERE)
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-j", "2", DOCS, out],
        env=os.environ | {"ZIVI_DOCS_NOT_EXECUTED": left_out},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return out


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_the_site_is_whole(site):
    pages = {path: Targets(path) for path in site.rglob("*.html")}
    assert {*(path.stem for path in PAGES), *GALLERY} <= {
        f"{path.relative_to(site).with_suffix('')}" for path in pages
    }
    for path, page in pages.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert file.exists(), f"{path.name}: {target}"
            if parts.fragment and file in pages and path.stem not in ("search", "genindex"):
                assert unquote(parts.fragment) in pages[file].anchors, f"{path.name}: {target}"


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_the_reference_has_what_controllers_inherit(site):
    anchors = Targets(site / "api_control.html").anchors
    for name in ("TwistingTracker", "TwistingRegulator", "ExplicitTwisting"):
        for member in ("step", "reset", "copy", "state", "signs", "status"):
            assert f"zivi.{name}.{member}" in anchors


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_the_site_has_figures_formulas_and_nothing_foreign(site):
    assert "<math" in (site / "api_simulation.html").read_text()
    page = (site / "gallery" / "rocking_block.html").read_text()
    assert "<img" in page
    assert "<pre>" in page
    for path in site.rglob("*.html"):
        for target in re.findall(r"<(?:script|img)[^>]* src=\"([^\"]+)\"", path.read_text()):
            assert not urlsplit(target).netloc, f"{path.name} loads {target}"
