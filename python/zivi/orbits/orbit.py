"""A periodic orbit: its times, speeds, multipliers, and what follows from them."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, MaybeNone, finite
from zivi.base.table import Field, ResultTable, Tabulated, counted
from zivi.derivatives.sensitivity import OrbitStatus, sensitivity
from zivi.orbits.mechanical.equations import evaluate
from zivi.orbits.sequence import Frame, as_word, derivative
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import parameter

__all__ = ["PeriodicOrbit"]

ORBIT_IMPACT = np.dtype([("t", "f8"), ("u", "f8"), ("xdot_before", "f8"), ("xdot_after", "f8")])
FIELDS: dict[str, Field] = {
    "t": ("impact", "s", "time of the impact"),
    "u": ("impact", "m/s", "speed after the impact"),
    "xdot_before": ("impact", "m/s", "velocity before the impact"),
    "multiplier_real": ("multiplier", "", "real parts of the multipliers"),
    "multiplier_imag": ("multiplier", "", "imaginary parts of the multipliers"),
}
"""Dimensions, unit and meaning of what is in the dataset."""

SUMMARY = {
    "period": "s",
    "multiple": "1",
    "stable": "",
    "admissible": "",
    "residual": "",
    "depth": "m",
    "zeno_time": "s",
    "liftoff_time": "s",
    "margin": "s",
}
"""What a study keeps of an orbit beside its multipliers, with its unit."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbit(Tabulated):
    """A periodic motion.

    Attributes
    ----------
    system : ImpactSystem
        The system whose motion it is.
    kind : str
        ``"flight"`` (without impacts), ``"impacting"``, or ``"resting"`` (it comes to rest through
        a Zeno point and lifts off again).
    period : float
        Period of the excitation (s).
    multiple : int
        After how many of them the motion repeats.
    impacts : structured ndarray
        The impacts of one period of the motion: ``t`` (s), ``u``, the speed after it (m/s), and
        ``xdot_before``, ``xdot_after``. Of a resting orbit those that were computed.
    multipliers : ndarray
        The two Floquet multipliers (complex); 0 and 0 for a resting orbit. Where nothing excites
        the system one of them is 1, that of a shift in time.
    residual : float
        Largest residual of the equations, relative to the size of the motion.
    iterations : int
        Newton's steps.
    depth : float
        How far the nearest grazing is (m): the least height of a minimum above the wall, or by
        how much a grazing impact would have to rise to vanish.
    admissible : bool
        Whether it is a motion of the system: all speeds after impacts positive, no flight behind
        the wall, and a simulation follows it.
    status : OrbitStatus
        ``COMPLETED``, ``NOT_CONVERGED``, ``LEFT_ADMISSIBLE``, or ``RESTS`` for a mass that never
        lifts off again.
    message : str
        What happened.
    zeno_time, liftoff_time : float or None
        Of a resting orbit, when it comes to rest and when it lifted off before that (s).
    """

    system: ImpactSystem
    kind: str
    period: float
    multiple: int
    impacts: NDArray[np.void]
    multipliers: NDArray[np.complex128]
    residual: float
    iterations: int
    depth: float
    admissible: bool
    status: OrbitStatus
    message: str
    _frame: Frame
    _y: Array
    zeno_time: float | MaybeNone = None
    liftoff_time: float | MaybeNone = None
    _away: Array | None = None
    """Where the orbit lies beside the event that it came from."""

    @property
    def success(self) -> bool:
        """Whether it was found and is a motion of the system."""
        return self.status is OrbitStatus.COMPLETED

    @property
    def stable(self) -> bool:
        """Whether the multipliers lie within the unit circle, but for that of a shift in time."""
        own = self.multipliers
        if self._frame.free and np.all(np.isfinite(own)):
            own = np.delete(own, np.argmin(np.abs(own - 1.0)))
        return bool(np.all(np.abs(own) < 1.0))

    @property
    def margin(self) -> float | MaybeNone:
        """How long a resting orbit rests before it lifts off again (s)."""
        if self.zeno_time is None or self.liftoff_time is None:
            return None
        return self.liftoff_time + self.multiple * self.period - self.zeno_time

    @functools.cached_property
    def trajectory(self) -> Trajectory:
        """A simulation over one period of the motion, from its first impact or its lift-off."""
        t, state = self._beginning()
        length = self.multiple * self.period
        return simulate(self.system, (t, t + length), state, self._frame.method)

    def _summary(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Give what a study keeps of it, and the units."""
        found = {name: getattr(self, name) for name in SUMMARY}
        return found | {
            "n_impacts": len(self.impacts),
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
            "orbit_status": int(self.status),
        }, {name: unit for name, unit in SUMMARY.items() if unit}

    def _beginning(self) -> tuple[float, tuple[float, float]]:
        if self.liftoff_time is not None:
            return self.liftoff_time, (0.0, 0.0)
        if self.kind == "flight":
            t, x, xdot, _ = self._frame.rows(self.system, self._y)[0]
            return float(t), (float(x), float(xdot))
        if self.status is OrbitStatus.RESTS:
            return self._frame.start, (0.0, 0.0)
        if not len(self._y):
            raise ValueError(f"no orbit was found: {self.message}")
        speed = float(self._y[0, 1])
        if self.system.e == 0.0:
            speed = max(speed, 0.0)  # rounding
        return float(self.impacts["t"][0]), (0.0, speed)

    def monodromy(self, t0: float | None = None) -> Array:
        """Give the derivative of the state after one period of the motion by the state at `t0`.

        Parameters
        ----------
        t0 : float, optional
            A time in flight (s); by default in the middle of the longest flight.

        Returns
        -------
        ndarray
            Of shape (2, 2); its eigenvalues are the multipliers.
        """
        length = self.multiple * self.period
        if t0 is None:
            times = np.append(self.impacts["t"], self._beginning()[0] + length)
            longest = int(np.argmax(np.diff(times))) if len(times) > 1 else 0
            t0 = float(times[longest : longest + 2].mean())
        begin = self._beginning()[0]
        x, v = self.trajectory(begin + (finite("t0", t0) - begin) % length)
        s = sensitivity(
            self.system,
            (t0, t0 + length),
            (max(float(x), 0.0), float(v)),
            method=self._frame.method,
            dense_output=False,
        )
        return s.final

    def derivative(self, name: str) -> Array:
        """Give the derivative of the orbit by a parameter.

        Parameters
        ----------
        name : str
            A parameter of the system.

        Returns
        -------
        ndarray
            Of ``(t_1, u_1, t_2, u_2, ...)``, flat; of the state in flight without impacts; of the
            Zeno time and the lift-off time before it for a resting orbit; empty for a mass that
            never lifts off, which has none of these. Where nothing excites the system the period
            takes the place of ``t_1``, and of the velocity in flight.
        """
        parameter(self.system, name)
        if self.status is OrbitStatus.RESTS:
            return np.empty(0)
        if not len(self._y):
            raise ValueError(f"no orbit was found: {self.message}")
        if self.kind == "resting":
            s = self._sensitivity(name)
            lift = s.liftoff_times[:1, 0]
            return np.concatenate([s.zeno_times[-1:, 0], lift])
        terms = evaluate(*as_word(self.system, self._frame, self._y))
        return derivative(terms, name).ravel()

    def _sensitivity(self, name: str) -> Any:
        """Differentiate a resting orbit, from the rest before its lift-off."""
        assert self.liftoff_time is not None
        assert self.zeno_time is not None
        rest = 0.5 * (self.margin or 0.0)
        begin = self.liftoff_time - rest
        end = self.zeno_time + rest
        return sensitivity(self.system, (begin, end), (0.0, 0.0), (name,), self._frame.method)

    def _table(self) -> ResultTable:
        """Tell the impacts and the multipliers."""
        values = {name: self.impacts[name] for name in ("t", "u", "xdot_before")}
        values |= {"multiplier_real": self.multipliers.real}
        values |= {"multiplier_imag": self.multipliers.imag}
        attrs = {"kind": self.kind, "period": self.period, "multiple": self.multiple}
        attrs |= {"status": self.status.name}
        return ResultTable("Periodic orbit", FIELDS, {}, values, attrs)

    def __repr__(self) -> str:
        multipliers = ", ".join(f"{value:.4g}" for value in self.multipliers)
        return (
            f"<PeriodicOrbit {self.kind}, {counted(len(self.impacts), 'impact')} in "
            f"{counted(self.multiple, 'period')}, "
            f"multipliers {multipliers}: {self.status.name.lower()}>"
        )
