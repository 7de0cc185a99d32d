"""Basins of attraction: which initial states settle on what."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, integer, real_array
from zivi.base.habits import hinted
from zivi.base.table import Field, Table, Tabulated
from zivi.orbits.attractor import TOLERANCE, Attractor, classify
from zivi.orbits.cells import settle_cells
from zivi.orbits.diagram import USUAL
from zivi.orbits.mechanical.cells import open_starts, settle_cells as settle_mechanical_cells
from zivi.orbits.mechanical.family import period_of
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.plan import starts_of
from zivi.orbits.mechanical.settled import attractor_of, classify as classify_mechanical
from zivi.orbits.orbit import PeriodicOrbit
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
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
        Initial distances (m) and velocities (m/s), or the values of the two `axes`.
    label : ndarray of int
        Of shape (len(v0s), len(x0s)): the number of the attractor, -1 where a gap is negative.
    attractors : list of Attractor
        Those given first, then those that were found.
    grazing : ndarray of bool
        Cells of which the run passed a grazing: an impact, or the want of one, that the tolerances
        decided. Their labels are those of the runs as computed, and uncertain. Of a mechanical
        system it is not told.
    border : ndarray of bool
        Cells with a neighbour that settles on something else, and grazing ones.
    axes : (str, str)
        What is varied.
    """

    x0s: Array
    v0s: Array
    label: NDArray[np.int64]
    attractors: list[Attractor]
    grazing: NDArray[np.bool_]
    axes: tuple[str, str] = ("x0", "xdot0")

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
        """The part of the cells, without those of negative gaps, that settles on each attractor."""
        inside = self.label[self.label >= 0]
        counts = np.bincount(inside, minlength=len(self.attractors))
        return np.asarray(counts / max(inside.size, 1), np.float64)

    def __repr__(self) -> str:
        pairs = zip(self.attractors, self.shares, strict=True)
        told = ", ".join(f"{it.kind} x{it.multiple}: {share:.1%}" for it, share in pairs)
        unsure = f", {unsure} cells graze" if (unsure := np.count_nonzero(self.grazing)) else ""
        penetrating = int(np.count_nonzero(self.label < 0))
        unsure += f", {penetrating} cells with a negative gap" if penetrating else ""
        return f"<Basins of {self.label.size} cells: {told}{unsure}>"

    def _table(self) -> Table:
        """Tell the numbers of the attractors over states, these over ``attractor``."""
        values = {
            "kind": [it.kind for it in self.attractors],
            "multiple": [it.multiple for it in self.attractors],
            "x0": self.x0s,
            "xdot0": self.v0s,
        }
        attrs = {} if self.axes == ("x0", "xdot0") else {"axes": list(self.axes)}
        return Table("Basins of attraction", FIELDS, COORDS, values, attrs, rows="attractor")


