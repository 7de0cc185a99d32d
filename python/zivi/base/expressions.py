"""Expressions of SymPy from formulas, and their source code."""

from __future__ import annotations

import ast
import contextlib
import importlib
import operator
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from zivi.base.extras import needed
from zivi.base.formula import CONSTANTS, FormulaError, checked_value, parse

# Formulas as SymPy expressions, without SymPy's parser and predefined names.

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
    """Return a formula as an expression of SymPy.

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
    """Reject expressions with which SymPy fails, whatever it raises.

    SymPy queries whether parts are real or positive and compares them; its answers may depend on
    its cache (on earlier formulas) and contradict each other.

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
        """Return the expression of a part."""
        chain: list[ast.BinOp] = []
        while isinstance(node, ast.BinOp):
            chain.append(node)
            node = node.left
        found = self._kept(self._atom(node))
        for link in reversed(chain):
            found = self._kept(self._joined(link.op, found, self.of(link.right)))
        return found

    def _joined(self, op: ast.operator, a: Any, b: Any) -> Any:
        from zivi.base.sympy_functions import raised

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
        from zivi.base.sympy_functions import OF_FORMULAS

        if not all(argument.is_number for argument in arguments):
            return OF_FORMULAS[name](*arguments)
        exact = EXACTLY.get(name, name)
        return getattr(self.sympy, exact)(*arguments)

    def _kept(self, part: Any) -> Any:
        """Return a part with its numbers in range; cancellation may create others."""
        sympy = self.sympy
        if {part, *part.args} & {sympy.nan, sympy.zoo, sympy.oo, -sympy.oo, sympy.I}:
            raise FormulaError("a part of it is not a real number")
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
    """Return an entry of the equations with numbers that a processor has.

    Raises
    ------
    FormulaError
        If it has infinite or undefined numbers, for example from a division by zero.
    """
    sympy = needed("sympy", "symbolic systems")
    if entry.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo, sympy.I):
        raise FormulaError("the equations have a part that is not a real number")
    numbers = entry.atoms(sympy.Float, sympy.Rational)
    values = {number: _double(number) for number in numbers}
    # a compiler has no whole numbers of any length
    long = {x: sympy.Float(value) for x, value in values.items() if x.is_Rational and _is_long(x)}
    return entry.xreplace(long) if long else entry


def _double(number: Any) -> float:
    """Return a number without names in double precision."""
    value = complex(number)
    if value == 0 and not number.is_zero:
        raise FormulaError("a number is too small")
    checked_value(value if value.imag else value.real)
    return value.real


def _is_long(number: Any) -> bool:
    return bool(abs(number.p) > EXACT or number.q > EXACT)


# Whether an expression depends on symbols: by numbers, since simplification may never end.

DIGITS = 50
LARGEST = 1e4
"""Largest exponent of 2 in what is worked out: sums of very different numbers take long."""
TRIES = 5
NAMES = {"abs": "fabs", "Abs": "fabs"}
"""Functions whose names in mpmath are others."""


