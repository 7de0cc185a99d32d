"""The sliders and fields of each tab."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import marimo as mo

from zivi.lab.settings import Ball, Regulator, Settings, Tracker

__all__ = ["laid_out", "panel"]

PERIODS = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2]
NOISE = [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1]

# the ranges of e, x and the gains go beyond what is possible: there is a message there
E = {"e": {"start": 0.0, "stop": 1.1, "step": 0.01, "label": "e, restitution"}}
STEP = {"h": {"steps": PERIODS, "label": "h, step (s)"}}
PERIOD = {"h": {"steps": PERIODS, "label": "h, sampling period (s)"}}
START = {
    "x0": {"start": -0.5, "stop": 10.0, "step": 0.1, "label": "x at t = 0 (m)"},
    "xdot0": {"start": -10.0, "stop": 10.0, "step": 0.1, "label": "velocity at t = 0 (m/s)"},
}
END = {"t_end": {"start": 0.5, "stop": 10.0, "step": 0.5, "label": "end of the run (s)"}}
SENSOR = {
    "noise_x": {"steps": NOISE, "label": "noise of x (m)"},
    "noise_xdot": {"steps": NOISE, "label": "noise of the velocity (m/s)"},
    "delay": {"start": 0, "stop": 10, "step": 1, "label": "delay (periods)"},
    "seed": {"start": 1, "stop": 20, "step": 1, "label": "seed of the noise"},
}


def _gains(largest: float, step: float) -> dict[str, Any]:
    span = {"start": 0.0, "stop": largest, "step": step}
    return {"mu1": span | {"label": "μ1 (m/s²)"}, "mu2": span | {"label": "μ2 (m/s²)"}}


def _forces(largest: float) -> dict[str, Any]:
    span = {"start": -largest, "stop": largest}
    return {
        "force": span | {"step": 0.01, "label": "force, known (m/s²)"},
        "disturbance": span | {"step": 0.1, "label": "disturbance, unknown (m/s²)"},
    }


SECTIONS: dict[type[Settings], dict[str, dict[str, Any]]] = {
    Ball: {
        "Wall and step": E | STEP,
        "Forces": {
            "gravity": {"start": -5.0, "stop": 20.0, "step": 0.01, "label": "gravity (m/s²)"},
            "amplitude": {"start": 0.0, "stop": 50.0, "step": 0.5, "label": "shaking (m/s²)"},
            "omega": {"start": 0.0, "stop": 60.0, "step": 0.5, "label": "its frequency (rad/s)"},
        },
        "Run": START | END,
    },
    Regulator: {
        "Wall and period": E | PERIOD,
        "Gains": _gains(20.0, 0.1),
        "Forces": _forces(10.0),
        "Sensor": SENSOR,
        "Run": START | END,
    },
    Tracker: {
        "Wall and period": E | PERIOD,
        "Gains": _gains(150.0, 1.0) | {"branch": {"options": ["positive", "nearest"]}},
        "Forces": _forces(30.0),
        "Reference": {
            "force_ref": {"start": -30.0, "stop": 5.0, "step": 0.01, "label": "its force (m/s²)"},
            "x_ref0": START["x0"] | {"label": "its x at t = 0 (m)"},
            "xdot_ref0": START["xdot0"] | {"label": "its velocity at t = 0 (m/s)"},
        },
        "Sensor": SENSOR,
        "Run": START | END,
    },
}
"""What can be set in each tab, in groups: the arguments of the sliders."""
SHOWN = "shown"
"""The control of the window that is shown, which is no setting."""


def panel(kind: type[Settings], moved: Callable[[Any], None]) -> dict[str, Any]:
    """Make the controls of a tab, with the defaults of its settings.

    Parameters
    ----------
    kind : type
        `Ball`, `Regulator` or `Tracker`.
    moved : callable
        What is called when one of them has changed.

    Returns
    -------
    dict
        The elements by the names of the settings. They are no ``marimo.ui.dictionary``: where two
        elements of one change while the page computes, marimo 0.25 forgets the first.
    """
    default = kind()
    elements = {
        name: _element(name, given | {"on_change": moved}, getattr(default, name))
        for group in SECTIONS[kind].values()
        for name, given in group.items()
    }
    elements[SHOWN] = mo.ui.range_slider(
        start=0.0,
        stop=100.0,
        step=1.0,
        value=[0.0, 100.0],
        label="shown (% of the run)",
        full_width=True,
        on_change=moved,
    )
    return elements


def _element(name: str, given: dict[str, Any], value: Any) -> Any:
    if name == "branch":
        return mo.ui.dropdown(**given, value=value, label="branch", full_width=True)
    return mo.ui.slider(**given, value=value, include_input=True, full_width=True)


def laid_out(elements: dict[str, Any]) -> Any:
    """Lay the controls of a tab out below each other, in their groups."""
    kind = next(kind for kind in SECTIONS if _names(kind) == set(elements))
    rows: list[Any] = [mo.Html('<div style="font-size: 1.4em; font-weight: bold">zivi lab</div>')]
    for title, group in SECTIONS[kind].items():
        rows.append(mo.Html(f'<div style="font-weight: bold; margin-top: 0.5em">{title}</div>'))
        rows += [elements[name] for name in group]
    return mo.vstack([*rows, elements[SHOWN]], gap=0.3)


def _names(kind: type[Settings]) -> set[str]:
    return {name for group in SECTIONS[kind].values() for name in group} | {SHOWN}
