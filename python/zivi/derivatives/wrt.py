"""What a run of a mechanical system can be differentiated by: names, numbers, values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from zivi.base.check import Array

__all__ = ["Column", "columns_of"]

Q0, QDOT0, T0, ALL_E, E, PARAMETER = range(6)
"""Kinds of columns, as the extension numbers them."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A derivative by one number.

    Parameters
    ----------
    name : str
        What it is called.
    code : (int, int)
        What it is for the extension.
    value : float
        The number.
    """

    name: str
    code: tuple[int, int]
    value: float


def columns_of(
    wrt: Sequence[str],
    state: tuple[Array, Array],
    duration: float,
    restitution: tuple[Array, Sequence[str]],
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
) -> list[Column]:
    """Read the names of columns, ``"q0"`` and ``"qdot0"`` as those of all coordinates.

    Raises
    ------
    ValueError
        For an unknown name, with the names that are known; for one that is given twice.
    """
    e, gaps = restitution
    single = {"t0": Column("t0", (T0, 0), duration)}
    if len(e):
        single["e"] = Column("e", (ALL_E, 0), float(np.max(e)))
    groups: dict[str, list[Column]] = {}
    for name, kind, values, names in (
        ("q0", Q0, state[0], coordinates),
        ("qdot0", QDOT0, state[1], coordinates),
        ("e", E, e, gaps),
    ):
        members = [
            Column(f"{name}.{own}", (kind, i), float(values[i])) for i, own in enumerate(names)
        ]
        if name != "e":
            groups[name] = members
        for i, column in enumerate(members):
            single[column.name] = column
            single[f"{name}[{i}]"] = column
    own = {
        name: Column(name, (PARAMETER, k), value)
        for k, (name, value) in enumerate(parameters.items())
    }
    # a parameter does not hide what every system has
    known = own | single
    found: list[Column] = []
    for name in wrt:
        if name in groups:
            found += groups[name]
        elif name in known:
            found.append(known[name])
        else:
            raise ValueError(_unknown(name, coordinates, gaps, parameters))
    names = [column.name for column in found]
    if not found or len(set(names)) != len(names):
        raise ValueError(f"wrt must be one or more different names, got {tuple(wrt)!r}")
    return found


def _unknown(
    name: str, coordinates: Sequence[str], gaps: Sequence[str], parameters: Mapping[str, float]
) -> str:
    names = ["q0", "qdot0", *(f"q0.{own}" for own in coordinates)]
    names += [*(f"qdot0.{own}" for own in coordinates), "t0"]
    names += ["e", *(f"e.{own}" for own in gaps)] if gaps else []
    hint = (
        ""
        if parameters
        else (
            "; this system has no parameters: zivi.symbolic.system(..., parameters={...}) or "
            "zivi.ParametricSystem(build, {...}) give them names"
        )
    )
    return f"{name!r} is no parameter here: {', '.join([*names, *parameters])}{hint}"
