"""What a run of a mechanical system can be differentiated by: names, numbers, values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from zivi.base.check import Array
from zivi.base.habits import closest
from zivi.system.impact_law import ImpactLaw, NewtonImpact, law_parameters

__all__ = ["Column", "columns_of"]

Q0, QDOT0, T0, ALL_E, LAW, PARAMETER = range(6)
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
    of : int
        Which parameter of an impact law it is.
    """

    name: str
    code: tuple[int, int]
    value: float
    of: int = 0


def columns_of(
    wrt: Sequence[str],
    state: tuple[Array, Array],
    duration: float,
    laws: Mapping[str, ImpactLaw],
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
) -> list[Column]:
    """Read the names of columns, ``"q0"`` and ``"qdot0"`` as those of all coordinates.

    Raises
    ------
    ValueError
        For an unknown name, with the names that are known; for one that is given twice.
    """
    single = {"t0": Column("t0", (T0, 0), duration), **_of_laws(laws)}
    groups: dict[str, list[Column]] = {}
    for name, kind, values in (("q0", Q0, state[0]), ("qdot0", QDOT0, state[1])):
        groups[name] = [
            Column(f"{name}.{own}", (kind, i), float(values[i]))
            for i, own in enumerate(coordinates)
        ]
        for i, column in enumerate(groups[name]):
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
            raise ValueError(_unknown(name, coordinates, laws, parameters))
    names = [column.name for column in found]
    if not found or len(set(names)) != len(names):
        raise ValueError(f"wrt must be one or more different names, got {tuple(wrt)!r}")
    return found


def _of_laws(laws: Mapping[str, ImpactLaw]) -> dict[str, Column]:
    """Give the columns by the impact laws: ``e``, ``e.gap``; of others as ``law.gap.e0``."""
    found = {}
    newton = {gap: law.e for gap, law in laws.items() if isinstance(law, NewtonImpact)}
    if newton and len(newton) == len(laws):
        found["e"] = Column("e", (ALL_E, 0), max(newton.values()))
    for i, (gap, law) in enumerate(laws.items()):
        if gap in newton:
            found[f"e.{gap}"] = found[f"e[{i}]"] = Column(f"e.{gap}", (LAW, i), newton[gap])
            continue
        for of, (name, value) in enumerate(law_parameters(law).items()):
            column = Column(f"law.{gap}.{name}", (LAW, i), value, of)
            found[column.name] = column
    return found


def _unknown(
    name: str,
    coordinates: Sequence[str],
    laws: Mapping[str, ImpactLaw],
    parameters: Mapping[str, float],
) -> str:
    names = ["q0", "qdot0", *(f"q0.{own}" for own in coordinates)]
    names += [*(f"qdot0.{own}" for own in coordinates), "t0"]
    names += [known for known in _of_laws(laws) if not known.endswith("]")]
    close = closest(name, [*names, *parameters])
    hint = f"; did you mean {close!r}?" if close else ""
    if not (parameters or close):
        hint = (
            "; this system has no parameters: zivi.symbolic.system(..., parameters={...}) or "
            "zivi.ParametricSystem(build, {...}) give them names"
        )
    return f"{name!r} is no parameter here: {', '.join([*names, *parameters])}{hint}"
