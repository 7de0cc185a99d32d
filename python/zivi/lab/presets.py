"""Settings to begin from, for each tab."""

from __future__ import annotations

from dataclasses import replace

from zivi.lab.settings import Ball, Belt, Regulator, Settings, Tracker

__all__ = ["PRESETS", "name_of"]

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


def name_of(settings: Settings) -> str:
    """Return the name of the preset with these settings; without one, that of the defaults."""
    presets = PRESETS[type(settings)]
    return next((name for name, it in presets.items() if it == settings), next(iter(presets)))
