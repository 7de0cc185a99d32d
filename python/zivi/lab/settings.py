"""Settings of the page: a frozen dataclass for each tab, ranges, presets, links."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias
from urllib.parse import urlencode

from zivi.base.check import finite, switch

# Inputs of the page: one frozen dataclass per tab.

MOST_STEPS = 400_000
"""Steps of the longest run that the page computes while a slider moves."""


@dataclasses.dataclass(frozen=True)
class Ball:
    """A ball above a wall, shaken by a harmonic force.

    Parameters
    ----------
    e : float
        Coefficient of restitution.
    h : float
        Step of the methods with fixed steps (s).
    gravity : float
        Pull towards the wall (m/s^2).
    amplitude, omega : float
        Amplitude (m/s^2) and frequency (rad/s) of the disturbance.
    x0, xdot0 : float
        Initial distance (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    e: float = 0.5
    h: float = 1e-2
    gravity: float = 9.81
    amplitude: float = 0.0
    omega: float = 15.0
    x0: float = 1.0
    xdot0: float = 4.0
    t_end: float = 4.0


@dataclasses.dataclass(frozen=True)
class Regulator:
    """A mass that the twisting regulator brings to rest at the wall.

    Parameters
    ----------
    e : float
        Coefficient of restitution.
    h : float
        Sampling period (s).
    mu1, mu2 : float
        Gains (m/s^2).
    force : float
        Force that the controller knows (m/s^2).
    disturbance : float
        Force that it does not know (m/s^2).
    amplitude, omega : float
        Amplitude (m/s^2) and frequency (rad/s) of a harmonic force that it does not know either.
    landing : bool
        Whether the implicit controller lands.
    noise_x, noise_xdot : float
        Standard deviations of the measured position (m) and velocity (m/s).
    seed : int
        Seed of the noise.
    delay : int
        Periods from a measurement to its control.
    observer : bool
        Whether an observer stands between the sensor and both controllers.
    position_only : bool
        Whether it takes positions alone.
    x0, xdot0 : float
        Initial distance (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    e: float = 0.33
    h: float = 1e-2
    mu1: float = 3.0
    mu2: float = 2.0
    force: float = 0.0
    disturbance: float = 0.0
    amplitude: float = 0.0
    omega: float = 3.0
    landing: bool = True
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    observer: bool = False
    position_only: bool = False
    x0: float = 1.0
    xdot0: float = 0.0
    t_end: float = 3.0


@dataclasses.dataclass(frozen=True)
class Tracker:
    """A mass that follows a bouncing reference; fields that `Regulator` has mean the same.

    Parameters
    ----------
    e, h, mu1, mu2, force, disturbance, amplitude, omega, landing, noise_x, noise_xdot, seed, delay
        As of `Regulator`.
    observer, position_only, x0, xdot0, t_end
        As of `Regulator`.
    force_ref : float
        Force on the reference (m/s^2).
    x_ref0, xdot_ref0 : float
        Initial distance (m) and velocity (m/s) of the reference.
    branch : {"positive", "nearest"}
        How the implicit tracker lifts what it measures.
    drawn : bool
        Whether the reference is drawn by hand: from `x_ref0` through the heights.
    height1, height2, height3, height4, height5 : float
        Heights of the drawn reference after each fifth of the run (m).
    """

    e: float = 0.33
    h: float = 1e-2
    mu1: float = 30.0
    mu2: float = 17.0
    force: float = -9.81
    disturbance: float = 0.0
    amplitude: float = 0.0
    omega: float = 3.0
    landing: bool = True
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    observer: bool = False
    position_only: bool = False
    x0: float = 6.0
    xdot0: float = 5.0
    t_end: float = 4.0
    force_ref: float = -5.0
    x_ref0: float = 3.0
    xdot_ref0: float = 3.0
    branch: Literal["positive", "nearest"] = "positive"
    drawn: bool = False
    height1: float = 1.0
    height2: float = 2.0
    height3: float = 0.0
    height4: float = 0.0
    height5: float = 1.5

    @property
    def heights(self) -> tuple[float, ...]:
        """Heights of the drawn reference, from its beginning to its end (m)."""
        later = (self.height1, self.height2, self.height3, self.height4, self.height5)
        return (self.x_ref0, *later)


@dataclasses.dataclass(frozen=True)
class Belt:
    """A mass of 1 kg at a spring on a belt with dry friction.

    Parameters
    ----------
    h : float
        Step of the methods with fixed steps (s).
    limit : float
        Friction while the mass slips (N).
    extra : float
        By how much more it holds a mass that sticks (N).
    speed : float
        Speed of the belt (m/s).
    stiffness, damping : float
        Of the spring (N/m) and of a parallel damper (N s/m).
    x0, xdot0 : float
        Initial position (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    h: float = 1e-2
    limit: float = 0.8
    extra: float = 0.4
    speed: float = 0.2
    stiffness: float = 1.0
    damping: float = 0.0
    x0: float = 0.0
    xdot0: float = 0.2
    t_end: float = 30.0


Settings: TypeAlias = Ball | Regulator | Tracker | Belt


def check_settings(settings: Settings) -> None:
    """Reject what would keep the page busy; the library checks the rest.

    Raises
    ------
    ValueError, TypeError
        For a run of too many steps, or an empty field.
    """
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if isinstance(field.default, bool):
            switch(field.name, value)
        elif field.name != "branch":
            finite(field.name, value)
    if settings.h > 0.0 and settings.t_end / settings.h > MOST_STEPS:
        raise ValueError(
            f"t_end / h must be at most {MOST_STEPS} steps on this page, "
            f"got {settings.t_end / settings.h:.3g}"
        )


def landing_of(given: Regulator | Tracker) -> dict[str, Any]:
    """Return the arguments of an implicit controller that are of the landing."""
    return {"landing": True, "ahead": 1 + given.delay} if given.landing else {"landing": False}


LEAST_NOISE = (1e-6, 1e-4)
"""What an observer takes for the noise of an exact sensor (m, m/s)."""


def observer_of(given: Regulator | Tracker) -> dict[str, Any]:
    """Return the arguments of the observer except `e` and `h`.

    The variance of the change of the unknown force is the larger of 7 (h max|d'|)^2 and that of a
    random walk of 1 m^2/s^5.
    """
    least_x, least_xdot = LEAST_NOISE
    walk = given.h * given.amplitude * given.omega
    return {
        "noise": (max(given.noise_x, least_x), max(given.noise_xdot, least_xdot)),
        "q_d": max(given.h, 7.0 * walk**2),
        "dmax": max(20.0, 2.0 * (abs(given.disturbance) + given.amplitude)),
        "position_only": given.position_only,
    }


# Between which values each setting can be chosen.

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


def _force_sliders(largest: float) -> dict[str, Any]:
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
        "Forces": _force_sliders(10.0),
        "Sensor": SENSOR,
        "Observer": OBSERVER,
        "Run": START | END,
    },
    Tracker: {
        "Wall and period": E | PERIOD,
        "Gains": _gains(150.0, 1.0)
        | {"branch": {"options": ["positive", "nearest"], "label": "branch"}}
        | LANDING,
        "Forces": _force_sliders(30.0),
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
    """Return the arguments of the sliders of a tab, by the names of its settings.

    Parameters
    ----------
    kind : type
        `Ball`, `Regulator`, `Tracker` or `Belt`.

    Returns
    -------
    dict
        ``start``, ``stop`` and ``step``, or the ``steps`` or ``options`` there are, or ``switch``,
        and a ``label``. A value within them is possible; only gains are rejected with mu2 >= mu1.
    """
    return {name: given for group in SECTIONS[kind].values() for name, given in group.items()}


def range_text(given: dict[str, Any]) -> str:
    """Return the range of a slider as text, such as ``0.01 to 1``."""
    low, high = _slider_ends(given)
    return f"{low:g} to {high:g}"


def _slider_ends(given: dict[str, Any]) -> tuple[float, float]:
    if "steps" in given:
        return given["steps"][0], given["steps"][-1]
    return given["start"], given["stop"]


def end_notices(settings: Settings, before: Settings) -> list[str]:
    """Return a sentence for each slider that has moved to an end of its range.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        What the page shows.
    before : Ball, Regulator, Tracker or Belt
        The preset that the settings began with.

    Examples
    --------
    >>> end_notices(Ball(e=1.0), Ball())
    ['e, restitution: 1 is an end of its range, 0.01 to 1; numbers outside it are set to the end.']
    """
    return [
        f"{given['label']}: {value:g} is an end of its range, {range_text(given)}; "
        "numbers outside it are set to the end."
        for name, given in ranges(type(settings)).items()
        if "switch" not in given and "options" not in given
        if (value := getattr(settings, name)) in _slider_ends(given)
        and value != getattr(before, name)
    ]


def nearest_value(given: dict[str, Any], text: str) -> Any:
    """Round a text to the nearest value of a slider.

    Parameters
    ----------
    given : dict
        One of `ranges`.
    text : str
        A number, or the name of an option.

    Returns
    -------
    float, int, bool, str or None
        None if it is not a number, an option, ``True`` or ``False``.
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


# Settings to begin from, for each tab.

_BALL = Ball(e=0.42, h=1e-3, x0=1.0, xdot0=6.0, t_end=4.0)
_TRACKER = Tracker(h=1e-3, force_ref=-19.81, t_end=2.0)
_REST = Tracker(
    e=0.8, h=1e-3, force_ref=-19.81, x0=2.0, xdot0=0.0, x_ref0=1.1, xdot_ref0=0.0, t_end=4.0
)

PRESETS: dict[type[Settings], dict[str, Settings]] = {
    Ball: {
        "first look": Ball(),
        "the paper": _BALL,
        "chattering": Ball(e=0.42, h=2e-2, xdot0=6.0, t_end=6.0),
        "shaken": Ball(e=0.8, h=1e-3, amplitude=15.0, omega=30.0, x0=0.5, xdot0=0.0),
    },
    Regulator: {
        "first look": Regulator(),
        "the paper": Regulator(h=1e-3, landing=False),
        "chattering": Regulator(e=0.8, h=5e-2, x0=2.0, xdot0=3.0, t_end=5.0),
        "noise": Regulator(h=1e-3, noise_x=1e-4, noise_xdot=1e-2),
        "disturbance": Regulator(h=1e-3, mu1=8.0, mu2=4.0, force=-1.0, disturbance=0.5),
    },
    Tracker: {
        "first look": Tracker(),
        "the paper": replace(_TRACKER, landing=False),
        "chattering": Tracker(
            h=5e-3, force_ref=-9.81, x0=3.0, xdot0=7.0, x_ref0=3.0, xdot_ref0=8.0, t_end=1.5
        ),
        "noise": replace(_TRACKER, noise_x=1e-4, noise_xdot=1e-2),
        "disturbance": replace(_TRACKER, disturbance=1.5),
        "exact rest at e = 0.8": _REST,
        "e = 0.8, no landing": replace(_REST, landing=False),
        "drawn by hand": Tracker(h=1e-3, e=0.8, drawn=True, x0=2.0, xdot0=0.0, x_ref0=1.0),
        "sine, positions alone": replace(
            _REST, amplitude=1.5, noise_x=1e-4, observer=True, position_only=True
        ),
    },
    Belt: {
        "first look": Belt(),
        "chattering": Belt(h=5e-2, speed=0.1, t_end=20.0),
        "fast belt": Belt(speed=1.5, damping=0.05),
        "a brake": Belt(speed=0.0, extra=0.0, limit=0.3, x0=2.0, xdot0=0.0, t_end=20.0),
    },
}
"""By tab and name; the first is what the page begins with: the defaults."""


def preset_name(settings: Settings) -> str:
    """Return the name of the preset with these settings; without one, that of the defaults."""
    presets = PRESETS[type(settings)]
    return next((name for name, it in presets.items() if it == settings), next(iter(presets)))


# Settings as the query of an address, and back: a link that carries them.

KINDS: dict[str, type[Settings]] = {
    "Ball": Ball,
    "Regulator": Regulator,
    "Tracker": Tracker,
    "Belt": Belt,
}
"""The tabs, by name."""


def query(settings: Settings) -> str:
    """Write the tab, and the settings that are not its defaults, as ``?tab=Ball&e=0.7``.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.

    Returns
    -------
    str
        What follows the path of the address.

    Examples
    --------
    >>> query(Ball(e=0.7))
    '?tab=Ball&e=0.7'
    """
    kind = type(settings)
    default = kind()
    changed = {
        field.name: value
        for field in dataclasses.fields(kind)
        if (value := getattr(settings, field.name)) != getattr(default, field.name)
    }
    return "?" + urlencode({"tab": kind.__name__} | changed)


def read_query(asked: Mapping[str, Any]) -> Settings:
    """Read the output of `query` or a typed query.

    Parameters
    ----------
    asked : mapping
        From names to texts.

    Returns
    -------
    Ball, Regulator, Tracker or Belt
        Unknown settings and values that are not numbers are ignored; values outside a slider's
        range are clipped.

    Examples
    --------
    >>> read_query({"tab": "Ball", "e": "7", "h": "fast"})
    Ball(e=1.0, h=0.01, gravity=9.81, amplitude=0.0, omega=15.0, x0=1.0, xdot0=4.0, t_end=4.0)
    """
    kind = KINDS.get(str(asked.get("tab")), Ball)
    given = {
        name: value
        for name, control in ranges(kind).items()
        if name in asked and (value := nearest_value(control, str(asked[name]))) is not None
    }
    return kind(**given)
