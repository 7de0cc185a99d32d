"""The motion as a film."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from zivi.base.check import finite
from zivi.base.extras import needed
from zivi.base.habits import hinted
from zivi.plot.curve import line_of
from zivi.plot.look import BLUE, GREEN, WALL, figure_of, has_reference, in_frame, wall_of
from zivi.plot.mechanical_animation import Lines, MechanicalScene
from zivi.plot.mechanics import is_mechanical
from zivi.plot.runs import check_run

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.base.check import Array
    from zivi.control.closed_loop import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory

FRAMES = 20_000
"""Most pictures of a film."""


@hinted("animate")
def animate(
    run: Trajectory | ClosedLoop | MechanicalTrajectory,
    *,
    bodies: Lines | None = None,
    walls: Lines | None = None,
    speed: float = 1.0,
    fps: float = 25.0,
    figure: Figure | None = None,
) -> FuncAnimation:
    """Animate a run: the mass above its wall, and its position as it is drawn over time.

    A closed loop is shown with its reference, a moving wall moves. Of a mechanical system the
    configuration is shown, with its gaps as they are drawn over time.

    Parameters
    ----------
    run : Trajectory, ClosedLoop or MechanicalTrajectory
        The run.
    bodies, walls : callable, optional
        How a mechanical system looks, and what it hits: functions of the time and the coordinates
        that return a list of lines, each ``(x, y)``, numbers or arrays of points. By default two
        coordinates are those of a point, others are points side by side, and walls are where gaps
        that are linear in the coordinates close.
    speed : float
        Seconds of the motion in a second of the film, > 0.
    fps : float
        Pictures a second, > 0.
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
        If `bodies` or `walls` is given for a mass above a wall.
    ValueError
        If `speed` or `fps` is not positive, the run has fewer than two samples, or the film
        would have more than 20,000 pictures.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> film = zivi.plot.animate(zivi.simulate(ball, (0, 0.2), (0.1, 0)), fps=10)
    >>> film.to_jshtml().strip()[:5]  # in a notebook; film.save("ball.gif") writes a file
    '<link'

    A pendulum beside a wall:

    >>> pendulum = zivi.MechanicalSystem(
    ...     mass=0.25,
    ...     force=lambda t, q, qdot: [-4.9 * np.sin(q[0])],
    ...     gaps=zivi.LinearGap([1]),
    ...     e=0.6,
    ... )
    >>> sol = zivi.simulate(pendulum, (0, 0.3), ([0.8], [0.0]))
    >>> film = zivi.plot.animate(
    ...     sol,
    ...     bodies=lambda t, q: [([0, 0.5 * np.sin(q[0])], [0, -0.5 * np.cos(q[0])])],
    ...     walls=lambda t, q: [([0, 0], [-0.6, -0.4])],
    ...     fps=10,
    ... )
    >>> film.to_jshtml().strip()[:5]
    '<link'
    """
    mechanical = is_mechanical(run)
    for name, lines in (("bodies", bodies), ("walls", walls)):
        if lines is not None and not (mechanical and callable(lines)):
            raise TypeError(f"{name} must be a function (t, q), for a run of a mechanical system")
    if not mechanical:
        check_run("animate", run)
    times = _times(run, finite("speed", speed), finite("fps", fps))
    needed("matplotlib.animation", "animations")
    from zivi.plot.film import Film

    where = figure_of(figure, 8.0, 4.0)
    scene: _Scene | MechanicalScene
    if mechanical:
        system = cast("MechanicalTrajectory", run)
        scene = MechanicalScene(system, times, where, bodies, walls)
    else:
        scene = _Scene(cast("Trajectory | ClosedLoop", run), times, where)
    # laid out once: every picture has the same places
    scene.show(0)
    where.draw_without_rendering()
    where.set_layout_engine("none")
    return Film(scene, len(times), fps)


def _times(run: Trajectory | ClosedLoop | MechanicalTrajectory, speed: float, fps: float) -> Array:
    for name, value in (("speed", speed), ("fps", fps)):
        if not value > 0.0:
            raise ValueError(f"{name} must be > 0, got {value}")
    if len(run.t) < 2:
        raise ValueError("the run has fewer than two samples: there is no motion to show")
    start, end = float(run.t[0]), float(run.t[-1])
    pictures = 1 + math.ceil((end - start) * fps / speed)
    if pictures > FRAMES:
        raise ValueError(
            f"the film would have {pictures} pictures, at most {FRAMES}: speed must be larger "
            "or fps smaller"
        )
    times: Array = np.minimum(start + speed / fps * np.arange(pictures), end)
    return times


class _Scene:
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
