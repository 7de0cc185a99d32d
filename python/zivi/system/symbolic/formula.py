"""A formula as an expression of SymPy, whose own names and parser take no part in it."""

from __future__ import annotations

import ast
import contextlib
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from zivi.base.extras import needed
from zivi.base.formula import CONSTANTS, FormulaError, checked_value, parse

__all__ = ["UnknownNameError", "expression", "sound", "worked_on"]

OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
EXACTLY = {"abs": "Abs", "min": "Min", "max": "Max"}
"""What SymPy calls its functions, which keep numbers exact, where its names are others."""
EXACT = 10_000
"""Largest numerator and denominator that are kept as whole numbers: powers of others are long."""


class UnknownNameError(FormulaError):
    """A name that is not declared.

    Parameters
    ----------
    name : str
        It.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"{name} is not declared")
        self.name = name


def expression(text: str, names: Mapping[str, Any]) -> Any:
    """Give a formula as an expression of SymPy.

    Parameters
    ----------
    text : str
        The formula.
    names : mapping
        The symbol of each declared name.

    Raises
    ------
    FormulaError
        If it is none, is too large, or has another name (`UnknownNameError`).
    """
    tree = parse(text, names)
    nodes = list(ast.walk(tree))
    called = {id(node.func) for node in nodes if isinstance(node, ast.Call)}
    used = [node.id for node in nodes if isinstance(node, ast.Name) and id(node) not in called]
    for name in used:
        if name not in names and name not in CONSTANTS:
            raise UnknownNameError(name)
    with worked_on("the formula"):
        return _Builder(names).of(tree)


@contextlib.contextmanager
def worked_on(what: str) -> Iterator[None]:
    """Refuse expressions with which SymPy fails, whatever it raises.

    It asks whether parts are real or positive, and compares them; what it finds may depend on its
    cache, that is on formulas before, and contradict itself.

    Parameters
    ----------
    what : str
        The expressions.

    Raises
    ------
    FormulaError
        For any other exception.
    """
    try:
        yield
    except FormulaError:
        raise
    except Exception as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise FormulaError(f"SymPy cannot work with {what} ({told[:200]})") from error


class _Builder:
    """Makes the expression of a tree part by part, each looked at before it is used.

    Parameters
    ----------
    names : mapping
        The symbol of each name.
    """

    def __init__(self, names: Mapping[str, Any]) -> None:
        self.sympy: Any = needed("sympy", "symbolic systems")
        self.names = names

    def of(self, node: ast.expr) -> Any:
        """Give the expression of a part."""
        chain: list[ast.BinOp] = []
        while isinstance(node, ast.BinOp):
            chain.append(node)
            node = node.left
        found = self._kept(self._atom(node))
        for link in reversed(chain):
            found = self._kept(self._joined(link.op, found, self.of(link.right)))
        return found

    def _joined(self, op: ast.operator, a: Any, b: Any) -> Any:
        from zivi.system.symbolic.functions import raised

        return raised(a, b) if isinstance(op, ast.Pow) else OPERATORS[type(op)](a, b)

    def _atom(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return self.sympy.sympify(node.value, strict=True)
        if isinstance(node, ast.Name):
            return self.names.get(node.id, self.sympy.pi)
        if isinstance(node, ast.UnaryOp):
            inner = self.of(node.operand)
            return -inner if isinstance(node.op, ast.USub) else inner
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        return self._called(node.func.id, [self.of(argument) for argument in node.args])

    def _called(self, name: str, arguments: list[Any]) -> Any:
        from zivi.system.symbolic.functions import OF_FORMULAS

        if not all(argument.is_number for argument in arguments):
            return OF_FORMULAS[name](*arguments)
        exact = EXACTLY.get(name, name)
        return getattr(self.sympy, exact)(*arguments)

    def _kept(self, part: Any) -> Any:
        """Give a part with its numbers in range: what cancels may leave others than are written."""
        sympy = self.sympy
        if {part, *part.args} & {sympy.nan, sympy.zoo, sympy.oo, -sympy.oo, sympy.I}:
            raise FormulaError("a part of it is no real number")
        if part.is_number:
            value = _double(part)
            return sympy.Float(value) if part.is_Rational and _is_long(part) else part
        factor, rest = part.as_coeff_Mul()
        if factor.is_Rational and _is_long(factor):
            return sympy.Float(_double(factor)) * rest
        term, rest = part.as_coeff_Add()
        if term.is_Rational and _is_long(term):
            return sympy.Float(_double(term)) + rest
        return part


def sound(entry: Any) -> Any:
    """Give an entry of the equations with numbers that a processor has.

    Raises
    ------
    FormulaError
        If it has others, such as what a division by zero gives.
    """
    sympy = needed("sympy", "symbolic systems")
    if entry.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo, sympy.I):
        raise FormulaError("the equations have a part that is no real number")
    numbers = entry.atoms(sympy.Float, sympy.Rational)
    values = {number: _double(number) for number in numbers}
    # a compiler has no whole numbers of any length
    long = {x: sympy.Float(value) for x, value in values.items() if x.is_Rational and _is_long(x)}
    return entry.xreplace(long) if long else entry


def _double(number: Any) -> float:
    """Give a number without names in double precision."""
    value = complex(number)
    if value == 0 and not number.is_zero:
        raise FormulaError("a number is too small")
    checked_value(value if value.imag else value.real)
    return value.real


def _is_long(number: Any) -> bool:
    return bool(abs(number.p) > EXACT or number.q > EXACT)
