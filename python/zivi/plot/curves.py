"""Lines over time, and velocity over position."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from zivi.plot.curve import line_of, reference_of
from zivi.plot.look import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    WALL,
    axes_of,
    has_reference,
    in_frame,
    labels,
    legend,
    next_colour,
    wall_of,
)
from zivi.plot.mechanics import controls, is_mechanical
from zivi.plot.orbits import branch_multipliers
from zivi.plot.runs import check_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.control.closed_loop import ClosedLoop
    from zivi.control.mechanical_loop_run import MechanicalClosedLoop
    from zivi.orbits.branch import Branch
    from zivi.plot.look import Frame
    from zivi.simulation.trajectory import Trajectory


def position(
    sol: Trajectory | ClosedLoop,
    ax: Axes | None = None,
    *,
    frame: Frame = "wall",
    **line: Any,
) -> Axes:
    """Plot the distance from the wall over time, of a closed loop beside its reference.

    Parameters
    ----------
    sol : Trajectory or ClosedLoop
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    frame : {"wall", "fixed"}
        Where a moving wall rests, or where it moves and is drawn too.
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
    check_run("position", sol)
    ax = axes_of(ax)
    curve = line_of(sol)
    x, _ = in_frame(sol, frame, curve.t, curve.x, curve.xdot)
    ax.plot(curve.t, x, **_look(ax, BLUE, "$x$", line))
    if frame == "fixed" and wall_of(sol) is not None:
        ax.plot(curve.t, wall_of(sol)(curve.t)[0], color=WALL, lw=1.0, label="wall $w$", zorder=1)
    if has_reference(sol):
        ax.plot(sol.t, sol.x_ref, color=next_colour(ax, GREEN), ls="--", label="$x_r$")
        legend(ax)
    ax.set(xlabel="time $t$ (s)", ylabel=labels(sol, frame)[0])
    return ax


def velocity(
    sol: Trajectory | ClosedLoop,
    ax: Axes | None = None,
    *,
    frame: Frame = "wall",
    **line: Any,
) -> Axes:
    """Plot the velocity over time; at impacts the line is broken, not joined.

    Parameters and return value as for `position`, `frame` too.
    """
    check_run("velocity", sol)
    ax = axes_of(ax)
    curve = line_of(sol)
    _, xdot = in_frame(sol, frame, curve.t, curve.x, curve.xdot)
    ax.plot(curve.broken(curve.t), curve.broken(xdot), **_look(ax, ORANGE, r"$\dot x$", line))
    if has_reference(sol):
        other = reference_of(sol)
        times, values = other.broken(other.t), other.broken(other.xdot)
        ax.plot(times, values, color=next_colour(ax, PURPLE), ls="--", label=r"$\dot x_r$")
        legend(ax)
    ax.set(xlabel="time $t$ (s)", ylabel=labels(sol, frame)[1])
    return ax


