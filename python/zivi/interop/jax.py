"""Runs and solutions of VIs in programs of JAX: differentiated by their own derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from zivi.base.extras import needed
from zivi.interop.gradient import ParameterFunction

__all__ = ["jax_function"]


def jax_function(function: ParameterFunction[Any]) -> Callable[[Any], Any]:
    """Make a JAX function from a run or from the solution of a VI.

    It can be compiled, differentiated forwards and backwards once (``jax.jvp``, ``jax.grad``,
    ``jax.jacobian``), and mapped over arrays of parameters (``jax.vmap``, one after the other).

    Parameters
    ----------
    function : RunFunction or SolutionFunction
        From `run_function` or `solution_function`.

    Returns
    -------
    callable
        ``f(p)``, of an array with an entry for each parameter; in single precision unless
        ``jax_enable_x64`` is set.

    Raises
    ------
    TypeError
        If `function` is none of these.
    ImportError
        Without JAX.

    See Also
    --------
    run_function, solution_function : make what it wraps.

    Examples
    --------
    >>> import jax  # doctest: +SKIP
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)  # doctest: +SKIP
    >>> rest = zivi.interop.run_function(ball, (0, 9), (1, 0), ["e"], "zeno_time")  # doctest: +SKIP
    >>> jax.grad(lambda e: zivi.interop.jax_function(rest)(e[None]))(0.5)  # doctest: +SKIP
    Array(3.612189, dtype=float32, weak_type=True)
    """
    if not isinstance(function, ParameterFunction):
        raise TypeError(
            "function must be a RunFunction, from run_function, or a SolutionFunction, from "
            f"solution_function, got {function!r}"
        )
    jax = needed("jax", "runs in programs of JAX")
    shape, m = function.shape, len(function.wrt)

    def run(p: Any) -> tuple[Any, Any]:
        value, derivative = function(np.asarray(p, np.float64))
        kind = np.asarray(p).dtype
        return np.asarray(value, kind).reshape(shape), np.asarray(derivative, kind)

    def called(p: Any) -> Any:
        kinds = (
            jax.ShapeDtypeStruct(shape, p.dtype),
            jax.ShapeDtypeStruct((*shape, m), p.dtype),
        )
        return jax.pure_callback(run, kinds, p, vmap_method="sequential")

    def rule(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (p,), (dp,) = primals, tangents
        at, derivative = called(p)
        return at, derivative @ dp

    value = jax.custom_jvp(lambda p: called(p)[0])
    value.defjvp(rule)

    def checked(p: Any) -> Any:
        array = jax.numpy.asarray(p, dtype=float)
        if array.shape != (m,):
            raise ValueError(f"p must have shape ({m},), got {array.shape}")
        return value(array)

    return checked
