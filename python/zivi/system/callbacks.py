"""Parts of a system combined into one function, compiled if all parts are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from zivi.base.check import Array, check_arguments
from zivi.system.gap import Channel, Gap, HarmonicWall, LinearGap, Slip
from zivi.system.model_parts import Compiled, Layout, Part, compiled_part
from zivi.system.table import Table

if TYPE_CHECKING:
    from zivi.base.machine_code import Native

__all__ = [
    "DrivenForce",
    "Evaluate",
    "Glued",
    "assembled",
    "driven",
    "glued",
]

# Forces of mechanical systems that take inputs from a table.

C_FORM = "void (double t, double *q, double *qdot, double *u, double *out)"


class DrivenForce(Compiled):
    """A compiled force that is called with the inputs of a table, too."""

    def __init__(self, address: int, owner: object, inputs: Table) -> None:
        # the same arguments as those of a part with data: addresses, of which one more is given
        super().__init__(address, 0, owner)
        self.inputs = inputs
        self._u = np.empty(inputs.width or 1)

    def fill(self, t: float, q: Array, qdot: Array, out: Array) -> None:
        """Evaluate into ``out``; all arrays are contiguous."""
        self.inputs._core.fill(t, self._u)
        u = self._u.ctypes.data
        self._call(t, q.ctypes.data, qdot.ctypes.data, u, out.ctypes.data)


def driven(force: Any, inputs: Any) -> Part:
    """Give a force ``F(t, q, qdot, u)`` with its inputs as one of (t, q, qdot)."""
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


# The parts of a system as one function that fills one row of numbers.

Evaluate: TypeAlias = Callable[[float, Array, Array], Array]
"""``(t, q, qdot)`` to the row of a `Layout`, a new one at each call."""

Filler: TypeAlias = Callable[[float, Array, Array], None]


def assembled(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
) -> Evaluate:
    """Join the parts of a system; an error names the part whose result has another shape.

    Each evaluation has a row of its own: several threads may be in one, and parts may evaluate
    their system.
    """
    unused = [_workspace(layout, mass, force, gaps, slips)]

    def evaluate(t: float, q: Array, qdot: Array) -> Array:
        try:
            fill = unused.pop()
        except IndexError:
            fill = _workspace(layout, mass, force, gaps, slips)
        try:
            return fill(t, q, qdot).copy()
        finally:
            unused.append(fill)

    return evaluate


def _workspace(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
) -> Evaluate:
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


def _of_state(function: Callable[..., Any], arguments: int) -> Callable[..., Any]:
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
    function = _of_state(given, arguments)
    return lambda t, q, qdot: write(function(t, q, qdot))


def _number_filler(name: str, given: Part, view: Array, arguments: int) -> Filler | None:
    """Give what writes a number into its place, or write it now if it is constant."""
    if isinstance(given, np.ndarray):
        view[0] = given[()]
        return None
    if isinstance(given, Compiled):
        fill = given.fill
        return lambda t, q, qdot: fill(t, q, qdot, view)
    function = _of_state(given, arguments)

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


# Compiled parts joined by a compiled function: a run of them does not call the interpreter.

HEAD = """\
#include <math.h>

typedef void (*part)(double, const double *, const double *, double *);
typedef void (*part_with_data)(double, const double *, const double *, double *, void *);
struct parts { const double *row; void *const *calls; const double *walls; };

