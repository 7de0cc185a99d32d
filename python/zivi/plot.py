"""Plots of trajectories.

Every function draws into ``ax`` (a new figure's axes by default), returns the axes, changes no
global setting and never calls ``show``. Further keywords go to `matplotlib.axes.Axes.plot`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.trajectory import Trajectory

__all__ = ["BLUE", "GREEN", "ORANGE", "PURPLE", "lifted", "multipliers", "phase_plane", "position"]
__all__ += ["velocity"]

# Okabe and Ito's palette: told apart by colour-blind readers and in grey
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]


def position(sol: Trajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the distance from the wall over time.

    Parameters
    ----------
    sol : Trajectory
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0), method=zivi.ThetaGamma(h=1e-3))
    >>> zivi.plot.position(sol).get_ylabel()
    'position $x$ (m)'
    """
    ax = _axes(ax)
    ax.plot(sol.t, sol.x, **{"color": BLUE} | line)
    ax.set(xlabel="time $t$ (s)", ylabel="position $x$ (m)")
    return ax


def velocity(sol: Trajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the velocity over time; at impacts the line is broken, not joined.

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    ax.plot(*_broken_at_impacts(sol), **{"color": ORANGE} | line)
    ax.set(xlabel="time $t$ (s)", ylabel=r"velocity $\dot x$ (m/s)")
    return ax


def lifted(sol: Trajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the transformed position and velocity over time: no jumps.

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    ax.plot(sol.t, sol.s, **{"color": BLUE, "label": "$s$ (m)"} | line)
    ax.plot(sol.t, sol.v, **{"color": ORANGE, "ls": "--", "label": "$v$ (m/s)"} | line)
    ax.set(xlabel="time $t$ (s)", ylabel="transformed state $s$, $v$")
    ax.legend()
    return ax


def multipliers(sol: Trajectory, ax: Axes | None = None, **line: Any) -> Axes:
    r"""Plot the multipliers over time.

    .. math:: \lambda_s \in \mathrm{sgn}\,s, \qquad \lambda_v \in \mathrm{sgn}\,v

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    ax.step(sol.t, sol.lambda_s, **{"color": BLUE, "label": r"$\lambda_s$"} | line)
    ax.step(sol.t, sol.lambda_v, **{"color": ORANGE, "ls": "--", "label": r"$\lambda_v$"} | line)
    ax.set(xlabel="time $t$ (s)", ylabel="multiplier (1)", ylim=(-1.15, 1.15))
    ax.legend()
    return ax


def phase_plane(
    sol: Trajectory,
    ax: Axes | None = None,
    *,
    coordinates: Literal["lifted", "physical"] = "lifted",
    **line: Any,
) -> Axes:
    """Plot velocity over position, in transformed (default) or physical coordinates.

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    if coordinates == "lifted":
        ax.plot(sol.s, sol.v, **{"color": BLUE} | line)
        ax.set(xlabel="transformed position $s$ (m)", ylabel="transformed velocity $v$ (m/s)")
    elif coordinates == "physical":
        _, xdot = _broken_at_impacts(sol)
        _, x = _broken_at_impacts(sol, sol.x)
        ax.plot(x, xdot, **{"color": BLUE} | line)
        ax.set(xlabel="position $x$ (m)", ylabel=r"velocity $\dot x$ (m/s)")
    else:
        raise ValueError(f"coordinates must be 'lifted' or 'physical', got {coordinates!r}")
    return ax


def _broken_at_impacts(
    sol: Trajectory, values: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Time and values (the velocity) with NaN between the samples that an impact separates."""
    values = sol.xdot if values is None else values
    after = np.searchsorted(sol.t, sol.impacts["t"], side="left")
    after = np.unique(after[(after > 0) & (after < len(sol.t))])
    return np.insert(sol.t, after, np.nan), np.insert(values, after, np.nan)
