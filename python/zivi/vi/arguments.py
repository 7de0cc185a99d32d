"""Bounds, options and starts of the solver of box VIs as users of SciPy write them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from zivi.base.arrays import Array, bound, count
from zivi.base.check import real
from zivi.vi.types import VIOptions, VIProgress

__all__ = ["arranged", "limits", "observer", "seconds", "settings_of"]


def arranged(lower: Any, upper: Any, x0: Any, bounds: Any) -> tuple[Any, Any, Any]:
    """Return lower bounds, upper bounds and start, wherever they were given.

    ``(F, x0, bounds=...)`` and ``(F, Bounds(...), x0)`` are as good as ``(F, lower, upper, x0)``.
    """
    if bounds is None and _is_bounds(lower):
        bounds, lower = lower, None
        if x0 is None:
            upper, x0 = None, upper
    elif bounds is not None and x0 is None and upper is None:
        lower, x0 = None, lower
    if bounds is not None:
        if lower is not None or upper is not None:
            raise TypeError("bounds were given twice: by lower or upper, and by bounds")
        lower, upper = _pair(bounds)
    if x0 is None:
        raise TypeError("x0 must be given: where to begin")
    return lower, upper, x0


def _is_bounds(value: Any) -> bool:
    """Whether it is a `scipy.optimize.Bounds`, or looks like one."""
    return hasattr(value, "lb") and hasattr(value, "ub")


def _pair(bounds: Any) -> tuple[Any, Any]:
    if _is_bounds(bounds):
        return bounds.lb, bounds.ub
    told = "bounds must be a scipy.optimize.Bounds or a sequence of pairs (lower, upper)"
    try:
        pairs = [tuple(pair) for pair in bounds]
    except TypeError:
        raise TypeError(f"{told}, got {bounds!r}") from None
    for i, pair in enumerate(pairs):
        if len(pair) != 2:
            raise ValueError(f"{told}, got {pair!r} as number {i}")
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def limits(lower: Any, upper: Any, n: int) -> tuple[Array | float, Array | float]:
    """Read both bounds; a bound with one entry stands for all components, as in SciPy."""
    return _limit("lower", lower, n), _limit("upper", upper, n)


def _limit(name: str, value: Any, n: int) -> Array | float:
    if isinstance(value, np.ndarray) and value.shape == (1,) and n > 1:
        value = value[0]  # scipy.optimize.Bounds makes arrays of numbers
    return bound(name, value, n)


def settings_of(
    tol: float | None,
    rtol: float,
    max_iter: int | None,
    options: VIOptions | Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return what differs from the defaults, by the names of the extension."""
    if isinstance(options, Mapping):
        options, max_iter = _of_mapping(options, max_iter)
    if options is None:
        settings = {}
    elif isinstance(options, VIOptions):
        settings = options._settings()
    else:
        raise TypeError(f"options must be a VIOptions or a dict, got {type(options).__name__}")
    if tol is not None:
        settings["tol"] = real("tol", tol)
    if rtol:
        settings["rtol"] = real("rtol", rtol)
    if max_iter is not None:
        settings["max_iterations"] = count("max_iter", max_iter, least=1)
    return settings


def _of_mapping(options: Mapping[str, Any], max_iter: int | None) -> tuple[VIOptions, int | None]:
    """Read the fields of `VIOptions`, and SciPy's ``maxiter``."""
    given = dict(options)
    for name in ("maxiter", "max_iter"):
        max_iter = given.pop(name, max_iter)
    known = [field.name for field in dataclasses.fields(VIOptions)]
    for name in given:
        if name not in known:
            raise TypeError(
                f"options has no entry {name!r}: there are maxiter and the fields of VIOptions, "
                f"{', '.join(known)}"
            )
    return VIOptions(**given), max_iter


def seconds(limit: float | None) -> float | None:
    """Read a time limit."""
    if limit is None:
        return None
    found = real("time_limit", limit)
    if not found > 0:
        raise ValueError(f"time_limit must be > 0 seconds, got {found}")
    return found


def observer(
    callback: Callable[[VIProgress], object] | None,
) -> Callable[[int, float, int, str], object] | None:
    """Return what hands a `VIProgress` to the callback."""
    if callback is None:
        return None
    if not callable(callback):
        raise TypeError(f"callback must be callable, got {type(callback).__name__}")
    return lambda *progress: callback(VIProgress(*progress))
