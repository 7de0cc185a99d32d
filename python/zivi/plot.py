"""Plots of trajectories and closed loops.

Every function draws into ``ax`` (a new figure's axes by default), returns the axes, changes no
global setting and never calls ``show``. Further keywords go to `matplotlib.axes.Axes.plot`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeGuard

import numpy as np

from zivi._curve import line_of
from zivi._extras import needed

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.closed_loop import ClosedLoop
    from zivi.trajectory import Trajectory

__all__ = ["BLUE", "GREEN", "ORANGE", "PURPLE", "control", "lifted", "multipliers", "overview"]
__all__ += ["phase_plane", "position", "signs", "velocity"]

# Okabe and Ito's palette: told apart by colour-blind readers and in grey
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    plt = needed("matplotlib.pyplot", "plots")
    axes: Axes = plt.subplots(layout="constrained")[1]
    return axes


def position(sol: Trajectory | ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the distance from the wall over time, of a closed loop beside its reference.

    Parameters
    ----------
    sol : Trajectory or ClosedLoop
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
    curve = line_of(sol)
    ax.plot(curve.t, curve.x, **{"color": BLUE, "label": "$x$"} | line)
    if _has_reference(sol):
        ax.plot(sol.t, sol.x_ref, color=GREEN, ls="--", label="$x_r$")
        ax.legend()
    ax.set(xlabel="time $t$ (s)", ylabel="position $x$ (m)")
    return ax


def velocity(sol: Trajectory | ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the velocity over time; at impacts the line is broken, not joined.

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    curve = line_of(sol)
    times, values = curve.broken(curve.t), curve.broken(curve.xdot)
    ax.plot(times, values, **{"color": ORANGE, "label": r"$\dot x$"} | line)
    if _has_reference(sol):
        ax.plot(sol.t, sol.xdot_ref, color=PURPLE, ls="--", label=r"$\dot x_r$")
        ax.legend()
    ax.set(xlabel="time $t$ (s)", ylabel=r"velocity $\dot x$ (m/s)")
    return ax


def lifted(sol: Trajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the transformed position and velocity over time: no jumps.

    Parameters and return value as for `position`.
    """
    ax = _axes(ax)
    curve = line_of(sol)
    ax.plot(curve.t, curve.s, **{"color": BLUE, "label": "$s$ (m)"} | line)
    ax.plot(curve.t, curve.v, **{"color": ORANGE, "ls": "--", "label": "$v$ (m/s)"} | line)
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
    sol: Trajectory | ClosedLoop,
    ax: Axes | None = None,
    *,
    coordinates: Literal["lifted", "physical"] | None = None,
    **line: Any,
) -> Axes:
    """Plot velocity over position.

    Parameters and return value as for `position`; `coordinates` are transformed by default for a
    trajectory, physical (the only ones) for a closed loop.
    """
    ax = _axes(ax)
    curve = line_of(sol)
    physical = curve.s.size == 0
    chosen = ("physical" if physical else "lifted") if coordinates is None else coordinates
    if chosen == "lifted" and not physical:
        ax.plot(curve.s, curve.v, **{"color": BLUE} | line)
        ax.set(xlabel="transformed position $s$ (m)", ylabel="transformed velocity $v$ (m/s)")
    elif chosen == "physical":
        ax.plot(curve.broken(curve.x), curve.broken(curve.xdot), **{"color": BLUE} | line)
        if _has_reference(sol):
            ax.plot(sol.x_ref, sol.xdot_ref, color=GREEN, ls="--", label="reference")
            ax.legend()
        ax.set(xlabel="position $x$ (m)", ylabel=r"velocity $\dot x$ (m/s)")
    else:
        allowed = "'physical' for a closed loop" if physical else "'lifted' or 'physical'"
        raise ValueError(f"coordinates must be {allowed}, got {coordinates!r}")
    return ax


def control(run: ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the control of a closed loop, held from sample to sample.

    Parameters
    ----------
    run : ClosedLoop
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = _axes(ax)
    ax.step(run.t, run.u, where="post", **{"color": ORANGE} | line)
    ax.set(xlabel="time $t$ (s)", ylabel="control $u$ (m/s$^2$)")
    return ax


SIGN_LINES = {
    r"$\lambda_s$": (BLUE, "-"),
    r"$\lambda_v$": (ORANGE, "--"),
    r"$\lambda_{s_r}$": (GREEN, "-"),
    r"$\lambda_{v_r}$": (PURPLE, "--"),
    r"$\lambda_{e_s}$": ("black", "-"),
    r"$\lambda_{e_v}$": ("gray", "--"),
}
"""Name, colour and style of the six signs."""


def signs(run: ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the multipliers of the controller's ticks, those that it has.

    Parameters and return value as for `control`.
    """
    ax = _axes(ax)
    for values, (label, (color, style)) in zip(run.signs.T, SIGN_LINES.items(), strict=True):
        if not np.all(np.isnan(values)):
            look = {"color": color, "ls": style, "label": label} | line
            ax.step(run.t, values, where="post", **look)
    ax.set(xlabel="time $t$ (s)", ylabel="multiplier (1)", ylim=(-1.15, 1.15))
    ax.legend(ncols=3)
    return ax


def overview(run: ClosedLoop, figure: Figure | None = None) -> Figure:
    """Plot a closed loop: position, velocity, control and signs over time.

    Parameters
    ----------
    run : ClosedLoop
        The run.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if figure is None:
        plt = needed("matplotlib.pyplot", "plots")
        figure = plt.figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    drawings: list[Callable[..., Axes]] = [position, velocity, control, signs]
    for draw, ax in zip(drawings, axes.flat, strict=True):
        draw(run, ax=ax)
    return figure


def _has_reference(sol: Trajectory | ClosedLoop) -> TypeGuard[ClosedLoop]:
    reference = getattr(sol, "x_ref", None)
    return reference is not None and not np.all(np.isnan(reference))
