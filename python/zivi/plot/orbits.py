"""Branches of periodic orbits, bifurcation diagrams, basins of attraction, two-parameter charts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.orbits.orbit import MechanicalBranch
from zivi.plot.drawing import BLUE, GREEN, ORANGE, PALETTE, PURPLE, axes_of, legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.base.check import Array
    from zivi.orbits.curve import EventCurve
    from zivi.orbits.diagram import Basins, Diagram
    from zivi.orbits.orbit import Branch

# Branches of periodic orbits, bifurcation diagrams, basins of attraction.

EVENTS = {
    "fold": ("s", BLUE, "fold"),
    "period_doubling": ("D", ORANGE, "period doubling"),
    "grazing": ("v", PURPLE, "grazing"),
    "interior_impact": ("^", PURPLE, "new impact"),
    "end_of_rest": ("X", GREEN, "end of rest"),
    "end_of_liftoff": ("P", GREEN, "no lift-off"),
    "rest_appears": ("X", GREEN, "rest appears"),
    "pitchfork": ("D", GREEN, "pitchfork"),
    "neimark_sacker": ("o", BLUE, "Neimark-Sacker"),
    "contact_ends": ("X", ORANGE, "end of a contact"),
    "opening": ("X", PURPLE, "opening"),
    "simultaneous": ("P", ORANGE, "two events at once"),
    "slip_grazing": ("v", BLUE, "slip grazes"),
    "slip_appears": ("^", BLUE, "slip appears"),
    "slip_vanishes": ("X", BLUE, "slip vanishes"),
    "stick_appears": ("^", GREEN, "stick appears"),
    "stick_vanishes": ("v", GREEN, "stick vanishes"),
    "turn_sticks": ("P", BLUE, "turn sticks"),
}
"""Marker, colour and name of each event."""
FLAT = 1e-6
"""Relative range of a quantity that does not change along a branch."""
QUANTITIES = {
    "u": "speed after the impact (m/s)",
    "phase": "phase of the impact (1)",
    "margin": "time at rest (s)",
    "multiplier": "largest modulus of a Floquet multiplier (1)",
}


def branch(b: Branch | MechanicalBranch, y: str = "u", ax: Axes | None = None, **line: Any) -> Axes:
    """Plot a branch over its parameter: stable orbits solid, others dashed, events marked.

    Parameters
    ----------
    b : Branch or MechanicalBranch
        The branch.
    y : {"u", "phase", "margin", "multiplier"}
        What is drawn: the speeds after impacts (m/s), their phases, the time at rest of a resting
        orbit (s), the largest modulus of a multiplier. Of a `MechanicalBranch` also ``"q.name"``,
        the largest value of a coordinate, and ``"amplitude"``, half of the range of the first one.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        For another object or quantity.

    See Also
    --------
    zivi.continue_orbit, zivi.plot.multipliers : computes it; its stability.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> orbit = zivi.periodic_orbit(zivi.ImpactSystem(table, e=0.5), [(0.6, 2.1)])
    >>> b = zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4))
    >>> zivi.plot.branch(b).get_xlabel()
    'amplitude'
    """
    if isinstance(b, MechanicalBranch):
        return mechanical_branch(b, y, axes_of(ax), line)
    if not hasattr(b, "orbits"):
        raise TypeError(f"b must be a Branch or MechanicalBranch, got {type(b).__name__}")
    if y not in QUANTITIES:
        raise ValueError(f"y must be one of {', '.join(map(repr, QUANTITIES))}, got {y!r}")
    ax = axes_of(ax)
    rests = any(orbit.kind == "resting" for orbit in b.orbits)
    look: dict[str, Any] = {"color": GREEN if rests else "black", "lw": 1.2} | line
    rows = np.array([_quantity(orbit, y) for orbit in b.orbits])
    solid = b.stable & b.admissible
    _draw_arc(ax, b.values, rows, solid, look)
    for event in b.events:
        _mark(ax, event.kind, event.value, _quantity(event.orbit, y))
    ax.set(xlabel=b.name, ylabel=QUANTITIES[y])
    _add_legend(ax)
    return ax


def _draw_arc(
    ax: Axes, values: Array, rows: Array, solid: np.ndarray, look: dict[str, Any]
) -> None:
    """Draw the columns over the parameter, stable ones solid."""
    for column in rows.T:
        stable = np.where(_with_neighbours(solid), column, np.nan)
        ax.plot(values, stable, **{"label": "stable" if solid.any() else "_"} | look)
        unstable: dict[str, Any] = {"label": "_" if solid.all() else "unstable", "ls": "--"}
        ax.plot(values, np.where(solid, np.nan, column), **unstable | look)


def _mark(ax: Axes, kind: str, value: float, heights: Array) -> None:
    """Mark an event of a branch."""
    marker, colour, name = EVENTS[kind]
    ax.plot([value] * len(heights), heights, marker, color=colour, ms=5.0, label=name)


def _add_legend(ax: Axes) -> None:
    """Add one legend entry for each kind of point, line and mark."""
    handles, names = ax.get_legend_handles_labels()
    low, high = ax.get_ylim()
    if 0.0 < high - low < FLAT * abs(high):  # a constant is not drawn as its rounding
        ax.set_ylim(0.9 * low, 1.1 * high)
    kept = {name: handles[names.index(name)] for name in names}
    if kept:
        legend(ax, handles=list(kept.values()), labels=list(kept))


def mechanical_branch(b: MechanicalBranch, y: str, ax: Axes, line: dict[str, Any]) -> Axes:
    """Plot a branch of a mechanical system, arc by arc."""
    label = _label(b, y)
    for arc in b.arcs:
        rests = any(orbit.kind == "resting" for orbit in arc.orbits)
        look: dict[str, Any] = {"color": GREEN if rests else "black", "lw": 1.2} | line
        rows = np.array([_mechanical_values(orbit, y) for orbit in arc.orbits])
        solid = np.array([orbit.stable and orbit.admissible for orbit in arc.orbits], dtype=bool)
        _draw_arc(ax, arc.values, rows, solid, look)
    for event in b.events:
        _mark(ax, event.kind, event.value, _mechanical_values(event.orbit, y))
    ax.set(xlabel=b.name, ylabel=label)
    _add_legend(ax)
    return ax


def _label(b: MechanicalBranch, y: str) -> str:
    own = {"u": "speed of the gap after the impact", "phase": QUANTITIES["phase"]}
    own |= {"multiplier": QUANTITIES["multiplier"], "amplitude": "half of the range"}
    system = b.arcs[0].orbits[0].system
    names = system.coordinate_names(b.arcs[0].orbits[0]._frame.flow.n)
    own |= {f"q.{name}": f"largest {name}" for name in names}
    if y not in own:
        raise ValueError(f"y must be one of {', '.join(repr(it) for it in own)}, got {y!r}")
    return own[y]


def _mechanical_values(orbit: Any, y: str) -> Array:
    if y == "multiplier":
        return np.array([np.max(np.abs(orbit.multipliers))])
    if y in ("u", "phase"):
        first = [k for k, letter in enumerate(orbit.word) if letter[0] in "ISZ"]
        if not first:
            return np.array([np.nan])
        # of an accumulation the first impact: as many on all points of an arc
        impacts = orbit.impacts if orbit.kind == "impacting" else orbit.impacts[:1]
        values = impacts["t"] / orbit.period % 1.0 if y == "phase" else impacts["u"]
        return np.asarray(values, np.float64)
    states = orbit._along()[1]
    if y == "amplitude":
        return np.array([0.5 * np.ptp(states[:, 0])])
    names = orbit.system.coordinate_names(orbit._frame.flow.n)
    return np.array([np.max(states[:, names.index(y.removeprefix("q."))])])


def _with_neighbours(kept: np.ndarray) -> np.ndarray:
    """Add the next points, so that no gap is drawn where the stability changes."""
    wider = kept.copy()
    wider[1:] |= kept[:-1]
    wider[:-1] |= kept[1:]
    return wider


def _quantity(orbit: Any, y: str) -> Array:
    if y == "margin":
        return np.array([np.nan if orbit.margin is None else orbit.margin])
    if y == "multiplier":
        return np.array([np.max(np.abs(orbit.multipliers))])
    impacts = orbit.impacts
    if not len(impacts):
        return np.array([np.nan if y == "phase" else 0.0])
    if orbit.kind == "resting":
        impacts = impacts[:1]  # as many on all points: the first after the lift-off
    values = impacts["t"] / orbit.period % 1.0 if y == "phase" else impacts["u"]
    return np.asarray(values, np.float64)


def branch_multipliers(b: Branch, ax: Axes | None = None, **line: Any) -> Axes:
    """Plot the multipliers of a branch in the complex plane, with the unit circle.

    The arrows point from the first orbit of the branch to the last.
    """
    ax = axes_of(ax)
    circle = np.linspace(0.0, 2.0 * np.pi, 200)
    ax.plot(np.cos(circle), np.sin(circle), color="0.5", lw=0.8)
    # near a grazing a multiplier is unbounded: the relevant part is near the unit circle
    values = np.where(np.abs(b.multipliers) < 3.0, b.multipliers, np.nan)
    for column, colour in zip(values.T, (BLUE, ORANGE), strict=True):
        look: dict[str, Any] = {"color": colour, "marker": ".", "ms": 3.0, "lw": 0.8}
        (drawn,) = ax.plot(column.real, column.imag, **look | line)
        _point(ax, column, drawn.get_color())
    ax.set(
        xlabel="real part of the Floquet multiplier (1)",
        ylabel="imaginary part (1)",
        aspect="equal",
    )
    return ax


def _point(ax: Axes, column: Any, colour: Any) -> None:
    """Draw an arrow along a line, at the middle of its length, in the direction of the branch."""
    points = column[np.isfinite(column)]
    lengths = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    if len(points) < 2 or lengths[-1] == 0.0:
        return
    k = min(int(np.searchsorted(lengths, 0.5 * lengths[-1])), len(points) - 1)
    k = max(k, 1)
    # a step is too short to show a direction: use a twentieth of the line
    first = int(np.searchsorted(lengths, lengths[k] - 0.05 * lengths[-1], side="right")) - 1
    start, end = points[max(first, 0)], points[k]
    ax.annotate(
        "",
        (end.real, end.imag),
        (start.real, start.imag),
        arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 14, "shrinkB": 0.0},
    )


def diagram(
    d: Diagram, branches: Sequence[Branch] = (), ax: Axes | None = None, **line: Any
) -> Axes:
    """Plot what runs settled on, with branches over it; runs that rest are green.

    Parameters
    ----------
    d : Diagram
        From `bifurcation_diagram`.
    branches : sequence of Branch
        Drawn over the points: stable solid, unstable dashed, events marked.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **line
        Passed to `matplotlib.axes.Axes.plot` for the points.

    Returns
    -------
    matplotlib.axes.Axes

    See Also
    --------
    zivi.bifurcation_diagram, zivi.plot.branch : computes it; adds branches.

    Examples
    --------
    >>> table = zivi.ImpactSystem(
    ...     zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2), e=0.5)
    >>> d = zivi.bifurcation_diagram(table, "amplitude", [1.3], transient=50)
    >>> zivi.plot.diagram(d).get_ylabel()
    'speed after the impact (m/s)'
    """
    ax = axes_of(ax)
    rests = d.resting[d.run] if len(d.run) else np.zeros(0, dtype=bool)
    still = d.run_value[np.array([it.kind == "rest" for it in d.attractors], dtype=bool)]
    for kept, colour in ((~rests, "0.35"), (rests, GREEN)):
        look: dict[str, Any] = {"color": colour, "marker": ".", "ms": 1.0, "ls": ""}
        ax.plot(d.value[kept], d.second[kept], **look | line)
    ax.plot(still, np.zeros(len(still)), color=GREEN, marker=".", ms=1.0, ls="")
    # the points are too small for a legend
    for there, colour, name in ((~rests, "0.35", "impacts"), (rests, GREEN, "impacts, then rest")):
        if there.any():
            ax.plot([], [], ".", color=colour, label=name if d.section == "impacts" else "states")
    if len(still) and not rests.any():
        ax.plot([], [], ".", color=GREEN, label="rest")
    for one in branches:
        branch(one, "u", ax)
    _add_legend(ax)
    named = "speed after the impact" if d.section == "impacts" else "velocity"
    of_mass = all(it.gaps is None for it in d.attractors)
    ax.set(xlabel=d.name, ylabel=f"{named} (m/s)" if of_mass else named)
    return ax


def basins(b: Basins, ax: Axes | None = None, **image: Any) -> Axes:
    """Plot basins of attraction, a colour for each attractor.

    Parameters
    ----------
    b : Basins
        From `zivi.basins`.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    **image
        Passed to `matplotlib.axes.Axes.pcolormesh`.

    Returns
    -------
    matplotlib.axes.Axes

    See Also
    --------
    zivi.basins : computes them.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> found = zivi.basins(zivi.ImpactSystem(table, e=0.5), [0.0, 1.0], [-1.0, 0.0], transient=50)
    >>> zivi.plot.basins(found).get_xlabel()
    'initial distance $x_0$ (m)'
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    ax = axes_of(ax)
    n = len(b.attractors)
    colours = [PALETTE[i % len(PALETTE)] for i in range(n)]
    norm = BoundaryNorm(np.arange(n + 1) - 0.5, n)
    given: dict[str, Any] = {"cmap": ListedColormap(colours), "norm": norm, "shading": "nearest"}
    ax.pcolormesh(b.x0s, b.v0s, np.ma.masked_less(b.label, 0), **given | image)
    names = [_kind_text(it.kind, it.multiple) for it in b.attractors]
    handles: list[Any] = [Patch(color=c, label=it) for c, it in zip(colours, names, strict=True)]
    if b.grazing.any():
        i, j = np.nonzero(b.grazing)
        handles += ax.plot(b.x0s[j], b.v0s[i], "k.", ms=3, label="decided by a grazing")
    legend(ax, handles=handles)
    if b.axes == ("x0", "xdot0"):
        ax.set(xlabel="initial distance $x_0$ (m)", ylabel=r"initial velocity $\dot x_0$ (m/s)")
    else:
        ax.set(xlabel=f"initial {b.axes[0]}", ylabel=f"initial {b.axes[1]}")
    return ax


