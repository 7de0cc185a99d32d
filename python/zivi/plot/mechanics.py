"""Plots of mechanical systems: gaps, reactions and coordinates over time, and the configuration."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from zivi.plot.drawing import PALETTE, WALL, axes_of, legend
from zivi.simulation.mechanical_trajectory import LinearMotion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.base.check import Array
    from zivi.control.mechanical_loop import MechanicalClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

# A run of a mechanical system as lines that can be drawn, with points by the motion.

Quantity: TypeAlias = Literal["q", "phase", "gaps", "reactions", "slips"]
"""What is drawn; ``"phase"`` is coordinates and velocities side by side."""

EVEN = 200
"""So many equidistant intervals at least are looked at."""
PER_STEP = 4
"""So many of them for each step of the method."""
OFF = 1e-3
"""Largest distance of a line from the curve, as a part of the range of the quantity."""
HALVINGS = 12
MOST = 500_000
"""Points at which an interval is no longer halved."""


def drawn(sol: MechanicalTrajectory, quantity: Quantity) -> tuple[Array, Array]:
    """Return times and columns of a quantity whose connecting lines follow the motion.

    The times are those of samples and events, the instants before each impact, and bisection points
    where a line deviates from the curve by more than a thousandth of the range. A run that keeps no
    motion is drawn at its samples.
    """
    path = sol._path
    unknown = quantity == "reactions" and not isinstance(path, LinearMotion) and sol._model is None
    if path is None or not getattr(path, "dense", True) or len(sol.t) < 2 or unknown:
        return sol.t, _sample_values(sol, quantity)
    start, end = float(sol.t[0]), float(sol.t[-1])
    tables = (sol.impacts, sol.zeno, sol.liftoffs, sol.openings, sol.transitions)
    events = np.concatenate([rows["t"] for rows in tables])
    known = [sol.t, events, np.nextafter(events, -np.inf)]
    if isinstance(path, LinearMotion):
        known.append(path.t)
    else:
        known.append(np.linspace(start, end, EVEN + PER_STEP * sol.n_steps + 1))
    times = np.unique(np.concatenate(known))
    times = times[(times >= start) & (times <= end)]
    values = _along_motion(sol, quantity, times)
    return (
        (times, values) if isinstance(path, LinearMotion) else _halved(sol, quantity, times, values)
    )


def broken(sol: MechanicalTrajectory, times: Array, values: Array) -> tuple[Array, Array]:
    """Insert NaN before impacts, where velocities jump."""
    after = np.searchsorted(times, np.unique(sol.impacts["t"]))
    after = np.unique(after[(after > 0) & (after < len(times))])
    return np.insert(times, after, np.nan), np.insert(values, after, np.nan, axis=0)


def _halved(
    sol: MechanicalTrajectory, quantity: Quantity, times: Array, values: Array
) -> tuple[Array, Array]:
    """Halve intervals until lines are near the curve."""
    with np.errstate(invalid="ignore"):
        spans = np.nanmax(values, axis=0, initial=-np.inf) - np.nanmin(
            values, axis=0, initial=np.inf
        )
    allowed = OFF * np.where(spans > 0.0, spans, np.inf)
    open_ = np.ones(len(times) - 1, dtype=bool)
    for _ in range(HALVINGS):
        left = np.flatnonzero(open_ & (np.diff(times) > 1e-12 * np.abs(times[1:])))
        if not len(left) or len(times) + len(left) > MOST:
            break
        middle = 0.5 * (times[left] + times[left + 1])
        found = _along_motion(sol, quantity, middle)
        off = np.abs(found - 0.5 * (values[left] + values[left + 1])) > allowed
        far = left[off.any(axis=1)]
        # an interval that is halved gives two that are open
        inside = np.zeros(len(times) - 1, dtype=bool)
        inside[far] = True
        kept = np.isin(left, far)
        open_ = np.repeat(inside, 1 + inside)
        times = np.insert(times, far + 1, middle[kept])
        values = np.insert(values, far + 1, found[kept], axis=0)
    return times, values


def _along_motion(sol: MechanicalTrajectory, quantity: Quantity, times: Array) -> Array:
    """Evaluate a quantity along the motion."""
    if quantity in ("reactions", "slips"):
        return _sample_values(sol.resample(times), quantity)
    path: Any = sol._path
    q, qdot, gaps, *_ = path.at(np.ascontiguousarray(times))
    columns: Array = {"q": q, "gaps": gaps, "phase": np.hstack([q, qdot])}[quantity]
    return columns


def _sample_values(sol: MechanicalTrajectory, quantity: Quantity) -> Array:
    """Return a quantity at the samples."""
    if quantity == "phase":
        return np.hstack([sol.q, sol.qdot])
    if quantity == "reactions":
        # a reaction jumps where its contact begins and ends
        contacts = np.where(sol.contacts, sol.reactions, np.nan)
        return np.hstack([contacts, sol.constraint_forces]) if sol.equality_names else contacts
    columns: Array = getattr(sol, quantity)
    return columns


# Plots of mechanical systems: gaps, reactions and coordinates over time, and the configuration.


def is_mechanical(run: Any) -> bool:
    """Whether a run has coordinates and gaps."""
    return all(hasattr(run, name) for name in ("q", "gaps", "reactions"))


def check_mechanical(plot: str, run: Any) -> None:
    """Raise a TypeError for a result that a plot of a mechanical system cannot draw."""
    if not is_mechanical(run):
        raise TypeError(
            f"zivi.plot.{plot} draws a zivi.MechanicalTrajectory, got {type(run).__name__}"
        )


def gaps(
    sol: MechanicalTrajectory, ax: Axes | None = None, *, units: Units = None, **line: Any
) -> Axes:
    """Plot the gaps over time, with marks at impacts, accumulations and lift-offs.

    Of two opposite gaps, whose sum is constant, the first is drawn between two walls: the second
    is the distance from the dashed one.

    Parameters
    ----------
    sol : MechanicalTrajectory
        The run.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    units : str or dict, optional
        Unit of all, such as ``"m"``, or units by name. By default those of a `Tree`; a system of
        functions and matrices does not know its units.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    See Also
    --------
    zivi.plot.reactions, zivi.plot.configuration : contact forces; the path.
    """
    check_mechanical("gaps", sol)
    ax, names = axes_of(ax), sol.gap_names
    given = units_of(sol, "gaps", units)
    t, values = drawn(sol, "gaps")
    walls = _opposite(values)
    shown = [k for k in range(len(names)) if k not in walls]
    _lines(ax, t, values, names, given, line, shown)
    for k, height in walls.items():
        wall: dict[str, Any] = {"color": _colour(k), "ls": "--", "lw": 0.8, "zorder": 0}
        ax.axhline(height, label=f"{names[k]} closed", **wall)
    for what, (events, mark) in _marked_events(sol).items():
        for k in np.unique(events["gap"]):
            times = events["t"][events["gap"] == k]
            at = np.full(len(times), walls.get(int(k), 0.0))
            look: dict[str, Any] = {
                "color": _colour(int(k)),
                "ms": 5,
                "clip_on": False,
                "ls": "none",
            }
            ax.plot(times, at, marker=mark, label=what, **look)
            what = "_"  # named once
    ax.axhline(0.0, color=WALL, lw=0.8, zorder=0)
    _labelled(ax, "gaps $g_i$", names, given)
    return ax


def _opposite(values: Array) -> dict[int, float]:
    """Find gaps that are the rest of a constant distance: the height of their walls."""
    walls: dict[int, float] = {}
    taken: set[int] = set()
    for i, j in itertools.combinations(range(values.shape[1]), 2):
        total = values[:, i] + values[:, j]
        near = np.ptp(total) <= SAME * np.max(total, initial=0.0) if len(total) else False
        if near and np.ptp(values[:, i]) > 0.0 and not {i, j} & taken:
            walls[j] = float(np.mean(total))
            taken |= {i, j}
    return walls


SAME = 1e-9
"""Relative variation of the sum of two gaps that is rounding."""


def _marked_events(sol: MechanicalTrajectory) -> dict[str, tuple[Any, str]]:
    return {
        "impact": (sol.impacts, "|"),
        "accumulation": (sol.zeno, "v"),
        "lift-off": (sol.liftoffs, "^"),
    }


def reactions(
    sol: MechanicalTrajectory, ax: Axes | None = None, *, units: Units = None, **line: Any
) -> Axes:
    """Plot the reactions over time, from 0; impulses, which are infinite forces, are not in them.

    The multipliers of equality rows are drawn with them. Parameters and return value as for `gaps`;
    `units` are those of the gaps: of metres the reactions are in newtons.
    """
    check_mechanical("reactions", sol)
    ax, names = axes_of(ax), (*sol.gap_names, *sol.equality_names)
    forces = [FORCES.get(it, "") for it in units_of(sol, "gaps", units)]
    forces += [""] * len(sol.equality_names)
    times, values = drawn(sol, "reactions")
    _lines(ax, times, values, names, forces, line)
    # the whole run with zero force, even if a gap is initially open
    ax.update_datalim([(times[0], 0.0), (times[-1], 0.0)] if len(times) else [])
    ax.autoscale_view()
    _labelled(ax, r"reactions $\lambda_i$", names, forces, one="reaction")
    return ax


FORCES = {"m": "N", "rad": "N m"}
"""The unit of a force by that of what it moves."""


def coordinates(
    sol: MechanicalTrajectory, ax: Axes | None = None, *, units: Units = None, **line: Any
) -> Axes:
    """Plot the coordinates over time, with marks at impacts; for a loop, with its reference.

    Parameters and return value as for `gaps`; `units` are those of the coordinates.
    """
    check_mechanical("coordinates", sol)
    ax, names = axes_of(ax), sol.coordinate_names
    given = units_of(sol, "coordinates", units)
    _lines(ax, *drawn(sol, "q"), names, given, line)
    reference = getattr(sol, "q_ref", None)
    for k, values in enumerate([] if reference is None else reference.T):
        if not np.all(np.isnan(values)):
            ax.plot(sol.t, values, color=_colour(k), ls="--", lw=0.8)
    times = np.unique(sol.impacts["t"])
    if len(times):
        look: dict[str, Any] = {
            "color": WALL,
            "marker": "|",
            "ls": "none",
            "ms": 6,
            "clip_on": False,
        }
        bottom = ax.get_xaxis_transform()
        ax.plot(times, np.zeros(len(times)), transform=bottom, label="impact", **look)
    _labelled(ax, "coordinates $q_i$", names, given)
    return ax


def configuration(
    sol: MechanicalTrajectory,
    ax: Axes | None = None,
    *,
    over: Sequence[int] | Sequence[str] | None = None,
    units: Units = None,
    **line: Any,
) -> Axes:
    """Plot one coordinate over another, with dots at impacts; of a single one its velocity.

    Parameters and return value as for `gaps`; `units` are those of the coordinates, `over` are two
    of them, numbers or names, by default the first two.
    """
    check_mechanical("configuration", sol)
    ax = axes_of(ax)
    names = sol.coordinate_names
    given = units_of(sol, "coordinates", units)
    look = {"color": _colour(len(ax.lines))} | line
    if over is None and len(names) == 1:
        times, phase = drawn(sol, "phase")
        ax.plot(*broken(sol, times, phase)[1].T, **look)
        _dots(ax, sol, times, *phase.T)
        speed = f"velocity of {names[0]}"
        ax.set(
            xlabel=with_unit(names[0], given[0]),
            ylabel=with_unit(speed, given[0] and f"{given[0]}/s"),
        )
        return ax
    chosen = [_coordinate_index(names, item) for item in (over if over is not None else (0, 1))]
    if len(chosen) != 2:
        raise ValueError(f"over must be two coordinates, got {over!r}")
    first, second = chosen
    times, q = drawn(sol, "q")
    ax.plot(q[:, first], q[:, second], **look)
    _dots(ax, sol, times, q[:, first], q[:, second])
    ax.set(
        xlabel=with_unit(names[first], given[first]),
        ylabel=with_unit(names[second], given[second]),
    )
    return ax


def _dots(ax: Axes, sol: MechanicalTrajectory, times: Array, x: Array, y: Array) -> None:
    """Mark the points of a curve at impacts, which are among its times if it follows the motion."""
    at = np.isin(times, sol.impacts["t"])
    if np.any(at):
        ax.plot(x[at], y[at], ".", color="black", ms=3, label="impact", zorder=3)
        legend(ax)


def slips(
    sol: MechanicalTrajectory, ax: Axes | None = None, *, units: Units = None, **line: Any
) -> Axes:
    """Plot the slip speeds of dry friction over time.

    Parameters and return value as for `gaps`; `units` are those of the slip speeds.
    """
    check_mechanical("slips", sol)
    ax, names = axes_of(ax), sol.channel_names
    given = units_of(sol, "channels", units)
    _lines(ax, *broken(sol, *drawn(sol, "slips")), names, given, line)
    ax.axhline(0.0, color=WALL, lw=0.8, zorder=0)
    _labelled(ax, "slip speeds $w_c$", names, given, one="slip speed")
    return ax


def modes(sol: MechanicalTrajectory, ax: Axes | None = None, **bar: Any) -> Axes:
    """Plot what each channel of dry friction does: bars of stick, of slip up and of slip down.

    Parameters and return value as for `gaps`; `**bar` is passed to
    `matplotlib.axes.Axes.broken_barh`.

    Raises
    ------
    ValueError
        If the run has no friction.

    See Also
    --------
    zivi.plot.slips : the slip speeds.

    Examples
    --------
    >>> belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
    >>> system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[belt])
    >>> ax = zivi.plot.modes(zivi.simulate(system, (0, 30), ([0.0], [0.2])))
    >>> [label.get_text() for label in ax.get_yticklabels()]
    ['belt']
    """
    check_mechanical("modes", sol)
    if not sol.channel_names:
        raise ValueError("zivi.plot.modes needs a run of a system with dry friction")
    ax = axes_of(ax)
    names = {0: "stick", 1: "slip, $w > 0$", -1: "slip, $w < 0$"}
    drawn_before: set[int] = set()
    for channel in range(len(sol.channel_names)):
        for mode in names:
            spans = [(t, end - t) for t, end, what in sol._spans(channel) if what == mode]
            label = names[mode] if spans and mode not in drawn_before else None
            drawn_before |= {mode} if spans else set()
            settings = {"facecolors": _colour(MODE_COLOURS[mode]), "label": label} | bar
            ax.broken_barh(spans, (channel - 0.4, 0.8), **settings)
    ax.set_yticks(range(len(sol.channel_names)), sol.channel_names)
    ax.set_ylim(-0.5, len(sol.channel_names) - 0.5)  # rows that never close, too
    ax.set(xlabel="time $t$ (s)", xlim=(sol.t[0], sol.t[-1]))
    ax.invert_yaxis()
    legend(ax)
    return ax


MODE_COLOURS = {0: 0, 1: 1, -1: 2}
"""The colours of stick and of both directions of slip, in the palette."""


def controls(run: MechanicalClosedLoop, ax: Axes, line: dict[str, Any]) -> Axes:
    """Plot the controls of a closed loop of a mechanical system, held from sample to sample."""
    names = run.control_names
    _lines(ax, run.t, run.u, names, [""] * len(names), {"drawstyle": "steps-post"} | line)
    _labelled(ax, "controls $u_j$", names, [""] * len(names))
    return ax


Units: TypeAlias = "str | Mapping[str, str] | None"
"""The unit of all, or units by name."""


def units_of(sol: MechanicalTrajectory, kind: str, units: Units) -> list[str]:
    """Return the units of coordinates, gaps or channels; "" if unknown."""
    owners = {"coordinates": "coordinate_names", "gaps": "gap_names", "channels": "channel_names"}
    names = getattr(sol, owners[kind])
    if isinstance(units, str):
        return [units] * len(names)
    if units is not None and not isinstance(units, Mapping):
        raise TypeError(f"units must be a string or a dict by name, got {units!r}")
    config: Any = getattr(sol, "config", None) or {}
    known = config.get("units", {}).get(kind, [""] * len(names))
    return [(units or {}).get(name, own) for name, own in zip(names, known, strict=True)]


def with_unit(text: str, unit: str) -> str:
    """Write a quantity and its unit, if that is known."""
    return f"{text} ({unit})" if unit else text


def _labelled(
    ax: Axes, what: str, names: Sequence[str], units: Sequence[str], one: str = ""
) -> None:
    """Label the axes with the quantity and its common unit."""
    if len(names) == 1:
        what = f"{one} {names[0]}".lstrip()
    unit = units[0] if len(set(units)) == 1 else ""
    ax.set(xlabel="time $t$ (s)", ylabel=with_unit(what, unit))
    if 0 < len(names) <= MOST_NAMED:
        legend(ax)


MOST_NAMED = 16
"""Lines that a legend names: of more it would be higher than the plot."""


def _coordinate_index(names: tuple[str, ...], item: int | str) -> int:
    if isinstance(item, str) and item in names:
        return names.index(item)
    if isinstance(item, int | np.integer) and -len(names) <= item < len(names):
        return int(item) % len(names)
    raise ValueError(f"over must hold coordinates of {', '.join(names)}, got {item!r}")


def _lines(
    ax: Axes,
    t: Array,
    columns: Array,
    names: Sequence[str],
    units: Sequence[str],
    line: dict[str, Any],
    shown: Iterable[int] | None = None,
) -> None:
    """Draw columns over time; units that differ stand with the names."""
    differ = len(set(units)) > 1
    for k in range(len(names)) if shown is None else shown:
        label = with_unit(names[k], units[k]) if differ else names[k]
        ax.plot(t, columns[:, k], **({"color": _colour(k), "label": label} | line))


def _colour(k: int) -> str:
    return PALETTE[k % len(PALETTE)]


# Wireframes of shapes on free bodies, for animations in space.


Lines: TypeAlias = Callable[[float, "Array"], Sequence[tuple[Any, ...]]]

POINTS = 33
"""Points of a circle."""
SQUARES = 6
"""Squares along an edge of the part of a plane that is drawn."""
FARTHEST = 5.0
"""Largest distance between the motion and a plane that is drawn, as a multiple of its size."""


def is_in_space(run: Any) -> bool:
    """Return whether a run has free bodies."""
    return any(is_free for _, is_free in run.config.get("rotations", {}).values())


def wireframes(
    run: MechanicalTrajectory, shapes: Mapping[str, Any] | None
) -> tuple[Lines, Lines | None]:
    """Return the lines of the bodies and of the planes of a run.

    Without shapes a body is the three axes of its frame.
    """
    free = [name for name, (_, is_free) in run.config["rotations"].items() if is_free]
    origins = np.concatenate([run.pose(name)[0] for name in free])
    low, high = origins.min(axis=0), origins.max(axis=0)
    size = max(float(np.max(high - low)), 1e-9)
    if shapes is None:
        axes = 0.1 * size * np.eye(3)
        moving = [(name, np.stack([0 * axis, axis])) for name in free for axis in axes]
        return _lines_of_bodies(run, moving), None
    moving, still = [], []
    largest = [float(np.nanmax(np.abs(_outline(it)))) for it in shapes.values()]
    size += 2 * max(largest, default=0.0)
    middle = (low + high) / 2
    for name, shape in shapes.items():
        body = getattr(shape, "body", None) or name
        if hasattr(shape, "normal"):
            away = abs(_height(shape, middle))
            if away <= FARTHEST * size:
                still += _plane_grid(shape, middle, 0.6 * max(size, away))
        elif body in free:
            moving.append((body, _outline(shape)))
        elif getattr(shape, "body", None) is None:
            still.append(_outline(shape))
        else:
            raise ValueError(
                f"shape {name!r} must be on a free body or on the world, got body {body!r}; "
                "use bodies, a function that returns lines (x, y, z)"
            )
    walls = [tuple(line.T) for line in still]
    return _lines_of_bodies(run, moving), (lambda t, q: walls) if walls else None


def _lines_of_bodies(run: MechanicalTrajectory, moving: Sequence[tuple[str, Array]]) -> Lines:
    return lambda t, q: [tuple(run._in_world(name, q, outline).T) for name, outline in moving]


def _circle(radius: float, one: Array, other: Array) -> Array:
    angles = np.linspace(0, 2 * np.pi, POINTS)[:, None]
    circle: Array = radius * (np.cos(angles) * one + np.sin(angles) * other)
    return circle


def _joined(lines: Sequence[Array]) -> Array:
    """Return lines as one with interruptions."""
    gap = np.full((1, 3), np.nan)
    return np.concatenate([part for line in lines for part in (line, gap)][:-1])


def _outline(shape: Any) -> Array:
    """Return the points of the wireframe of a shape in the frame of its body."""
    if hasattr(shape, "normal"):
        return np.zeros((1, 3))
    center = np.asarray(shape.center, dtype=float)
    if hasattr(shape, "half_extents"):
        half = np.asarray(shape.half_extents, dtype=float)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        faces = [np.column_stack([corners, np.full(5, z)]) for z in (-1, 1)]
        edges = [np.array([[x, y, -1], [x, y, 1]]) for x, y in corners[:4]]
        return center + half * _joined([*faces, *edges])
    if not hasattr(shape, "half_length"):
        return center + _joined(
            [_circle(shape.radius, *pair) for pair in _coordinate_planes(np.eye(3))]
        )
    along = np.asarray(shape.axis, dtype=float)
    along = along / np.linalg.norm(along)
    one, other = _across(along)
    ends = [side * shape.half_length * along for side in (-1, 1)]
    circles = [end + _circle(shape.radius, *pair) for end in ends
               for pair in _coordinate_planes(np.array([one, other, along]))]  # fmt: skip
    sides = [np.array(ends) + shape.radius * it for it in (one, -one, other, -other)]
    return center + _joined([*circles, *sides])


def _coordinate_planes(axes: Array) -> list[tuple[Array, Array]]:
    return [(axes[0], axes[1]), (axes[1], axes[2]), (axes[2], axes[0])]


def _across(normal: Array) -> tuple[Array, Array]:
    """Return two directions at right angles to a unit vector and to each other."""
    one = np.eye(3)[np.argmin(np.abs(normal))]
    one = one - normal * (normal @ one)
    one = one / np.linalg.norm(one)
    return one, np.cross(normal, one)


def _height(plane: Any, point: Array) -> float:
    return float(np.asarray(plane.normal) @ point) - float(plane.offset or 0.0)


def _plane_grid(plane: Any, near: Array, reach: float) -> list[Array]:
    """Return the grid of a plane below the motion."""
    normal = np.asarray(plane.normal, dtype=float)
    foot = near - normal * _height(plane, near)
    one, other = _across(normal)
    places = reach * np.linspace(-1, 1, SQUARES + 1)
    across = [[foot + at * one + side * reach * other for side in (-1, 1)] for at in places]
    along = [[foot + at * other + side * reach * one for side in (-1, 1)] for at in places]
    return [_joined([np.array(line) for line in (*across, *along)])]
