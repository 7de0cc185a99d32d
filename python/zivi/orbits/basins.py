"""Basins of attraction: which initial states settle on what."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, real_array, whole
from zivi.base.table import Field, Table, Tabulated
from zivi.orbits.attractor import TOLERANCE, Attractor, classify
from zivi.orbits.cells import settle_cells
from zivi.orbits.diagram import USUAL
from zivi.orbits.flights import period_of
from zivi.orbits.orbit import PeriodicOrbit
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import check_newton

__all__ = ["Basins", "basins"]

NEAR = 100.0
"""Runs are of one attractor if they differ by less than so many times the tolerance."""
FIELDS: dict[str, Field] = {
    "label": (("xdot0", "x0"), "", "number of the attractor"),
    "border": (("xdot0", "x0"), "", "whether a neighbour settles on something else"),
    "grazing": (("xdot0", "x0"), "", "whether a grazing decided"),
    "kind": ("attractor", "", "kind of the attractor"),
    "multiple": ("attractor", "", "after how many periods it repeats"),
}
COORDS: dict[str, Field] = {
    "x0": ("x0", "m", "initial distance"),
    "xdot0": ("xdot0", "m/s", "initial velocity"),
}
"""Dimensions, unit and meaning of what is in the dataset."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Basins(Tabulated):
    """Which initial states settle on which attractor.

    Attributes
    ----------
    x0s, v0s : ndarray
        Initial distances (m) and velocities (m/s).
    label : ndarray of int
        Of shape (len(v0s), len(x0s)): the number of the attractor.
    attractors : list of Attractor
        Those given first, then those that were found.
    grazing : ndarray of bool
        Cells of which the run passed a grazing: an impact, or the want of one, that the tolerances
        decided. Their labels are those of the runs as computed, and uncertain.
    border : ndarray of bool
        Cells with a neighbour that settles on something else, and grazing ones.
    """

    x0s: Array
    v0s: Array
    label: NDArray[np.int64]
    attractors: list[Attractor]
    grazing: NDArray[np.bool_]

    @property
    def border(self) -> NDArray[np.bool_]:
        """Cells with a neighbour that settles on something else, and grazing ones."""
        label, edge = self.label, self.grazing.copy()
        across, along = label[1:] != label[:-1], label[:, 1:] != label[:, :-1]
        edge[1:] |= across
        edge[:-1] |= across
        edge[:, 1:] |= along
        edge[:, :-1] |= along
        return edge

    @property
    def shares(self) -> Array:
        """The part of the cells that settles on each attractor."""
        counts = np.bincount(self.label.ravel(), minlength=len(self.attractors))
        return np.asarray(counts / self.label.size, np.float64)

    def __repr__(self) -> str:
        pairs = zip(self.attractors, self.shares, strict=True)
        told = ", ".join(f"{it.kind} x{it.multiple}: {share:.1%}" for it, share in pairs)
        return f"<Basins of {self.label.size} cells: {told}>"

    def _table(self) -> Table:
        """Tell the numbers of the attractors over states, these over ``attractor``."""
        values = {
            "kind": [it.kind for it in self.attractors],
            "multiple": [it.multiple for it in self.attractors],
            "x0": self.x0s,
            "xdot0": self.v0s,
        }
        return Table("Basins of attraction", FIELDS, COORDS, values, rows="attractor")


def basins(
    system: ImpactSystem,
    x0s: ArrayLike,
    v0s: ArrayLike,
    attractors: Sequence[PeriodicOrbit] | None = None,
    *,
    transient: int = 200,
    keep: int = 32,
    period: float | None = None,
    tolerance: float = TOLERANCE,
    method: SwitchedRK = USUAL,
    threads: int | None = None,
    progress: bool | None = None,
) -> Basins:
    """Simulate from a grid of initial states, and tell what each settles on.

    Motions are told apart by their kind, after how many periods they repeat, and the phases and
    speeds of their impacts. A motion that rests is one class for each phase of its lift-off. Runs
    whose states at the start of a period differ by less than the tolerances are one from there on.
    A cell of which a grazing decided is marked.

    Parameters
    ----------
    system : ImpactSystem
        A system with a periodic excitation. Forces that need no interpreter run as a batch.
    x0s, v0s : array_like
        Initial distances, >= 0 (m), and velocities (m/s), at the start of a period.
    attractors : sequence of PeriodicOrbit, optional
        Known orbits: they get the first numbers.
    transient, keep : int
        Periods that are not looked at, and that are.
    period : float, optional
        The period of the excitation (s), by default from the system.
    tolerance : float
        How well a periodic motion repeats, relative to the period and the largest speed.
    method : SwitchedRK
        Tolerances.
    threads : int, optional
        Threads of the batch; by default as many as the machine runs at once.
    progress : bool, optional
        Show a progress bar; by default on a terminal only.

    Returns
    -------
    Basins
        The number of the attractor of each cell, and whether a grazing decided it.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> found = zivi.basins(
    ...     zivi.ImpactSystem(table, e=0.5), np.linspace(0, 2, 6), np.linspace(-2, 2, 5))
    >>> sorted({it.kind for it in found.attractors})  # both are stable
    ['impacting', 'resting']
    """
    check_newton(system)
    across, along = (real_array(n, v).ravel() for n, v in (("x0s", x0s), ("v0s", v0s)))
    if not len(across) or not len(along) or np.any(across < 0.0):
        raise ValueError("x0s and v0s must hold numbers, those of x0s >= 0")
    if whole("transient", transient) < 0 or whole("keep", keep) < 2:
        raise ValueError(f"transient must be >= 0 and keep >= 2, got {transient} and {keep}")
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be > 0, got {tolerance}")
    length = period_of(system, period)
    known = [_of_orbit(orbit) for orbit in attractors or ()]
    states = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    cells = settle_cells(system, states, length, transient, keep, method, threads, progress)
    label = np.empty(len(cells.settled), dtype=np.int64)
    # attractors are numbered in the order of the cells
    for i in np.argsort(np.unique(cells.which, return_index=True)[1]):
        mine = classify(system, cells.settled[i], length, keep, tolerance)
        same = (j for j, other in enumerate(known) if mine.is_same(other, NEAR * tolerance))
        label[i] = next(same, len(known))
        if label[i] == len(known):
            known.append(mine)
    shape = (len(along), len(across))
    label, grazing = label[cells.which].reshape(shape), cells.grazing.reshape(shape)
    return Basins(across, along, label, known, grazing)


def _of_orbit(orbit: PeriodicOrbit) -> Attractor:
    if not isinstance(orbit, PeriodicOrbit):
        raise TypeError(f"attractors must be zivi.PeriodicOrbit, got {orbit!r}")
    rows = np.column_stack([orbit.impacts["t"] / orbit.period % 1.0, orbit.impacts["u"]])
    if orbit.kind == "resting":
        return Attractor("resting", orbit.multiple, rows[:1])
    return Attractor(orbit.kind, orbit.multiple, rows[np.argsort(rows[:, 0])])
