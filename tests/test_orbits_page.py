"""The programs of docs/orbits.md, one after the other, and what the page says of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "orbits.md").read_text()


@pytest.mark.slow
def test_the_programs_of_the_page_run():
    pytest.importorskip("sympy")
    optimize = pytest.importorskip("scipy.optimize")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(compile(block, "docs/orbits.md", "exec"), names)
    found, late = names["found"], names["late"]
    assert found.converged
    assert abs(late(found.root)[0]) < 1e-9
    # the least Zeno time that the page tells
    least = optimize.minimize_scalar(lambda h: late(h)[0], bounds=(0.2, 0.25), method="bounded")
    said = re.search(r"never less than ([\d.]+) s, at h = ([\d.]+)", PAGE)
    assert said
    np.testing.assert_allclose(least.fun + 0.42, float(said[1]), atol=5e-5)
    assert abs(least.x - float(said[2])) < 1e-3
    assert names["twice"].multiple == 2
    assert names["doubling"].value == pytest.approx(1.526823701, abs=1e-9)
