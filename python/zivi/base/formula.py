"""The language of formulas: numbers, declared names, pi, ``+ - * / **``, brackets, some functions.

A formula is parsed by Python and read from its syntax tree: nothing in it is ever run, and no name
means anything that is not declared or listed here. Formulas of excessive size are rejected.
"""

from __future__ import annotations

import ast
import dataclasses
import keyword
import math
import re
import unicodedata
from collections.abc import Callable, Iterable
from typing import TypeGuard

from zivi.base.habits import closest


class FormulaError(ValueError):
    """Raised for a formula that cannot be parsed; the message names the fault."""


def _sign(x: float) -> float:
    return math.copysign(1.0, x) if x else 0.0


_OF_ONE = (
    *(
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "acosh",
        "atanh",
    ),
    *("exp", "log", "sqrt"),
)
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    **{name: (1, getattr(math, name)) for name in _OF_ONE},
    **{"abs": (1, abs), "sign": (1, _sign)},
    **{"atan2": (2, math.atan2), "min": (2, min), "max": (2, max)},
}
"""What a formula may call: the number of arguments, and its value for numbers."""
CONSTANTS = {"pi": math.pi}
"""Names that need no declaration."""

LONGEST = 10_000
"""Characters of a formula."""
MOST = 500
"""Numbers, names, operators and functions of a formula."""
DEEPEST = 40
"""Levels of brackets, functions and powers in each other."""
HIGHEST = 100
"""Largest exponent that is a number."""
DEGREE = 1000
"""Largest degree of a formula in its names, were it multiplied out."""
DERIVED = 10_000
"""Parts of its second derivatives, which grow with products of many factors."""
LARGEST, SMALLEST = 1e300, 1e-300
"""Bounds of a number, and of what numbers alone give."""

_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}


def normal(name: str) -> str:
    """Return the spelling of a name that Python reads (NFKC): the micro sign is the letter mu."""
    return unicodedata.normalize("NFKC", name)


def meant(name: str, known: Iterable[str]) -> str:
    """Ask for the known name that is nearest to another; nothing if none is near."""
    close = closest(name, known)
    return f"did you mean {close}?" if close else ""