int model(double t, const double *q, const double *w, double *out, void *parameters)
{
    const struct parts *p = parameters;
    for (int k = 0; k < SIZE; k++) out[k] = p->row[k];
"""
WALL = """\
    {
        const double *at = p->walls + WALL;
        const double angle = at[1]*t + at[2], swing = at[0]*cos(angle);
        out[VALUE] -= at[3] + swing;
        out[CURVATURE] = at[1]*at[1]*swing;
        out[RATE] = at[0]*at[1]*sin(angle);
    }
"""
DRIVEN = """\
    {
        typedef void (*driven)(double, const double *, const double *, const double *, double *);
        double u[WIDTH];
        ((part_with_data)p->calls[PLACE])(t, q, w, u, p->calls[PLACE + 1]);
        ((driven)p->calls[PLACE + 2])(t, q, w, u, out + START);
    }
"""
TABLE = """\
    {
        double at[3];
        ((part_with_data)p->calls[PLACE])(t, q, w, at, p->calls[PLACE + 1]);
        out[VALUE] -= at[0];
        out[CURVATURE] = -at[2];
        out[RATE] = -at[1];
    }
"""


BELT = """\
    {
        const double *at = p->walls + WALL;
        const double angle = at[1]*t + at[2];
        out[CURVATURE] = at[1]*at[1]*at[0]*cos(angle);
        out[RATE] = at[0]*at[1]*sin(angle);
    }
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Glued:
    """A compiled model of compiled parts.

    Parameters
    ----------
    native : Native
        The function that joins them.
    address : int
        Of what it takes as its parameters.
    owners : list
        What keeps parts and parameters alive.
    """

    native: Native
    address: int
    owners: list[Any]


def glued(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
) -> Glued | None:
    """Join compiled parts; None if one needs the interpreter, or there is no C compiler.

    Systems of constants only are left to the interpreter: it has nothing to call in them.
    """
    row = np.zeros(layout.size)
    views = layout.views(row)
    linear = [gap for gap in gaps if isinstance(gap, LinearGap)]
    named: list[tuple[Part, Array]] = [(mass, views["mass"]), (force, views["force"])]
    for i, gap in enumerate(gaps):
        if isinstance(gap, LinearGap):
            views["gaps"][i] = gap.offset
            named.append((gap.normal, views["gradients"][i]))
        else:
            names = ("gaps", "gradients", "curvatures", "rates")
            places = [views[name][i : i + 1] for name in names]
            named += zip(gap._parts(), places, strict=True)
    for c, (_, slip) in enumerate(slips):
        if slip.by_speed is not None:
            return None
        named += _of_slip(slip, views, c)
    given = [part for part, _ in named]
    native = all(isinstance(part, np.ndarray | Compiled) for part in given)
    moved = [gap.motion for gap in linear if gap.motion is not None]
    moved += [slip.motion for _, slip in slips if slip.motion is not None]
    if not (native and any(isinstance(part, Compiled) for part in given)):
        return None
    if not all(isinstance(motion, HarmonicWall | Table) for motion in moved):
        return None
    from zivi.base.machine_code import (
        c_compiler,
        compile_model,  # what most runs do not need
    )

    if c_compiler() is None:
        return None
    lines: list[str] = []
    calls: list[int] = []
    for part, view in named:
        if isinstance(part, np.ndarray):
            if part.size != view.size:
                return None  # the interpreter says what is wrong
            view[...] = part.reshape(view.shape)
        elif isinstance(part, Compiled):
            start = (view.ctypes.data - row.ctypes.data) // row.itemsize
            lines.append(_call(len(calls), start, part))
            if isinstance(part, DrivenForce):
                values, _, table = part.inputs._core.functions
                calls += [values, table, part.address]
            else:
                calls += [part.address] if part.data is None else [part.address, part.data]
    lines += [_linear(layout, i) for i, gap in enumerate(gaps) if isinstance(gap, LinearGap)]
    walls: list[float] = []
    for i, gap in enumerate(gaps):
        motion = getattr(gap, "motion", None)
        if isinstance(motion, HarmonicWall):
            lines.append(_wall(layout, i, len(walls)))
            walls += [motion.amplitude, motion.omega, motion.phase, motion.offset]
        elif isinstance(motion, Table):
            lines.append(_placed(TABLE.replace("PLACE", str(len(calls))), layout, i))
            calls += motion._core.functions[1:]
    for c, (_, slip) in enumerate(slips):
        if isinstance(slip.motion, HarmonicWall):
            lines.append(_belt(layout, c, len(walls)))
            motion = slip.motion
            walls += [motion.amplitude, motion.omega, motion.phase, motion.offset]
        if slip.static is None:
            held = layout.size - 2 * layout.p + c
            lines.append(f"    out[{held + layout.p}] = out[{held}];\n")
    source = HEAD.replace("SIZE", str(layout.size)) + "".join([*lines, "    return 0;\n}\n"])
    numbers, addresses = np.array([*walls, 0.0]), np.array([*calls, 0], dtype=np.uintp)
    parameters = np.array([a.ctypes.data for a in (row, addresses, numbers)], dtype=np.uintp)
    owners = [row, addresses, numbers, parameters, given, moved]
    return Glued(compile_model({"c": source}, "c"), parameters.ctypes.data, owners)


def _call(place: int, start: int, part: Compiled) -> str:
    if isinstance(part, DrivenForce):
        text = DRIVEN.replace("PLACE", str(place)).replace("START", str(start))
        return text.replace("WIDTH", str(part.inputs.width or 1))
    kind = "part" if part.data is None else "part_with_data"
    more = "" if part.data is None else f", p->calls[{place + 1}]"
    return f"    (({kind})p->calls[{place}])(t, q, w, out + {start}{more});\n"


def _linear(layout: Layout, i: int) -> str:
    """Add ``n . q`` to the offset of a linear gap."""
    places = _gap_places(layout, i)
    return (
        f"    for (int j = 0; j < {layout.n}; j++)"
        f" out[{places['VALUE']}] += out[{places['GRADIENT']} + j]*q[j];\n"
    )


def _wall(layout: Layout, i: int, place: int) -> str:
    """Let the wall of a linear gap move: its value, its rate, its curvature."""
    return _placed(WALL.replace("WALL", str(place)), layout, i)


def _placed(text: str, layout: Layout, i: int) -> str:
    """Write the places of a gap into a text."""
    for name, index in _gap_places(layout, i).items():
        text = text.replace(name, str(index))
    return text


def _of_slip(slip: Slip, views: dict[str, Array], c: int) -> list[tuple[Part, Array]]:
    """Give the parts of a channel of friction with their places; motions are added later."""
    given = {
        "tangents": slip.direction,
        "slip_curvatures": slip.curvature,
        "slip_rates": slip.rate,
        "limits": slip.limit,
        "static_limits": slip.static,
    }
    if slip.motion is not None:
        del given["slip_curvatures"], given["slip_rates"]
    return [(part, views[name][c : c + 1]) for name, part in given.items() if part is not None]


def _belt(layout: Layout, c: int, place: int) -> str:
    """Let the surface of a channel move: its rate, its curvature."""
    places = _gap_places(layout, layout.m + c)
    text = BELT.replace("WALL", str(place))
    for name in ("CURVATURE", "RATE"):
        text = text.replace(name, str(places[name]))
    return text


def _gap_places(layout: Layout, i: int) -> dict[str, int]:
    n, m, rows = layout.n, layout.m, layout.m + layout.p
    value = n * n + n + i
    gradient, curvature = n * n + n + m + i * n, n * n + n + m + rows * n + i
    return {"VALUE": value, "GRADIENT": gradient, "CURVATURE": curvature, "RATE": curvature + rows}
