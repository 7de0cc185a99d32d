"""`zivi.continue_curve`: where an event happens, in two parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from zivi.base.check import Array, finite, integer
from zivi.base.table import Field, Table, Tabulated
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.along import with_failed
from zivi.orbits.branch import BranchEvent
from zivi.orbits.mechanical.branch import MechanicalEvent
from zivi.orbits.mechanical.crossing import crossed
from zivi.orbits.mechanical.curve import CurvePoint, Line, Named, run
from zivi.orbits.mechanical.equations import Frame, evaluate
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.find import orbit_of
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.reopening import about
from zivi.orbits.mechanical.rest_curve import rest_curve
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.sequence import as_word
from zivi.simulation.run import pair

__all__ = ["CodimensionTwo", "EventCurve", "continue_curve"]

KINDS = (
    "fold",
    "period_doubling",
    "pitchfork",
    "neimark_sacker",
    "grazing",
    "interior_impact",
    "contact_ends",
    "simultaneous",
    "end_of_rest",
)
FIELDS: dict[str, Field] = {
    "first": ("point", "", "first parameter"),
    "second": ("point", "", "second parameter"),
    "kappa": ("point", "", "cosine of the angle of the pair that turns"),
    "residual": ("point", "", "largest residual"),
}
MESSAGES = {
    OrbitStatus.RANGE_END: "The curve was followed to the ends of the ranges.",
    OrbitStatus.CLOSED: "The curve is closed.",
    OrbitStatus.MAX_POINTS: "The curve has max_points points.",
    OrbitStatus.NOT_CONVERGED: "No step was short enough for Newton's iteration to converge.",
}


class CodimensionTwo(NamedTuple):
    """A point at which two things happen at once.

    Attributes
    ----------
    kind : str
        On a fold ``cusp`` and ``fold_flip``, on a doubling ``fold_flip`` and
        ``generalized_period_doubling`` (its cubic coefficient vanishes); of a turning pair
        ``resonance_1_1`` to ``resonance_1_4``; of a grazing ``resonant_grazing`` (a curve of folds
        touches there) and ``period_doubling``; where a contact ends, or two events are at once,
        ``fold`` and ``period_doubling``. On all of them what ends a motion: ``grazing``
        (of another impact), ``interior_impact``, ``contact_ends``, ``end_of_rest``, ``opening``,
        ``simultaneous``.
    values : ndarray
        Both parameters.
    orbit : MechanicalOrbit
        The orbit there.
    """

    kind: str
    values: Array
    orbit: MechanicalOrbit


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class EventCurve(Tabulated):
    """Where an event happens, in two parameters.

    Attributes
    ----------
    kind : str
        The event.
    names : (str, str)
        The parameters.
    values : ndarray
        Their values along the curve, shape (k, 2).
    kappa : ndarray
        Of turning pairs the cosine of their angle, else NaN, shape (k,).
    residual : ndarray
        The largest residual of each point, relative to the size of the motion, shape (k,).
    points : list of CodimensionTwo
        Points of codimension two, in order.
    status : OrbitStatus
        ``RANGE_END``, ``CLOSED``, ``MAX_POINTS`` or ``NOT_CONVERGED``, of both ends.
    message : str
        What happened.
    """

    kind: str
    names: tuple[str, str]
    values: Array
    kappa: Array
    residual: Array
    points: list[CodimensionTwo]
    status: OrbitStatus
    message: str
    _found: list[CurvePoint]
    _multiple: int

    def __len__(self) -> int:
        return len(self.values)

    def orbits(self, i: int) -> MechanicalOrbit:
        """Give the orbit at a point of the curve.

        Parameters
        ----------
        i : int
            Which. An end of rest of one mass keeps none; of a mechanical system it is the
            shortest rest that was computed.

        Returns
        -------
        MechanicalOrbit
            ``admissible`` tells whether it is a motion.
        """
        return orbit_at(self._found[i], self._multiple)

    @property
    def admissible(self) -> np.ndarray:
        """Whether the orbit is a motion at each point."""
        return np.array([_why_not(it) is None for it in self._found], dtype=bool)

    def of_kind(self, kind: str) -> list[CodimensionTwo]:
        """Give the points of codimension two of one kind.

        Parameters
        ----------
        kind : str
            As in `CodimensionTwo`.

        Returns
        -------
        list of CodimensionTwo
            In the order of the curve.
        """
        return [point for point in self.points if point.kind == kind]

    def switch(self, point: CodimensionTwo) -> MechanicalOrbit:
        """Give the orbit at a point of codimension two, from where other branches begin.

        Parameters
        ----------
        point : CodimensionTwo
            One of `points`.

        Returns
        -------
        MechanicalOrbit
            The orbit there.
        """
        return point.orbit

    def _failed_text(self) -> str:
        failed = failed_text(self._found)
        return f", {failed}" if failed else ""

    def _table(self) -> Table:
        values = {"first": self.values[:, 0], "second": self.values[:, 1]}
        attrs = {
            "kind": self.kind,
            "names": list(self.names),
            "status": self.status.name,
            "points": [point.kind for point in self.points],
        }
        return Table("Curve of an event in two parameters", FIELDS, {}, values, attrs)

    def __repr__(self) -> str:
        listed = ", ".join(
            f"{it.kind} at ({it.values[0]:.9g}, {it.values[1]:.9g})" for it in self.points
        )
        return (
            f"<EventCurve of {self.kind} over {self.names[0]} and {self.names[1]}, "
            f"{len(self)} points: {listed or 'nothing else'}{self._failed_text()}; "
            f"{self.status.name.lower()}>"
        )


def continue_curve(
    event: MechanicalEvent | BranchEvent,
    names: Sequence[str],
    spans: Sequence[Sequence[float]],
    *,
    step: float = 0.02,
    max_points: int = 400,
) -> EventCurve:
    """Follow an event of a branch in two parameters, in both directions.

    Parameters
    ----------
    event : MechanicalEvent or BranchEvent
        A ``fold``, ``period_doubling``, ``pitchfork``, ``neimark_sacker``, ``grazing``,
        ``interior_impact``, ``contact_ends``, ``simultaneous`` or ``end_of_rest`` of a branch; of
        one mass not ``rest_appears`` and ``end_of_liftoff``. For an end of rest the first parameter
        is that of its branch.
    names : (str, str)
        The parameters, as in `continue_orbit`.
    spans : ((float, float), (float, float))
        Their ranges.
    step : float
        The first step along the curve, relative to the ranges and the motion. Steps adapt.
    max_points : int
        Most points.

    Returns
    -------
    EventCurve
        What was found, with its status.

    Raises
    ------
    ValueError
        For another kind of event, a parameter that there is not, a range that is none.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> orbit = zivi.periodic_orbit(zivi.ImpactSystem(table, e=0.5), [(0.6, 2.1)])
    >>> branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))
    >>> fold = branch.of_kind("fold")[0]
    >>> curve = zivi.continue_curve(fold, ("amplitude", "e"), ((0.1, 2.0), (0.3, 0.9)))
    >>> amplitude, e = curve.values.T
    >>> bool(np.max(np.abs(amplitude - np.pi * (1 - e) / (1 + e))) < 1e-11)
    True
    """
    if not isinstance(event, MechanicalEvent | BranchEvent):
        raise TypeError(f"event must be one of a branch, got {event!r}")
    if event.kind not in KINDS:
        raise ValueError(f"event must be one of {', '.join(KINDS)}, got {event.kind!r}")
    rests = event.kind == "end_of_rest"
    both = tuple(str(name) for name in names)
    if len(both) != 2 or both[0] == both[1]:
        raise ValueError(f"names must be two different parameters, got {both!r}")
    if len(spans) != 2:
        raise ValueError("spans must be two ranges, ((low, high), (low, high))")
    ranges = np.array(
        [[finite("spans", end) for end in pair("spans", it, "(low, high)")] for it in spans]
    )
    if isinstance(event, BranchEvent) and "e" in both:
        ranges[both.index("e")] = ranges[both.index("e")].clip(0.0, 1.0)
    orbit: Any = event.orbit
    if isinstance(event, BranchEvent) and not rests:
        orbit = _of_one_mass(event.orbit)
    for name, (low, high) in zip(both, ranges, strict=True):
        value = value_of(orbit.system, name)
        if not low <= value <= high or low == high:
            raise ValueError(
                f"spans must contain {name} = {value} of the event, got ({low}, {high})"
            )
    if not 0.0 < finite("step", step) < 1.0:
        raise ValueError(f"step must be in (0, 1), got {step}")
    if integer("max_points", max_points) < 2:
        raise ValueError(f"max_points must be >= 2, got {max_points}")
    if rests:
        if isinstance(event, MechanicalEvent) and event.name != both[0]:
            raise ValueError(f"names must begin with that of the branch, {event.name!r}")
        of_rest = rest_curve(event, (both[0], both[1]), ranges, step, max_points)
        return _of_rest((both[0], both[1]), *of_rest, orbit.multiple)
    frame, y = _critical_word(event, orbit)
    kappa = getattr(event, "kappa", None)
    if kappa is None and event.kind == "neimark_sacker":
        turning = orbit.multipliers[np.imag(orbit.multipliers) > 0.0]
        kappa = float(np.real(turning[0]) / np.abs(turning[0]))
    found = _followed(event.kind, frame, y, (both[0], both[1]), ranges, step, max_points, kappa)
    return _curve(event.kind, (both[0], both[1]), found, orbit.multiple)


def _of_one_mass(orbit: PeriodicOrbit) -> MechanicalOrbit:
    """Give an orbit of one mass with its word."""
    if orbit.kind == "resting":
        raise ValueError("event: a resting orbit of one mass has no curve but that of its end")
    terms = evaluate(*as_word(orbit.system, orbit._frame, orbit._y))
    return orbit_of(terms, orbit.multiple, orbit.residual, 0, None)


def _followed(
    kind: str,
    frame: Frame,
    y: Array,
    names: tuple[str, str],
    ranges: Array,
    step: float,
    most: int,
    kappa: float | None,
) -> tuple[list[CurvePoint], list[Named], OrbitStatus]:
    line = Line(kind, frame, y, names, np.ptp(ranges, axis=1), kappa or 0.0)
    start = line.start(y, kappa or 0.0)
    if start is None:
        raise ValueError("event: its equations could not be solved")
    borders = line.critical
    ahead = run(line, start, ranges, step, most // 2 + 1, 1.0)
    if ahead[2] is OrbitStatus.CLOSED:
        return ahead
    line.critical = borders
    back = run(line, start, ranges, step, most - len(ahead[0]) + 1, -1.0)
    order = list(MESSAGES)
    status = max(ahead[2], back[2], key=order.index)
    return back[0][:0:-1] + ahead[0], back[1][::-1] + ahead[1], status


def _curve(
    kind: str,
    names: tuple[str, str],
    found: tuple[list[CurvePoint], list[Named], OrbitStatus],
    multiple: int,
) -> EventCurve:
    points, named, status = found
    turning = kind == "neimark_sacker"
    return EventCurve(
        kind=kind,
        names=names,
        values=np.array([it.values for it in points]),
        kappa=np.array([it.kappa if turning else np.nan for it in points]),
        residual=np.array([it.residual for it in points]),
        points=[
            CodimensionTwo(it.kind, it.point.values, orbit_at(it.point, multiple)) for it in named
        ],
        status=status,
        message=with_failed(MESSAGES[status], failed_text(points)),
        _found=points,
        _multiple=multiple,
    )


def _of_rest(
    names: tuple[str, str],
    values: Array,
    found: list[CurvePoint],
    status: OrbitStatus,
    multiple: int,
) -> EventCurve:
    none = np.full(len(values), np.nan)
    residual = np.array([it.residual for it in found]) if found else none
    message = with_failed(MESSAGES[status], failed_text(found))
    return EventCurve(
        "end_of_rest", names, values, none, residual, [], status, message, found, multiple
    )


def failed_text(found: list[CurvePoint]) -> str:
    """Say at how many points the orbit is no motion, nothing if it is one everywhere."""
    number = sum(_why_not(it) is not None for it in found)
    return f"{number} of {len(found)} points where the orbit is no motion" if number else ""


def _critical_word(event: Any, orbit: MechanicalOrbit) -> tuple[Frame, Array]:
    """Give the word of an event: with the impact that is about to begin."""
    smooth = all(it.kind == "P" for it in orbit._frame.word)
    if event.kind == "contact_ends" and smooth and isinstance(orbit._frame.section, float):
        return _around_least_force(orbit)
    if event.kind != "interior_impact":
        return orbit._frame, orbit._y
    terms = evaluate(orbit._frame, orbit._y)
    own = [low for low in Margins(terms).lows if low.kind == "interior_impact"]
    beyond = crossed(terms, min(own, key=lambda it: abs(it.value))) if own else None
    if beyond is None:
        raise ValueError("event: there is no minimum of a gap to insert an impact at")
    return beyond


def _around_least_force(orbit: MechanicalOrbit) -> tuple[Frame, Array]:
    """Put the section of a motion without events away from where a force is least."""
    terms = evaluate(orbit._frame, orbit._y)
    lows = [it for it in Margins(terms).lows if it.kind == "contact_ends"]
    return about(terms, min(lows, key=lambda it: it.value / it.size).t)


def _why_not(point: CurvePoint) -> str | None:
    """Say why a point is no motion; None if it is one."""
    return Margins(point.terms).why_not(1e-9, grazing=True)


def orbit_at(point: CurvePoint, multiple: int) -> MechanicalOrbit:
    """Give the orbit at a point."""
    why = _why_not(point)
    return orbit_of(
        point.terms,
        multiple,
        point.residual,
        point.corrections,
        why,
        message="A point of a curve.",
    )
