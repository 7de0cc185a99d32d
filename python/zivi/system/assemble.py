"""The parts of a system as one function that fills one row of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from zivi.base.check import Array
from zivi.system.friction import Channel, Slip
from zivi.system.gap import Gap
from zivi.system.layout import Layout
from zivi.system.model_parts import Compiled, Part

__all__ = ["Evaluate", "assembled"]

Evaluate: TypeAlias = Callable[[float, Array, Array], Array]
"""``(t, q, qdot)`` to the row of a `Layout`; each call writes over the last row."""

Filler: TypeAlias = Callable[[float, Array, Array], None]


def assembled(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
) -> Evaluate:
    """Join the parts of a system; an error names the part whose result has another shape."""
    row = np.zeros(layout.size)
    views = layout.views(row)
    fillers = [
        _filler("mass", mass, views["mass"], 2),
        _filler("force", force, views["force"], 3),
    ]
    for i, gap in enumerate(gaps):
        called = f"of gap {gap.name!r}" if gap.name else f"of gap {i}"
        value, gradient, curvature, rate = gap._parts()
        fillers += [
            _number_filler(f"value {called}", value, views["gaps"][i : i + 1], 2),
            _filler(f"gradient {called}", gradient, views["gradients"][i], 2),
            _number_filler(f"curvature {called}", curvature, views["curvatures"][i : i + 1], 3),
            _number_filler(f"rate {called}", rate, views["rates"][i : i + 1], 2),
        ]
    for c, (channel, slip) in enumerate(slips):
        fillers += _of_channel(channel, slip, views, c)
    moving = [filler for filler in fillers if filler is not None]

    def evaluate(t: float, q: Array, qdot: Array) -> Array:
        for fill in moving:
            fill(t, q, qdot)
        return row

    return evaluate


def _of_channel(
    channel: Channel, slip: Slip, views: dict[str, Array], c: int
) -> list[Filler | None]:
    """Give what writes the parts of a channel of friction into their places."""
    at_gap = channel.gap is not None
    own, row, held, most = (
        views[name][c : c + 1] for name in ("slip_rates", "tangents", "limits", "static_limits")
    )
    called = f"of gap {channel.name!r}" if at_gap else f"of friction {channel.name!r}"
    prefix, name = ("tangent_", "mu") if at_gap else ("", "limit")
    direction = "tangent" if at_gap else "direction"
    k = views["slip_curvatures"][c : c + 1]
    fillers = [
        _filler(f"{direction} {called}", slip.direction, row[0], 2),
        _number_filler(f"{prefix}curvature {called}", slip.curvature, k, 3),
        _number_filler(f"{prefix}velocity {called}", slip.rate, own, 2),
        _number_filler(f"{name} {called}", slip.limit, held, 3),
    ]
    if slip.by_speed is not None:
        mu = slip.by_speed

        def limit(t: float, q: Array, qdot: Array) -> float:
            return mu(abs(float(row[0] @ qdot + own[0])))

        fillers[-1] = _number_filler(f"{name} {called}", limit, held, 3)
    if slip.static is not None:
        static = _number_filler(f"{name}_static {called}", slip.static, most, 3)
        return [*fillers, static]
    return [*fillers, _number_filler(f"static {called}", lambda t, q, qdot: held[0], most, 3)]


def _called(function: Callable[..., Any], arguments: int) -> Callable[..., Any]:
    """Give a function of (t, q, qdot), also for one of (t, q)."""
    return function if arguments == 3 else lambda t, q, qdot: function(t, q)


def _filler(name: str, given: Part, view: Array, arguments: int) -> Filler | None:
    """Give what writes a vector or matrix into its place, or write it now if it is constant."""
    shape, one = view.shape, view.size == 1

    def write(result: Any) -> None:
        if np.shape(result) != shape and not (one and np.size(result) == 1):
            raise ValueError(f"{name} must have shape {shape}, got {np.shape(result)}")
        try:
            view[...] = np.reshape(result, shape) if one else result
        except (TypeError, ValueError):
            raise TypeError(f"{name} must hold real numbers, got {result!r}") from None

    if isinstance(given, np.ndarray):
        write(given)
        return None
    if isinstance(given, Compiled):
        fill = given.fill
        return lambda t, q, qdot: fill(t, q, qdot, view)
    function = _called(given, arguments)
    return lambda t, q, qdot: write(function(t, q, qdot))


def _number_filler(name: str, given: Part, view: Array, arguments: int) -> Filler | None:
    """Give what writes a number into its place, or write it now if it is constant."""
    if isinstance(given, np.ndarray):
        view[0] = given[()]
        return None
    if isinstance(given, Compiled):
        fill = given.fill
        return lambda t, q, qdot: fill(t, q, qdot, view)
    function = _called(given, arguments)

    def number(t: float, q: Array, qdot: Array) -> None:
        result = function(t, q, qdot)
        try:
            view[0] = result
        except (TypeError, ValueError):
            told = f"{name} must be one number, got {type(result).__name__}"
            if shape := np.shape(result):
                raise ValueError(f"{told} of shape {shape}") from None
            raise TypeError(told) from None

    return number
