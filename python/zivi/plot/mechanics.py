"""Plots of mechanical systems: gaps, reactions and coordinates over time, and the configuration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.plot.look import PALETTE, WALL, axes_of, legend
from zivi.plot.mechanical_curve import broken, drawn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from zivi.base.check import Array
    from zivi.control.mechanical_loop_run import MechanicalClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

__all__ = [
    "check_mechanical",
    "configuration",
    "controls",
    "coordinates",
    "gaps",
    "is_mechanical",
    "modes",
    "reactions",
    "slips",
]


def is_mechanical(run: Any) -> bool:
    """Whether a run has coordinates and gaps."""
    return all(hasattr(run, name) for name in ("q", "gaps", "reactions"))


def check_mechanical(plot: str, run: Any) -> None:
    """Raise a TypeError for what a plot of a mechanical system cannot draw."""
    if not is_mechanical(run):
        raise TypeError(
            f"zivi.plot.{plot} draws a zivi.MechanicalTrajectory, got {type(run).__name__}"
        )


def gaps(sol: MechanicalTrajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the gaps over time, with a mark at each accumulation and each lift-off.

    Parameters
    ----------
    sol : MechanicalTrajectory
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    check_mechanical("gaps", sol)
    ax = axes_of(ax)
    _lines(ax, *drawn(sol, "gaps"), sol.gap_names, line)
    for events, mark in ((sol.zeno, "v"), (sol.liftoffs, "^")):
        for event in events:
            ax.plot(event["t"], 0.0, mark, color=_colour(int(event["gap"])), ms=5, clip_on=False)
    ax.axhline(0.0, color=WALL, lw=0.8, zorder=0)
    ax.set(xlabel="time $t$ (s)", ylabel="gaps $g_i$ (SI)")
    return ax


def reactions(sol: MechanicalTrajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the reactions over time; impulses, which are infinite forces, are not in them.

    Parameters and return value as for `gaps`.
    """
    check_mechanical("reactions", sol)
    ax = axes_of(ax)
    _lines(ax, *drawn(sol, "reactions"), sol.gap_names, line)
    ax.set(xlabel="time $t$ (s)", ylabel=r"reactions $\lambda_i$ (SI)")
    return ax


def coordinates(sol: MechanicalTrajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the coordinates over time, of a closed loop beside its reference.

    Parameters and return value as for `gaps`.
    """
    check_mechanical("coordinates", sol)
    ax = axes_of(ax)
    _lines(ax, *drawn(sol, "q"), sol.coordinate_names, line)
    reference = getattr(sol, "q_ref", None)
    for k, values in enumerate([] if reference is None else reference.T):
        if not np.all(np.isnan(values)):
            ax.plot(sol.t, values, color=_colour(k), ls="--", lw=0.8)
    ax.set(xlabel="time $t$ (s)", ylabel="coordinates $q_i$ (SI)")
    return ax


def configuration(
    sol: MechanicalTrajectory,
    ax: Axes | None = None,
    *,
    over: Sequence[int] | Sequence[str] | None = None,
    **line: Any,
) -> Axes:
    """Plot one coordinate over another; of a single coordinate its velocity over it.

    Parameters and return value as for `gaps`; `over` are two coordinates, numbers or names, by
    default the first two.
    """
    check_mechanical("configuration", sol)
    ax = axes_of(ax)
    names = sol.coordinate_names
    if over is None and len(names) == 1:
        _, phase = broken(sol, *drawn(sol, "phase"))
        ax.plot(*phase.T, **({"color": _colour(len(ax.lines))} | line))
        ax.set(xlabel=names[0], ylabel=f"velocity of {names[0]}")
        return ax
    chosen = [_number(names, item) for item in (over if over is not None else (0, 1))]
    if len(chosen) != 2:
        raise ValueError(f"over must be two coordinates, got {over!r}")
    first, second = chosen
    q = drawn(sol, "q")[1]
    ax.plot(q[:, first], q[:, second], **({"color": _colour(len(ax.lines))} | line))
    ax.set(xlabel=names[first], ylabel=names[second])
    return ax


def slips(sol: MechanicalTrajectory, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the slip speeds of dry friction over time.

    Parameters and return value as for `gaps`.
    """
    check_mechanical("slips", sol)
    ax = axes_of(ax)
    _lines(ax, *broken(sol, *drawn(sol, "slips")), sol.channel_names, line)
    ax.axhline(0.0, color=WALL, lw=0.8, zorder=0)
    ax.set(xlabel="time $t$ (s)", ylabel="slip speeds $w_c$ (SI)")
    return ax


def modes(sol: MechanicalTrajectory, ax: Axes | None = None, **bar: Any) -> Axes:
    """Plot what each channel of dry friction does: bars of stick, of slip up and of slip down.

    Parameters and return value as for `gaps`; `**bar` is passed to
    `matplotlib.axes.Axes.broken_barh`.

    Raises
    ------
    ValueError
        If the run has no friction.

    Examples
    --------
    >>> belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
    >>> system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[belt])
    >>> ax = zivi.plot.modes(zivi.simulate(system, (0, 30), ([0.0], [0.2])))
    >>> [label.get_text() for label in ax.get_yticklabels()]
    ['belt']
    """
    check_mechanical("modes", sol)
    if not sol.channel_names:
        raise ValueError("zivi.plot.modes draws dry friction, the run has none")
    ax = axes_of(ax)
    names = {0: "stick", 1: "slip +", -1: "slip -"}
    drawn_before: set[int] = set()
    for channel in range(len(sol.channel_names)):
        for mode in names:
            spans = [(t, end - t) for t, end, what in sol._spans(channel) if what == mode]
            label = names[mode] if spans and mode not in drawn_before else None
            drawn_before |= {mode} if spans else set()
            settings = {"facecolors": _colour(MODE_COLOURS[mode]), "label": label} | bar
            ax.broken_barh(spans, (channel - 0.4, 0.8), **settings)
    ax.set_yticks(range(len(sol.channel_names)), sol.channel_names)
    ax.set_ylim(-0.5, len(sol.channel_names) - 0.5)  # rows that never close, too
    ax.set(xlabel="time $t$ (s)", xlim=(sol.t[0], sol.t[-1]))
    ax.invert_yaxis()
    legend(ax)
    return ax


MODE_COLOURS = {0: 0, 1: 1, -1: 2}
"""The colours of stick and of both directions of slip, in the palette."""


def controls(run: MechanicalClosedLoop, ax: Axes, line: dict[str, Any]) -> Axes:
    """Plot the controls of a closed loop of a mechanical system, held from sample to sample."""
    _lines(ax, run.t, run.u, run.control_names, {"drawstyle": "steps-post"} | line)
    ax.set(xlabel="time $t$ (s)", ylabel="controls $u_j$ (SI)")
    return ax


MOST_NAMED = 16
"""Lines that a legend names: of more it would be higher than the plot."""


def _number(names: tuple[str, ...], item: int | str) -> int:
    if isinstance(item, str) and item in names:
        return names.index(item)
    if isinstance(item, int | np.integer) and -len(names) <= item < len(names):
        return int(item) % len(names)
    raise ValueError(f"over must hold coordinates of {', '.join(names)}, got {item!r}")


def _lines(
    ax: Axes, t: Array, columns: Array, names: tuple[str, ...], line: dict[str, Any]
) -> None:
    for k, (values, name) in enumerate(zip(columns.T, names, strict=True)):
        ax.plot(t, values, **({"color": _colour(k), "label": name} | line))
    if 0 < len(names) <= MOST_NAMED:
        legend(ax)


def _colour(k: int) -> str:
    return PALETTE[k % len(PALETTE)]
