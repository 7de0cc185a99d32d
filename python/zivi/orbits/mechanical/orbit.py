"""A periodic orbit of a mechanical system."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, finite
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.mechanical.accumulation import onto
from zivi.orbits.mechanical.by_parameter import by_parameter
from zivi.orbits.mechanical.equations import Frame, evaluate
from zivi.orbits.mechanical.mass_flow import MassFlow
from zivi.orbits.mechanical.multipliers import monodromy_at
from zivi.orbits.mechanical.word import Word, named, shortened
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run import simulate
from zivi.system.mechanism import MechanicalSystem

__all__ = ["MechanicalOrbit"]

IMPACT = np.dtype([("t", "f8"), ("gap", "i8"), ("u", "f8"), ("impulse", "f8")])
CONTACT = np.dtype([("t0", "f8"), ("t1", "f8"), ("gap", "i8")])
FIELDS: dict[str, Field] = {
    "t": ("impact", "", "time of the impact"),
    "gap": ("impact", "", "number of the gap"),
    "u": ("impact", "", "speed of the gap after the impact"),
    "impulse": ("impact", "", "impulse"),
    "multiplier_real": ("multiplier", "", "real parts of the multipliers"),
    "multiplier_imag": ("multiplier", "", "imaginary parts of the multipliers"),
    "zeno_time": ("zeno", "", "times of accumulations"),
    "liftoff_time": ("liftoff", "", "times of lift-off"),
}
"""Dimensions, unit and meaning of what is in the dataset."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalOrbit(Tabulated):
    """A periodic motion of a mechanical system with n coordinates and m gaps.

    Attributes
    ----------
    system : MechanicalSystem
        The system whose motion it is.
    word : tuple of str
        The events of one period: ``"I stop"`` an impact, ``"S stop"`` a plastic one that closes
        the gap, ``"Z road"`` an accumulation (its first impact), ``"L road"`` a lift-off, ``"P"``
        a motion without events.
    period : float
        Period of the excitation; where nothing excites the system that of the motion.
    multiple : int
        After how many of them the motion repeats.
    segments : structured ndarray
        The motion between the events: ``t0``, ``t1``, and ``contacts``, m flags.
    impacts : structured ndarray
        The impacts of one period of the motion, ``t``, ``gap`` (its number), ``u``, the speed of
        the gap after it, and ``impulse``; of an accumulation those that were computed.
    contacts : structured ndarray
        When gaps are closed: ``t0``, ``t1``, ``gap``.
    zeno_times, liftoff_times : ndarray
        When impacts accumulate, and when contacts end.
    multipliers : ndarray
        The 2n Floquet multipliers (complex): two are 0 for each gap that is closed at some time.
        Where nothing excites the system that of a shift in time is left out.
    symmetric : bool
        Whether it was found as a half, whose image under the symmetry is the other half.
    depth : float
        How far the nearest grazing is.
    residual : float
        Largest residual of the equations, relative to the size of the motion.
    iterations : int
        Newton's steps.
    admissible : bool
        Whether it is a motion of the system: no impact that opens a gap, no gap < 0, no force of a
        contact that pulls; one simulation follows it.
    status : OrbitStatus
        ``COMPLETED``, ``NOT_CONVERGED``, ``LEFT_ADMISSIBLE``, or ``NOT_DIFFERENTIABLE`` (several
        gaps are hit, or come to rest, at once).
    message : str
        What happened.
    """

    system: MechanicalSystem
    period: float
    multiple: int
    segments: NDArray[np.void]
    impacts: NDArray[np.void]
    contacts: NDArray[np.void]
    zeno_times: Array
    liftoff_times: Array
    multipliers: NDArray[np.complex128]
    residual: float
    iterations: int
    depth: float
    admissible: bool
    status: OrbitStatus
    message: str
    _frame: Frame
    _y: Array
    _word: Word
    """The word of the whole period."""
    _starts: Array
    """Time and state at the start of each of its segments, shape (k, 1 + 2n)."""
    _away: Array | None = None
    """The direction in which the orbit lies beside the event that it came from."""

    @property
    def word(self) -> tuple[str, ...]:
        """The events of one period, with the names of the gaps."""
        return named(self._word, getattr(self.system, "gap_names", ("wall",)))

    @property
    def kind(self) -> str:
        """``"flight"`` (no events), ``"impacting"``, or ``"resting"`` (with contacts)."""
        if any(it.contacts for it in self._word):
            return "resting"
        return "flight" if all(it.kind == "P" for it in self._word) else "impacting"

    @property
    def symmetric(self) -> bool:
        """Whether it was found as a half, whose image is the other half."""
        return self._frame.turn is not None

    @property
    def success(self) -> bool:
        """Whether it was found and is a motion of the system."""
        return self.status is OrbitStatus.COMPLETED

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie within the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0))

    @functools.cached_property
    def trajectory(self) -> MechanicalTrajectory:
        """A simulation over one period of the motion, from the middle of a flight."""
        t, z = self._middle()
        n = len(z) // 2
        span = (t, t + self.multiple * self.period)
        state = tuple(z) if isinstance(self._frame.flow, MassFlow) else (z[:n], z[n:])
        return simulate(self.system, span, state, self._frame.method)

    def _along(self, count: int = 64) -> tuple[Array, Array]:
        """Give times and states ``(q, qdot)`` along the segments, so many each."""
        times, states = [], []
        for s, segment in enumerate(self._word):
            t0, t1 = float(self.segments["t0"][s]), float(self.segments["t1"][s])
            own = np.linspace(t0, t1, count)
            times.append(own)
            path = self._frame.flow.path(segment.contacts, t0, self._starts[s, 1:], own)
            states.append(path)
        return np.concatenate(times), np.vstack(states)

    def _middle(self) -> tuple[float, Array]:
        """Give time and state in the middle of the longest segment with the most contacts."""
        lengths = self.segments["t1"] - self.segments["t0"]
        most = max(len(it.contacts) for it in self._word)
        own = [s for s, it in enumerate(self._word) if len(it.contacts) == most]
        s = max(own, key=lambda it: float(lengths[it]))
        t0 = float(self._starts[s, 0])
        t = t0 + 0.5 * float(lengths[s])
        contacts = self._word[s].contacts
        flow = self._frame.flow
        z = flow.path(contacts, t0, self._starts[s, 1:], np.array([t]))[0]
        return t, onto(flow, contacts, t, z, contacts)

    def monodromy(self, t: float | None = None) -> Array:
        """Give the derivative of the state after one period of the motion by the state at `t`.

        Parameters
        ----------
        t : float, optional
            A time, by default in the middle of the longest flight, or contact.

        Returns
        -------
        ndarray
            Of shape (2n, 2n), for ``(q, qdot)``.
        """
        when = self._middle()[0] if t is None else finite("t", t)
        return monodromy_at(evaluate(self._frame, self._y), self.multiple * self.period, when)

    def derivative(self, name: str) -> Array:
        """Give the derivative of the orbit by a parameter of its system.

        Parameters
        ----------
        name : str
            A parameter, as in `zivi.continue_orbit`.

        Returns
        -------
        ndarray
            Of the times of the events ``word`` (of the half, for a symmetric orbit), then where
            nothing excites the system of the period.

        Raises
        ------
        ValueError
            For a name that there is not, or an orbit that was not found.
        """
        if self.status in (OrbitStatus.NOT_CONVERGED, OrbitStatus.NOT_DIFFERENTIABLE):
            raise ValueError(f"no orbit was found: {self.message}")
        frame = self._frame
        terms = evaluate(frame, self._y)
        moved = np.linalg.solve(terms.matrix(), -by_parameter(frame, self._y, name, precise=True))
        rows = np.asarray(moved, np.float64).reshape(len(frame.word), frame.size)
        return np.append(rows[:, -1], rows[:1, 0]) if frame.free else rows[:, -1].copy()

    def _summary(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Give what a study keeps of it, and the units."""
        names = ("period", "multiple", "stable", "admissible", "residual", "depth")
        return {name: getattr(self, name) for name in names} | {
            "n_impacts": len(self.impacts),
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
            "orbit_status": int(self.status),
        }, {}

    def _table(self) -> ResultTable:
        values = {name: self.impacts[name] for name in ("t", "gap", "u", "impulse")}
        values |= {"multiplier_real": self.multipliers.real}
        values |= {"multiplier_imag": self.multipliers.imag}
        values |= {"zeno_time": self.zeno_times, "liftoff_time": self.liftoff_times}
        attrs = {"word": " ".join(self.word), "period": self.period, "multiple": self.multiple}
        attrs |= {"status": self.status.name}
        return ResultTable("Periodic orbit of a mechanical system", FIELDS, {}, values, attrs)

    def __repr__(self) -> str:
        multipliers = ", ".join(f"{value:.4g}" for value in self.multipliers)
        return (
            f"<MechanicalOrbit {shortened(self.word)!r} in {self.multiple} periods, "
            f"multipliers {multipliers}: {self.status.name.lower()}>"
        )
