"""Figures (plotly) and animations (SVG) of runs."""

from __future__ import annotations

import dataclasses
import html
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.base.check import Array
from zivi.control.loop_run import ClosedLoop
from zivi.lab.runs import NAMES, BeltRun, Runs
from zivi.plot import BLUE, GREEN, ORANGE, PURPLE
from zivi.plot.curves import Line, line_of
from zivi.plot.drawing import has_reference
from zivi.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import plotly.graph_objects as go

# Fewer points of a line that look the same: the extremes of every piece of it.

POINTS = 1000
"""Points of a line that is drawn."""


def thinned(
    columns: tuple[Array, ...], breaks: np.ndarray | None = None, points: int = POINTS
) -> tuple[Array, ...]:
    """Thin the columns of a line alike, keeping the extremes of each in every piece.

    Parameters
    ----------
    columns : tuple of ndarray
        Coordinates of the line's points, all of one length.
    breaks : ndarray of int, optional
        Indices of points before which the line is interrupted, by NaN.
    points : int
        Maximal number of points, NaN included; at least 2 for each column and 2.

    Returns
    -------
    tuple of ndarray
        The columns at the points that are left.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 100_001)
    >>> few_t, few_x = thinned((t, np.sin(1000.0 * t)))
    >>> len(few_t) <= 1000, round(float(few_x.max()), 6)
    (True, 1.0)
    """
    before = np.empty(0, dtype=int) if breaks is None else breaks
    kept = _decimated_indices(columns, points - min(len(before), points // 2))
    gaps = np.unique(np.searchsorted(kept, before))
    gaps = gaps[(gaps > 0) & (gaps < len(kept))]
    return tuple(np.insert(column[kept], gaps, np.nan) for column in columns)


def _decimated_indices(columns: tuple[Array, ...], points: int) -> np.ndarray:
    """Choose indices: both ends, and minima and maxima of each column in every interval."""
    length = len(columns[0])
    if length <= points:
        return np.arange(length)
    pieces = max((points - 2) // (2 * len(columns)), 1)
    size = -(-length // pieces)
    starts = np.arange(0, length, size)
    chosen = [np.array([0, length - 1])]
    for column in columns:
        # the last piece is filled up with its last value, whose first index is taken
        full = np.append(column, np.full(len(starts) * size - length, column[-1]))
        piece = np.nan_to_num(full).reshape(len(starts), size)
        chosen += [starts + piece.argmin(axis=1), starts + piece.argmax(axis=1)]
    return np.unique(np.minimum(np.concatenate(chosen), length - 1))


# From runs to a plotly figure, with the colours and labels of `zivi.plot`.

GREY = "#666666"
COLORS = {"implicit": BLUE, "explicit": ORANGE, "high_order": GREY, "reference": GREEN}
BELOW = ("explicit", "implicit", "high_order")
"""In which order runs are drawn: explicit signs, which may fill a band, lie below."""
PANELS = {
    "position": ("time t (s)", "position x (m)"),
    "velocity": ("time t (s)", "velocity dx/dt (m/s)"),
    "phase": ("position x (m)", "velocity dx/dt (m/s)"),
    "lifted": ("time t (s)", "transformed s (m), v (m/s)"),
    "control": ("time t (s)", "control u (m/s²)"),
    "error": ("time t (s)", "error x - x<sub>r</sub> (m)"),
    "signs": ("time t (s)", "signs, implicit (1)"),
    "friction": ("time t (s)", "force of the belt (N)"),
    "slip": ("time t (s)", "slip speed (m/s)"),
}
"""Panels and the labels of their axes."""
SIGNS = {
    "λ<sub>s</sub>": (BLUE, "solid"),
    "λ<sub>v</sub>": (ORANGE, "dash"),
    "λ<sub>sr</sub>": (GREEN, "solid"),
    "λ<sub>vr</sub>": (PURPLE, "dash"),
    "λ<sub>es</sub>": ("black", "solid"),
    "λ<sub>ev</sub>": ("gray", "dash"),
}


@dataclasses.dataclass(frozen=True)
class LineStyle:
    """Legend entry, colour and style of a line.

    Parameters
    ----------
    name, color, dash : str
        Settings of plotly.
    """

    name: str
    color: str
    dash: str = "solid"


@dataclasses.dataclass(frozen=True)
class Curve:
    """One line of one panel.

    Parameters
    ----------
    panel : str
        Key of the panel.
    look : Look
        Name, colour and style.
    x, y : ndarray
        The points, at most 1000.
    held : bool
        Whether a value holds until the next one.
    """

    panel: str
    look: LineStyle
    x: Array
    y: Array
    held: bool = False


def draw_runs(runs: Runs, window: tuple[float, float] | None = None, columns: int = 3) -> go.Figure:
    """Draw runs: time series, phase plane, signs, of a closed loop the control.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.simulate_settings` gave.
    window : (float, float), optional
        Times to show (s); all by default. A line has at most 1000 points, those with the extremes:
        where a window holds fewer samples, all are shown.
    columns : {3, 2, 1}
        Number of panels in a row.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    import plotly.graph_objects as go

    panels = _panels(runs)
    drawn: set[str] = set()
    traces: list[dict[str, Any]] = []
    for curve in curves(runs, window):
        traces.append(_trace(curve, panels.index(curve.panel) + 1, curve.look.name not in drawn))
        drawn.add(curve.look.name)
    return go.Figure({"data": traces, "layout": _layout(panels, columns)})


def curves(runs: Runs, window: tuple[float, float] | None = None) -> list[Curve]:
    """Return all lines that are drawn, thinned; parameters as of `draw_runs`."""
    made: list[Curve] = []
    implicit = runs["implicit"]
    if isinstance(implicit, BeltRun):
        for name in BELOW:
            made += _on_belt(name, runs[name], window)
        return [*made, _belt_curve(implicit, window)]
    others: dict[str, Any] = {**runs}
    for name in BELOW:
        if name in others:
            made += _motion(name, others[name], window)
    if isinstance(implicit, ClosedLoop):
        made += _reference_curves(implicit, window)
        signs = implicit.signs
    else:
        signs = np.column_stack([implicit.transformed.lambda_s, implicit.transformed.lambda_v])
    return made + _sign_curves(implicit.t, signs, window)


def _on_belt(name: str, run: Any, window: tuple[float, float] | None) -> list[Curve]:
    look = LineStyle(NAMES[name], COLORS[name], "dot" if name == "high_order" else "solid")
    t, x, xdot, slip, force = _clip(run.t, window, run.x, run.xdot, run.slip, run.friction)
    lines = {"position": (t, x), "velocity": (t, xdot), "phase": (x, xdot), "slip": (t, slip)}
    made = [_thinned_curve(panel, look, *pair) for panel, pair in lines.items()]
    return [*made, _thinned_curve("friction", look, t, force)]


def _belt_curve(run: BeltRun, window: tuple[float, float] | None) -> Curve:
    (t,) = _clip(run.t, window)
    look = LineStyle("belt", GREEN, "dash")
    return _thinned_curve("velocity", look, t, np.full(len(t), run.speed))


def _motion(
    name: str, run: Trajectory | ClosedLoop, window: tuple[float, float] | None
) -> list[Curve]:
    look = LineStyle(NAMES[name], COLORS[name], "dot" if name == "high_order" else "solid")
    line = _cut(line_of(run), window)
    made = [
        _thinned_curve("position", look, line.t, line.x),
        _thinned_curve("velocity", look, line.t, line.xdot, line.impacts),
        _thinned_curve("phase", look, line.x, line.xdot, line.impacts),
    ]
    if not isinstance(run, ClosedLoop):
        lifted = (line.s, line.v)
        return made + [_thinned_curve("lifted", look, line.t, values) for values in lifted]
    t, u, error = _clip(run.t, window, run.u, run.error)
    made.append(_thinned_curve("control", look, t, u, held=True))
    return [*made, _thinned_curve("error", look, t, error)] if has_reference(run) else made


def _reference_curves(run: ClosedLoop, window: tuple[float, float] | None) -> list[Curve]:
    if not has_reference(run):
        return []
    t, x, xdot = _clip(run.t, window, run.x_ref, run.xdot_ref)
    pairs = {"position": (t, x), "velocity": (t, xdot), "phase": (x, xdot)}
    look = LineStyle("reference", COLORS["reference"], "dash")
    return [_thinned_curve(panel, look, *pair) for panel, pair in pairs.items()]


def _sign_curves(t: Array, signs: Array, window: tuple[float, float] | None) -> list[Curve]:
    times, shown = _clip(t, window, signs)
    return [
        _thinned_curve("signs", LineStyle(name, *style), times, values, held=True)
        for values, (name, style) in zip(shown.T, SIGNS.items(), strict=False)
        if not np.all(np.isnan(values))
    ]


def _thinned_curve(
    panel: str,
    look: LineStyle,
    x: Array,
    y: Array,
    breaks: np.ndarray | None = None,
    *,
    held: bool = False,
) -> Curve:
    few_x, few_y = thinned((x, y), breaks)
    return Curve(panel, look, few_x, few_y, held)


def _clip(t: Array, window: tuple[float, float] | None, *columns: Array) -> tuple[Array, ...]:
    shown = slice(None) if window is None else (t >= window[0]) & (t <= window[1])
    return t[shown], *(column[shown] for column in columns)


def _cut(line: Line, window: tuple[float, float] | None) -> Line:
    t, x, xdot = _clip(line.t, window, line.x, line.xdot)
    s, v = _clip(line.t, window, line.s, line.v)[1:] if line.s.size else (line.s, line.v)
    first = 0 if window is None else int(np.searchsorted(line.t, window[0]))
    after = line.impacts - first
    return Line(t, x, xdot, s, v, after[(after > 0) & (after < len(t))])


def _panels(runs: Runs) -> list[str]:
    """Order the panels, by row; the last row is the shorter one."""
    run = runs["implicit"]
    if isinstance(run, BeltRun):
        return ["position", "velocity", "phase", "friction", "slip"]
    if not isinstance(run, ClosedLoop):
        return ["position", "velocity", "phase", "lifted", "signs"]
    if has_reference(run):
        return ["position", "velocity", "phase", "control", "error", "signs"]
    return ["position", "velocity", "phase", "control", "signs"]


def _trace(curve: Curve, number: int, in_legend: bool) -> dict[str, Any]:
    look = curve.look
    shape = "hv" if curve.held else "linear"
    return {
        "type": "scatter",
        "mode": "lines",
        "name": look.name,
        "legendgroup": look.name,
        "showlegend": in_legend,
        "legend": "legend2" if curve.panel == "signs" else "legend",
        "x": curve.x,
        "y": curve.y,
        "line": {"color": look.color, "dash": look.dash, "width": 1.5, "shape": shape},
        "xaxis": f"x{number}",
        "yaxis": f"y{number}",
        "hovertemplate": "%{x:.6g}, %{y:.6g}",
    }


GAPS = {3: 0.075, 2: 0.11, 1: 0.0}
"""The gap between columns, as a part of the width, by their number."""
BETWEEN = {3: 80, 2: 80, 1: 100}
"""Height between two rows (px) by the number of columns: in one the legend of the signs wraps."""
ROW, ABOVE, BELOW_ALL = 205, 40, 45
"""Heights of a row of panels, and above and below all (px)."""


def _layout(panels: list[str], columns: int) -> dict[str, Any]:
    gap, between = GAPS[columns], BETWEEN[columns]
    width = (1.0 - gap * (columns - 1)) / columns
    rows = -(-len(panels) // columns)
    height = rows * ROW + (rows - 1) * between
    layout: dict[str, Any] = {}
    corner = (1.0, 1.0)
    for number, panel in enumerate(panels, start=1):
        row, column = divmod(number - 1, columns)
        left, top = column * (width + gap), 1.0 - row * (ROW + between) / height
        # where the place below the phase plane would stay empty, it takes that too
        tall = panel == "phase" and columns == 3 and len(panels) < columns * rows
        domain = (0.0 if tall else max(top - ROW / height, 0.0), top)
        across, up = PANELS[panel]
        layout[f"xaxis{number}"] = _axis(across, (left, left + width), f"y{number}")
        layout[f"yaxis{number}"] = _axis(up, domain, f"x{number}")
        if panel != "phase":
            layout[f"xaxis{number}"]["matches"] = None if number == 1 else "x"
        if panel == "signs":
            layout[f"yaxis{number}"]["range"] = (-1.15, 1.15)
            corner = (left + width, top + 2.0 / height)
    return layout | _layout_settings(height, corner)


def _axis(title: str, domain: tuple[float, float], anchor: str) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 6},
        "domain": domain,
        "anchor": anchor,
        "showline": True,
        "linecolor": "#999999",
        "gridcolor": "#eeeeee",
        "zerolinecolor": "#cccccc",
        "exponentformat": "power",
    }


def _layout_settings(height: int, corner: tuple[float, float]) -> dict[str, Any]:
    """Return the rest of the layout; `corner` is the upper right one of the panel of signs."""
    return {
        "height": ABOVE + height + BELOW_ALL,
        "margin": {"l": 55, "r": 10, "t": ABOVE, "b": BELOW_ALL},
        "font": {"size": 12, "color": "#222222"},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "legend": {"orientation": "h", "x": 0.0, "y": 1.0 + 6.0 / height, "yanchor": "bottom"},
        "legend2": {
            "orientation": "h",
            "x": corner[0],
            "xanchor": "right",
            "y": corner[1],
            "yanchor": "bottom",
        },
        "hovermode": "closest",
        "dragmode": "zoom",
    }


# Animation of the masses of a run (SVG).

A_SECOND = 40
"""Positions of a mass a second of its motion."""
MOST = 800
"""Positions of a mass at most."""
HEIGHT, FLOOR, RADIUS, LANE = 240.0, 200.0, 9.0, 105.0
"""Height of the picture, of the wall in it, radius of a mass and width for each (px)."""
WIDE = 420.0
"""Width of a belt (px)."""


def film(runs: Runs) -> str:
    """Draw the masses side by side above the wall, moving in real time in a loop.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.simulate_settings` gave.

    Returns
    -------
    str
        An ``svg`` element, animated without a script.
    """
    end = max(float(run.t[-1]) for run in runs.values())
    times = np.linspace(0.0, end, min(max(int(A_SECOND * end), 2), MOST))
    if isinstance(runs["implicit"], BeltRun):
        return _belts(runs, times)
    lanes = _positions_at({**runs}, times)
    top = max(1e-12, *(float(x.max()) for x in lanes.values()))
    width = LANE * len(lanes)
    drawn = [
        _mass_svg(name, LANE * (number + 0.5), x / top, end)
        for number, (name, x) in enumerate(lanes.items())
    ]
    return (
        f'<svg viewBox="0 0 {width:g} {HEIGHT:g}" role="img" aria-label="The masses in motion" '
        f'style="width: 100%; max-width: {width:g}px; background: white">'
        f'<rect x="0" y="{FLOOR:g}" width="{width:g}" height="5" fill="#999999"/>'
        f'<rect x="0" y="0" width="0" height="3" fill="#cccccc">'
        f"{_animated('width', ['0', f'{width:g}'], end)}</rect>{''.join(drawn)}</svg>"
    )


def _belts(runs: dict[str, Any], times: Array) -> str:
    """Draw masses on belts below each other."""
    end, rows = float(times[-1]), len(runs)
    places = {name: np.interp(times, run.t, run.x) for name, run in runs.items()}
    low = min(float(x.min()) for x in places.values())
    high = max(float(x.max()) for x in places.values())
    scale = (WIDE - 4.0 * RADIUS) / max(high - low, 1e-12)
    drawn = ""
    for row, (name, x) in enumerate(places.items()):
        floor = LANE * row + 60.0
        across = [f"{2.0 * RADIUS + (value - low) * scale:.1f}" for value in x]
        drawn += (
            f'<rect x="0" y="{floor:g}" width="{WIDE:g}" height="5" fill="#999999"/>'
            f'<circle cx="{across[0]}" cy="{floor - RADIUS:g}" r="{RADIUS:g}" '
            f'fill="{COLORS[name]}">{_animated("cx", across, end)}</circle>'
            f'<text x="0" y="{floor + 22:g}" font-size="12" font-family="sans-serif" '
            f'fill="#222222">{html.escape(NAMES[name])}</text>'
        )
    return (
        f'<svg viewBox="0 0 {WIDE:g} {LANE * rows:g}" role="img" '
        f'aria-label="The masses on their belts" '
        f'style="width: 100%; max-width: {WIDE:g}px; background: white">{drawn}</svg>'
    )


def _positions_at(runs: dict[str, Any], times: Array) -> dict[str, Array]:
    found = {}
    for name, run in runs.items():
        line = line_of(run)
        found[name] = np.maximum(np.interp(times, line.t, line.x), 0.0)
    implicit = runs["implicit"]
    if isinstance(implicit, ClosedLoop) and not np.all(np.isnan(implicit.x_ref)):
        found["reference"] = np.interp(times, implicit.t, implicit.x_ref)
    return found


def _mass_svg(name: str, across: float, heights: Array, end: float) -> str:
    """Draw one mass; `heights` are parts of the highest."""
    up = FLOOR - RADIUS - heights * (FLOOR - 2.0 * RADIUS - 8.0)
    places = [f"{y:.1f}" for y in up]
    look = f'r="{RADIUS:g}" fill="{COLORS[name]}"'
    if name == "reference":
        look = f'r="{RADIUS - 1:g}" fill="none" stroke="{COLORS[name]}" stroke-width="2"'
    title = html.escape(NAMES.get(name, name))
    return (
        f'<circle cx="{across:g}" cy="{places[0]}" {look}>{_animated("cy", places, end)}</circle>'
        f'<text x="{across:g}" y="{HEIGHT - 14:g}" text-anchor="middle" font-size="12" '
        f'font-family="sans-serif" fill="#222222">{title}</text>'
    )


def _animated(attribute: str, values: list[str], seconds: float) -> str:
    return (
        f'<animate attributeName="{attribute}" dur="{seconds:g}s" repeatCount="indefinite" '
        f'values="{";".join(values)}"/>'
    )
