"""Periodic orbits and branches of them: times, speeds, multipliers, events."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, MaybeNone, finite
from zivi.base.extras import import_attribute
from zivi.base.table import Field, ResultTable, Tabulated, counted, listed_by
from zivi.derivatives.result import OrbitStatus
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.equations import Frame, Terms, evaluate, monodromy_at, onto
from zivi.orbits.flows import Flow, MassFlow, Segment, Word, named, shortened
from zivi.orbits.path import by_parameter
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import parameter

# Orbits of one mass as rows ``(t, u)`` of impacts, and as words of the equations.


def word_of_rows(
    system: ImpactSystem,
    method: SwitchedRK,
    y: Array,
    length: float,
    *,
    free: bool = False,
    start: float = 0.0,
) -> tuple[Frame, Array]:
    """Return the event sequence of impacts ``(t, u)`` or of a flight from ``(x, xdot)``.

    In an autonomous system the first impact is at ``t = 0``, and a flight begins at its apex.
    """
    count, hits = len(y) if y.ndim == 2 else 1, y.ndim == 2
    x, e = np.zeros((count, 4)), system.e
    if hits:
        x[:, 0], x[:, 2] = y[:, 0] - (y[0, 0] if free else 0.0), y[:, 1]
        x[:, 3] = np.append(x[1:, 0], x[0, 0] + length)
    else:
        x[0] = start, *y, start + length
    segment = Segment((), "I", 0, ()) if hits else Segment((), "P", -1, ())
    section: int | float = 0 if free else float(x[0, 3])
    flow = MassFlow(system, method)
    frame = Frame(system, flow, (segment,) * count, method, length, free, None, section)
    if not hits or free:
        return frame, frame.joined(x, length)
    if e > 0.0:
        return frame, np.column_stack([(1.0 + e) / e * y[:, 1], y[:, 0]]).ravel()
    # a segment of a word ends with its event: the first one begins with the last impact
    x = np.roll(x, 1, axis=0)
    x[0, [0, 3]] -= length
    return frame, frame.joined(x, length)


def resting_frame(system: ImpactSystem, method: SwitchedRK, length: float, t: float = 0.0) -> Frame:
    """Return the frame of a mass that stays at rest."""
    word = (Segment((0,), "P", -1, (0,)),)
    return Frame(system, MassFlow(system, method), word, method, length, False, None, t)


@dataclasses.dataclass(frozen=True)
class MassFrame:
    """Substitute for a `Frame` in pickles of versions up to 0.2."""

    multiple: int
    period: float | None
    method: SwitchedRK
    start: float = 0.0
    free: bool = False

    def word(self, system: ImpactSystem, y: Array, period: float) -> tuple[Frame, Array]:
        """Return the word of such an orbit, and its unknowns."""
        length = self.multiple * period
        if self.free:
            rows = np.array([y[0], 0.0]) if y.ndim == 1 else np.vstack([[0.0, y[0, 1]], y[1:]])
            return word_of_rows(system, self.method, rows, length, free=True)
        return word_of_rows(system, self.method, y, length, start=self.start)


def rows_along(terms: Terms, move: Array) -> Array:
    """Return the change of impacts ``(t, u)`` or of a flight for a change of the unknowns."""
    frame = terms.frame
    if frame.impulses is not None:
        e = float(frame.flow.e[0])
        return np.column_stack([move[1::2], e / (1.0 + e) * move[::2]])
    rows = move.reshape(-1, 4)
    if frame.word[0].kind == "I":
        return rows[:, [0, 2]]
    # at the time of the section, or the highest point and the period
    return rows[0, [1, 0]] if frame.free else rows[0, 1:3]


# A periodic orbit: times, speeds, Floquet multipliers and derived quantities.

ORBIT_IMPACT = np.dtype([("t", "f8"), ("u", "f8"), ("xdot_before", "f8"), ("xdot_after", "f8")])
ORBIT_FIELDS: dict[str, Field] = {
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


class AnyOrbit(Tabulated):
    """Base class of orbits of one mass and of mechanical systems."""

    _kept: ClassVar[dict[str, str]] = SUMMARY
    if TYPE_CHECKING:
        status: OrbitStatus
        impacts: NDArray[np.void]
        multipliers: NDArray[np.complex128]

    @property
    def success(self) -> bool:
        """Whether the orbit converged and is admissible."""
        return self.status is OrbitStatus.COMPLETED

    def _summary(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the values that a study keeps, and their units."""
        found = {name: getattr(self, name) for name in self._kept}
        return found | {
            "n_impacts": len(self.impacts),
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
            "orbit_status": int(self.status),
        }, {name: unit for name, unit in self._kept.items() if unit}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbit(AnyOrbit):
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
        Distance to the nearest grazing (m): the least height of a minimum above the wall, or the
        rise at which a grazing impact would vanish.
    admissible : bool
        Whether it is admissible: all speeds after impacts are positive, x >= 0 in all flights, and
        a simulation reproduces it.
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
    """The direction in which the orbit lies beside the event that it came from."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        if isinstance(state["_frame"], MassFrame):
            state |= import_attribute("zivi.orbits.words", "renewed")(state)
        vars(self).update(state)

    @property
    def stable(self) -> bool:
        """Whether all multipliers, except the trivial one, lie inside the unit circle."""
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

    def _beginning(self) -> tuple[float, tuple[float, float]]:
        if self.liftoff_time is not None:
            return self.liftoff_time, (0.0, 0.0)
        if not len(self._y):
            raise ValueError(f"no orbit was found: {self.message}")
        if self.kind == "impacting":
            speed = float(self.impacts["u"][0])
            if self.system.e == 0.0:
                speed = max(speed, 0.0)  # rounding
            return float(self.impacts["t"][0]), (0.0, speed)
        (begin, *z, end), *_ = self._frame.split(self._y)[0]
        return float(begin if self._frame.free else end), self._frame.flow.initial(np.array(z))

    def monodromy(self, t0: float | None = None) -> Array:
        """Return the derivative of the state after one period of the motion by the state at `t0`.

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
        """Return the derivative of the orbit by a parameter.

        Parameters
        ----------
        name : str
            A parameter of the system.

        Returns
        -------
        ndarray
            Of ``(t_1, u_1, t_2, u_2, ...)``, flat; of the state in flight without impacts; of the
            Zeno time and the lift-off time before it for a resting orbit; empty for a mass that
            never lifts off, which has none of these. In an autonomous system the period replaces
            ``t_1``, or the velocity in flight.
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
        terms = evaluate(self._frame, self._y)
        move: Array = -np.linalg.solve(terms.matrix(), by_parameter(self._frame, self._y, name))
        found = rows_along(terms, move)
        if name == "e" and self._frame.impulses is not None:
            found[:, 1] += self._y[::2] / (1.0 + self.system.e) ** 2
        return found.ravel()

    def _sensitivity(self, name: str) -> Any:
        """Differentiate a resting orbit, from the rest before its lift-off."""
        assert self.liftoff_time is not None
        assert self.zeno_time is not None
        rest = 0.5 * (self.margin or 0.0)
        begin = self.liftoff_time - rest
        end = self.zeno_time + rest
        return sensitivity(self.system, (begin, end), (0.0, 0.0), (name,), self._frame.method)

    def _table(self) -> ResultTable:
        """Describe the dataset: impacts and Floquet multipliers."""
        values = {name: self.impacts[name] for name in ("t", "u", "xdot_before")}
        values |= {"multiplier_real": self.multipliers.real}
        values |= {"multiplier_imag": self.multipliers.imag}
        attrs = {"kind": self.kind, "period": self.period, "multiple": self.multiple}
        attrs |= {"status": self.status.name}
        return ResultTable("Periodic orbit", ORBIT_FIELDS, {}, values, attrs)

    def __repr__(self) -> str:
        multipliers = ", ".join(f"{value:.4g}" for value in self.multipliers)
        return (
            f"<PeriodicOrbit {self.kind}, {counted(len(self.impacts), 'impact')} in "
            f"{counted(self.multiple, 'period')}, "
            f"multipliers {multipliers}: {self.status.name.lower()}>"
        )


# A periodic orbit of a mechanical system.


def letter_names(system: Any) -> tuple[str, ...]:
    """Return the names of gaps, or of channels of friction, for the letters of a word."""
    if not isinstance(system, MechanicalSystem):
        return ("wall",)
    return system.channel_names or system.gap_names


def middle_of(flow: Flow, word: Word, starts: Array, ends: Array) -> tuple[float, Array]:
    """Return time and state in the middle of the longest segment with the most contacts.

    With dry friction it is one with the fewest channels that stick.
    """
    lengths = ends - starts[:, 0]
    most = (min if flow.channels else max)(len(it.held) for it in word)
    own = [s for s, it in enumerate(word) if len(it.held) == most]
    s = max(own, key=lambda it: float(lengths[it]))
    t0, contacts = float(starts[s, 0]), word[s].contacts
    t = t0 + 0.5 * float(lengths[s])
    z = flow.path(contacts, t0, starts[s, 1:], np.array([t]))[0]
    held = word[s].held
    return t, onto(flow, held, t, z, held) if held else z


IMPACT = np.dtype([("t", "f8"), ("gap", "i8"), ("u", "f8"), ("impulse", "f8")])
CONTACT = np.dtype([("t0", "f8"), ("t1", "f8"), ("gap", "i8")])
MECHANICAL_ORBIT_FIELDS: dict[str, Field] = {
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
class MechanicalOrbit(AnyOrbit):
    """A periodic motion of a mechanical system with n coordinates and m gaps.

    Attributes
    ----------
    system : MechanicalSystem
        The system whose motion it is.
    word : tuple of str
        The events of one period: ``"I stop"`` an impact, ``"S stop"`` a plastic one that closes
        the gap, ``"Z road"`` an accumulation (its first impact), ``"L road"`` a lift-off, ``"P"``
        a motion without events. With dry friction in joints ``"K belt"``, a slip ends in stick,
        ``"B belt"``, a stick breaks, ``"T belt"``, a slip turns into the other direction.
    period : float
        Period of the excitation; where nothing excites the system that of the motion.
    multiple : int
        After how many of them the motion repeats.
    segments : structured ndarray
        The motion between the events: ``t0``, ``t1``, and ``contacts``, m flags, or one for each
        channel of dry friction, which say whether it sticks.
    impacts : structured ndarray
        The impacts of one period of the motion, ``t``, ``gap`` (its number), ``u``, the speed of
        the gap after it, and ``impulse``; of an accumulation those that were computed.
    contacts : structured ndarray
        When gaps are closed, or channels of dry friction stick: ``t0``, ``t1``, ``gap`` (the
        number of the gap or channel).
    zeno_times, liftoff_times : ndarray
        When impacts accumulate, and when contacts end.
    multipliers : ndarray
        The 2n Floquet multipliers (complex): two are 0 for each gap that is closed at some time,
        one for each channel of dry friction that sticks. Where nothing excites the system that of a
        shift in time is left out.
    symmetric : bool
        Whether it was computed as a half orbit, whose image under the symmetry is the other half.
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
        gaps are hit or come to rest simultaneously).
    message : str
        What happened.
    """

    _kept = dict.fromkeys(("period", "multiple", "stable", "admissible", "residual", "depth"), "")

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
        return named(self._word, letter_names(self.system))

    @property
    def kind(self) -> str:
        """``"flight"`` (no events), ``"impacting"``, or ``"resting"`` (with contacts).

        With dry friction ``"sticking"`` (with sticks) or ``"slipping"``.
        """
        holds = any(it.held for it in self._word)
        if self._frame.flow.channels:
            return "sticking" if holds else "slipping"
        if holds:
            return "resting"
        return "flight" if all(it.kind == "P" for it in self._word) else "impacting"

    @property
    def symmetric(self) -> bool:
        """Whether it was computed as a half orbit, whose image is the other half."""
        return self._frame.turn is not None

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie within the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0))

    @functools.cached_property
    def trajectory(self) -> MechanicalTrajectory:
        """A simulation over one period of the motion, from the middle of a flight."""
        t, z = self._middle()
        span = (t, t + self.multiple * self.period)
        return simulate(self.system, span, self._frame.flow.initial(z), self._frame.method)

    def _along(self, count: int = 64) -> tuple[Array, Array]:
        """Return `count` times and states ``(q, qdot)`` along each segment."""
        times, states = [], []
        for s, segment in enumerate(self._word):
            t0, t1 = float(self.segments["t0"][s]), float(self.segments["t1"][s])
            own = np.linspace(t0, t1, count)
            times.append(own)
            path = self._frame.flow.path(segment.contacts, t0, self._starts[s, 1:], own)
            states.append(path)
        return np.concatenate(times), np.vstack(states)

    def _middle(self) -> tuple[float, Array]:
        """Return time and state in the middle of the longest segment with the most contacts."""
        return middle_of(self._frame.flow, self._word, self._starts, self.segments["t1"])

    def monodromy(self, t: float | None = None) -> Array:
        """Return the derivative of the state after one period of the motion by the state at `t`.

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
        """Return the derivative of the orbit by a parameter of its system.

        Parameters
        ----------
        name : str
            A parameter (see `zivi.continue_orbit`).

        Returns
        -------
        ndarray
            Derivatives of the event times of ``word`` (of the half for a symmetric orbit), and of
            the period in an autonomous system.

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

    def _table(self) -> ResultTable:
        values = {name: self.impacts[name] for name in ("t", "gap", "u", "impulse")}
        values |= {"multiplier_real": self.multipliers.real}
        values |= {"multiplier_imag": self.multipliers.imag}
        values |= {"zeno_time": self.zeno_times, "liftoff_time": self.liftoff_times}
        attrs = {"word": " ".join(self.word), "period": self.period, "multiple": self.multiple}
        attrs |= {"status": self.status.name}
        return ResultTable(
            "Periodic orbit of a mechanical system", MECHANICAL_ORBIT_FIELDS, {}, values, attrs
        )

    def __repr__(self) -> str:
        multipliers = ", ".join(f"{value:.4g}" for value in self.multipliers)
        return (
            f"<MechanicalOrbit {shortened(self.word)!r} in {self.multiple} periods, "
            f"multipliers {multipliers}: {self.status.name.lower()}>"
        )


# Base class of branches of orbits of one mass and of mechanical systems.

BRANCH_MESSAGES = {
    OrbitStatus.RANGE_END: "The branch was followed to the ends of the range.",
    OrbitStatus.MAX_POINTS: "The branch has max_points points.",
    OrbitStatus.LEFT_ADMISSIBLE: "The branch ends where the orbit becomes inadmissible.",
    OrbitStatus.CLOSED: "The branch is closed: it came back to a point of its own.",
    OrbitStatus.NOT_CONVERGED: "No step was short enough for Newton's iteration to converge.",
}

BRANCH_FIELDS: dict[str, Field] = {
    "stable": ("point", "", "whether the orbit is stable"),
    "admissible": ("point", "", "whether it is a motion of the system"),
    "multiplier_real": (("point", "multiplier"), "", "real parts of the multipliers"),
    "multiplier_imag": (("point", "multiplier"), "", "imaginary parts of the multipliers"),
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter and the impact."""

