"""A copy of a plant as a controller believes it to be, driven period by period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.simulation.mechanical_run import mechanism
from zivi.simulation.methods import SwitchedRK
from zivi.system.gap_coordinates import GapKinetics
from zivi.system.mechanism import MechanicalSystem, Model

__all__ = ["BelievedPlant", "onto"]

METHOD = SwitchedRK(rtol=1e-9, atol=1e-12)
PROJECTIONS = 4
NONE = np.empty(0)


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
    """

    def __init__(self, system: MechanicalSystem, h: float, n: int) -> None:
        self.h, self.model = h, system.model(n)
        self._mechanism = mechanism(system, self.model)
        self._inputs = system.control_inputs(np.zeros(n)).spec()

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
        times: Array = t + self.h * np.arange(len(controls) + 1, dtype=np.float64)
        record = _zivi.simulate_mechanical_loop(
            self._mechanism,
            self._inputs,
            METHOD._core,
            times,
            times[1:-1],
            _zivi.Configuration(q, qdot),
            controls[0],
            lambda k, t, q, qdot: controls[k],
            dense=False,
            one_step=True,
        )
        run = record.run
        return run.q[-1], run.qdot[-1], run.contacts[-1]


def onto(
    model: Model, t: float, q: Array, qdot: Array, closed: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Move a state, M-orthogonally, to where contacts are closed and no gap is below 0."""
    q, qdot = q.copy(), qdot.copy()
    for _ in range(PROJECTIONS):
        here = model.layout.read(model.evaluate(t, q, qdot))
        moved = closed | (here.gaps < 0.0)
        if not moved.any():
            return q, qdot
        kinetics = GapKinetics.of(here, qdot)
        mobility, D = kinetics.mobility[:, moved], kinetics.D[np.ix_(moved, moved)]
        if not np.any(here.gaps[moved]):
            break
        q = q - mobility @ np.linalg.solve(D, here.gaps[moved])
    if closed.any():
        here = model.layout.read(model.evaluate(t, q, qdot))
        kinetics = GapKinetics.of(here, qdot)
        mobility, D = kinetics.mobility[:, closed], kinetics.D[np.ix_(closed, closed)]
        qdot = qdot - mobility @ np.linalg.solve(D, kinetics.gdot[closed])
    return q, qdot