def depends(entry: Any, symbols: Sequence[Any]) -> bool:
    """Whether an expression depends on some symbols; True if that is undecidable.

    It is worked out twice at random places, with other values of these symbols, and both again with
    more digits: a difference by rounding shrinks, a true one stays.
    """
    there = sorted(set(symbols) & entry.free_symbols, key=str)
    if not there:
        return False
    drawn, told = random.Random(1), False
    for _ in range(TRIES):
        place = {s: drawn.uniform(-1, 1) for s in sorted(entry.free_symbols, key=str)}
        other = place | {s: drawn.uniform(-1, 1) for s in there}
        try:
            few, many = (_change(entry, place, other, digits) for digits in (DIGITS, 2 * DIGITS))
        except (ArithmeticError, ValueError):
            continue
        except _UnknownFunctionError:
            # only in a user expression, never in a formula
            simple = needed("sympy", "symbolic systems").simplify(entry)
            return not simple.free_symbols.isdisjoint(there)
        if few and many > few / 10 ** (DIGITS // 5):
            return True
        told = True
    return not told


class _UnknownFunctionError(Exception):
    """A function without values in many digits."""


def _change(entry: Any, one: Mapping[Any, float], other: Mapping[Any, float], digits: int) -> Any:
    """Return the distance of the values at two places."""
    mpmath = importlib.import_module("mpmath")  # SymPy needs it

    with mpmath.workdps(digits):
        return abs(_Evaluator(mpmath, one).of(entry) - _Evaluator(mpmath, other).of(entry))


class _Evaluator:
    """Works out expressions at one place; each part once, and none that would fill the memory."""

    def __init__(self, mpmath: Any, place: Mapping[Any, float]) -> None:
        self.mpmath = mpmath
        self.known: dict[Any, Any] = {s: mpmath.mpf(value) for s, value in place.items()}

    def of(self, part: Any) -> Any:
        if part not in self.known:
            value = self._worked_out(part)
            if any(abs(self.mpmath.mag(it)) > LARGEST for it in (value.real, value.imag) if it):
                raise OverflowError
            self.known[part] = value
        return self.known[part]

    def _worked_out(self, part: Any) -> Any:
        mpmath = self.mpmath
        if not part.args:
            return mpmath.mpmathify(part.evalf(mpmath.mp.dps))
        values = [self.of(argument) for argument in part.args]
        if part.is_Add:
            return mpmath.fsum(values)
        if part.is_Mul:
            return mpmath.fprod(values)
        name = type(part).__name__
        if part.is_Pow or name == "power":
            base, exponent = values
            if base and abs(exponent * mpmath.log(base)) > LARGEST:
                raise OverflowError
            return base**exponent
        if name in ("exp", "sinh", "cosh") and abs(values[0]) > LARGEST:
            raise OverflowError
        if name in ("atan2", "max", "Max", "sign"):
            if any(value.imag for value in values):
                raise ValueError("a function of real numbers")
            values = [value.real for value in values]
        function = max if name in ("max", "Max") else getattr(mpmath, NAMES.get(name, name), None)
        if function is None:
            raise _UnknownFunctionError
        return function(*values)


# Equations as the source of one function, in C or in Python for numba, each part computed once.

C_HEAD = """\
#include <math.h>

int model(double t, const double *q, const double *w, double *out, void *parameters)
{
    const double *p = parameters;
    (void)t; (void)q; (void)w; (void)p;
"""


def c_source(entries: Sequence[Any]) -> str:
    """Write a C function that fills ``out`` with the entries."""
    parts, values = _printed(entries, _c_printer())
    lines = [f"    const double {line};" for line in parts] + [f"    {line};" for line in values]
    return C_HEAD + "\n".join([*lines, "    return 0;", "}", ""])


def python_source(entries: Sequence[Any]) -> str:
    """Write a Python function that numba compiles to the same."""
    needed("sympy", "symbolic systems")
    from sympy.printing.pycode import PythonCodePrinter

    printer = PythonCodePrinter({"fully_qualified_modules": True, "strict": True})
    parts, values = _printed(entries, printer)
    lines = [f"    {line}" for line in parts + values]
    head = "import math\n\n\ndef model(t, q, w, out, p):\n"
    return head + "\n".join([*lines, "    return 0", ""])


def _printed(entries: Sequence[Any], printer: Any) -> tuple[list[str], list[str]]:
    """Print the common subexpressions, then the statements that fill ``out``."""
    sympy = needed("sympy", "symbolic systems")
    from sympy.printing.codeprinter import PrintMethodNotImplementedError

    def written(name: Any, value: Any) -> str:
        try:
            return f"{name} = {printer.doprint(value)}"
        except PrintMethodNotImplementedError:
            raise FormulaError(
                f"no compiled form of {value} is known: write it by elementary functions"
            ) from None

    names = sympy.numbered_symbols("c", real=True)
    with worked_on("the equations"):
        parts, values = sympy.cse(list(entries), symbols=names, order="canonical")
        shared = [written(name, value) for name, value in parts]
        return shared, [written(f"out[{k}]", value) for k, value in enumerate(values)]


def _c_printer() -> Any:
    needed("sympy", "symbolic systems")
    from sympy.printing.c import C99CodePrinter

    class Printer(C99CodePrinter):  # type: ignore[misc, unused-ignore]
        """C99 with small whole powers as products."""

        def _print_Pow(self, expr: Any) -> str:  # noqa: N802
            base, power = expr.as_base_exp()
            if power.is_Integer and 2 <= abs(int(power)) <= 4:
                product = "*".join([f"({self._print(base)})"] * abs(int(power)))
                return f"({product})" if power > 0 else f"(1.0/({product}))"
            return str(super()._print_Pow(expr))

    return Printer()
