"""The programs of the pages on derivatives and orbits, and what the pages say of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

PAGES = ("derivatives", "orbits", "mechanical_orbits")
PAGE = "\n".join((Path(__file__).parents[1] / "docs" / f"{name}.md").read_text() for name in PAGES)


@pytest.mark.slow
def test_the_programs_of_the_page_run():
    pytest.importorskip("sympy")
    optimize = pytest.importorskip("scipy.optimize")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(compile(block, "docs", "exec"), names)
    found, late = names["found"], names["late"]
    assert found.converged
    assert abs(late(found.root)[0]) < 1e-9
    # the least Zeno time that the page tells
    least = optimize.minimize_scalar(lambda h: late(h)[0], bounds=(0.2, 0.25), method="bounded")
    said = re.search(r"never takes less than ([\d.]+) s, at h = (\d.\d+)", " ".join(PAGE.split()))
    assert said
    np.testing.assert_allclose(least.fun + 0.42, float(said[1]), atol=5e-5)
    assert abs(least.x - float(said[2])) < 1e-3
    assert names["twice"].multiple == 2
    assert names["doubling"].value == pytest.approx(1.526823701, abs=1e-9)
