"""The examples run, and what the documentation quotes of them is what they give."""

import re
from pathlib import Path

import numpy as np
import pytest

from example_scripts import example

ROOT = Path(__file__).parents[1]
PAGE = " ".join((ROOT / "docs" / "vi.md").read_text().split())


def test_the_market_clears(capsys):
    market = example("market_equilibrium")
    result = market.main()
    flow, loss = result.x, market.losses(result.x)
    assert result.success
    # nobody ships at a loss, and where nothing is shipped it would be at one
    assert np.all(flow >= 0)
    assert np.all(loss >= -1e-9)
    assert np.abs(flow * loss).max() < 1e-8
    shipped = [f"{value:.4f}" for value in flow[flow > 0]]
    at_a_loss = [f"{value:.2f}" for value in loss[flow == 0]]
    assert tuple(shipped) == re.findall(r"(\d+\.\d{4}) and (\d+\.\d{4}) units", PAGE)[0]
    assert tuple(at_a_loss) == re.findall(r"loss of (\d\.\d+) and (\d\.\d+) a unit", PAGE)[0]
    assert "region 0 -> city 0" in capsys.readouterr().out


def test_the_membrane_agrees_with_projected_gauss_seidel():
    obstacle = example("obstacle")
    n = 8
    matrix, lower = obstacle.laplacian(n).toarray(), obstacle.obstacle(n)
    u = lower.copy()
    for _ in range(2000):
        for i in range(n * n):
            rest = matrix[i] @ u - matrix[i, i] * u[i] + obstacle.WEIGHT
            u[i] = max(lower[i], -rest / matrix[i, i])
    result = obstacle.solve(n)
    assert result.success
    assert np.abs(result.x - u).max() < 1e-10


def test_the_obstacle_figure_is_drawn(tmp_path, capsys):
    example("obstacle").main(str(tmp_path / "obstacle.png"))
    assert (tmp_path / "obstacle.png").stat().st_size > 1000
    assert "400 unknowns" in capsys.readouterr().out


def test_the_picture_of_the_readme_is_drawn(tmp_path):
    picture = example("readme_picture")
    picture.main(str(tmp_path / "zeno.png"))
    assert (tmp_path / "zeno.png").stat().st_size > 1000
    times, stuck = picture.scipy_restarts()
    assert stuck > 5
    assert times[-1] == pytest.approx(2.4658466315590443, abs=1e-9)