def parse(text: str, declared: Iterable[str] = ()) -> ast.expr:
    """Read a formula.

    Parameters
    ----------
    text : str
        The formula.
    declared : sequence of str
        Its names, for messages.

    Returns
    -------
    ast.expr
        Its tree: numbers, names, ``+ - * / **`` and calls of `FUNCTIONS`, few enough to work with.

    Raises
    ------
    FormulaError
        If it is none, or too large.
    """
    if len(text) > LONGEST:
        raise FormulaError(f"it has more than {LONGEST} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise FormulaError(_no_formula(text, error, declared)) from None
    # a call and its name are two nodes
    parts = sum(isinstance(it, ast.expr) - isinstance(it, ast.Call) for it in ast.walk(tree))
    if parts > MOST:
        raise FormulaError(f"it has more than {MOST} numbers, names, operators and functions")
    _measure(tree, 0)
    return tree


def _no_formula(text: str, error: Exception, declared: Iterable[str]) -> str:
    """Return the reason why a text is not a formula."""
    words = set(re.findall(r"\w+", text))
    for name in declared:
        if name in words and keyword.iskeyword(name):
            return f"{name} is a word of Python: give it another name, such as {name}_"
    if isinstance(error, SyntaxError) and str(error.msg).startswith("invalid character"):
        return f"it is not a formula: {error.msg}"
    return "it is not a formula"


@dataclasses.dataclass(frozen=True)
class _Measure:
    """Size of the result of a part of a formula.

    Parameters
    ----------
    value : float or None
        Its value, if it has no names.
    degree : int
        Its degree in its names.
    sizes : tuple of int
        Bounds of the numbers, names, operators and functions of itself, its first and its second
        derivatives.
    """

    value: float | None
    degree: int
    sizes: tuple[int, int, int]

    def __post_init__(self) -> None:
        if self.value is not None:
            checked_value(self.value)
        if self.degree > DEGREE:
            raise FormulaError(f"multiplied out, its degree is above {DEGREE}")
        if self.sizes[2] > DERIVED:
            raise FormulaError(f"its second derivatives have more than {DERIVED} parts")


def checked_value(value: float | complex) -> None:
    """Reject what numbers give that is no real number of double precision."""
    if isinstance(value, complex) or value != value:
        raise FormulaError("a part of it is not a real number")
    if abs(value) > LARGEST:
        raise FormulaError("a number is too large")
    if 0 < abs(value) < SMALLEST:
        raise FormulaError("a number is too small")


def _measure(node: ast.expr, depth: int) -> _Measure:
    """Check and measure a part of a formula."""
    if depth > DEEPEST:
        raise FormulaError(f"it has more than {DEEPEST} levels of brackets, functions and powers")
    chain: list[ast.BinOp] = []
    while isinstance(node, ast.BinOp):  # down the left operands: a sum of many terms is not deep
        chain.append(node)
        node = node.left
    measure = _atom(node, depth)
    for link in reversed(chain):
        if isinstance(link.op, ast.BitXor):
            raise FormulaError("a power is **")
        if type(link.op) not in _OPERATORS:
            raise FormulaError(f"{type(link.op).__name__} is not allowed in a formula")
        measure = _measure_operation(link.op, measure, _measure(link.right, depth + 1))
    return measure


def _atom(node: ast.expr, depth: int) -> _Measure:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        inner = _measure(node.operand, depth + 1)
        value = inner.value
        if value is not None and isinstance(node.op, ast.USub):
            value = -value
        return dataclasses.replace(inner, value=value)
    if isinstance(node, ast.Constant) and _is_plain_number(node.value):
        # a whole number may be too large to be a float
        return _Measure(float(node.value) if abs(node.value) <= LARGEST else math.inf, 0, (1, 0, 0))
    if isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise FormulaError(f"{node.id} needs an argument")
        value = CONSTANTS.get(node.id)
        return _Measure(value, int(value is None), (1, int(value is None), 0))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return _measure_call(node.func.id, node.args, depth)
    raise FormulaError(f"{type(node).__name__} is not allowed in a formula")


def _measure_call(name: str, arguments: list[ast.expr], depth: int) -> _Measure:
    if name not in FUNCTIONS:
        raise FormulaError(f"unknown function {name}; {meant(name, FUNCTIONS)}".rstrip("; "))
    wanted, function = FUNCTIONS[name]
    if len(arguments) != wanted:
        raise FormulaError(
            f"{name} takes {wanted} argument{'s' * (wanted > 1)}, got {len(arguments)}"
        )
    inner = [_measure(argument, depth + 1) for argument in arguments]
    value = _worked_out(function, inner)
    return _Measure(value, int(value is None), _chain_rule(inner))


def _measure_operation(op: ast.operator, a: _Measure, b: _Measure) -> _Measure:
    """Measure what an operator makes of two parts."""
    value = _worked_out(_OPERATORS[type(op)], [a, b])
    if isinstance(op, ast.Add | ast.Sub):
        return _Measure(value, max(a.degree, b.degree), _sum_rule(a, b))
    if isinstance(op, ast.Mult | ast.Div):
        return _Measure(value, a.degree + b.degree, _product_rule(a, b))
    if b.value is None:
        return _Measure(value, 1, _chain_rule([a, b]))
    if abs(b.value) > HIGHEST:
        raise FormulaError(f"the exponent {b.value:g} is too high: at most {HIGHEST}")
    return _Measure(value, math.ceil(a.degree * abs(b.value)), _chain_rule([a, b]))


def _worked_out(function: Callable[..., float], parts: list[_Measure]) -> float | None:
    """Return the value of numbers; None if there are names."""
    values = [part.value for part in parts if part.value is not None]
    if len(values) < len(parts):
        return None
    try:
        return function(*values)
    except ZeroDivisionError:
        raise FormulaError("it divides by zero") from None
    except OverflowError:
        return math.inf
    except ValueError:
        return math.nan


def _sum_rule(a: _Measure, b: _Measure) -> tuple[int, int, int]:
    (s, d, dd), (u, v, vv) = a.sizes, b.sizes
    return s + u + 1, d + v + 1, dd + vv + 1


def _product_rule(a: _Measure, b: _Measure) -> tuple[int, int, int]:
    (s, d, dd), (u, v, vv) = a.sizes, b.sizes
    first = (d and d + u + 1) + (v and s + v + 1)
    second = (dd and dd + u + 1) + (d and v and 2 * (d + v + 1)) + (vv and s + vv + 1)
    return s + u + 1, first, second


def _chain_rule(parts: list[_Measure]) -> tuple[int, int, int]:
    sizes = [part.sizes for part in parts]
    s = 1 + sum(own for own, _, _ in sizes)
    d = sum(first and s + first + 1 for _, first, _ in sizes)
    dd = sum(first and s + 2 * first + second + 3 for _, first, second in sizes)
    return s, d, dd * len(parts)


def _is_plain_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
