"""The short programs, each by itself as it stands: it prints what it says."""

import contextlib
import io
import re

import pytest

from generated import programs, programs_page

PROGRAMS = {told.partition("\n")[0]: (code, printed) for told, code, printed in programs()}


def output(code, folder, monkeypatch):
    monkeypatch.chdir(folder)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "program", "exec"), {"__name__": "__main__"})
    return out.getvalue()


@pytest.mark.parametrize("title", PROGRAMS)
def test_a_program_prints_what_it_says(title, tmp_path, monkeypatch):
    code, printed = PROGRAMS[title]
    assert output(code, tmp_path, monkeypatch) == printed
    made = re.findall(r"\.(?:savefig|to_netcdf)\(\"(.+?)\"\)", code)
    assert [path.name for path in tmp_path.iterdir()] == made


def test_all_programs_are_on_their_page():
    page = programs_page()
    assert len(PROGRAMS) == page.count("```python") == page.count("\n## ") == 12
    assert "# Twelve programs" in page
    assert all(f"```python\n{code}```" in page for code, _ in PROGRAMS.values())
    assert all(printed and len(code.splitlines()) <= 20 for code, printed in PROGRAMS.values())
