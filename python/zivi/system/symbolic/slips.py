"""Slip speeds and limits of dry friction as expressions, and the derivatives of the speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from zivi.system.friction import Channel, tangential_restitution
from zivi.system.symbolic.formula import worked_on
from zivi.system.symbolic.quadratic import depends

__all__ = ["NO_FRICTION", "Rubbing", "slips_of"]


@dataclasses.dataclass(frozen=True)
class Rubbing:
    """The dry friction of a system as it was given, by the names of gaps and joints.

    Parameters
    ----------
    slips : dict
        Slip speeds at gaps.
    mu : dict
        Coefficients there, each one expression or a pair, in slip and in stick.
    friction : dict
        Of joints: slip speed, limit, and the static limit if it is another.
    e_t : dict
        Tangential restitutions at gaps.
    """

    slips: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    mu: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    friction: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    e_t: Mapping[str, float] = dataclasses.field(default_factory=dict)


NO_FRICTION = Rubbing()


@dataclasses.dataclass(frozen=True)
class Slip:
    """The expressions of a channel of friction."""

    channel: Channel
    direction: list[Any]
    rate: Any
    curvature: Any
    limit: Any
    static: Any


def slips_of(words: Any, gaps: Sequence[str], given: Rubbing) -> list[Slip]:
    """Derive the channels of friction: those of gaps in the order of these, then joints."""
    for name, table in (("slips", given.slips), ("mu", given.mu), ("e_t", given.e_t)):
        if not isinstance(table, Mapping):
            raise TypeError(f"{name} must be a dict by the names of gaps, got {table!r}")
        known = gaps if name == "slips" else given.slips
        for gap in table:
            if gap not in known:
                names = ", ".join(map(repr, known)) or "none"
                of = "gaps" if name == "slips" else "slips"
                raise ValueError(f"{name} has {gap!r}, which is none of the {of}: {names}")
    if not isinstance(given.friction, Mapping):
        raise TypeError(f"friction must be a dict by names of joints, got {given.friction!r}")
    found = []
    for i, gap in enumerate(gaps):
        if gap not in given.slips:
            continue
        if gap not in given.mu:
            raise ValueError(f"mu of gap {gap!r} must be given: it has a slip speed")
        e_t = tangential_restitution(f"gap {gap!r}", given.e_t.get(gap, 0.0))
        limits = _several(given.mu[gap], f"mu of gap {gap!r}", 1)
        found.append(_slip(words, Channel(gap, i, e_t), given.slips[gap], limits))
    for name, told in given.friction.items():
        if name in gaps:
            raise ValueError(f"names of gaps and friction must differ, got {name!r} twice")
        speed, *limits = _several(told, f"friction {name!r}", 2)
        found.append(_slip(words, Channel(name, None), speed, limits))
    return found


def _several(given: Any, what: str, least: int) -> list[Any]:
    """Read one expression or a few: with the static limit, one more than the least."""
    several = list(given) if isinstance(given, tuple | list) else [given]
    if not least <= len(several) <= least + 1:
        forms = {1: "mu or (mu, mu_static)", 2: "(speed, limit) or (speed, limit, static)"}
        raise ValueError(f"{what} must be {forms[least]}, got {given!r}")
    return several


def _slip(words: Any, channel: Channel, speed: Any, limits: Sequence[Any]) -> Slip:
    r"""Derive :math:`B = \partial w/\partial\dot q`, :math:`\beta` and :math:`k`.

    .. math:: k = \frac{\partial w}{\partial q} \dot q + \frac{\partial w}{\partial t}
    """
    of = "friction" if channel.gap is None else "gap"
    what = f"slip speed of {of} {channel.name!r}"
    w = words.read(what, speed)
    with worked_on(what):
        direction = [w.diff(v) for v in words.w]
        rate = w.subs(dict.fromkeys(words.w, 0))
        along = sum(w.diff(x) * v for x, v in zip(words.q, words.w, strict=True)) + w.diff(words.t)
        is_linear = any(direction) and not any(depends(entry, words.w) for entry in direction)
    if not is_linear:
        raise ValueError(f"{what} must be linear in the velocities and have some")
    name = "limit" if channel.gap is None else "mu"
    held = [words.read(f"{name} of {of} {channel.name!r}", limit) for limit in limits]
    return Slip(channel, direction, rate, along, held[0], held[-1])
