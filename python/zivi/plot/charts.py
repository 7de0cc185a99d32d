"""Charts of events of periodic orbits in two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.plot.look import BLUE, GREEN, ORANGE, PURPLE, axes_of, legend
from zivi.plot.orbits import EVENTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.orbits.mechanical.two_parameters import EventCurve

COLOURS = {
    "fold": BLUE,
    "period_doubling": ORANGE,
    "pitchfork": ORANGE,
    "neimark_sacker": GREEN,
    "grazing": PURPLE,
    "interior_impact": PURPLE,
    "end_of_rest": "0.3",
}


APART = 70.0, 10.0
"""Points (1/72 inch) between named ones, sideways and up: nearer names would cover each other."""


def _name(kind: str) -> str:
    return EVENTS[kind][2] if kind in EVENTS else kind.replace("_", " ")


def _is_free(ax: Axes, place: tuple[float, float]) -> bool:
    """Whether no name is written near a place."""
    to_points = ax.transData.transform
    told = [it.xy for it in ax.texts if hasattr(it, "xy")]
    apart = np.multiply(APART, ax.figure.dpi / 72)
    return all(np.any(np.abs(to_points(it) - to_points(place)) > apart) for it in told)


def curve(c: EventCurve, ax: Axes | None = None, *, words: bool = False, **line: Any) -> Axes:
    """Plot a curve of an event in two parameters: dashed where the orbit is no motion.

    Parameters
    ----------
    c : EventCurve
        From `zivi.continue_curve`.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    words : bool
        Whether the word of the orbit is written beside the curve.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> orbit = zivi.periodic_orbit(zivi.ImpactSystem(table, e=0.5), [(0.6, 2.1)])
    >>> fold = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6)).of_kind("fold")[0]
    >>> c = zivi.continue_curve(fold, ("amplitude", "e"), ((0.5, 1.5), (0.4, 0.6)))
    >>> zivi.plot.curve(c).get_ylabel()
    'e'
    """
    ax = axes_of(ax)
    look: dict[str, Any] = {"color": COLOURS.get(c.kind, "black"), "lw": 1.2} | line
    label = look.pop("label", _name(c.kind))
    solid = c.admissible if len(c._found) else np.ones(len(c), dtype=bool)
    wide = solid.copy()
    wide[1:] |= solid[:-1]
    wide[:-1] |= solid[1:]
    x, y = c.values.T
    faint: dict[str, Any] = {"ls": "--", "alpha": 0.5} | look
    ax.plot(x, np.where(wide, y, np.nan), label=label, **look)
    ax.plot(x, np.where(solid, np.nan, y), **faint)
    for point in c.points:
        ax.plot(*point.values, "o", color=look["color"], ms=4.0)
        first, _, ratio = point.kind.partition("resonance_")
        told = ratio.replace("_", ":") or _name(first)
        place = (float(point.values[0]), float(point.values[1]))
        if _is_free(ax, place):
            ax.annotate(told, place, (3, 3), textcoords="offset points", fontsize="x-small")
    if words and len(c._found):
        from zivi.orbits.mechanical.word import shortened as short

        middle = len(c) // 2
        place = (float(x[middle]), float(y[middle]))
        ax.annotate(short(c.orbits(middle).word), place, fontsize="x-small")
    ax.set(xlabel=c.names[0], ylabel=c.names[1])
    return ax


def chart(
    curves: Sequence[EventCurve], ax: Axes | None = None, *, words: bool = False, **line: Any
) -> Axes:
    """Plot several curves of events over the same two parameters, with a legend.

    Parameters
    ----------
    curves : sequence of EventCurve
        From `zivi.continue_curve`.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    words : bool
        Whether the words of the orbits are written beside the curves.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If the curves have other parameters, or there is none.
    """
    if not len(curves) or len({tuple(c.names) for c in curves}) != 1:
        raise ValueError("curves must be one or more over the same two parameters")
    ax = axes_of(ax)
    known: set[str] = set()
    for c in curves:
        label = "_" if c.kind in known else _name(c.kind)
        known.add(c.kind)
        curve(c, ax, words=words, **{"label": label} | line)
    legend(ax)
    return ax
