"""Trees of bodies as numbers that the binary of a loop reads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from zivi.system.tree.system import Tree

__all__ = ["tree_numbers"]

KINDS = ("lower", "upper", "plane", "balls")
"""Kinds of gaps by their numbers."""


def tree_numbers(tree: Tree) -> Iterator[float]:
    """Give joints, gaps, and by number of the tree its polynomial in the parameters."""
    structure = tree._structure
    for parent, slide in structure.joints():
        yield from (parent, slide)
    for side in structure.sides():
        yield from (KINDS.index(side.kind), *side.joints)
    values = {name: Polynomial({(i,): 1.0}) for i, name in enumerate(tree.parameters)}
    numbers = structure.numbers(values)
    yield len(numbers)
    for number in numbers:
        terms = number.terms if isinstance(number, Polynomial) else {(): float(number)}
        terms = {of: factor for of, factor in terms.items() if factor != 0.0}
        yield len(terms)
        for of, factor in terms.items():
            yield from (factor, len(of), *of)


class Polynomial:
    """A polynomial: factors of products of parameters, told by their sorted numbers."""

    def __init__(self, terms: dict[tuple[int, ...], float]) -> None:
        self.terms = terms

    def __add__(self, other: Any) -> Any:
        more = _terms(other)
        if more is None:
            return NotImplemented
        terms = dict(self.terms)
        for of, factor in more.items():
            terms[of] = terms.get(of, 0.0) + factor
        return Polynomial(terms)

    def __mul__(self, other: Any) -> Any:
        factors = _terms(other)
        if factors is None:
            return NotImplemented
        terms: dict[tuple[int, ...], float] = {}
        for one, first in self.terms.items():
            for two, second in factors.items():
                of = tuple(sorted(one + two))
                terms[of] = terms.get(of, 0.0) + first * second
        return Polynomial(terms)

    def __neg__(self) -> Polynomial:
        return Polynomial({of: -factor for of, factor in self.terms.items()})

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if _terms(other) is None else self + (-1.0) * other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    __radd__, __rmul__ = __add__, __mul__


def _terms(value: Any) -> dict[tuple[int, ...], float] | None:
    """Give the terms of a polynomial or of a number, none of what is neither."""
    if isinstance(value, Polynomial):
        return value.terms
    return {(): float(value)} if isinstance(value, int | float) else None
