"""Kinds of values that describe a mechanical system: expressions, names and states.

An expression is a formula and nothing else: what is no number, name, operator or known function is
refused before anything reads it, so that a file cannot run code.
"""

from __future__ import annotations

import ast
import dataclasses
import keyword
from typing import Any, TypeGuard

from zivi.files.kinds import Kind, Number, read_each
from zivi.files.mistakes import Mistakes, got

__all__ = ["FUNCTIONS", "Each", "Expression", "Names", "OneOrEach"]

FUNCTIONS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "exp", "log", "sqrt"),
)
"""What an expression may call."""
LONGEST = 10_000
"""Characters of an expression."""
HIGHEST = 100
"""Largest exponent that is a number: higher ones are slips, and take for ever."""

LARGEST = 1e300
"""Largest number."""

OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)


@dataclasses.dataclass(frozen=True)
class Expression:
    """A formula as a string, or a number."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "an expression or a finite number"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> str | float | None:
        """Give the expression as it stands, or a float."""
        if isinstance(value, str):
            wrong = _wrong(value)
            if wrong:
                mistakes.add(key, f"must be {self.allowed}, {got(value)}: {wrong}")
            return value
        tried = Mistakes(mistakes.file)
        number = Number().read(value, key, tried)
        if tried.found:
            mistakes.add(key, f"must be {self.allowed}, {got(value)}")
        return number


def _wrong(text: str) -> str:
    """Say what in a text is no formula; nothing if it is one."""
    if len(text) > LONGEST:
        return f"it has more than {LONGEST} characters"
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return "it is no formula"
    functions = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree.body):
        told = _wrong_node(node, id(node) in functions)
        if told:
            return told
    return ""


def _wrong_node(node: ast.AST, called: bool) -> str:
    """Say why a node is no part of a formula; `called` tells the names of functions."""
    if isinstance(node, (*OPERATORS, ast.UAdd, ast.USub, ast.UnaryOp, ast.Load)):
        return ""
    if isinstance(node, ast.BitXor):
        return "a power is **"
    if isinstance(node, ast.BinOp):
        return _wrong_power(node)
    if isinstance(node, ast.Name):
        if called == (node.id in FUNCTIONS):
            return ""
        return f"{node.id} {'is no function' if called else 'needs an argument'}"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return ""
    if isinstance(node, ast.Constant) and _is_number(node.value):
        return "" if abs(node.value) < LARGEST else "a number is too large"
    return f"{type(node).__name__} is no part of a formula"


def _wrong_power(node: ast.BinOp) -> str:
    power = isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant)
    exponent = node.right.value if power and isinstance(node.right, ast.Constant) else 0
    high = _is_number(exponent) and abs(exponent) > HIGHEST
    return f"the exponent {exponent!r} is too high" if high else ""


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclasses.dataclass(frozen=True)
class Names:
    """A list of names, not empty and all different."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "a list of names"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[str] | None:
        """Give the names."""
        if not (isinstance(value, list) and value):
            mistakes.add(key, f"must be {self.allowed}, {got(value)}")
            return None
        for n, name in enumerate(value):
            if not (isinstance(name, str) and name.isidentifier()) or keyword.iskeyword(name):
                mistakes.add(f"{key}[{n}]", f"must be a name of letters and digits, {got(name)}")
            elif name in value[:n]:
                mistakes.add(f"{key}[{n}]", f"must be another name, got {name!r} again")
        return value


@dataclasses.dataclass(frozen=True)
class Each:
    """A list of any length, not empty.

    Parameters
    ----------
    of : Kind
        Its entries.
    entries : str
        What they are.
    """

    of: Kind
    entries: str

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a list of {self.entries}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
        """Give the list."""
        return read_each(self, self.of, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class OneOrEach:
    """One value for all, or a list with one for each."""

    of: Number

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"{self.of.allowed}, or a list of them"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give a float or a list of floats."""
        if isinstance(value, list):
            return [self.of.read(it, f"{key}[{n}]", mistakes) for n, it in enumerate(value)]
        return self.of.read(value, key, mistakes)