Event = TypeVar("Event")


def failed_text(orbits: Sequence[Any]) -> str:
    """Describe how many orbits failed, by status; "" if none did."""
    failed = [it.status.name.lower() for it in orbits if it.status is not OrbitStatus.COMPLETED]
    unknown = sum(bool(np.isnan(it.multipliers).any()) for it in orbits)
    found = [listed_by(len(orbits), "orbits with a status", failed)] if failed else []
    found += [f"{unknown} of {len(orbits)} orbits without multipliers"] if unknown else []
    return ", ".join(found)


def with_failed(message: str, failed: str) -> str:
    """Return the message of a result with its failures."""
    return f"{message} {failed[0].upper()}{failed[1:]}." if failed else message


class OrbitsAlong(Tabulated, Generic[Event]):
    """Orbits along a parameter, with events."""

    if TYPE_CHECKING:
        name: str
        events: list[Any]
        status: OrbitStatus

        @property
        def orbits(self) -> Sequence[Any]: ...  # noqa: D102
        @property
        def values(self) -> Array: ...  # noqa: D102
        @property
        def multipliers(self) -> np.ndarray: ...  # noqa: D102

    def __len__(self) -> int:
        return len(self.orbits)

    @property
    def stable(self) -> np.ndarray:
        """Whether each orbit is stable."""
        return np.array([orbit.stable for orbit in self.orbits], dtype=bool)

    @property
    def admissible(self) -> np.ndarray:
        """Whether each orbit is a motion of the system."""
        return np.array([orbit.admissible for orbit in self.orbits], dtype=bool)

    def of_kind(self, kind: str) -> list[Event]:
        """Return the events of one kind.

        Parameters
        ----------
        kind : str
            As in `events`.

        Returns
        -------
        list
            In the order of the branch.
        """
        return [event for event in self.events if event.kind == kind]

    def _failed_text(self) -> str:
        """Describe the failures after a comma; "" if there are none."""
        failed = failed_text(self.orbits)
        return f", {failed}" if failed else ""

    def _columns(self) -> dict[str, Any]:
        """Return the parameter, the first impact and the multipliers of each orbit."""
        first = [orbit.impacts[0] if len(orbit.impacts) else None for orbit in self.orbits]
        return {
            self.name: self.values,
            "t": [math.nan if it is None else it["t"] for it in first],
            "u": [math.nan if it is None else it["u"] for it in first],
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
        }

    def _end_and_events(self) -> dict[str, Any]:
        """Return the end of the branch and its events."""
        return {
            "status": self.status.name,
            "events": [event.kind for event in self.events],
            "event_values": [event.value for event in self.events],
        }