def lifted(sol: Trajectory | ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the transformed position and velocity over time: no jumps.

    Parameters and return value as for `position`.
    """
    check_run("lifted", sol)
    ax = axes_of(ax)
    curve = line_of(sol)
    ax.plot(curve.t, curve.s, **_look(ax, BLUE, "$s$ (m)", line))
    ax.plot(curve.t, curve.v, **_look(ax, ORANGE, "$v$ (m/s)", {"ls": "--"} | line))
    ax.set(xlabel="time $t$ (s)", ylabel="transformed state $s$, $v$")
    legend(ax)
    return ax


def multipliers(sol: Trajectory | Branch, ax: Axes | None = None, **line: Any) -> Axes:
    r"""Plot the multipliers of a run over time, or those of a branch of orbits.

    .. math:: \lambda_s \in \mathrm{sgn}\,s, \qquad \lambda_v \in \mathrm{sgn}\,v

    The Floquet multipliers of a `Branch` are drawn in the complex plane, with the unit circle.
    Parameters and return value as for `position`.
    """
    from zivi.orbits.branch import Branch

    if isinstance(sol, Branch):
        return branch_multipliers(sol, ax, **line)
    check_run("multipliers", sol, needs="residual", of="Trajectory")
    ax = axes_of(ax)
    lifted = sol.transformed
    ax.step(sol.t, lifted.lambda_s, **_look(ax, BLUE, r"$\lambda_s$", line))
    ax.step(sol.t, lifted.lambda_v, **_look(ax, ORANGE, r"$\lambda_v$", {"ls": "--"} | line))
    ax.set(xlabel="time $t$ (s)", ylabel="multiplier (1)", ylim=(-1.15, 1.15))
    legend(ax)
    return ax


def phase_plane(
    sol: Trajectory | ClosedLoop,
    ax: Axes | None = None,
    *,
    coordinates: Literal["lifted", "physical"] | None = None,
    frame: Frame = "wall",
    **line: Any,
) -> Axes:
    """Plot velocity over position.

    Parameters and return value as for `position`, `frame` too; `coordinates` are transformed by
    default for a trajectory, physical for a closed loop.
    """
    check_run("phase_plane", sol)
    ax = axes_of(ax)
    curve = line_of(sol)
    chosen = coordinates or ("physical" if hasattr(sol, "u") or not curve.s.size else "lifted")
    if chosen == "lifted":
        ax.plot(curve.s, curve.v, **_look(ax, BLUE, "$(s, v)$", line))
        if has_reference(sol) and sol._reference is not None:
            s_ref, v_ref = sol._reference.lifted(sol.t)
            ax.plot(s_ref, v_ref, color=next_colour(ax, GREEN), ls="--", label="$(s_r, v_r)$")
            legend(ax)
        ax.set(xlabel="transformed position $s$ (m)", ylabel="transformed velocity $v$ (m/s)")
    elif chosen == "physical":
        x, xdot = in_frame(sol, frame, curve.t, curve.x, curve.xdot)
        ax.plot(curve.broken(x), curve.broken(xdot), **_look(ax, BLUE, r"$(x, \dot x)$", line))
        if has_reference(sol):
            colour = next_colour(ax, GREEN)
            other = reference_of(sol)
            x_ref, xdot_ref = other.broken(other.x), other.broken(other.xdot)
            ax.plot(x_ref, xdot_ref, color=colour, ls="--", label="reference")
            legend(ax)
        ax.set(**dict(zip(("xlabel", "ylabel"), labels(sol, frame), strict=True)))
    else:
        raise ValueError(f"coordinates must be 'lifted' or 'physical', got {coordinates!r}")
    return ax


def _look(ax: Axes, first: str, label: str, line: dict[str, Any]) -> dict[str, Any]:
    """Complete the settings of a line: an overlay takes the next colour."""
    return {"color": next_colour(ax, first), "label": label} | line


def control(run: ClosedLoop | MechanicalClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the control of a closed loop, held from sample to sample.

    Parameters
    ----------
    run : ClosedLoop or MechanicalClosedLoop
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if is_mechanical(run) and hasattr(run, "control_names"):
        return controls(cast("MechanicalClosedLoop", run), axes_of(ax), line)
    run = cast("ClosedLoop", run)
    check_run("control", run, needs="u", of="ClosedLoop")
    ax = axes_of(ax)
    ax.step(run.t, run.u, where="post", **_look(ax, ORANGE, "$u$", line))
    ax.set(xlabel="time $t$ (s)", ylabel="control $u$ (m/s$^2$)")
    return ax


SIGN_LINES = {
    r"$\lambda_s$": BLUE,
    r"$\lambda_v$": ORANGE,
    r"$\lambda_{s_r}$": GREEN,
    r"$\lambda_{v_r}$": PURPLE,
    r"$\lambda_{e_s}$": "black",
    r"$\lambda_{e_v}$": "gray",
}
"""Name and colour of the six signs."""
SIGN_ROW = 2.6
"""Distance of the rows of two signs."""


def signs(run: ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the multipliers of the controller's ticks, those that it has, one below the other.

    Each has a row of its own, named at the left, from -1 to 1 about a thin line at 0.
    Parameters and return value as for `control`.
    """
    check_run("signs", run, needs="signs", of="ClosedLoop")
    ax = axes_of(ax)
    known = [
        (values, label, color)
        for values, (label, color) in zip(run.signs.T, SIGN_LINES.items(), strict=True)
        if not np.all(np.isnan(values))
    ]
    heights = [-SIGN_ROW * k for k in range(len(known))]
    for (values, label, color), height in zip(known, heights, strict=True):
        ax.axhspan(height - 1.0, height + 1.0, color=WALL, alpha=0.12, lw=0.0, zorder=0)
        ax.step(run.t, height + values, where="post", **{"color": color, "label": label} | line)
    if known:
        # a label for each row: those of +1 and of -1 next to it would overlap in a small panel
        ax.set_yticks(heights, [label for _, label, _ in known])
        ax.set_yticks([it + end for it in heights for end in (1.0, -1.0)], minor=True)
        ax.set_ylim(heights[-1] - 1.25, 1.25)
    else:
        ax.text(0.5, 0.5, "a controller without signs", ha="center", transform=ax.transAxes)
    ax.set(xlabel="time $t$ (s)", ylabel="multipliers (1), from -1 to 1")
    return ax
