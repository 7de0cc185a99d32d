"""The impact laws of the gaps of a system, from the argument `e`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array
from zivi.system.impact_law.laws import ImpactLaw, NewtonImpact, SpeedDependentImpact
from zivi.system.impact_law.restitution import Restitution, RestitutionTable


def law_class(name: str) -> type[ImpactLaw]:
    """Make the class of a law that only the core knows, from its parameters."""
    parameters = _zivi.IMPACT_LAWS[name]
    fields: list[Any] = [
        (it.name, float) if it.required else (it.name, float, dataclasses.field(default=it.default))
        for it in parameters
    ]
    told = "\n".join(f"{it.name}: {it.meaning} ({it.unit}), {it.range}." for it in parameters)
    kind = dataclasses.make_dataclass(name, fields, bases=(ImpactLaw,), frozen=True)
    kind.__doc__, kind.__module__ = f"The impact law {name} of the core.\n\n{told}", __name__
    return kind


OWN = (NewtonImpact, SpeedDependentImpact)
"""Laws of the core that have a class with documentation."""
LAWS: dict[str, Any] = {
    **{name: law_class(name) for name in _zivi.IMPACT_LAWS},
    **{kind.__name__: kind for kind in (*OWN, RestitutionTable)},
}
"""The class of each law that files can name."""
globals().update(LAWS)

GivenRestitutions: TypeAlias = (
    float
    | ArrayLike
    | ImpactLaw
    | Callable[[float], float]
    | Sequence[float | ImpactLaw | Callable[[float], float]]
)
"""What `e` of a mechanical system may be: one for all gaps, or one for each."""

Restitutions: TypeAlias = Array | tuple[ImpactLaw, ...]
"""What the gaps have: coefficients, or laws where one is not Newton's."""


def law_of(e: Any) -> Any:
    """Return the law of a function of the speed; what is none stays."""
    is_function = callable(e) and not isinstance(e, ImpactLaw | type)
    return Restitution(e) if is_function else e


def restitutions(e: Any, m: int) -> Restitutions:
    """Read the coefficients of restitution or the laws of `m` gaps: one for all, one for each."""
    each = [law_of(law) for law in e] if isinstance(e, list | tuple) else [law_of(e)]
    if all(isinstance(law, NewtonImpact) or not isinstance(law, ImpactLaw) for law in each):
        numbers = [law.e if isinstance(law, NewtonImpact) else law for law in each]
        return _coefficients(numbers if isinstance(e, list | tuple) else numbers[0], m)
    if not isinstance(e, list | tuple):
        each *= m
    if len(each) != m:
        raise ValueError(f"e must be one law or one for each of the {m} gaps, got {len(each)}")
    return tuple(
        law if isinstance(law, ImpactLaw) else NewtonImpact(real(f"e[{i}]", law))
        for i, law in enumerate(each)
    )


def _coefficients(e: Any, m: int) -> Array:
    given = real_array("e", e)
    if given.ndim == 0:
        given = np.full(m, float(given))
    if given.shape != (m,):
        raise ValueError(f"e must be one number or one for each of the {m} gaps, got {given.shape}")
    for i, value in enumerate(given):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"e[{i}] must be in [0, 1], got {value}")
    return given.copy()


def laws_of(e: Restitutions) -> tuple[ImpactLaw, ...]:
    """Return the law of each gap."""
    return e if isinstance(e, tuple) else tuple(map(NewtonImpact, e.tolist()))


def core_of(e: Restitutions) -> Array | list[_zivi.ImpactLaw]:
    """Return the impact laws for the core."""
    return [law._core for law in e] if isinstance(e, tuple) else e


def written(e: Restitutions) -> str:
    """Write them, as ``(0.5, 0.3)``."""
    each = map(repr, e) if isinstance(e, tuple) else (f"{value:g}" for value in e)
    return f"({', '.join(each)})"
