"""Pictures of results: one run, one closed loop, one study."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi import plot
from zivi.base.check import Array
from zivi.files.kinds import FileError
from zivi.plot.drawing import legend
from zivi.simulation.trajectory import Trajectory
from zivi.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.control.loop_run import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

PANELS = 9
"""Results of a study that are drawn at most."""
LINES = 6
"""Lines that are drawn in one panel at most."""
NUMERIC = "biuf"
"""Kinds of arrays of numbers."""


def run_picture(run: Trajectory | ClosedLoop | MechanicalTrajectory) -> Figure:
    """Draw one run."""
    if not isinstance(run, Trajectory):
        return plot.overview(run)
    figure = _new_figure((9.0, 6.0))
    axes = figure.subplots(2, 2)
    plot.position(run, axes[0, 0])
    plot.velocity(run, axes[0, 1])
    plot.lifted(run, axes[1, 0])
    plot.phase_plane(run, axes[1, 1], coordinates="physical")
    return figure


def study_picture(study: Study) -> Figure:
    """Draw the results of a study over its parameters: lines, maps, or points."""
    dataset = study.dataset
    dims = dataset["status"].dims
    names = [
        str(name)
        for name, it in dataset.data_vars.items()
        if it.dims == dims and it.dtype.kind == "f"
    ][:PANELS]
    if not names:
        raise FileError("the study does not contain numbers over its parameters")
    columns = math.ceil(math.sqrt(len(names)))
    lines = math.ceil(len(names) / columns)
    figure = _new_figure((1.0 + 4.0 * columns, 0.5 + 3.2 * lines))
    for name, ax in zip(names, figure.subplots(lines, columns, squeeze=False).flat, strict=False):
        _draw(study, name, ax)
    for ax in figure.axes[len(names) :]:
        if not ax.has_data():
            ax.set_axis_off()
    return figure


def _new_figure(size: tuple[float, float]) -> Figure:
    import matplotlib.pyplot as plt

    return plt.figure(figsize=size, layout="constrained")


def _draw(study: Study, name: str, ax: Axes) -> None:
    result = study.dataset[name]
    if result.dims == ("point",) or result.ndim > 2:
        _draw_points(study, name, ax)
    elif result.ndim == 1 or min(result.shape) <= LINES:
        _draw_lines(study, name, ax)
    else:
        _map(study, name, ax)


def _draw_lines(study: Study, name: str, ax: Axes) -> None:
    """Draw a result over the parameter with more values, one line for each value of the other."""
    result = study.dataset[name]
    along = max(result.dims, key=lambda dim: result.sizes[dim])
    x = result[along].values
    (other,) = set(result.dims) - {along} or {None}
    values = [None] if other is None else result[other].values
    colours = _colours(len(values))
    for number, (value, colour) in enumerate(zip(values, colours, strict=True)):
        line = result if other is None else result.isel({other: number})
        label = None if other is None else f"{other} = {_value_text(value)}"
        ax.plot(x, line.values, ".-", color=colour, label=label)
    if other is not None:
        legend(ax)
    if _spreads(x):
        ax.set_xscale("log")
    ax.set(xlabel=_axis_label(study, str(along)), ylabel=_axis_label(study, name))


def _colours(number: int) -> list[Any]:
    """Return colours that go from dark to light."""
    import matplotlib as mpl

    return (
        [plot.BLUE] if number == 1 else list(mpl.colormaps["cividis"](np.linspace(0, 0.9, number)))
    )


def _value_text(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def _map(study: Study, name: str, ax: Axes) -> None:
    result = study.dataset[name]
    down, along = result.dims
    x, y = result[along].values, result[down].values
    values = np.ma.masked_invalid(result.values)
    mesh = ax.pcolormesh(_edges(x), _edges(y), values, shading="flat")
    if _spreads(x):
        ax.set_xscale("log")
    if _spreads(y):
        ax.set_yscale("log")
    if x.dtype.kind not in NUMERIC:
        ax.set_xticks(range(len(x)), [str(value) for value in x])
    if y.dtype.kind not in NUMERIC:
        ax.set_yticks(range(len(y)), [str(value) for value in y])
    ax.set(xlabel=_axis_label(study, str(along)), ylabel=_axis_label(study, str(down)))
    _bar(ax, mesh, _axis_label(study, name))


def _edges(values: Any) -> Array:
    """Return the edges of cells around values, in the scale of their axis."""
    if values.dtype.kind not in NUMERIC:
        return np.arange(-0.5, len(values), dtype=np.float64)
    scaled = np.log(values) if _spreads(values) else values.astype(float)
    middles = 0.5 * (scaled[:-1] + scaled[1:])
    edges = np.concatenate([[2 * scaled[0] - middles[0]], middles, [2 * scaled[-1] - middles[-1]]])
    return (np.exp(edges) if _spreads(values) else edges).astype(np.float64)


def _spreads(values: Any) -> bool:
    """Whether values are positive and of several powers of ten."""
    if values.dtype.kind not in NUMERIC:
        return False
    return bool(np.min(values) > 0 and np.max(values) > 30 * np.min(values))


def _draw_points(study: Study, name: str, ax: Axes) -> None:
    """Draw a result over the first parameter; the second is the colour."""
    dataset = study.dataset
    parameters = [str(it) for it in dataset.coords][:2]
    columns = [dataset[it].broadcast_like(dataset["status"]).values.ravel() for it in parameters]
    colour: dict[str, Any] = {"color": plot.BLUE}
    if len(columns) == 2:
        numeric = columns[1].dtype.kind in NUMERIC
        colour = {"c": columns[1] if numeric else np.unique(columns[1], return_inverse=True)[1]}
    drawn = ax.scatter(columns[0], dataset[name].values.ravel(), s=12, **colour)
    if _spreads(columns[0]):
        ax.set_xscale("log")
    ax.set(xlabel=_axis_label(study, parameters[0]), ylabel=_axis_label(study, name))
    if len(columns) == 2:
        _bar(ax, drawn, _axis_label(study, parameters[1]))


def _bar(ax: Axes, drawn: Any, label: str) -> None:
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(drawn, ax=ax, label=label)


def _axis_label(study: Study, name: str) -> str:
    unit = study.dataset[name].attrs.get("units", "1")
    return name if unit == "1" else f"{name} ({unit})"
