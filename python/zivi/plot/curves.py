"""Lines over time, velocity over position, sections and histograms of impacts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from zivi.base.check import Array, finite, integer
from zivi.base.status import warn
from zivi.plot.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    PALETTE,
    PURPLE,
    WALL,
    axes_of,
    axis_labels,
    check_run,
    figure_of,
    has_reference,
    in_frame,
    legend,
    next_colour,
    wall_of,
)
from zivi.plot.mechanics import (
    Units,
    configuration,
    controls,
    coordinates,
    gaps,
    is_mechanical,
    modes,
    reactions,
    slips,
)
from zivi.plot.orbits import branch_multipliers

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from zivi.control.loop_run import ClosedLoop
    from zivi.control.mechanical_loop import MechanicalClosedLoop
    from zivi.orbits.orbit import Branch
    from zivi.plot.drawing import Frame
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory

# A run as lines that can be drawn: smooth between samples, broken at impacts.

PARTS = 24
"""Points of a step, or of what an impact leaves of it, where a method has a dense output."""
FINEST = 1e-3
"""Smallest arc of an extrapolated accumulation that is drawn, as a part of the fastest impact."""


@dataclasses.dataclass(frozen=True)
class Line:
    """Points of a line, and its breaks at impacts.

    Parameters
    ----------
    t, x, xdot : ndarray
        Times (s), positions (m) and velocities (m/s).
    s, v : ndarray
        The transformed state, empty if the run has none.
    impacts : ndarray
        Indices of the first points after impacts.
    """

    t: Array
    x: Array
    xdot: Array
    s: Array
    v: Array
    impacts: np.ndarray

    def broken(self, values: Array) -> Array:
        """Insert NaN where an impact separates two points."""
        return np.insert(values, self.impacts, np.nan)


def line_of(run: Trajectory | ClosedLoop) -> Line:
    """Return the points of a run: its samples, refined where the method knows more."""
    path: Any = getattr(run, "_path", None)
    held = hasattr(run, "u")  # a closed loop is drawn at its samples
    if held or not (hasattr(path, "tails") and path.dense and len(run.t) > 1):
        s, v = run.transformed.s, run.transformed.v
        return Line(run.t, run.x, run.xdot, s, v, _after(run.t, run.resolved_impacts["t"]))
    times, impacts = _curve_times(run, path.starts())  # type: ignore[arg-type]
    x, xdot = path.physical(times)
    s, v = path.lifted(times)
    return Line(times, x, xdot, s, v, _after(times, impacts))


def reference_line(run: ClosedLoop) -> Line:
    """Return the samples of a reference, broken where it turns within a step of the wall."""
    x, xdot = run.x_ref, run.xdot_ref
    turned = (xdot[:-1] < 0.0) & (xdot[1:] > 0.0)
    reach = 2.0 * np.diff(run.t) * np.abs(xdot[:-1])
    after = np.flatnonzero(turned & (x[:-1] <= reach)) + 1
    return Line(run.t, x, xdot, np.empty(0), np.empty(0), after)


def _curve_times(sol: Trajectory, begun: Array) -> tuple[Array, Array]:
    """Choose times that show every arc, with the last moment before each impact."""
    fastest = float(np.max(sol.impacts["xdot_after"], initial=0.0))
    known = sol.impacts_down_to(FINEST * fastest)["t"] if fastest > 0.0 else sol.impacts["t"]
    impacts = known[(known > sol.t[0]) & (known <= sol.t[-1])]
    within = begun[(begun > sol.t[0]) & (begun < sol.t[-1])]
    corners = np.union1d(np.append(within, sol.t[[0, -1]]), impacts)
    parts = np.arange(PARTS) / PARTS
    inner = (corners[:-1, None] + parts * np.diff(corners)[:, None]).ravel()
    return np.unique(np.concatenate([inner, sol.t, np.nextafter(impacts, -np.inf)])), impacts


def _after(t: Array, impacts: Array) -> np.ndarray:
    after = np.searchsorted(t, impacts, side="left")
    return np.unique(after[(after > 0) & (after < len(t))])


# Lines over time, and velocity over position.


def position(
    sol: Trajectory | ClosedLoop,
    ax: Axes | None = None,
    *,
    frame: Frame = "wall",
    **line: Any,
) -> Axes:
    """Plot the distance from the wall over time; for a closed loop, with its reference.

    Parameters
    ----------
    sol : Trajectory or ClosedLoop
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    frame : {"wall", "fixed"}
        The frame of a moving wall, or the fixed frame, in which the wall is drawn as well.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    See Also
    --------
    zivi.plot.velocity, zivi.plot.overview : the velocity; all views of a run.

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
    ax.set(xlabel="time $t$ (s)", ylabel=axis_labels(sol, frame)[0])
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
        other = reference_line(sol)
        times, values = other.broken(other.t), other.broken(other.xdot)
        ax.plot(times, values, color=next_colour(ax, PURPLE), ls="--", label=r"$\dot x_r$")
        legend(ax)
    ax.set(xlabel="time $t$ (s)", ylabel=axis_labels(sol, frame)[1])
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


