"""Settings as the query of an address, and back: a link that carries them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlencode

from zivi.lab.ranges import nearest, ranges
from zivi.lab.settings import Ball, Belt, Regulator, Settings, Tracker

__all__ = ["KINDS", "query", "settings_of"]

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


def settings_of(asked: Mapping[str, Any]) -> Settings:
    """Read what `query` wrote, or what somebody typed.

    Parameters
    ----------
    asked : mapping
        From names to texts.

    Returns
    -------
    Ball, Regulator, Tracker or Belt
        What is no setting of the tab, or no number, is left out; what lies beyond the end of a
        slider is taken to it.

    Examples
    --------
    >>> settings_of({"tab": "Ball", "e": "7", "h": "fast"})
    Ball(e=1.0, h=0.01, gravity=9.81, amplitude=0.0, omega=15.0, x0=1.0, xdot0=4.0, t_end=4.0)
    """
    kind = KINDS.get(str(asked.get("tab")), Ball)
    given = {
        name: value
        for name, control in ranges(kind).items()
        if name in asked and (value := nearest(control, str(asked[name]))) is not None
    }
    return kind(**given)
