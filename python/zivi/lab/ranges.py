"""Between which values each setting can be chosen."""

from __future__ import annotations

import math
from typing import Any

from zivi.lab.settings import Ball, Belt, Regulator, Settings, Tracker

__all__ = ["SECTIONS", "between", "ends", "nearest", "ranges"]

PERIODS = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2]
NOISE = [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1]

E = {"e": {"start": 0.01, "stop": 1.0, "step": 0.01, "label": "e, restitution"}}
STEP = {"h": {"steps": PERIODS, "label": "h, step (s)"}}
PERIOD = {"h": {"steps": PERIODS, "label": "h, sampling period (s)"}}
START = {
    "x0": {"start": 0.0, "stop": 10.0, "step": 0.1, "label": "x at t = 0 (m)"},
    "xdot0": {"start": -10.0, "stop": 10.0, "step": 0.1, "label": "velocity at t = 0 (m/s)"},
}
END = {"t_end": {"start": 0.5, "stop": 10.0, "step": 0.5, "label": "end of the run (s)"}}
SENSOR = {
    "noise_x": {"steps": NOISE, "label": "noise of x (m)"},
    "noise_xdot": {"steps": NOISE, "label": "noise of the velocity (m/s)"},
    "delay": {"start": 0, "stop": 10, "step": 1, "label": "delay (periods)"},
    "seed": {"start": 1, "stop": 20, "step": 1, "label": "seed of the noise"},
}
LANDING = {"landing": {"switch": True, "label": "landing"}}
OBSERVER = {
    "observer": {"switch": True, "label": "observer"},
    "position_only": {"switch": True, "label": "from positions alone"},
}


def _gains(largest: float, step: float) -> dict[str, Any]:
    span = {"start": step, "stop": largest, "step": step}
    return {"mu1": span | {"label": "μ1 (m/s²)"}, "mu2": span | {"label": "μ2 (m/s²)"}}


def _forces(largest: float) -> dict[str, Any]:
    span = {"start": -largest, "stop": largest}
    return {
        "force": span | {"step": 0.01, "label": "force, known (m/s²)"},
        "disturbance": span | {"step": 0.1, "label": "disturbance, unknown (m/s²)"},
        "amplitude": span | {"start": 0.0, "step": 0.1, "label": "unknown sine (m/s²)"},
        "omega": {"start": 0.0, "stop": 30.0, "step": 0.5, "label": "its frequency (rad/s)"},
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
        "Gains": _gains(20.0, 0.1) | LANDING,
        "Forces": _forces(10.0),
        "Sensor": SENSOR,
        "Observer": OBSERVER,
        "Run": START | END,
    },
    Tracker: {
        "Wall and period": E | PERIOD,
        "Gains": _gains(150.0, 1.0)
        | {"branch": {"options": ["positive", "nearest"], "label": "branch"}}
        | LANDING,
        "Forces": _forces(30.0),
        "Reference": {
            "force_ref": {"start": -30.0, "stop": 5.0, "step": 0.01, "label": "its force (m/s²)"},
            "x_ref0": START["x0"] | {"label": "its x at t = 0 (m)"},
            "xdot_ref0": START["xdot0"] | {"label": "its velocity at t = 0 (m/s)"},
            "drawn": {"switch": True, "label": "drawn by hand instead"},
        }
        | {f"height{k}": START["x0"] | {"label": f"drawn x at {k}/5 (m)"} for k in range(1, 6)},
        "Sensor": SENSOR,
        "Observer": OBSERVER,
        "Run": START | END,
    },
    Belt: {
        "Step": STEP,
        "Belt": {
            "limit": {"start": 0.0, "stop": 3.0, "step": 0.05, "label": "friction, slipping (N)"},
            "extra": {"start": 0.0, "stop": 2.0, "step": 0.05, "label": "more of it, sticking (N)"},
            "speed": {"start": 0.0, "stop": 2.0, "step": 0.01, "label": "speed of the belt (m/s)"},
        },
        "Spring": {
            "stiffness": {"start": 0.1, "stop": 10.0, "step": 0.1, "label": "stiffness (N/m)"},
            "damping": {"start": 0.0, "stop": 1.0, "step": 0.01, "label": "damping (N s/m)"},
        },
        "Run": {
            "x0": {"start": -3.0, "stop": 3.0, "step": 0.1, "label": "x at t = 0 (m)"},
            "xdot0": {"start": -3.0, "stop": 3.0, "step": 0.1, "label": "velocity at t = 0 (m/s)"},
            "t_end": {"start": 5.0, "stop": 60.0, "step": 5.0, "label": "end of the run (s)"},
        },
    },
}
"""What can be set in each tab, in groups: the arguments of the sliders."""


def ranges(kind: type[Settings]) -> dict[str, dict[str, Any]]:
    """Give the arguments of the sliders of a tab, by the names of its settings.

    Parameters
    ----------
    kind : type
        `Ball`, `Regulator`, `Tracker` or `Belt`.

    Returns
    -------
    dict
        ``start``, ``stop`` and ``step``, or the ``steps`` or ``options`` there are, or ``switch``,
        and a ``label``. A value within them is possible; only gains are refused with mu2 >= mu1.
    """
    return {name: given for group in SECTIONS[kind].values() for name, given in group.items()}


def between(given: dict[str, Any]) -> str:
    """Return the range of a slider as text, such as ``0.01 to 1``."""
    low, high = _ends(given)
    return f"{low:g} to {high:g}"


def _ends(given: dict[str, Any]) -> tuple[float, float]:
    if "steps" in given:
        return given["steps"][0], given["steps"][-1]
    return given["start"], given["stop"]


def ends(settings: Settings, before: Settings) -> list[str]:
    """Return a sentence for each slider that has moved to an end of its range.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        What the page shows.
    before : Ball, Regulator, Tracker or Belt
        The preset that the settings began with.

    Examples
    --------
    >>> ends(Ball(e=1.0), Ball())
    ['e, restitution: 1 is an end of its range, 0.01 to 1; numbers outside it are set to the end.']
    """
    return [
        f"{given['label']}: {value:g} is an end of its range, {between(given)}; "
        "numbers outside it are set to the end."
        for name, given in ranges(type(settings)).items()
        if "switch" not in given and "options" not in given
        if (value := getattr(settings, name)) in _ends(given) and value != getattr(before, name)
    ]


def nearest(given: dict[str, Any], text: str) -> Any:
    """Take a text to the nearest value that a slider can have.

    Parameters
    ----------
    given : dict
        One of `ranges`.
    text : str
        A number, or the name of an option.

    Returns
    -------
    float, int, bool, str or None
        None if it is no number, no option, or neither ``True`` nor ``False``.
    """
    if "switch" in given:
        return {"True": True, "False": False}.get(text)
    if "options" in given:
        return text if text in given["options"] else None
    try:
        value = float(text)
    except ValueError:
        return None
    if not math.isfinite(value):
        return None
    if "steps" in given:
        return min(given["steps"], key=lambda step: abs(step - value))
    value = min(max(value, given["start"]), given["stop"])
    return round(value) if isinstance(given["start"], int) else value
