"""The programs of the tutorial, each by itself as it stands on the page: it prints what it says."""

import contextlib
import io
import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "tutorial_programs.md").read_text()
PROGRAMS = {
    title: (code, printed)
    for title, code, printed in re.findall(
        r"^## ([^\n]+)\n(?:(?!^##|^```).)*^```python\n(.*?)^```\n\n```text\n(.*?)^```$",
        PAGE,
        re.DOTALL | re.MULTILINE,
    )
}


def output(code, folder, monkeypatch):
    monkeypatch.chdir(folder)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "program", "exec"), {"__name__": "__main__"})
    return out.getvalue()


@pytest.mark.parametrize("title", PROGRAMS)
def test_a_program_prints_what_the_page_shows(title, tmp_path, monkeypatch):
    code, printed = PROGRAMS[title]
    assert output(code, tmp_path, monkeypatch) == printed
    made = re.findall(r"\.(?:savefig|to_netcdf)\(\"(.+?)\"\)", code)
    assert [path.name for path in tmp_path.iterdir()] == made


def test_no_program_of_the_page_is_left_out():
    assert len(PROGRAMS) == PAGE.count("```python") == PAGE.count("\n## ") == 12
    assert "# Twelve programs" in PAGE
    assert all(len(code.splitlines()) <= 20 for code, _ in PROGRAMS.values())
