"""The references of tests/data/orbit_references.json as systems."""

from __future__ import annotations

import functools
import json
import math
import pathlib
from typing import Any

import zivi

FILE = pathlib.Path(__file__).parent / "data" / "orbit_references.json"
FIELDS = {
    "k": "stiffness",
    "c": "damping",
    "G": "gravity",
    "F": "amplitude",
    "w": "omega",
    "ph": "phase",
}
OF_CUBIC = ("k", "b", "c", "d", "G", "F", "w", "ph")


@functools.cache
def references() -> dict[str, Any]:
    """All references by name."""
    return {k: v for k, v in json.loads(FILE.read_text()).items() if k != "_about"}


def of_kind(kind: str) -> list[str]:
    """Names of the references of a kind."""
    return [name for name, it in references().items() if it["kind"] == kind]


def number(text: str) -> float:
    """The number that a reference gives as a string."""
    return -math.pi / 2 if text == "-pi/2" else float(text)


def cubic(t: float, x: float, v: float, *p: float) -> float:
    """The force with cubic spring and damper."""
    k, b, c, d, g, a, w, ph = p
    return -k * x - b * x**3 - c * v - d * v**3 - g + a * math.cos(w * t + ph)


def cubic_slopes(t: float, x: float, v: float, *p: float) -> tuple[float, ...]:
    """Its derivatives by time, state and parameters."""
    k, b, c, d, _, a, w, ph = p
    cos, sin = math.cos(w * t + ph), math.sin(w * t + ph)
    by_state = (-a * w * sin, -k - 3 * b * x * x, -c - 3 * d * v * v)
    return (*by_state, -x, -(x**3), -v, -(v**3), -1.0, cos, -a * t * sin, -a * sin)


def system_of(parameters: dict[str, str], **other: float) -> tuple[zivi.ImpactSystem, dict]:
    """The system of a reference, and what its parameters are called here."""
    values = {name: number(text) for name, text in parameters.items() if name not in other}
    values |= other
    names = {"x0": "x0", "v0": "xdot0", "e": "e"}
    if values["b"] == 0.0 and values["d"] == 0.0:
        force = zivi.LinearForce(**{FIELDS[name]: values[name] for name in FIELDS})
        names |= FIELDS
    else:
        force = zivi.ParametricForce(cubic, {k: values[k] for k in OF_CUBIC}, cubic_slopes)
        names |= {name: name for name in OF_CUBIC}
    return zivi.ImpactSystem(force, e=values["e"]), names