def _kind_text(kind: str, multiple: int) -> str:
    periods = f", {multiple} period{'s' if multiple > 1 else ''}"
    return kind + (periods if multiple else "")


# Charts of events of periodic orbits in two parameters.

COLOURS = {
    "fold": BLUE,
    "period_doubling": ORANGE,
    "pitchfork": ORANGE,
    "neimark_sacker": GREEN,
    "grazing": PURPLE,
    "interior_impact": PURPLE,
    "end_of_rest": "0.3",
}


MARKERS = {
    "cusp": "^",
    "fold_flip": "D",
    "generalized_period_doubling": "s",
    "resonance_1_1": "P",
    "resonance_1_2": "X",
    "resonance_1_3": "v",
    "resonance_1_4": "*",
    "resonant_grazing": "h",
    "period_doubling": "d",
    "grazing": "p",
}
"""Of points of codimension two: they often lie close together, where names would overlap."""


def _event_label(kind: str) -> str:
    return EVENTS[kind][2] if kind in EVENTS else kind.replace("_", " ")


def _codimension_label(kind: str) -> str:
    """Return the label of a point of codimension two, such as ``"1:3 resonance (point)"``."""
    first, _, ratio = kind.partition("resonance_")
    name = f"{ratio.replace('_', ':')} resonance" if ratio else _event_label(first)
    return f"{name} (point)"


