"""The programs of the pages on derivatives and orbits, and what the pages say of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGES = ("derivatives", "orbits", "mechanical_orbits")
PAGE = "\n".join((Path(__file__).parents[1] / "docs" / f"{name}.md").read_text() for name in PAGES)


@pytest.mark.slow
def test_the_programs_of_the_page_run():
    pytest.importorskip("sympy")
    pytest.importorskip("scipy.optimize")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(compile(block, "docs", "exec"), names)
    found, late = names["found"], names["late"]
    assert found.converged
    assert abs(late(found.root)[0]) < 1e-9
    assert names["twice"].multiple == 2
    assert names["doubling"].value == pytest.approx(1.526823701, abs=1e-9)
