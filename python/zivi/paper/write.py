"""Writes the figures, the data behind each, and the table of checked numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from zivi.methods import ThetaGamma
from zivi.paper import ball
from zivi.paper.checks import Check, save
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["write"]


def write(out: Path | str) -> list[Check]:
    """Write the paper's figures and numbers.

    Parameters
    ----------
    out : path
        Folder, made if needed: a PNG for each figure, a CSV with the data behind it, and
        ``checks.csv``.

    Returns
    -------
    list of Check
        Every checked number; the reproduction holds if all are ``ok``.

    Examples
    --------
    >>> import tempfile
    >>> from zivi.paper import write
    >>> all(check.ok for check in write(tempfile.mkdtemp()))
    True
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    sol = ball.run(ThetaGamma(ball.H))
    for name, (figure, quantities) in ball.figures(sol).items():
        _save_figure(figure, folder / f"{name}.png")
        _save_data(sol, quantities, folder / f"{name}.csv")
    figure, runs = ball.explicit_and_implicit()
    _save_figure(figure, folder / "explicit_and_implicit.png")
    for name, run in runs.items():
        _save_data(run, ["x", "xdot", "s", "v"], folder / f"explicit_and_implicit_{name}.csv")
    checks = ball.checks(sol)
    save(checks, folder / "checks.csv")
    return checks


def _save_figure(figure: Figure, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, dpi=200)
    plt.close(figure)


def _save_data(sol: Trajectory, quantities: list[str], path: Path) -> None:
    sol.to_xarray()[quantities].to_dataframe().to_csv(path)