def curve(c: EventCurve, ax: Axes | None = None, *, words: bool = False, **line: Any) -> Axes:
    """Plot a curve of an event in two parameters: dashed where the orbit is no motion.

    Parameters
    ----------
    c : EventCurve
        From `zivi.continue_curve`.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    words : bool
        Whether the curve is labelled with the event sequence of the orbit.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    See Also
    --------
    zivi.continue_curve, zivi.plot.chart : computes it; several curves.

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
    label = look.pop("label", _event_label(c.kind))
    solid = c.admissible if len(c._found) else np.ones(len(c), dtype=bool)
    wide = solid.copy()
    wide[1:] |= solid[:-1]
    wide[:-1] |= solid[1:]
    x, y = c.values.T
    faint: dict[str, Any] = {"ls": "--", "alpha": 0.5} | look
    ax.plot(x, np.where(wide, y, np.nan), label=label, **look)
    ax.plot(x, np.where(solid, np.nan, y), **faint)
    for point in c.points:
        named = _codimension_label(point.kind)
        again = any(it.get_label() == named for it in ax.lines)
        marker = MARKERS.get(point.kind, "o")
        label = "_" if again else named
        ax.plot(*point.values, ls="", marker=marker, color=look["color"], ms=6.0, label=label)
    if c.points:
        legend(ax)
    if words and len(c._found):
        from zivi.orbits.flows import shortened as short

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
        Whether the curves are labelled with the event sequences of the orbits.
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
        label = "_" if c.kind in known else _event_label(c.kind)
        known.add(c.kind)
        curve(c, ax, words=words, **{"label": label} | line)
    legend(ax)
    return ax