# Branches of periodic orbits over a parameter, with the events at which they change.

MASS_MESSAGES = {
    **BRANCH_MESSAGES,
    OrbitStatus.COMPLETED: "The branch was followed to where it begins, at a period doubling.",
}

MASS_FIELDS: dict[str, Field] = {
    "t": ("point", "s", "time of the first impact"),
    "u": ("point", "m/s", "speed after the first impact"),
    **BRANCH_FIELDS,
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter."""


class BranchEvent(NamedTuple):
    """Where a branch changes.

    Attributes
    ----------
    kind : str
        ``fold``, ``period_doubling``, ``grazing`` (an impact dies), ``interior_impact`` (a new
        one), ``end_of_rest`` (the time at rest vanishes), ``end_of_liftoff``, ``rest_appears``
        (near a new impact they become infinitely many, and the orbit rests), ``neimark_sacker``
        (a pair of multipliers passes the unit circle), ``contact_ends`` (the force lifts a mass
        that rests off once more).
    value : float
        The parameter.
    orbit : PeriodicOrbit
        The orbit there.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Branch(OrbitsAlong[BranchEvent]):
    """Orbits along a parameter.

    Attributes
    ----------
    name : str
        The parameter.
    orbits : list of PeriodicOrbit
        The points in the order of the arc.
    values : ndarray
        The parameter at each.
    events : list of BranchEvent
        Folds, period doublings, grazings, the end of rest, in the order of the arc.
    status : OrbitStatus
        Why the arc ends: ``COMPLETED`` (where a doubled orbit begins), ``RANGE_END``, ``CLOSED``
        (it came back to itself), ``LEFT_ADMISSIBLE``, ``MAX_POINTS``, ``NOT_CONVERGED``; of its two
        ends the one that needs more attention.
    message : str
        What happened.
    n_flights : int
        Flights that were computed.
    """

    name: str
    orbits: list[PeriodicOrbit]
    values: Array
    events: list[BranchEvent]
    status: OrbitStatus
    message: str
    n_flights: int

    @property
    def multipliers(self) -> np.ndarray:
        """The multipliers of each orbit, of shape (n, 2)."""
        return np.array([orbit.multipliers for orbit in self.orbits]).reshape(-1, 2)

    def switch(self, event: BranchEvent) -> PeriodicOrbit:
        """Return an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : BranchEvent
            One of `events`. At a period doubling, a nearby orbit of twice the period (from a
            doubled orbit, the orbit of half the period); at a grazing, the orbit without the
            impact; at an interior impact, the orbit with it; at the end of a rest, an orbit of
            finitely many impacts past it; where rest appears, the resting orbit; at a fold, the
            orbit there.

        Returns
        -------
        PeriodicOrbit
            See its ``status`` for success.
        """
        orbit: PeriodicOrbit = import_attribute("zivi.orbits.follow", "switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Describe the dataset: points of the branch, with its events as attributes."""
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **MASS_FIELDS}
        return ResultTable(
            "Branch of periodic orbits", fields, {}, self._columns(), self._end_and_events()
        )

    def __repr__(self) -> str:
        told = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        known = f"{told or 'no events'}{self._failed_text()}"
        return (
            f"<Branch of {len(self)} orbits over {self.name}: {known}; {self.status.name.lower()}>"
        )


# Branches of periodic orbits of mechanical systems: arcs of one word each, and events.

MECHANICAL_MESSAGES = {
    **BRANCH_MESSAGES,
    OrbitStatus.RETRACED: "The branch came to where it begins, at a period doubling.",
    OrbitStatus.SIMULTANEOUS: "The branch ends where two events happen at once.",
}

MECHANICAL_FIELDS: dict[str, Field] = {
    "arc": ("point", "", "number of the arc, of one word each"),
    "n_impacts": ("point", "", "impacts of a period of the motion"),
    "t": ("point", "", "time of the first impact"),
    "u": ("point", "", "speed of its gap after the first impact"),
    **BRANCH_FIELDS,
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter."""


class MechanicalEvent(NamedTuple):
    """Where a branch of orbits of a mechanical system changes.

    Attributes
    ----------
    kind : str
        ``fold``, ``period_doubling``, ``pitchfork`` (of a symmetric orbit), ``neimark_sacker``,
        ``grazing`` (an impact vanishes), ``interior_impact`` (a new one appears), ``contact_ends``
        (the force of a contact vanishes), ``end_of_rest`` (the duration of a contact vanishes),
        ``rest_appears`` (an impact sequence accumulates), ``opening`` (the impulse of an impact on
        a closed contact vanishes), ``simultaneous`` (two events coincide). With dry
        friction ``stick_vanishes`` (its duration), ``turn_sticks`` (the static limit holds a slip
        that turned), ``slip_grazing`` (a slip speed reaches zero tangentially), ``stick_appears``
        (it touches zero within a slip), ``slip_appears`` (the force of a stick reaches the static
        limit), ``slip_vanishes``.
    value : float
        The parameter.
    orbit : MechanicalOrbit
        The orbit there.
    gap : str or None
        The gap that it belongs to.
    kappa : float or None
        Of a Neimark-Sacker point the cosine of the angle of its multipliers.
    name : str
        The parameter's name.
    cubic : float or None
        For a period doubling or a pitchfork, the coefficient `c` of its normal form
        ``xi -> -xi + c xi**3``, for states relative to the size of the motion: positive if the
        bifurcation is supercritical, so that the other branch is stable.
    """

    kind: str
    value: float
    orbit: MechanicalOrbit
    gap: str | None = None
    kappa: float | None = None
    name: str = ""
    cubic: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class BranchArc:
    """A part of a branch on which the orbits have one word."""

    word: tuple[str, ...]
    orbits: list[MechanicalOrbit]
    values: Array

    def __len__(self) -> int:
        return len(self.orbits)

    def __repr__(self) -> str:
        ends = f"{self.values[0]:.9g} .. {self.values[-1]:.9g}"
        return f"<BranchArc {shortened(self.word)!r}, {len(self)} orbits, {ends}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBranch(OrbitsAlong[MechanicalEvent]):
    """Orbits of a mechanical system along a parameter, from word to word.

    Attributes
    ----------
    name : str
        The parameter.
    arcs : list of BranchArc
        Parts of one ``word`` each, in order, with their ``orbits`` and ``values``; where one ends
        at a grazing the next begins there.
    events : list of MechanicalEvent
        What happens, in order.
    status : OrbitStatus
        Why the branch ends: ``RANGE_END``, ``CLOSED`` (it came back to itself), ``RETRACED``,
        ``LEFT_ADMISSIBLE``, ``SIMULTANEOUS``, ``MAX_POINTS``, ``NOT_CONVERGED``; of its two ends
        the one that needs more attention.
    message : str
        What happened.
    n_flights : int
        Flights that were computed.
    """

    name: str
    arcs: list[BranchArc]
    events: list[MechanicalEvent]
    status: OrbitStatus
    message: str
    n_flights: int

    @property
    def orbits(self) -> list[MechanicalOrbit]:
        """The orbits of all arcs."""
        return [orbit for arc in self.arcs for orbit in arc.orbits]

    @property
    def values(self) -> Array:
        """The parameter at each orbit."""
        return np.concatenate([arc.values for arc in self.arcs])

    @property
    def words(self) -> list[str]:
        """The words of the arcs, in short."""
        return [shortened(arc.word) for arc in self.arcs]

    @property
    def multipliers(self) -> np.ndarray:
        """The multipliers of each orbit, a row each."""
        return np.array([orbit.multipliers for orbit in self.orbits])

    def switch(self, event: MechanicalEvent) -> MechanicalOrbit:
        """Return an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : MechanicalEvent
            One of `events`. At a period doubling, a nearby orbit of twice the period; at a
            pitchfork, an asymmetric orbit; at a grazing, the orbit without the impact; at an
            interior impact, the orbit with it; at the end of a rest, an orbit of many impacts past
            it; otherwise the orbit there.

        Returns
        -------
        MechanicalOrbit
            See its ``status`` for success.
        """
        orbit: MechanicalOrbit = import_attribute("zivi.orbits.follow", "switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Describe the dataset: points of the branch, with its events as attributes."""
        values = self._columns() | {
            "arc": np.repeat(np.arange(len(self.arcs)), [len(arc) for arc in self.arcs]),
            "n_impacts": [len(orbit.impacts) for orbit in self.orbits],
        }
        attrs = self._end_and_events() | {"words": self.words}
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **MECHANICAL_FIELDS}
        return ResultTable("Branch of periodic orbits", fields, {}, values, attrs)

    def __repr__(self) -> str:
        listed = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        words = " | ".join(self.words)
        return (
            f"<MechanicalBranch of {len(self)} orbits over {self.name}, {words}: "
            f"{listed or 'no events'}{self._failed_text()}; {self.status.name.lower()}>"
        )


# How a resting orbit ends.


def chatter_exponent(e: float) -> float:
    r"""Return the exponent with which a resting orbit ends.

    Near the parameter at which the impacts no longer accumulate before the force turns outward, the
    time at rest vanishes like :math:`(F_c - F)^\beta` with

    .. math::

        \lambda^3 + 2 \lambda^2 = e (1 + 2 \lambda), \quad \tau = 1 - \lambda, \quad
        \beta = \frac{\ln 1/\lambda}{\ln \mu}

    One plastic impact (e = 0) moves smoothly past the lift-off: :math:`\beta = 1`.
    """
    if e == 0.0:
        return 1.0
    roots = np.roots([1.0, 2.0, -2.0 * e, -e])
    lam = float(max(root.real for root in roots if abs(root.imag) < 1e-12))
    tau = 1.0 - lam
    half = tau / 2.0 - tau**2 / 3.0
    top = e * ((0.5 - 2.0 * tau / 3.0) * (1.0 - tau) + 2.0 * half)
    mu = top / ((1.0 - tau) ** 3 * (0.5 - tau / 3.0))
    return math.log(1.0 / lam) / math.log(mu)
