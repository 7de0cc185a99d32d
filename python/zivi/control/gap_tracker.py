"""A controller of mechanical systems: one tracker a gap, the rest at right angles to impacts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, real, real_array, switch
from zivi.control.component import TickStatus, delay_of
from zivi.control.gap_law import Allocation, reach
from zivi.control.mechanical_reference import ReferenceSample
from zivi.control.model_based import ModelBased, Outlook, believed, numbers
from zivi.control.twisting import TwistingTracker
from zivi.simulation.run import pair
from zivi.system.gap_coordinates import GapKinetics
from zivi.system.mechanism import MechanicalSystem

__all__ = ["GapTracker"]

EXACT = (1e-9, 1e-9)
"""What is closed without noise: a gap, and its rate."""
DEVIATIONS = 20.0
"""A gap within so many deviations of its measurement may be closed."""
STEPS = 5.0
"""The same in steps of the sensor."""
PUSHED = 0.8
"""Part of its own press by which the other contacts may push a gap that lands."""
OUT = 5
"""A contact is open after so many measurements beyond that."""


class GapTracker(ModelBased):
    r"""Lets the gaps of a mechanism follow bouncing references through impacts, rest and lift-off.

    With :math:`D = N M^{-1} N^T` and :math:`Z` as in `zivi.mechanics.gap_coordinates`:

    .. math::

        \ddot g = a + D \lambda, \qquad
        Z \ddot q = Z (\ddot q_r - k_p (q - q_r) - k_d (\dot q - \dot q_r))

    where :math:`a_i` is the control of a `TwistingTracker` on gap i, for all of which impacts,
    accumulations and landings are those of one mass; an impact leaves the second line alone.
    Contacts that rest with their reference are held, and pressed with the forces that are asked
    for, :math:`a_A = -D_{AA} \lambda_d`.

    Parameters
    ----------
    system : MechanicalSystem
        What the plant is believed to be, such as ``arm.replace(m2=0.9)``.
    h : float
        Sampling period, > 0 (s).
    gains : dict
        For each gap the gains ``(mu1, mu2)`` of its tracker.
    posture : (float, float)
        :math:`k_p` (1/s^2) and :math:`k_d` (1/s).
    force : dict, optional
        The contact forces :math:`\lambda_d` > 0 by gap, numbers or functions of time. They must
        exceed what the model does not know, :math:`M_i/D_{ii}`; without one a gap is pressed as its
        landing does.
    u_limits : sequence of (float, float), optional
        Range of each control.
    horizon : float
        As for `TwistingTracker`.
    shift : bool
        As for `TwistingTracker`.
    latch : (float, float), optional
        Below which gap and rate a contact that rests with its reference is held; by default
        20 deviations of their noise, which `simulate_closed_loop` tells, or 1e-9 without.
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64: the state is
        predicted as far ahead.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range or a gap without gains; at the first tick, if the controls do not
        reach all gaps: :math:`N M^{-1} B` has not rank m.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> ctl = zivi.GapTracker(box, h=1e-3, gains={"floor": (30, 17)}, force={"floor": 5.0})
    >>> run = zivi.simulate_closed_loop(box, ctl, (0, 1), ([0, 0.3], [0, 0]), reference="rest")
    >>> run.contacts[-1], run.reactions[-1].round(9)
    (array([ True]), array([5.]))
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        h: float,
        gains: Mapping[str, Sequence[float]],
        posture: Sequence[float] = (400.0, 40.0),
        force: Mapping[str, float | Callable[[float], float]] | None = None,
        u_limits: Sequence[Sequence[float]] | None = None,
        horizon: float = 1.0,
        shift: bool = False,
        latch: Sequence[float] | None = None,
        delay: int = 0,
    ) -> None:
        settings: dict[str, Any] = {
            "h": real("h", h),
            "gains": {
                name: pair(f"gains[{name!r}]", it, "(mu1, mu2)") for name, it in gains.items()
            },
            "posture": pair("posture", posture, "(kp, kd)"),
            "force": _forces(force or {}),
            "u_limits": u_limits,
            "horizon": real("horizon", horizon),
            "shift": switch("shift", shift),
            "latch": None if latch is None else pair("latch", latch, "(of the gap, of its rate)"),
            "delay": delay_of(delay),
        }
        for name, both in (("posture", posture), ("latch", latch or (0.0, 0.0))):
            if not all(math.isfinite(it) and it >= 0.0 for it in both):
                raise ValueError(f"{name} must be two finite numbers >= 0, got {both}")
        names = believed(system).gap_names
        _same_names("gains", settings["gains"], names, every=True)
        _same_names("force", settings["force"], names)
        self._trackers = [
            TwistingTracker(
                *settings["gains"][name],
                h=settings["h"],
                e=float(e),
                horizon=settings["horizon"],
                shift=settings["shift"],
            )
            for name, e in zip(names, system.e, strict=True)
        ]
        super().__init__(system, settings)
        self._noise = np.zeros((2, 2))

    @property
    def latched(self) -> NDArray[np.bool_]:
        """Which contacts are held, shape (m,)."""
        return self._latched.copy()

    @property
    def accelerations(self) -> Array:
        """What was asked of the gaps at the last tick, without contact forces, shape (m,)."""
        return self._a.copy()

    @property
    def least_singular_value(self) -> float:
        r"""The least singular value so far of :math:`D^{-1/2} N M^{-1} B`, in parts of limits."""
        return self._least

    @property
    def zero_dynamics(self) -> int:
        """How many directions have no actuator of their own: nothing is promised of them."""
        return self._uncontrolled

    def reset(self) -> None:
        """Forget all that was measured."""
        super().reset()
        for tracker in self._trackers:
            tracker.reset(0.0, 0.0)
        m = len(self._trackers)
        self._latched = np.zeros(m, dtype=bool)
        self._beyond = np.zeros(m, dtype=int)
        self._a = np.zeros(m)
        self._place: Array | None = None
        self._least, self._uncontrolled = math.inf, 0

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores what it was of exactly."""
        return (
            tuple(tracker.state for tracker in self._trackers),
            tuple(self._latched.tolist()),
            tuple(self._beyond.tolist()),
            tuple(self._a.tolist()),
            numbers(self._queue),
            *numbers([self._u, self._place]),
            int(self._status),
            (self._least, self._uncontrolled),
        )

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        trackers, latched, beyond, a, queue, u, held, status, rank = state
        for tracker, own in zip(self._trackers, trackers, strict=True):
            tracker.state = own
        self._latched, self._beyond = np.array(latched, dtype=bool), np.array(beyond, dtype=int)
        self._a = np.array(a, dtype=np.float64)
        self._queue = [np.array(it) for it in queue]
        self._u, self._place = (None if it is None else np.array(it) for it in (u, held))
        self._status, (self._least, self._uncontrolled) = TickStatus(status), rank

    def copy(self) -> Self:
        """Copy it: the same settings, the same state."""
        twin = super().copy()
        twin._trackers = [tracker.copy() for tracker in self._trackers]
        return twin

    def __setstate__(self, state: dict[str, Any]) -> None:
        GapTracker.__init__(self, state["system"], **state["settings"])
        self._noise, self.state = state["noise"], state["state"]

    def sensed(self, noise: Sequence[float], steps: Sequence[float]) -> None:
        """Take note of the sensor: deviations and steps of coordinates and of velocities."""
        self._noise = np.array([noise, steps], dtype=np.float64)

    def step(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Give the controls for the period that starts now; all gaps land and rest.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).

        Returns
        -------
        ndarray
            The controls, shape (r,). Where a measurement is not finite they are the last ones, and
            the status is ``REFUSED``.
        """
        at = np.atleast_1d(real_array("q", q))
        if self._place is None:
            self._place = at
        m = len(self._trackers)
        rest = ReferenceSample(
            self._place,
            np.zeros(len(at)),
            np.ones(m),
            np.ones(m, dtype=bool),
            np.zeros(m),
            np.zeros(m),
            np.zeros(m),
        )
        return self.step_to(t, at, qdot, rest, rest)

    def step_to(
        self,
        t: float,
        q: ArrayLike,
        qdot: ArrayLike,
        now: ReferenceSample,
        next: ReferenceSample,
    ) -> Array:
        """Give the controls for a reference that is given at this sample and at the next one.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).
        now, next : ReferenceSample
            The reference, as many periods ahead as `delay` says.

        Returns
        -------
        ndarray
            As `step`.
        """
        there = self._outlook(t, q, qdot, self._latched)
        if there is None:
            return self._held()
        now, next = self._complete(now), self._complete(next)
        a = self._wanted(there.t, there.kinetics, now, next)
        return self._sent(self._controls(there, a, now))

    def _complete(self, sample: ReferenceSample) -> ReferenceSample:
        """Add the gaps of a reference that does not tell them."""
        if sample.gaps is not None and sample.gap_rates is not None:
            return sample
        here = self.system.at(0.0, sample.q, sample.qdot)
        closed, rates = np.asarray(sample.contacts), here.gradients @ sample.qdot + here.rates
        gaps = np.where(closed, 0.0, np.maximum(here.gaps, 0.0))
        return sample._replace(gaps=gaps, gap_rates=np.where(closed, 0.0, rates))

    def _wanted(
        self, t: float, kinetics: GapKinetics, now: ReferenceSample, end: ReferenceSample
    ) -> Array:
        """Give the accelerations of the gaps."""
        gaps, rates, D = kinetics.here.gaps, kinetics.gdot, kinetics.D
        resting = np.asarray(now.contacts) & np.asarray(end.contacts)
        self._latch(kinetics, resting)
        held, a = self._latched, np.empty(len(gaps))
        for i, tracker in enumerate(self._trackers):
            x, v = (0.0, 0.0) if held[i] else (max(float(gaps[i]), 0.0), float(rates[i]))
            ends = [
                (float(it.gaps[i]), float(it.gap_rates[i]), float(it.sides[i]))  # type: ignore[index]
                for it in (now, end)
            ]
            known = now.accelerations
            pull = None if known is None or np.isnan(known[i]) else float(known[i])
            a[i] = tracker.step_to(x, v, 0.0, ends[0], ends[1], pull)
        if held.any():
            usual = self._usual_forces(D)
            # while others land, all are pressed alike: forces that change with the contacts would
            # feed the kicks that coupled gaps give each other
            landing = bool(np.any(resting & ~held))
            forces = usual if landing else self._forces(t, usual)
            # a gap that lands is pushed by the other contacts as by a constant force, or impacts
            # on coupled gaps would not end; one that follows has its reference's own pushes
            known = np.where(resting, D @ (forces - usual), D @ forces)
            # as long as that leaves it a part of its own press, or it would not fall
            excess = D @ usual - PUSHED * self._press()
            known = known + np.where(resting & ~held, np.maximum(excess, 0.0), 0.0)
            a = np.where(held, -(D @ forces), a - known)
        self._a = a
        return a

    def _latch(self, kinetics: GapKinetics, resting: NDArray[np.bool_]) -> None:
        """Hold contacts that rest with their reference, and let go of those that do not."""
        if self._settings["latch"] is not None:
            near, slow = self._settings["latch"]
        else:
            deviation, steps = self._noise
            size = np.sqrt(np.sum(kinetics.here.gradients**2, axis=1))
            within = np.maximum(DEVIATIONS * deviation, STEPS * steps)
            near, slow = (np.maximum(e, it * size) for e, it in zip(EXACT, within, strict=True))
        at = np.abs(kinetics.here.gaps) <= near
        closes = resting & ~self._latched & at & (np.abs(kinetics.gdot) <= slow)
        self._beyond = np.where(self._latched & ~at, self._beyond + 1, 0)
        lost = self._latched & resting & (self._beyond >= OUT)
        if lost.any():
            self._status |= TickStatus.LATCH_LOST
        self._latched = (self._latched & resting & ~lost) | closes

    def _press(self) -> Array:
        """Give the accelerations with which landings press gaps that rest."""
        return np.array([float(it.press or 0.0) for it in self._trackers])

    def _usual_forces(self, D: Array) -> Array:
        """Give the forces with which landings press the contacts that are held, 0 elsewhere."""
        held, forces = self._latched, np.zeros(len(D))
        press = self._press()
        own = np.linalg.solve(D[np.ix_(held, held)], press[held])
        forces[held] = own if np.all(own > 0.0) else (press / np.diag(D))[held]
        return forces

    def _forces(self, t: float, usual: Array) -> Array:
        """Give the forces of the contacts that are held, as they are asked for."""
        forces = usual.copy()
        for i, name in enumerate(self.system.gap_names):
            if self._latched[i] and name in self._settings["force"]:
                asked = self._settings["force"][name]
                forces[i] = real(f"force[{name!r}]", asked(t)) if callable(asked) else asked
        return forces

    def _controls(self, there: Outlook, a: Array, now: ReferenceSample) -> Array:
        """Give the controls that make these accelerations of the gaps, and the rest as they can."""
        _, q, qdot, kinetics, matrix = there
        kp, kd = self._settings["posture"]
        wanted = -kp * (q - now.q) - kd * (qdot - now.qdot)
        if now.qddot is not None:
            wanted = wanted + now.qddot
        found = Allocation.of(kinetics, matrix, a, wanted, self._settings["u_limits"])
        if found.least is None and self._least == math.inf:
            found = dataclasses.replace(found, least=reach(kinetics, matrix))
        if found.least is not None:
            self._least = min(self._least, found.least)
            self._uncontrolled = len(matrix) - int(np.linalg.matrix_rank(matrix))
        if found.limited:
            self._status |= TickStatus.SATURATED
        return found.u


def _forces(force: Mapping[str, Any]) -> dict[str, Any]:
    read = {}
    for name, it in force.items():
        read[str(name)] = it if callable(it) else real(f"force[{name!r}]", it)
        if not callable(it) and not (math.isfinite(it) and it > 0.0):
            raise ValueError(f"force[{name!r}] must be finite and > 0, got {it}")
    return read


def _same_names(
    name: str, given: Mapping[str, Any], gaps: tuple[str, ...], *, every: bool = False
) -> None:
    strange = sorted(set(given) - set(gaps))
    if strange:
        raise ValueError(f"{name} has {strange[0]!r}, which is no gap of {gaps}")
    missing = sorted(set(gaps) - set(given))
    if every and missing:
        raise ValueError(f"{name} must have each gap of {gaps}, lacks {missing[0]!r}")