def multipliers(branch: Branch, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the Floquet multipliers of a branch in the complex plane, with the unit circle.

    Parameters and return value as for `position`. The selections of the signs of a run are
    `zivi.plot.signs`; a `Trajectory` as the argument is deprecated.
    """
    from zivi.orbits.orbit import Branch

    if isinstance(branch, Branch):
        return branch_multipliers(branch, ax, **line)
    # a run with a residual is a trajectory
    check_run("multipliers", branch, needs="residual", of="Branch")
    warn("plot.multipliers of a run is deprecated; use plot.signs", DeprecationWarning)
    return signs(branch, ax, **line)


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

    See Also
    --------
    zivi.plot.poincare : the points of a section only.
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
            other = reference_line(sol)
            x_ref, xdot_ref = other.broken(other.x), other.broken(other.xdot)
            ax.plot(x_ref, xdot_ref, color=colour, ls="--", label="reference")
            legend(ax)
        ax.set(**dict(zip(("xlabel", "ylabel"), axis_labels(sol, frame), strict=True)))
    else:
        raise ValueError(f"coordinates must be 'lifted' or 'physical', got {coordinates!r}")
    return ax


def _look(ax: Axes, first: str, label: str, line: dict[str, Any]) -> dict[str, Any]:
    """Complete the settings of a line; an overlay has the next colour."""
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

    See Also
    --------
    zivi.plot.signs, zivi.plot.overview : the set-valued signs; all views of a loop.
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


def signs(run: Trajectory | ClosedLoop, ax: Axes | None = None, **line: Any) -> Axes:
    r"""Plot the selections of the signs of a run over time.

    .. math:: \lambda_s \in \mathrm{sgn}\,s, \qquad \lambda_v \in \mathrm{sgn}\,v

    Those of the controller of a closed loop are drawn one below the other: each has a row of its
    own, named at the left, from -1 to 1. Parameters and return value as for `position`.
    """
    check_run("signs", run)
    ax = axes_of(ax)
    if not hasattr(run, "signs"):
        lifted = run.transformed
        ax.step(run.t, lifted.lambda_s, **_look(ax, BLUE, r"$\lambda_s$", line))
        ax.step(run.t, lifted.lambda_v, **_look(ax, ORANGE, r"$\lambda_v$", {"ls": "--"} | line))
        ax.set(xlabel="time $t$ (s)", ylabel="selection of the sign (1)", ylim=(-1.15, 1.15))
        legend(ax)
        return ax
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
    ax.set(xlabel="time $t$ (s)", ylabel="selections of the signs (1)")
    return ax


# Several plots of one run in a figure.


def overview(
    run: Trajectory | ClosedLoop | MechanicalTrajectory,
    figure: Figure | None = None,
    *,
    units: Units = None,
) -> Figure:
    """Plot a run as a whole.

    A trajectory: position, velocity and transformed state over time, and the physical phase
    plane. A closed loop: position, velocity, control and signs over time; the phase plane instead
    of signs that the controller does not have. A mechanical system: coordinates, gaps and
    reactions over time, and its configuration, of a closed loop its controls; with dry friction
    what sticks and slips instead of the reactions. Empty panels, for example reactions of a system
    without contacts, are left out.

    Parameters
    ----------
    run : Trajectory, ClosedLoop or MechanicalTrajectory
        The run.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure by default.
    units : str or dict, optional
        Of a mechanical system the unit of all coordinates and gaps, or units by name.

    Returns
    -------
    matplotlib.figure.Figure

    See Also
    --------
    zivi.plot.animate : the motion as an animation.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> len(zivi.plot.overview(zivi.simulate(ball, (0, 3), (1, 0))).axes)
    4
    """
    if is_mechanical(run):
        drawings = _mechanical_drawings(cast("MechanicalTrajectory", run), units)
    else:
        check_run("overview", run)
        plane = partial(phase_plane, coordinates="physical")
        drawings = [position, velocity, lifted, plane]
        if hasattr(run, "u"):
            signed = not np.all(np.isnan(cast("ClosedLoop", run).signs))
            drawings[2:] = [control, signs if signed else plane]
    figure = figure_of(figure, 9.0, 6.0)
    first = None
    for place, draw in zip(_divide_figure(figure, len(drawings)), drawings, strict=True):
        over_time = getattr(draw, "func", draw) not in PLANES
        ax = figure.add_subplot(place, sharex=first if over_time else None)
        first = first or ax
        draw(run, ax=ax)
    return figure


def _mechanical_drawings(run: MechanicalTrajectory, units: Units) -> list[Callable[..., Axes]]:
    """Choose what is not empty."""
    drawings: list[Callable[..., Axes]] = [partial(coordinates, units=units)]
    drawings += [partial(gaps, units=units)] if run.gap_names else []
    if run.channel_names:
        drawings += [modes] if run.gap_names else [slips, modes]
    elif run.contacts.any() or run.equality_names:
        drawings += [partial(reactions, units=units)]
    plane = partial(configuration, units=units)
    return [*drawings, control if hasattr(run, "control_names") else plane]


PLANES = (phase_plane, configuration)
"""What is not drawn over time."""


def _divide_figure(figure: Figure, number: int) -> list[SubplotSpec]:
    """Divide a figure: two rows and columns, of three places the last one high."""
    if number == 2:
        row = figure.add_gridspec(1, 2)
        return [row[0, 0], row[0, 1]]
    grid = figure.add_gridspec(2, 2)
    if number == 3:
        return [grid[0, 0], grid[1, 0], grid[:, 1]]
    return [grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1]]


# Points of a Poincare section.


def poincare(
    sol: Trajectory,
    period: float,
    ax: Axes | None = None,
    *,
    section: Literal["period", "impacts"] = "period",
    phase: float = 0.0,
    skip: int = 0,
    **line: Any,
) -> Axes:
    r"""Plot the state once a period, or the impacts by their phase.

    Parameters
    ----------
    sol : Trajectory
        A run with dense output.
    period : float
        Period of the excitation, > 0 (s).
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    section : {"period", "impacts"}
        Points :math:`(x, \dot x)` at the times ``phase + k * period``; or the speed after each
        impact over the time since the last of these, as a part of the period. Impacts that the
        run extrapolated are not among them.
    phase : float
        Time of one of the sections (s).
    skip : int
        Points at the start that are left out, >= 0: a transient.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If a setting is out of range, or no point is left to draw.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=9.81, amplitude=30.0, omega=25.0)
    >>> sol = zivi.simulate(zivi.ImpactSystem(table, e=0.5), (0, 20), (0.1, 0))
    >>> zivi.plot.poincare(sol, 2 * 3.141592653589793 / 25.0, skip=10).get_ylabel()
    'velocity $\\dot x$ (m/s)'
    """
    by_period = section == "period"
    check_run("poincare", sol, needs="__call__" if by_period else None, of="Trajectory")
    period, phase = finite("period", period), finite("phase", phase)
    if not period > 0.0:
        raise ValueError(f"period must be > 0, got {period}")
    if integer("skip", skip) < 0:
        raise ValueError(f"skip must be >= 0, got {skip}")
    if by_period:
        across, along = _strobe(sol, period, phase)
        named = axis_labels(sol, "wall")
    elif section == "impacts":
        across = np.mod((sol.impacts["t"] - phase) / period, 1.0)
        along = sol.impacts["xdot_after"]
        named = "phase of the impact (1)", "speed after the impact (m/s)"
    else:
        raise ValueError(f"section must be 'period' or 'impacts', got {section!r}")
    if len(across) <= skip:
        raise ValueError(f"the run has {len(across)} points of this section, and skip is {skip}")
    ax = axes_of(ax)
    look: dict[str, Any] = {"color": next_colour(ax, BLUE), "marker": ".", "ms": 3.0, "ls": ""}
    ax.plot(across[skip:], along[skip:], **look | line)
    ax.set(xlabel=named[0], ylabel=named[1])
    return ax


def _strobe(sol: Trajectory, period: float, phase: float) -> tuple[Array, Array]:
    first = math.ceil((sol.t[0] - phase) / period)
    last = math.floor((sol.t[-1] - phase) / period)
    x, xdot = sol(np.clip(phase + period * np.arange(first, last + 1), sol.t[0], sol.t[-1]))
    return x, xdot


# How fast the impacts of a run are: a histogram.

DECADES = 100.0
"""From this ratio of the fastest to the slowest impact on the axis of speeds is logarithmic."""


def impacts(
    sol: Trajectory | ClosedLoop | MechanicalTrajectory,
    ax: Axes | None = None,
    *,
    bins: int = 20,
    **bars: Any,
) -> Axes:
    """Plot a histogram of the speeds before impacts, stacked by gap for a mechanical system.

    Parameters
    ----------
    sol : Trajectory, ClosedLoop or MechanicalTrajectory
        The run; its ``impacts`` are counted, those of extrapolated accumulations down to the part
        ``slowest`` of the fastest one.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    bins : int
        Number of intervals of the speed, >= 1: of equal length, or, on a logarithmic axis, of equal
        ratio if the speeds span more than a factor of 100.
    **bars
        Passed to `matplotlib.axes.Axes.hist`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError
        If `sol` is not a run.
    ValueError
        If `bins` is not positive.

    See Also
    --------
    zivi.plot.position : the motion between the impacts.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> ax = zivi.plot.impacts(zivi.simulate(ball, (0, 4), (1, 0)))
    >>> int(sum(bar.get_height() for bar in ax.patches)), ax.get_xlabel()
    (10, 'speed before the impact (m/s)')
    """
    mechanical = is_mechanical(sol)
    if not mechanical:
        check_run("impacts", sol, needs="impacts")
    if integer("bins", bins) < 1:
        raise ValueError(f"bins must be >= 1, got {bins}")
    ax = axes_of(ax)
    rows = sol.impacts
    speeds, gap = -np.asarray(rows["speed_before"]), np.asarray(rows["gap"])
    gap, speeds = gap[speeds > 0.0], speeds[speeds > 0.0]
    hit = np.unique(gap) if mechanical else np.zeros(1, int)
    if speeds.size:
        fast, slow = speeds.max(), speeds.min()
        if fast > DECADES * slow:
            ax.set_xscale("log")
            edges = np.geomspace(slow, fast, bins + 1)
        else:
            edges = np.histogram_bin_edges(speeds, bins)
        edges[0], edges[-1] = min(edges[0], slow), max(edges[-1], fast)
        settings: dict[str, Any] = {"stacked": True, "color": [BLUE]}
        if mechanical:
            names = cast("MechanicalTrajectory", sol).gap_names
            settings["label"] = [names[i] for i in hit]
            settings["color"] = [PALETTE[i % len(PALETTE)] for i in hit]
        ax.hist([speeds[gap == i] for i in hit], edges.tolist(), **settings | bars)
        if mechanical:
            legend(ax)
    else:
        ax.text(0.5, 0.5, "no impacts", ha="center", transform=ax.transAxes)
    ax.set(xlabel="speed before the impact (m/s)", ylabel="number of impacts")
    ax.locator_params(axis="y", integer=True)
    return ax


# Plots of fits: data, predictions, residuals, profiles of the likelihood.


def draw_fit(rows: Sequence[Mapping[str, Any]], figure: Figure | None) -> Figure:
    """Draw data, predictions and residuals of each data set in a column of two axes."""
    figure = figure_of(figure, max(6.4, 4.2 * len(rows)), 4.8)
    axes = figure.subplots(2, len(rows), squeeze=False, height_ratios=(3, 1), sharex="col")
    for (top, bottom), row in zip(axes.T, rows, strict=True):
        if row["bounces"]:
            _draw_bounces(top, row)
        else:
            top.plot(row["t"], row["measured"], ".", ms=4, color="0.6", label="data")
            top.plot(row["t"], row["predicted"], color=BLUE, lw=1.2, label="fit")
            top.set_ylabel(row["label"])
        bottom.axhline(0.0, color="0.7", lw=0.8)
        bottom.plot(row["t"], row["residual"], ".", ms=4, color=ORANGE)
        bottom.set(xlabel="t (s)", ylabel="residual / $\\sigma$")
        legend(top)
    return figure


def _draw_bounces(ax: Axes, row: Mapping[str, Any]) -> None:
    """Draw the intervals between bounces; spurious times as crosses at the bottom."""
    known = np.isfinite(row["predicted"])
    times, predicted = row["measured"][known], row["predicted"][known]
    ax.plot(times[1:], np.diff(times), "o", ms=5, color="0.6", label="data")
    ax.plot(times[1:], np.diff(predicted), "_", ms=12, color=BLUE, label="fit")
    alone = row["measured"][~known]
    if len(alone):
        ax.plot(alone, np.zeros(len(alone)), "x", color=ORANGE, label="spurious")
    ax.set_ylabel("interval (s)")


def draw_profile(profile: Any, ax: Axes | None) -> Axes:
    """Draw the root of the rise of the sum of squares along a parameter."""
    ax = axes_of(ax)
    ax.plot(profile.values, np.sqrt(np.maximum(profile.delta, 0.0)), ".-", color=BLUE)
    for end in profile.interval(0.95):
        ax.axvline(end, color="0.7", lw=0.8)
    ax.set(xlabel=profile.name, ylabel=r"$\sqrt{\Delta\chi^2}$")
    return ax
