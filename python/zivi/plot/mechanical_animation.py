"""The pictures of a film of a mechanical system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from zivi.plot.look import BLUE, PALETTE, WALL, legend
from zivi.plot.mechanical_curve import drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.base.check import Array
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

__all__ = ["Lines", "MechanicalScene"]

Lines: TypeAlias = Callable[[float, "Array"], Sequence[tuple[Any, Any]]]
"""Time and coordinates to what is seen: pairs of x and y of the points of each line."""


class MechanicalScene:
    """The configuration on the left, the gaps over time on the right, as they come.

    Parameters
    ----------
    run : MechanicalTrajectory
        The run.
    times : ndarray
        Times of the pictures.
    figure : matplotlib.figure.Figure
        Where to draw.
    bodies, walls : callable or None
        Lines of the bodies and of what they hit.
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
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        self._bodies = self._lines("bodies", bodies or points)
        if walls is None and bodies is None:
            walls = linear_walls(run)
        self._walls = [] if walls is None else self._lines("walls", walls)
        self._draw_bodies(left)
        self._draw_gaps(right, run.gap_names)

    def _lines(self, name: str, lines: Lines) -> list[list[Array]]:
        """Evaluate lines at all times: of each picture, each line, x and y."""
        found = []
        for t, q in zip(self._times, self._q, strict=True):
            given = lines(float(t), q.copy())
            try:
                found.append([np.array(np.broadcast_arrays(x, y), float) for x, y in given])
            except (TypeError, ValueError):
                raise ValueError(
                    f"{name} must return pairs of x and y, numbers or arrays of one length, "
                    f"got {given!r:.80} at t = {t:g}"
                ) from None
            if len(found[-1]) != len(found[0]):
                raise ValueError(
                    f"{name} must return as many lines at all times, got {len(found[-1])} at "
                    f"t = {t:g} and {len(found[0])} before"
                )
        return found

    def _draw_bodies(self, ax: Axes) -> None:
        every = [line.reshape(2, -1) for picture in self._bodies for line in picture]
        low, high = (f(np.hstack(every), axis=1) for f in (np.min, np.max))
        middle, half = (low + high) / 2, 0.6 * max(*(high - low), 1e-9)
        ax.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]))
        if self._given:
            ax.set_aspect("equal")
        else:
            ax.set(xlabel=point_label(self._names, 0), ylabel=point_label(self._names, 1))
        self._stone = [ax.plot([], [], color=WALL, lw=3)[0] for _ in (self._walls or [[]])[0]]
        self._marks = [
            ax.plot([], [], color=PALETTE[k % len(PALETTE)], marker="o", ms=6, lw=2)[0]
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
        for mark, (x, y) in zip(self._marks, self._bodies[number], strict=True):
            mark.set_data(np.atleast_1d(x), np.atleast_1d(y))
        walls = self._walls[number] if self._walls else []
        for stone, (x, y) in zip(self._stone, walls, strict=True):
            stone.set_data(np.atleast_1d(x), np.atleast_1d(y))
        t, past = self._times[number], self._curve[0] <= self._times[number]
        for curve, gap, here in zip(
            self._curves, self._curve[1].T, self._gaps[number], strict=True
        ):
            curve.set_data(np.append(self._curve[0][past], t), np.append(gap[past], here))
        self._clock.set_text(f"$t$ = {t:.2f} s")
        return [*self._marks, *self._stone, *self._curves, self._clock]


def motion_at(run: MechanicalTrajectory, times: Array) -> tuple[Array, Array]:
    """Give coordinates and gaps; between samples on lines if the run keeps no motion."""
    if run._path is not None:
        there = run.resample(times)
        return there.q, there.gaps

    def between(columns: Array) -> Array:
        return np.array([[np.interp(t, run.t, c) for c in columns.T] for t in times])

    return between(run.q), between(run.gaps)


def points(t: float, q: Array) -> list[tuple[Any, Any]]:
    """Give the system as points: the plane of two coordinates, else each over its number."""
    if len(q) == 2:
        return [(q[0], q[1])]
    return [(float(k), value) for k, value in enumerate(q)]


ENDS = np.array([-1.0, 1.0])
FAR = 1e3
"""Length of a wall in the plane, as a multiple of the distance of all positions."""


def linear_walls(run: MechanicalTrajectory) -> Lines | None:
    """Return where gaps close that are linear in the coordinates, None if that is not known.

    In the plane of two coordinates these are lines, else a gap of one coordinate is a short line
    below its point. Gaps with gradients that change, or of several coordinates, are left out.
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
    """Name an axis of `points`."""
    if len(names) == 2:
        return names[axis]
    return "coordinates" if axis else "number"
