"""Equations as the source of one function, in C or in Python for numba, each part computed once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zivi.base.extras import needed
from zivi.base.formula import FormulaError
from zivi.system.symbolic.formula import worked_on

__all__ = ["c_source", "python_source"]

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
    """Print the parts that entries share, each computed once, and what fills ``out``."""
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
