"""References that are motions of the system itself, made by forces that decouple its gaps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, finite, not_negative, real
from zivi.control.mechanical_reference import posture_of
from zivi.control.model_based import believed
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.system.mechanism import MechanicalSystem, Model
from zivi.system.partials import Partials

__all__ = ["reference_run"]

EXACT = SwitchedRK(rtol=1e-9, atol=1e-12)

Virtual = Mapping[str, float | Callable[[float], float]]


def reference_run(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Sequence[ArrayLike],
    *,
    virtual: Virtual,
    posture: ArrayLike | Callable[[float], Any] | None = None,
    gains: Sequence[float] = (400.0, 40.0),
    method: SwitchedRK = EXACT,
    tstops: ArrayLike | None = None,
) -> MechanicalTrajectory:
    r"""Simulate a motion of a system that a `GapTracker` can follow exactly.

    Its gaps fall under accelerations of their own and are coupled in impacts only; what impacts
    leave alone is drawn to a posture:

    .. math::

        \ddot g = a + W \lambda, \qquad
        Z \ddot q = Z (\ddot q_n - k_p (q - q_n) - k_d (\dot q - \dot q_n))

    Where an impact on one gap kicks another a reference must have the same kicks: this one has.

    Parameters
    ----------
    system : MechanicalSystem
        The system, with as many independent gaps as it has.
    t_span : (float, float)
        Start and end (s).
    y0 : (array_like, array_like)
        Coordinates and velocities at the start, shape (n,) each.
    virtual : dict
        For each gap its acceleration a: a number, or a function of time (negative: towards
        contact). Times at which one jumps, such as that of a lift-off, belong into `tstops`.
    posture : array_like or callable, optional
        The coordinates :math:`q_n`, or a function of time that gives them, or these with velocities
        and accelerations, shapes (n,), (2, n) or (3, n). By default where the motion starts.
    gains : (float, float)
        :math:`k_p` (1/s^2) and :math:`k_d` (1/s).
    method : SwitchedRK
        How the motion is integrated.
    tstops : array_like, optional
        Times at which an acceleration jumps (s).

    Returns
    -------
    MechanicalTrajectory

    Raises
    ------
    ValueError
        If a gap has no acceleration, or one that is no gap has.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> run = zivi.reference_run(box, (0, 2), ([0.2, 0.5], [0, 0]), virtual={"floor": -4.0})
    >>> round(float(run.zeno.t[0]), 6), run.contacts[-1]  # 3 sqrt(2 0.5/4)
    (1.5, array([ True]))
    """
    own, virtual = believed(system), by_name("virtual", virtual)
    strange = sorted(set(virtual) - set(system.gap_names))
    missing = sorted(set(system.gap_names) - set(virtual))
    if strange or missing:
        raise ValueError(
            f"virtual must have an acceleration for each gap of {system.gap_names}, "
            f"{'lacks ' + repr(missing[0]) if missing else 'has ' + repr(strange[0])}"
        )
    pulls = {
        name: it if callable(it) else finite(f"virtual[{name!r}]", it)
        for name, it in virtual.items()
    }
    start = state_of(y0, own._n)
    kp, kd = (not_negative("gains", it) for it in pair("gains", gains, "(kp, kd)"))
    driven = Decoupled(own, pulls, start[0] if posture is None else posture, (kp, kd))
    return simulate(driven, t_span, start, method, tstops=tstops, samples="steps")


class Decoupled(MechanicalSystem):
    """A system under forces that decouple its gaps.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    pulls : dict
        The acceleration of each gap, a number or a function of time.
    posture : array_like or callable
        As for `reference_run`.
    gains : (float, float)
        Of the posture.
    """

    derived = True

    def __init__(
        self,
        system: MechanicalSystem,
        pulls: Mapping[str, Any],
        posture: Any,
        gains: tuple[float, float],
    ) -> None:
        self._own, self._pulls, self._posture, self._gains = system, pulls, posture, gains
        self._gaps, self._gap_names = system.gaps, system.gap_names
        self._e, self._n, self._coordinates = system.e, system._n, system._coordinates

    def _breaks(self, span: tuple[float, float]) -> Array:
        return self._own._breaks(span)

    def model(self, n: int) -> Model:
        """Give what the extension integrates: the system without friction, under these forces."""
        own = self._own.model(n)
        layout = own.layout
        if layout.p:
            raise ValueError("reference_run takes systems without dry friction")
        names, (kp, kd) = self._gap_names, self._gains

        def evaluate(t: float, q: Array, qdot: Array) -> Array:
            row = own.evaluate(t, q, qdot)
            here = layout.read(row)
            at, along, turning = posture_of(self._posture, t, n)
            wanted = turning - kp * (q - at) - kd * (qdot - along)
            pulls = [
                real(f"virtual[{name!r}]", it(t)) if callable(it) else it
                for name, it in ((name, self._pulls[name]) for name in names)
            ]
            row[n * n : n * n + n] = _zivi.decoupling_force(
                here.mass, here.gradients, here.curvatures, np.array(pulls, np.float64), wanted
            )
            return row

        return Model(layout, _zivi.Model.callable(evaluate), evaluate)

    def partials(self, model: Model) -> Partials:
        """Give no derivatives."""
        return Partials()

    def __getstate__(self) -> dict[str, Any]:
        return {
            "system": self._own,
            "pulls": self._pulls,
            "posture": self._posture,
            "gains": self._gains,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        Decoupled.__init__(self, **state)
