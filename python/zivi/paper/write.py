"""Writes the figures, the data behind each, and the table of checked numbers."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from zivi.methods import ThetaGamma
from zivi.paper import ball, linearisation
from zivi.paper.checks import Check, save
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Reproduction", "write"]


@dataclasses.dataclass(frozen=True)
class Reproduction:
    """What `write` found.

    Parameters
    ----------
    checks : list of Check
        Every checked number.
    rates : list of linearisation.Rate
        How often the linearisations of section V.A fail; measured, not checked.
    """

    checks: list[Check]
    rates: list[linearisation.Rate]

    @property
    def ok(self) -> bool:
        """Whether every checked number agrees."""
        return all(check.ok for check in self.checks)


def write(out: Path | str) -> Reproduction:
    """Write the paper's figures and numbers.

    Parameters
    ----------
    out : path
        Folder, made if needed: a PNG for each figure, a CSV with the data behind it,
        ``checks.csv`` and ``linearisation.csv``.

    Returns
    -------
    Reproduction
        The checked numbers and the measured rates.

    Examples
    --------
    >>> import tempfile
    >>> from zivi.paper import write
    >>> write(tempfile.mkdtemp()).ok
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
    rates = linearisation.measure()
    linearisation.save(rates, folder / "linearisation.csv")
    return Reproduction(checks, rates)


def _save_figure(figure: Figure, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, dpi=200)
    plt.close(figure)


def _save_data(sol: Trajectory, quantities: list[str], path: Path) -> None:
    sol.to_xarray()[quantities].to_dataframe().to_csv(path)
