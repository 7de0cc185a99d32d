"""Parts of a system combined into one model, which calls functions for variable parts only."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, check_arguments
from zivi.system.constraints.equality import Equality
from zivi.system.gap import Channel, Gap, HarmonicWall, LinearGap, MovingWall, Slip
from zivi.system.model_parts import Compiled, Layout, Part, compiled_part
from zivi.system.table import Table

Evaluate: TypeAlias = Callable[[float, Array, Array], Array]
"""``(t, q, qdot)`` to the row of a `Layout`, a new one at each call."""

# Forces of mechanical systems that take inputs from a table.

C_FORM = "void (double t, double *q, double *qdot, double *u, double *out)"


class DrivenForce(Compiled):
    """A compiled force with an additional argument, the inputs of a table."""

    def __init__(self, address: int, owner: object, inputs: Table) -> None:
        # the same arguments as those of a part with data: addresses, of which one more is given
        super().__init__(address, 0, owner)
        self.inputs = inputs


def driven(force: Any, inputs: Any) -> Part:
    """Return a force ``F(t, q, qdot, u)`` with its inputs as one of (t, q, qdot)."""
    if not isinstance(inputs, Table):
        raise TypeError(f"inputs must be a zivi.Table, got {inputs!r}")
    compiled = compiled_part("force", force)
    if compiled is not None:
        low_level = isinstance(force, tuple)  # of SciPy: its last argument is its own data
        if compiled.data is None or low_level:
            raise TypeError(f"force with inputs, compiled, must have the signature {C_FORM}")
        return DrivenForce(compiled.address, force, inputs)
    if not callable(force):
        raise TypeError(
            f"force must be a function (t, q, qdot, u) of the inputs, or compiled {C_FORM}, "
            f"got {type(force).__name__}"
        )
    check_arguments("force", force, "t, q, qdot, u")
    core, size = inputs._core, inputs.width or 1

    def evaluated(t: float, q: Array, qdot: Array) -> Any:
        u = np.empty(size)
        core.fill(t, u)
        return force(t, q, qdot, u)

    return evaluated


# The parts of a system as a model of the extension, which computes what needs no function.


@dataclasses.dataclass
class PartPlaces:
    """The row of an evaluation: constants in their places, functions for the others.

    Parameters
    ----------
    layout : Layout
        Numbers of coordinates, gaps and channels of friction.
    """

    layout: Layout

    def __post_init__(self) -> None:
        self.row = np.zeros(self.layout.size)
        self.views = self.layout.views(self.row)
        self.functions: list[_zivi.Part] = []

    def add(self, name: str, given: Part, view: Array, arguments: int = 3) -> None:
        """Write a constant into its place, or keep the function of a variable vector or matrix."""
        read = functools.partial(_read_array, name, view.shape)
        if isinstance(given, np.ndarray):
            view[...] = read(given).reshape(view.shape)
        else:
            self._call(given, view, view.shape, arguments, read)

    def add_number(self, name: str, given: Part, view: Array, arguments: int = 3) -> None:
        """Write a constant into its place, or keep the function of a variable number."""
        if isinstance(given, np.ndarray):
            view[0] = given[()]
        else:
            self._call(given, view, (), arguments, functools.partial(_read_number, name))

    def _call(
        self, given: Any, view: Array, shape: tuple[int, ...], arguments: int, read: Any
    ) -> None:
        start = (view.ctypes.data - self.row.ctypes.data) // self.row.itemsize
        if isinstance(given, DrivenForce):
            table = given.inputs._core
            found = _zivi.Part.driven(start, view.size, given.address, table)
        elif isinstance(given, Compiled):
            found = _zivi.Part.compiled(start, view.size, given.address, given.data)
        else:
            found = _zivi.Part.python(
                start, shape, given, takes_velocities=arguments == 3, read=read
            )
        self.functions.append(found)


def _read_array(name: str, shape: tuple[int, ...], result: Any) -> Array:
    """Read what a function returned; an error names the part."""
    one = math.prod(shape) == 1
    if np.shape(result) != shape and not (one and np.size(result) == 1):
        raise ValueError(f"{name} must have shape {shape}, got {np.shape(result)}")
    read = np.empty(shape)
    try:
        read[...] = np.reshape(result, shape) if one else result
    except (TypeError, ValueError):
        raise TypeError(f"{name} must hold real numbers, got {result!r}") from None
    return read.ravel()


def _read_number(name: str, result: Any) -> Array:
    read = np.empty(1)
    try:
        read[0] = result
    except (TypeError, ValueError):
        told = f"{name} must be one number, got {type(result).__name__}"
        if shape := np.shape(result):
            raise ValueError(f"{told} of shape {shape}") from None
        raise TypeError(told) from None
    return read


def model_of_parts(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
    equalities: Sequence[Equality] = (),
    *,
    steady: bool = False,
) -> _zivi.Model:
    """Return the model of parts: constants, flat gaps and belts call no function.

    Parameters
    ----------
    layout : Layout
        Numbers of coordinates, gaps and channels of friction.
    mass, force : Part
        Mass matrix and force.
    gaps : sequence of Gap
        The gaps.
    slips : sequence of (Channel, Slip)
        The channels of friction.
    equalities : sequence of Equality
        The equality rows.
    steady : bool
        Whether mass, force, gradients and rates are constants.

    Raises
    ------
    ValueError, TypeError
        If a constant has another shape; the error names the part.
    """
    places = PartPlaces(layout)
    places.add("mass", mass, places.views["mass"], 2)
    places.add("force", force, places.views["force"], 3)
    added = [_add_gap(places, i, gap) for i, gap in enumerate(gaps)]
    belts: list[tuple[int, _zivi.Wall]] = []
    for c, (channel, slip) in enumerate(slips):
        if isinstance(slip.motion, HarmonicWall):
            belts.append((c, slip.motion._spec()))
        _add_channel(places, c, channel, slip)
    for i, row in enumerate(equalities):
        _add_equality(places, i, row)
    is_flat = all(isinstance(gap, LinearGap) for gap in gaps)
    is_flat = is_flat and all(row._is_flat() for row in equalities)
    return _zivi.Model.parts(
        (layout.n, layout.m, layout.p, layout.k),
        places.row,
        gaps=[flat for flat in added if flat is not None],
        belts=belts,
        without_static=[c for c, (_, slip) in enumerate(slips) if slip.static is None],
        functions=places.functions,
        steady=steady,
        constant=isinstance(mass, np.ndarray) and is_flat and not slips,
        owner=(mass, force, tuple(gaps), tuple(slips), tuple(equalities)),
    )


FlatGap: TypeAlias = "tuple[int, list[float], float, _zivi.Wall | None]"
"""Number, normal, offset and moving wall of a flat gap."""


def _add_gap(places: PartPlaces, i: int, gap: Gap) -> FlatGap | None:
    """Add a gap; return the parts of a flat one."""
    views, called = places.views, f"of gap {gap.name!r}" if gap.name else f"of gap {i}"
    value, gradient, curvature, rate = gap._parts()
    if isinstance(gap, LinearGap):
        places.add(f"gradient {called}", gap.normal, views["gradients"][i])
        motion = gap.motion
        if isinstance(motion, MovingWall):
            places.functions.append(_zivi.Part.wall(i, motion._at))
            motion = None
        return i, gap.normal.tolist(), gap.offset, None if motion is None else motion._spec()
    places.add_number(f"value {called}", value, views["gaps"][i : i + 1], 2)
    places.add(f"gradient {called}", gradient, views["gradients"][i], 2)
    places.add_number(f"curvature {called}", curvature, views["curvatures"][i : i + 1])
    places.add_number(f"rate {called}", rate, views["rates"][i : i + 1], 2)
    return None


def _add_equality(places: PartPlaces, i: int, row: Equality) -> None:
    """Add the parts of an equality row."""
    value, gradient, curvature, rate = row._parts()
    called, views = f"of equality {row.name!r}", places.views
    one = slice(i, i + 1)
    places.add_number(f"value {called}", value, views["equalities"][one], 2)
    places.add(f"gradient {called}", gradient, views["equality_gradients"][i], 2)
    places.add_number(f"curvature {called}", curvature, views["equality_curvatures"][one])
    places.add_number(f"rate {called}", rate, views["equality_rates"][one], 2)


def _add_channel(places: PartPlaces, c: int, channel: Channel, slip: Slip) -> None:
    """Add the parts of a channel of friction."""
    own, row, held, most, k = (
        places.views[name][c : c + 1]
        for name in ("slip_rates", "tangents", "limits", "static_limits", "slip_curvatures")
    )
    at_gap = channel.gap is not None
    called = f"of gap {channel.name!r}" if at_gap else f"of friction {channel.name!r}"
    prefix, name = ("tangent_", "mu") if at_gap else ("", "limit")
    places.add(f"{'tangent' if at_gap else 'direction'} {called}", slip.direction, row[0], 2)
    if not isinstance(slip.motion, HarmonicWall):
        places.add_number(f"{prefix}curvature {called}", slip.curvature, k)
        places.add_number(f"{prefix}velocity {called}", slip.rate, own, 2)
    if slip.by_speed is None:
        places.add_number(f"{name} {called}", slip.limit, held)
    else:
        read = functools.partial(_read_number, f"{name} {called}")
        places.functions.append(_zivi.Part.of_speed(c, slip.by_speed, read))
    if slip.static is not None:
        places.add_number(f"{name}_static {called}", slip.static, most)
