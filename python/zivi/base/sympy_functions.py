"""The functions of formulas, for SymPy to derive and print but not to work on.

SymPy's own functions examine their arguments whenever they are built (real, positive, imaginary
part), which may not terminate. These functions are real and do not examine arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy
from sympy import Function, Integer, Rational

from zivi.base.formula import HIGHEST, FormulaError

# The functions of formulas, for SymPy to derive and print but not to work on.


HALF = Rational(1, 2)


class Real(Function):  # type: ignore[misc, unused-ignore]
    """A function that is real; the classes made of it have the names that formulas call."""

    is_real = True
    slopes: tuple[Callable[..., Any], ...]
    parity = 0
    in_c: str
    in_python: str

    @classmethod
    def eval(cls, *arguments: Any) -> Any:
        """Return a canonical form for even and odd functions, which drops the argument's sign."""
        if cls.parity and arguments[0].could_extract_minus_sign():
            return cls.parity * cls(-arguments[0])
        return None

    def fdiff(self, argindex: int = 1) -> Any:
        """Return the derivative by an argument; at a kink, the mean of both sides."""
        return self.slopes[argindex - 1](*self.args)

    def _ccode(self, printer: Any) -> str:
        return self.in_c.format(*map(printer._print, self.args))

    def _pythoncode(self, printer: Any) -> str:
        return self.in_python.format(*map(printer._print, self.args))


def _made(
    name: str, *slopes: Callable[..., Any], parity: int = 0, c: str = "", python: str = ""
) -> Any:
    """Make a function from its partial derivatives and its C and Python code."""
    call = f"{name}({', '.join(['{}'] * len(slopes))})"
    parts = {"nargs": len(slopes), "slopes": slopes, "parity": parity, "__module__": __name__}
    return type(name, (Real,), parts | {"in_c": c or call, "in_python": python or f"math.{call}"})


sin: Any = _made("sin", lambda u: cos(u), parity=-1)
cos: Any = _made("cos", lambda u: -sin(u), parity=1)
tan: Any = _made("tan", lambda u: 1 + tan(u) ** 2, parity=-1)
asin: Any = _made("asin", lambda u: 1 / sqrt(1 - u**2), parity=-1)
acos: Any = _made("acos", lambda u: -1 / sqrt(1 - u**2))
atan: Any = _made("atan", lambda u: 1 / (1 + u**2), parity=-1)
atan2: Any = _made("atan2", lambda y, x: x / (x**2 + y**2), lambda y, x: -y / (x**2 + y**2))
sinh: Any = _made("sinh", lambda u: cosh(u), parity=-1)
cosh: Any = _made("cosh", lambda u: sinh(u), parity=1)
tanh: Any = _made("tanh", lambda u: 1 - tanh(u) ** 2, parity=-1)
asinh: Any = _made("asinh", lambda u: 1 / sqrt(u**2 + 1), parity=-1)
acosh: Any = _made("acosh", lambda u: 1 / (sqrt(u - 1) * sqrt(u + 1)))
atanh: Any = _made("atanh", lambda u: 1 / (1 - u**2), parity=-1)
exp: Any = _made("exp", lambda u: exp(u))
log: Any = _made("log", lambda u: 1 / u)
sqrt: Any = _made("sqrt", lambda u: 1 / (2 * sqrt(u)))
power: Any = _made(
    "power",
    lambda u, v: v * raised(u, v - 1),
    lambda u, v: power(u, v) * (sympy.log if u.is_number else log)(u),
    c="pow({}, {})",
    python="math.pow({}, {})",
)
abs: Any = _made("abs", lambda u: sign(u), parity=1, c="fabs({})", python="abs({})")
sign: Any = _made(
    "sign",
    lambda u: Integer(0),
    parity=-1,
    c="(({0} > 0.0) - ({0} < 0.0))",
    python="(1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else 0.0))",
)
max: Any = _made(
    "max",
    lambda a, b: HALF + sign(a - b) / 2,
    lambda a, b: HALF - sign(a - b) / 2,
    c="fmax({}, {})",
    python="max({}, {})",
)

OF_FORMULAS: dict[str, Callable[..., Any]] = {
    it.__name__: it
    for it in (
        *(sin, cos, tan, asin, acos, atan, atan2, sinh, cosh, tanh, asinh, acosh, atanh),
        *(exp, log, sqrt, abs, sign, max),
    )
} | {"min": lambda a, b: -max(-a, -b)}
"""By the names that formulas call."""


def raised(base: Any, exponent: Any) -> Any:
    """Return a power: SymPy's, if its exponent is whole or both are numbers."""
    if exponent.is_number:
        value = float(exponent)  # of what is whole but for 1e-800, too
        if not -HIGHEST - 2 <= value <= HIGHEST:  # a derivative may lower it twice
            raise FormulaError(f"an exponent is too high: at most {HIGHEST}")
        if base.is_number and not exponent.is_Rational:
            # exact, a tower of such powers takes twice as long with each of them
            return sympy.Float(float(base)) ** sympy.Float(value)
        if base.is_number or value.is_integer():
            return base ** (exponent if base.is_number else int(value))
        if exponent == HALF:
            return sqrt(base)
        if exponent == -HALF:
            return 1 / sqrt(base)
    if base.is_number and float(base) <= 0:
        raise FormulaError("a power of a number <= 0 has an exponent that varies")
    return power(base, exponent)
