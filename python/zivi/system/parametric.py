"""Forces of the user with parameters that a run can be differentiated by."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import zivi._zivi as _zivi
from zivi.base.check import finite
from zivi.base.functions import check_arguments, is_jitted, reads_time

__all__ = ["ParametricForce"]

RESERVED = ("x0", "xdot0", "t0", "e")
"""Names that `zivi.sensitivity` has for something else."""
MOST_COMPILED = 5
"""Parameters of a compiled force."""


@dataclasses.dataclass(frozen=True)
class ParametricForce:
    r"""A force :math:`f(t, x, \dot x; p_1, p_2, \dots)` with named parameters.

    Parameters
    ----------
    f : callable
        ``f(t, x, xdot, p1, p2, ...) -> float`` (m/s^2), the parameters in the order of
        `parameters`: a Python function, or a compiled one whose arguments are all doubles (a numba
        ``@cfunc``, a `ctypes` function pointer; at most 5 parameters), which runs without the
        interpreter. A function of numba's ``@njit`` is compiled to one.
    parameters : dict of str to float
        Names and values.
    jacobian : callable, optional
        ``jacobian(t, x, xdot, p1, ...) -> (f_t, f_x, f_xdot, f_p1, ...)``. Without it derivatives
        are central differences, each of two more evaluations, whose own error is about 1e-10.

    Raises
    ------
    TypeError
        If `f` or `jacobian` cannot be called, or a compiled `f` has other arguments.
    ValueError
        If a value is not finite, or a name is taken: ``x0``, ``xdot0``, ``t0``, ``e``.

    Examples
    --------
    >>> spring = zivi.ParametricForce(
    ...     lambda t, x, xdot, k, b: -k * x - b * x**3 - 1.0, {"k": 4.0, "b": 0.5})
    >>> system = zivi.ImpactSystem(spring, e=0.5)
    >>> s = zivi.sensitivity(system, (0, 5), (1, 0), wrt=("k", "b"))
    >>> s.zeno_times.shape
    (1, 2)
    """

    f: Callable[..., float] | Any
    parameters: Mapping[str, float]
    jacobian: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if not callable(self.f) and not hasattr(self.f, "address"):
            raise TypeError(f"f must be a function f(t, x, xdot, ...), got {self.f!r}")
        if self.jacobian is not None and not callable(self.jacobian):
            raise TypeError(f"jacobian must be a function or None, got {self.jacobian!r}")
        if not isinstance(self.parameters, Mapping) or not self.parameters:
            raise TypeError(
                f"parameters must be a dict of names and values, got {self.parameters!r}"
            )
        values = {}
        for name, value in self.parameters.items():
            if not isinstance(name, str) or name in RESERVED or "." in name:
                raise ValueError(
                    f"parameters: {name!r} cannot be a name; {', '.join(RESERVED)} and names with "
                    "a dot are taken"
                )
            values[name] = finite(f"parameters[{name!r}]", value)
        object.__setattr__(self, "parameters", values)
        arguments = ", ".join(("t", "x", "xdot", *values))
        if callable(self.f) and getattr(self.f, "ctypes", None) is None:
            check_arguments("f", self.f, arguments)
        if self.jacobian is not None:
            check_arguments("jacobian", self.jacobian, arguments)

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Evaluate the force (m/s^2) with the values of the parameters."""
        return float(self._function()(t, x, xdot, *self.parameters.values()))

    def _function(self) -> Callable[..., float]:
        compiled = getattr(self.f, "ctypes", None)
        return compiled if compiled is not None else self.f

    def replace(self, **values: float) -> ParametricForce:
        """Give the same force with other values of some parameters.

        Parameters
        ----------
        **values
            New values by name.

        Returns
        -------
        ParametricForce
            A new force.

        Raises
        ------
        ValueError
            For a name that is none of its parameters.
        """
        for name in values:
            if name not in self.parameters:
                raise ValueError(
                    f"{name!r} is no parameter of this force: {', '.join(self.parameters)}"
                )
        return dataclasses.replace(self, parameters={**self.parameters, **values})

    def _compiled(self) -> tuple[int, object] | None:
        """Give the address of a compiled function and what owns its code."""
        code = _compiled_by_numba(self.f, len(self.parameters))
        owner: Any = code if code is not None else self.f
        pointer: Any = getattr(owner, "ctypes", owner)
        if getattr(pointer, "argtypes", None) is None or not hasattr(pointer, "restype"):
            return None
        n = len(self.parameters)
        if pointer.restype is not ctypes.c_double or list(pointer.argtypes) != (
            [ctypes.c_double] * (3 + n)
        ):
            raise TypeError(
                f"f, compiled, must return a double and take {3 + n} of them, (t, x, xdot, "
                f"{', '.join(self.parameters)})"
            )
        if n > MOST_COMPILED:
            raise ValueError(f"parameters: a compiled force has at most {MOST_COMPILED}, got {n}")
        address = ctypes.cast(pointer, ctypes.c_void_p).value
        if not address:
            raise ValueError("f: the compiled function is a null pointer")
        return address, owner

    def _spec(self) -> _zivi.Force:
        """Give what the extension takes."""
        values, timed = list(self.parameters.values()), reads_time(self.f)
        if (compiled := self._compiled()) is not None:
            address, owner = compiled
            plain = _zivi.Force.compiled(address, parameters=values, owner=owner, reads_time=timed)
        else:
            plain = _zivi.Force.callable(self, reads_time=timed)
        return _zivi.Force.parametric(plain, self._function(), values, self.jacobian)


def _compiled_by_numba(function: Any, n: int) -> Any:
    if not is_jitted(function):
        return None
    known = function.__dict__.get("_zivi_parametric")
    if known is None:
        import numba

        numbers = ", ".join(f"p{k}" for k in range(3 + n))
        scope: dict[str, Any] = {"function": function}
        exec(f"def law({numbers}):\n    return function({numbers})", scope)
        signature = f"float64({', '.join(['float64'] * (3 + n))})"
        known = function.__dict__.setdefault(
            "_zivi_parametric", numba.cfunc(signature)(scope["law"])
        )
    return known
