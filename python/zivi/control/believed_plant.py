"""A copy of a plant as a controller believes it to be, driven period by period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.simulation.mechanical_run import mechanism
from zivi.system.mechanism import MechanicalSystem

__all__ = ["BelievedPlant"]


class BelievedPlant:
    """A system that moves under held controls, with its impacts and contacts.

    Parameters
    ----------
    system : MechanicalSystem
        What the plant is believed to be.
    h : float
        Length of a period (s).
    n : int
        Number of coordinates.
    tasks : MechanicalSystem, optional
        A system whose gaps are functions of the coordinates that may follow a reference.
    """

    def __init__(
        self, system: MechanicalSystem, h: float, n: int, tasks: MechanicalSystem | None = None
    ) -> None:
        self.h, self.model = h, system.model(n)
        self.tasks = None if tasks is None else tasks.model(n)
        controls = system.control_inputs(np.zeros(n))
        self.r, inputs = controls.r, controls.spec()
        functions = None
        if tasks is not None and self.tasks is not None:
            functions = mechanism(tasks, self.tasks)
        self.core = _zivi.Believed(mechanism(system, self.model), inputs, h, functions)

    def moved(
        self, t: float, q: Array, qdot: Array, controls: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Give coordinates, velocities and contacts after as many periods as there are controls.

        Parameters
        ----------
        t : float
            Time at the start (s).
        q, qdot : ndarray
            The state there, shape (n,); no gap may be below 0.
        controls : ndarray
            The controls, shape (d, r).
        """
        q, qdot, closed = self.core.moved(t, q, qdot, controls)
        return q, qdot, np.array(closed, dtype=bool)

    def onto(
        self, t: float, q: Array, qdot: Array, closed: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Move a state, M-orthogonally, to where contacts are closed and no gap is below 0."""
        return self.core.onto(t, q, qdot, closed)
