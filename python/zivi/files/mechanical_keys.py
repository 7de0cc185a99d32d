"""All keys of a file of a mechanical system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import zivi._zivi as _zivi
from zivi.files.expressions import Each, Expression, Few, Names, OneOrEach
from zivi.files.keys import ANY, LAW, METHODS, POSITIVE, SIMULATE, UNIT
from zivi.files.kinds import Choice, Either, Numbers
from zivi.files.tables import Key, Open, Table, Tagged
from zivi.system.friction import IMPACT_LAWS, PARADOXES

__all__ = ["MECHANICS", "RESTITUTIONS", "is_mechanical"]

FORMULA = Expression()
RESTITUTIONS = Key(
    "e", OneOrEach(Either(UNIT, LAW)), "restitution or law, of all gaps or of each", "1", "0"
)
SHARED = {key.name: key for key in SIMULATE}

SYSTEM = Table(
    (
        Key("q", Names(), "the coordinates; the velocity of x is xdot, the time t"),
        Key("T", FORMULA, "kinetic energy, quadratic in the velocities"),
        Key("V", FORMULA, "potential energy", default="0"),
        Key("Q", Each(FORMULA, "expressions"), "other forces, one for each of q", default="none"),
        Key("gaps", Open(FORMULA, "gaps"), "what stays >= 0, by name", default="none"),
        Key("parameters", Open(ANY, "parameters"), "values of all other names", default="none"),
        RESTITUTIONS,
        Key(
            "slips",
            Open(FORMULA, "gaps"),
            "slip speeds of gaps with dry friction, linear in the velocities",
            default="none",
        ),
        Key("mu", Open(Few(("mu", "mu_static"), 1), "gaps"), "their coefficients", "1", "none"),
        Key("e_t", Open(UNIT, "gaps"), "their tangential restitutions", "1", "0"),
        Key(
            "friction",
            Open(Few(("slip speed", "limit", "static limit"), 2), "joints"),
            "dry friction in joints, by names of yours",
            default="none",
        ),
        Key(
            "impact_law",
            Choice(IMPACT_LAWS),
            "the law of impacts with friction",
            default='"newton"',
        ),
        Key(
            "paradox",
            Choice(PARADOXES),
            "what follows where a sliding contact is jammed",
            default='"stop"',
        ),
    )
)

MECHANICS = (
    SHARED["t_span"],
    Key("y0", Each(Numbers(), "two lists of numbers, [q0, qdot0]"), "coordinates and velocities"),
    Key("system", SYSTEM, "the system, by its energies"),
    Key(
        "method",
        Tagged(
            "name",
            {name: METHODS[name] for name, it in _zivi.METHODS.items() if it.takes_mechanism}
            # of this family the one member only
            | {"ThetaGamma": (Key("h", POSITIVE, "step", "s"),)},
            "SwitchedRK",
        ),
        "the method",
        default="SwitchedRK",
    ),
    SHARED["t_eval"],
    SHARED["tstops"],
)


def is_mechanical(content: Mapping[str, Any]) -> bool:
    """Whether a file describes a mechanical system, and not a mass above a wall."""
    system = content.get("system")
    return isinstance(system, dict) and bool({"q", "T", "V", "Q", "gaps"} & set(system))
