"""Animations of the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from zivi.base.check import finite
from zivi.base.extras import needed
from zivi.base.habits import hinted
from zivi.plot.curves import line_of
from zivi.plot.drawing import (
    BLUE,
    GREEN,
    PALETTE,
    WALL,
    check_run,
    figure_of,
    has_reference,
    in_frame,
    legend,
    wall_of,
)
from zivi.plot.mechanics import Lines, drawn, is_in_space, is_mechanical, wireframes

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.base.check import Array
    from zivi.control.loop_run import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory

# The frames of a video of a mechanical system.


class MechanicalScene:
    """The configuration on the left, the gaps over time on the right, as they come.

    Parameters
    ----------
    run : MechanicalTrajectory
        The run.
    times : ndarray
        Times of the pictures.
    figure : matplotlib.figure.Figure
        Target of the drawing.
    bodies, walls : callable or None
        Lines of the bodies and of the walls, in the plane or in space.
    """

    def __init__(
        self,
        run: MechanicalTrajectory,
        times: Array,
        figure: Figure,
        bodies: Lines | None,
        walls: Lines | None,
    ) -> None:
        self.figure, self._times, self._names = figure, times, run.coordinate_names
        self._q, self._gaps = motion_at(run, times)
        self._curve = drawn(run, "gaps")
        self._given = bodies is not None
        self._bodies = self._lines("bodies", bodies or coordinate_points)
        if walls is None and bodies is None:
            walls = linear_walls(run)
        self._walls = [] if walls is None else self._lines("walls", walls)
        shown = [line for picture in (*self._bodies, *self._walls) for line in picture]
        self._sides = len(shown[0]) if shown else 2
        if any(len(line) != self._sides for line in shown):
            raise ValueError("bodies and walls must be lines (x, y), or all of them (x, y, z)")
        wider = 1.0 if self._sides == 3 else 1.5
        grid = figure.add_gridspec(1, 2, width_ratios=(1, wider))
        space = {"projection": "3d"} if self._sides == 3 else {}
        left, right = figure.add_subplot(grid[0], **space), figure.add_subplot(grid[1])
        self._draw_bodies(left)
        self._draw_gaps(right, run.gap_names)

    def _lines(self, name: str, lines: Lines) -> list[list[Array]]:
        """Evaluate lines at all times: of each picture, each line, x and y, in space z."""
        found = []
        for t, q in zip(self._times, self._q, strict=True):
            given = lines(float(t), q.copy())
            try:
                found.append([np.array(np.broadcast_arrays(*line), float) for line in given])
                if any(len(line) not in (2, 3) for line in found[-1]):
                    raise ValueError
            except (TypeError, ValueError):
                raise ValueError(
                    f"{name} must return pairs of x and y, in space x, y and z, numbers or arrays "
                    f"of one length, got {given!r:.80} at t = {t:g}"
                ) from None
            if len(found[-1]) != len(found[0]):
                raise ValueError(
                    f"{name} must return as many lines at all times, got {len(found[-1])} at "
                    f"t = {t:g} and {len(found[0])} before"
                )
        return found

    def _draw_bodies(self, ax: Axes) -> None:
        # a 3D axes does not clip: what lies outside its limits is drawn beside it
        seen = self._bodies if self._sides == 2 else [*self._bodies, *self._walls]
        every = [line.reshape(self._sides, -1) for picture in seen for line in picture]
        low, high = (f(np.hstack(every), axis=1) for f in (np.nanmin, np.nanmax))
        middle, half = (low + high) / 2, 0.6 * max(*(high - low), 1e-9)
        view: Any = ax
        for name, at in zip("xyz", middle, strict=False):
            ax.set(**{f"{name}lim": at + half * np.array([-1, 1])})
            if self._sides == 3:
                ax.set(**{f"{name}label": f"${name}$ (m)"})
                view.locator_params(axis=name, nbins=4)
        if self._sides == 3:
            view.set_box_aspect((1, 1, 1), zoom=0.8)  # the label of z is not part of the layout
        elif self._given:
            ax.set_aspect("equal")
        else:
            ax.set(xlabel=point_label(self._names, 0), ylabel=point_label(self._names, 1))
        none: list[list[float]] = [[]] * self._sides
        thin = {"lw": 1.0} if self._sides == 3 else {"lw": 2.0, "marker": "o", "ms": 6}
        wide = 0.5 if self._sides == 3 else 3.0
        self._stone = [ax.plot(*none, color=WALL, lw=wide)[0] for _ in (self._walls or [[]])[0]]
        self._marks = [
            ax.plot(*none, color=PALETTE[k % len(PALETTE)], **thin)[0]
            for k in range(len(self._bodies[0]))
        ]
        self._clock = ax.set_title("", fontsize="medium")

    def _draw_gaps(self, ax: Axes, names: Sequence[str]) -> None:
        high = float(np.max(self._curve[1], initial=0.0))
        margin = 0.05 * high or 1.0
        ax.set(xlim=(self._times[0], self._times[-1]), ylim=(-margin, high + margin))
        ax.set(xlabel="time $t$ (s)", ylabel="gaps $g_i$")
        ax.axhline(0.0, color=WALL, lw=1)
        colours = [PALETTE[k % len(PALETTE)] for k in range(len(names))] or [BLUE]
        self._curves = [
            ax.plot([], [], color=colour, label=name)[0]
            for name, colour in zip(names, colours, strict=False)
        ]
        if names:
            legend(ax)

    def show(self, number: int) -> list[Any]:
        """Draw one picture."""
        walls = self._walls[number] if self._walls else []
        artists: list[Any] = [*self._marks, *self._stone]
        lines = zip(artists, (*self._bodies[number], *walls), strict=True)
        for artist, line in lines:
            move = artist.set_data_3d if self._sides == 3 else artist.set_data
            move(*(np.atleast_1d(part) for part in line))
        t, past = self._times[number], self._curve[0] <= self._times[number]
        for curve, gap, here in zip(
            self._curves, self._curve[1].T, self._gaps[number], strict=True
        ):
            curve.set_data(np.append(self._curve[0][past], t), np.append(gap[past], here))
        self._clock.set_text(f"$t$ = {t:.2f} s")
        return [*self._marks, *self._stone, *self._curves, self._clock]


def motion_at(run: MechanicalTrajectory, times: Array) -> tuple[Array, Array]:
    """Return coordinates and gaps; between samples on lines if the run keeps no motion."""
    if run._path is not None:
        there = run.resample(times)
        return there.q, there.gaps

    def between(columns: Array) -> Array:
        return np.array([[np.interp(t, run.t, c) for c in columns.T] for t in times])

    return between(run.q), between(run.gaps)


def coordinate_points(t: float, q: Array) -> list[tuple[Any, Any]]:
    """Return the system as points: the plane of two coordinates, else each over its number."""
    if len(q) == 2:
        return [(q[0], q[1])]
    return [(float(k), value) for k, value in enumerate(q)]


ENDS = np.array([-1.0, 1.0])
FAR = 1e3
"""Length of a wall in the plane, as a multiple of the distance of all positions."""


def linear_walls(run: MechanicalTrajectory) -> Lines | None:
    """Return where gaps close that are linear in the coordinates, None if that is not known.

    In the plane of two coordinates these are lines, else a gap of one coordinate is a short line
    below its point. Gaps with varying gradients or several coordinates are left out.
    """
    model = run._model
    if model is None or not len(run.t) or not run.gap_names:
        return None

    def at(t: float, q: Array) -> tuple[Array, Array]:
        here = model.layout.read(model.evaluate(t, q, np.zeros_like(q)))
        return here.gaps, here.gradients

    q, few = run.q, np.linspace(0, len(run.t) - 1, 9).astype(int)
    gradients = np.array([at(float(run.t[k]), q[k])[1] for k in few])
    same = np.all(np.ptp(gradients, axis=0) == 0.0, axis=1)
    alone = np.count_nonzero(gradients[0], axis=1) == 1
    plane = q.shape[1] == 2
    chosen = np.flatnonzero(same & (np.any(gradients[0] != 0.0, axis=1) if plane else alone))
    reach = FAR * (float(np.ptp(q)) or 1.0)

    def walls(t: float, now: Array) -> list[tuple[Any, Any]]:
        values, normals = at(t, now)
        lines = []
        for i in chosen:
            n = normals[i]
            foot = now - values[i] * n / (n @ n)
            if plane:
                along = reach * np.array([-n[1], n[0]]) / np.linalg.norm(n)
                lines.append(((foot[0] + along[0] * ENDS), (foot[1] + along[1] * ENDS)))
            else:
                k = int(np.flatnonzero(n)[0])
                lines.append((k + 0.3 * ENDS, np.full(2, foot[k])))
        return lines

    return walls


def point_label(names: Sequence[str], axis: int) -> str:
    """Return the label of an axis of `coordinate_points`."""
    if len(names) == 2:
        return names[axis]
    return "coordinates" if axis else "number"


# The motion as a video.

FRAMES = 20_000
"""Largest number of frames of a video."""


@hinted("animate")
def animate(
    run: Trajectory | ClosedLoop | MechanicalTrajectory,
    *,
    bodies: Lines | None = None,
    walls: Lines | None = None,
    shapes: Mapping[str, Any] | None = None,
    speed: float = 1.0,
    fps: float = 25.0,
    figure: Figure | None = None,
) -> FuncAnimation:
    """Animate a run: the mass above its wall, and its position over time.

    A closed loop is shown with its reference, a moving wall moves. Of a mechanical system the
    configuration is shown, with its gaps as they are drawn over time.

    Parameters
    ----------
    run : Trajectory, ClosedLoop or MechanicalTrajectory
        The run.
    bodies, walls : callable, optional
        Lines of the bodies of a mechanical system and of the walls: functions of time and
        coordinates that return a list of lines, each ``(x, y)`` or, in space, ``(x, y, z)``,
        numbers or arrays of points. By default free bodies of a `Tree` are wireframes. Of other
        systems two coordinates are those of a point, more are points side by side, and walls are
        where gaps that are linear in the coordinates close.
    shapes : dict, optional
        Shapes of free bodies and of the world by name, as `Tree` has them (`zivi.mechanics.Ball`,
        `Box`, `Capsule`, `Plane`). Without them a free body is the axes of its frame. Planes
        farther away than five times the size of the motion are left out.
    speed : float
        Seconds of the motion in a second of the animation, > 0.
    fps : float
        Frames a second, > 0.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Keep it in a variable while it is shown. ``.save("ball.gif")`` writes it,
        ``.to_jshtml()`` shows it in a notebook.

    Raises
    ------
    TypeError
        If `bodies` or `walls` is given for a mass above a wall, or `shapes` for a system without
        free bodies.
    ValueError
        If `speed` or `fps` is not positive, the run has fewer than two samples, or the animation
        would have more than 20,000 frames.

    See Also
    --------
    zivi.plot.configuration : the path without time.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> video = zivi.plot.animate(zivi.simulate(ball, (0, 0.2), (0.1, 0)), fps=10)
    >>> video.to_jshtml().strip()[:5]  # in a notebook; video.save("ball.gif") writes a file
    '<link'

    A pendulum next to a wall:

    >>> pendulum = zivi.MechanicalSystem(
    ...     mass=0.25,
    ...     force=lambda t, q, qdot: [-4.9 * np.sin(q[0])],
    ...     gaps=zivi.LinearGap([1]),
    ...     e=0.6,
    ... )
    >>> sol = zivi.simulate(pendulum, (0, 0.3), ([0.8], [0.0]))
    >>> video = zivi.plot.animate(
    ...     sol,
    ...     bodies=lambda t, q: [([0, 0.5 * np.sin(q[0])], [0, -0.5 * np.cos(q[0])])],
    ...     walls=lambda t, q: [([0, 0], [-0.6, -0.4])],
    ...     fps=10,
    ... )
    >>> video.to_jshtml().strip()[:5]
    '<link'

    A box that is thrown on a floor, as a wireframe:

    >>> shapes = {"box": zivi.mechanics.Box([0.1, 0.2, 0.1]), "floor": zivi.mechanics.Plane()}
    >>> tree = zivi.Tree(
    ...     [zivi.mechanics.Body("box", kind="free", mass=1.0, inertia=[0.017, 0.007, 0.017])],
    ...     contacts=[zivi.mechanics.Contact("box", "floor", mu=0.3)],
    ...     shapes=shapes,
    ... )
    >>> sol = zivi.simulate(tree, (0, 0.2), ([0, 0, 1, 1, 0, 0, 0], [1, 0, 0, 1, 2, 0]))
    >>> video = zivi.plot.animate(sol, shapes=shapes, fps=10)
    >>> video.to_jshtml().strip()[:5]
    '<link'
    """
    mechanical = is_mechanical(run)
    for name, lines in (("bodies", bodies), ("walls", walls)):
        if lines is not None and not (mechanical and callable(lines)):
            raise TypeError(f"{name} must be a function (t, q), for a run of a mechanical system")
    if not mechanical:
        check_run("animate", run)
    if shapes is not None and not (mechanical and bodies is None and is_in_space(run)):
        raise TypeError("shapes must be given for a run with free bodies, without bodies")
    times = _frames(run, finite("speed", speed), finite("fps", fps))
    needed("matplotlib.animation", "animations")
    from zivi.plot.video import Video

    where = figure_of(figure, 8.0, 4.0)
    scene: _MassScene | MechanicalScene
    if mechanical:
        system = cast("MechanicalTrajectory", run)
        if bodies is None and is_in_space(run):
            bodies, planes = wireframes(system, shapes)
            walls = walls or planes
        scene = MechanicalScene(system, times, where, bodies, walls)
    else:
        scene = _MassScene(cast("Trajectory | ClosedLoop", run), times, where)
    # laid out once: every picture has the same places
    scene.show(0)
    where.draw_without_rendering()
    where.set_layout_engine("none")
    return Video(scene, len(times), fps)


def _frames(run: Trajectory | ClosedLoop | MechanicalTrajectory, speed: float, fps: float) -> Array:
    for name, value in (("speed", speed), ("fps", fps)):
        if not value > 0.0:
            raise ValueError(f"{name} must be > 0, got {value}")
    if len(run.t) < 2:
        raise ValueError("the run must have at least two samples to animate")
    start, end = float(run.t[0]), float(run.t[-1])
    pictures = 1 + math.ceil((end - start) * fps / speed)
    if pictures > FRAMES:
        raise ValueError(
            f"the animation would have {pictures} frames, at most {FRAMES}: speed must be larger "
            "or fps smaller"
        )
    times: Array = np.minimum(start + speed / fps * np.arange(pictures), end)
    return times


class _MassScene:
    """The mass and its wall on the left, its position over time on the right."""

    def __init__(self, run: Trajectory | ClosedLoop, times: Array, figure: Figure) -> None:
        self.figure, self._times = figure, times
        curve = line_of(run)
        fixed, _ = in_frame(run, "fixed", curve.t, curve.x, curve.xdot)
        self._curve = curve.t, fixed
        wall = wall_of(run)
        self._wall = np.zeros_like(times) if wall is None else wall(times)[0]
        self._bodies = {BLUE: np.interp(times, *self._curve)}
        if has_reference(run):
            self._bodies[GREEN] = np.interp(times, run.t, run.x_ref)
        left, right = figure.subplots(1, 2, width_ratios=(1, 3), sharey=True)
        self._draw_bodies(left)
        self._draw_curves(right)

    def _draw_bodies(self, ax: Axes) -> None:
        ax.set(xlim=(-1, 1), xticks=[], ylabel="position (m)")
        (self._floor,) = ax.plot([-1, 1], [0, 0], color=WALL, lw=3.0, solid_capstyle="butt")
        # the mass is a point: the disc is centred on it
        self._marks = [
            ax.plot([0.0], [0.0], marker="o", ms=14, color=colour, fillstyle=fill, ls="")[0]
            for colour, fill in zip(self._bodies, ("full", "none"), strict=False)
        ]

    def _draw_curves(self, ax: Axes) -> None:
        heights = np.concatenate([self._curve[1], self._wall, *self._bodies.values()])
        low, high = float(np.min(heights)), float(np.max(heights))
        margin = 0.08 * (high - low) or 1.0
        ax.set(xlim=(self._times[0], self._times[-1]), ylim=(low - margin, high + margin))
        ax.set_xlabel("time $t$ (s)")
        ax.plot(self._times, self._wall, color=WALL, lw=1.0)
        if GREEN in self._bodies:
            ax.plot(self._times, self._bodies[GREEN], color=GREEN, ls="--", lw=1.0)
        (self._line,) = ax.plot([], [], color=BLUE)
        self._clock = ax.set_title("", fontsize="medium")

    def show(self, number: int) -> list[Any]:
        """Draw one picture."""
        t = self._times[number]
        for mark, heights in zip(self._marks, self._bodies.values(), strict=True):
            mark.set_data([0.0], [heights[number]])
        self._floor.set_ydata([self._wall[number]] * 2)
        past, here = self._curve[0] <= t, self._bodies[BLUE][number]
        drawn = [values[past] for values in self._curve]
        self._line.set_data(np.append(drawn[0], t), np.append(drawn[1], here))
        self._clock.set_text(f"$t$ = {t:.2f} s")
        return [*self._marks, self._floor, self._line, self._clock]
