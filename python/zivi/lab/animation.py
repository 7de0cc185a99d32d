"""The masses of a run in motion, as a picture that moves by itself (SVG)."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.control.closed_loop import ClosedLoop
from zivi.lab.belt import BeltRun
from zivi.lab.facts import NAMES
from zivi.lab.figures import COLORS
from zivi.lab.runs import Runs
from zivi.plot.curve import line_of

__all__ = ["film"]

A_SECOND = 40
"""Positions of a mass a second of its motion."""
MOST = 800
"""Positions of a mass at most."""
HEIGHT, FLOOR, RADIUS, LANE = 240.0, 200.0, 9.0, 105.0
"""Height of the picture, of the wall in it, radius of a mass and width for each (px)."""
WIDE = 420.0
"""Width of a belt (px)."""


def film(runs: Runs) -> str:
    """Draw the masses beside each other above the wall; they move in real time, again and again.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.compute` gave.

    Returns
    -------
    str
        An ``svg`` element, animated without a script.
    """
    end = max(float(run.t[-1]) for run in runs.values())
    times = np.linspace(0.0, end, min(max(int(A_SECOND * end), 2), MOST))
    if isinstance(runs["implicit"], BeltRun):
        return _belts(runs, times)
    lanes = _positions({**runs}, times)
    top = max(1e-12, *(float(x.max()) for x in lanes.values()))
    width = LANE * len(lanes)
    drawn = [
        _mass(name, LANE * (number + 0.5), x / top, end)
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


def _positions(runs: dict[str, Any], times: Array) -> dict[str, Array]:
    found = {}
    for name, run in runs.items():
        line = line_of(run)
        found[name] = np.maximum(np.interp(times, line.t, line.x), 0.0)
    implicit = runs["implicit"]
    if isinstance(implicit, ClosedLoop) and not np.all(np.isnan(implicit.x_ref)):
        found["reference"] = np.interp(times, implicit.t, implicit.x_ref)
    return found


def _mass(name: str, across: float, heights: Array, end: float) -> str:
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