@hinted("settled")
def basins(
    system: ImpactSystem | MechanicalSystem,
    x0s: ArrayLike,
    v0s: ArrayLike,
    attractors: Sequence[PeriodicOrbit | MechanicalOrbit] | None = None,
    *,
    axes: Sequence[str] | None = None,
    y0: Any = None,
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
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation. Forces that need no interpreter run as a batch.
    x0s, v0s : array_like
        Initial distances, >= 0 (m), and velocities (m/s), at the start of a period; of a mechanical
        system the values of the two `axes`.
    attractors : sequence of PeriodicOrbit or MechanicalOrbit, optional
        Known orbits: they get the first numbers.
    axes : (str, str), optional
        Of a mechanical system the two initial values that are varied, as ``"q0.x"`` or
        ``"qdot0[1]"``; by default those of the first coordinate.
    y0 : (array_like, array_like), optional
        Of a mechanical system ``(q0, qdot0)``, which has the others; by default zeros.
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
    across, along = (real_array(n, v).ravel() for n, v in (("x0s", x0s), ("v0s", v0s)))
    is_mass = not isinstance(system, MechanicalSystem)
    if not len(across) or not len(along) or (is_mass and np.any(across < 0.0)):
        told = ", those of x0s >= 0" if is_mass else ""
        raise ValueError(f"x0s and v0s must hold numbers{told}")
    if integer("transient", transient) < 0 or integer("keep", keep) < 2:
        raise ValueError(f"transient must be >= 0 and keep >= 2, got {transient} and {keep}")
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be > 0, got {tolerance}")
    found = _Found(transient, keep, tolerance, method, threads, progress)
    states = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    known = [_of_orbit(orbit, is_mass) for orbit in attractors or ()]
    if isinstance(system, MechanicalSystem):
        names, starts = starts_of(system, states, axes, y0)
        label, grazing = found.of_mechanism(system, starts, period, known)
    else:
        if axes is not None or y0 is not None:
            raise ValueError("axes and y0 are for a zivi.MechanicalSystem")
        check_newton(system)
        names = ("x0", "xdot0")
        label, grazing = found.of_mass(system, states, period, known)
    shape = (len(along), len(across))
    return Basins(across, along, label.reshape(shape), known, grazing.reshape(shape), names)


Labels = tuple[NDArray[np.int64], NDArray[np.bool_]]
"""The number of the attractor of each state, and which a grazing decided."""


@dataclasses.dataclass(frozen=True)
class _Found:
    """How it is found what the states settle on."""

    transient: int
    keep: int
    tolerance: float
    method: SwitchedRK
    threads: int | None
    progress: bool | None

    def of_mass(
        self, system: ImpactSystem, states: Array, period: float | None, known: list[Attractor]
    ) -> Labels:
        length = period_of(system, period)
        cells = settle_cells(
            system,
            states,
            length,
            self.transient,
            self.keep,
            self.method,
            self.threads,
            self.progress,
        )
        kinds = [classify(system, it, length, self.keep, self.tolerance) for it in cells.settled]
        return self.numbers(kinds, cells.which, known)[cells.which], cells.grazing

    def of_mechanism(
        self, system: MechanicalSystem, states: Array, period: float | None, known: list[Attractor]
    ) -> Labels:
        length = period_of(system, period)
        label = np.full(len(states), -1, dtype=np.int64)
        inside = open_starts(system, states)
        if inside.any():
            settled, which = settle_mechanical_cells(
                system,
                states[inside],
                length,
                self.transient,
                self.keep,
                self.method,
                self.threads,
                self.progress,
            )
            kinds = [classify_mechanical(it, length, self.keep, self.tolerance) for it in settled]
            label[inside] = self.numbers(kinds, which, known)[which]
        return label, np.zeros(len(states), dtype=bool)

    def numbers(
        self, kinds: list[Attractor], which: NDArray[np.int64], known: list[Attractor]
    ) -> NDArray[np.int64]:
        """Give numbers to what was found; what is new is added in the order of the cells."""
        label = np.empty(len(kinds), dtype=np.int64)
        for i in np.argsort(np.unique(which, return_index=True)[1]):
            same = (
                j for j, other in enumerate(known) if kinds[i].is_same(other, NEAR * self.tolerance)
            )
            label[i] = next(same, len(known))
            if label[i] == len(known):
                known.append(kinds[i])
        return label


def _of_orbit(orbit: PeriodicOrbit | MechanicalOrbit, is_mass: bool) -> Attractor:
    if not isinstance(orbit, PeriodicOrbit if is_mass else MechanicalOrbit):
        name = "PeriodicOrbit" if is_mass else "MechanicalOrbit"
        raise TypeError(f"attractors must be zivi.{name}, got {orbit!r}")
    rows = np.column_stack([orbit.impacts["t"] / orbit.period % 1.0, orbit.impacts["u"]])
    if isinstance(orbit, MechanicalOrbit):
        return attractor_of(orbit.kind, orbit.multiple, rows, orbit.impacts["gap"])
    if orbit.kind == "resting":
        return Attractor("resting", orbit.multiple, rows[:1])
    return Attractor(orbit.kind, orbit.multiple, rows[np.argsort(rows[:, 0])])
