"""Points of a Poincare section."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from zivi.base.check import finite, integer
from zivi.plot.look import BLUE, axes_of, labels, next_colour
from zivi.plot.runs import check_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.base.check import Array
    from zivi.simulation.trajectory import Trajectory


def poincare(
    sol: Trajectory,
    period: float,
    ax: Axes | None = None,
    *,
    section: Literal["period", "impacts"] = "period",
    phase: float = 0.0,
    skip: int = 0,
    **line: Any,
) -> Axes:
    r"""Plot the state once a period, or the impacts by their phase.

    Parameters
    ----------
    sol : Trajectory
        A run with dense output.
    period : float
        Period of the excitation, > 0 (s).
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    section : {"period", "impacts"}
        Points :math:`(x, \dot x)` at the times ``phase + k * period``; or the speed after each
        impact over the time since the last of these, as a part of the period. Impacts that the
        run extrapolated are not among them.
    phase : float
        Time of one of the sections (s).
    skip : int
        Points at the start that are left out, >= 0: a transient.
    **line
        Passed to `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If a setting is out of range, or no point is left to draw.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=9.81, amplitude=30.0, omega=25.0)
    >>> sol = zivi.simulate(zivi.ImpactSystem(table, e=0.5), (0, 20), (0.1, 0))
    >>> zivi.plot.poincare(sol, 2 * 3.141592653589793 / 25.0, skip=10).get_ylabel()
    'velocity $\\dot x$ (m/s)'
    """
    by_period = section == "period"
    check_run("poincare", sol, needs="__call__" if by_period else None, of="Trajectory")
    period, phase = finite("period", period), finite("phase", phase)
    if not period > 0.0:
        raise ValueError(f"period must be > 0, got {period}")
    if integer("skip", skip) < 0:
        raise ValueError(f"skip must be >= 0, got {skip}")
    if by_period:
        across, along = _strobe(sol, period, phase)
        named = labels(sol, "wall")
    elif section == "impacts":
        across = np.mod((sol.impacts["t"] - phase) / period, 1.0)
        along = sol.impacts["xdot_after"]
        named = "phase of the impact (1)", "speed after the impact (m/s)"
    else:
        raise ValueError(f"section must be 'period' or 'impacts', got {section!r}")
    if len(across) <= skip:
        raise ValueError(f"the run has {len(across)} points of this section, and skip is {skip}")
    ax = axes_of(ax)
    look: dict[str, Any] = {"color": next_colour(ax, BLUE), "marker": ".", "ms": 3.0, "ls": ""}
    ax.plot(across[skip:], along[skip:], **look | line)
    ax.set(xlabel=named[0], ylabel=named[1])
    return ax


def _strobe(sol: Trajectory, period: float, phase: float) -> tuple[Array, Array]:
    first = math.ceil((sol.t[0] - phase) / period)
    last = math.floor((sol.t[-1] - phase) / period)
    x, xdot = sol(np.clip(phase + period * np.arange(first, last + 1), sol.t[0], sol.t[-1]))
    return x, xdot
