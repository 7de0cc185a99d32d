"""Solutions of the orbit equations over a parameter: margins, tangents, events."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, finite
from zivi.orbits.dry_friction import friction_flow_of
from zivi.orbits.equations import (
    Frame,
    MassTerms,
    Terms,
    evaluate,
    multipliers_of,
    row_sizes,
    sizes_of,
)
from zivi.orbits.flows import (
    FlightError,
    Flow,
    LinearFlow,
    MassFlow,
    MassImpulses,
    NonlinearFlow,
    Word,
    corrected,
    is_exact,
)
from zivi.simulation.methods import SwitchedRK
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import (
    ParametricSystem,
    excitation,
    friction_numbers,
    parameter,
    parameters_of,
    with_friction_numbers,
    with_value,
)

# A step of a search for a zero in a bracket.

Look = tuple[float, float]
"""A place and the value there."""


def secant(last: Look, before: Look, low: float, high: float) -> float:
    """Return the zero of a line through two points, or the middle where that is not within."""
    rise = last[1] - before[1]
    if np.isfinite(rise) and rise != 0.0:
        part = last[0] - last[1] * (last[0] - before[0]) / rise
        if low < part < high:
            return float(part)
    return 0.5 * (low + high)


# The numbers of a mechanical system by their names, and systems with other values of them.

System = TypeVar("System", bound=MechanicalSystem | ImpactSystem)
OF_WALL = ("amplitude", "omega", "phase")


def core_of(system: MechanicalSystem) -> MechanicalSystem:
    """Return the mechanical system that a parametric system builds."""
    return system._built if isinstance(system, ParametricSystem) else system


def _parameters(system: MechanicalSystem) -> dict[str, float]:
    return dict(getattr(system, "parameters", {}))


def values_of(system: MechanicalSystem | ImpactSystem) -> dict[str, float]:
    """Return the numbers that have names, and their values."""
    if isinstance(system, ImpactSystem):
        return {"e": system.e} | parameters_of(system)
    found = _parameters(system)
    if isinstance(system, LinearSystem):
        found |= _of_linear(system)
    found |= {name: it.value for name, it in friction_numbers(system).items()}
    if system.m:
        e = system.e
        if np.ptp(e) == 0.0:
            found["e"] = float(e[0])
        found |= {f"e.{name}": float(e[i]) for i, name in enumerate(system.gap_names)}
    return found


def _of_linear(system: LinearSystem) -> dict[str, float]:
    found: dict[str, float] = {}
    waves = [part for part in system.excitation if isinstance(part, Harmonic)]
    if waves and len({wave.omega for wave in waves}) == 1:
        found["omega"] = waves[0].omega
        force = _strength(waves)
        found |= {"F": force, "amplitude": force}
        found["phase"] = waves[0].phase
    for name, gap in zip(system.gap_names, system.gaps, strict=True):
        assert isinstance(gap, LinearGap)
        found[f"{name}.offset"] = float(gap.offset)
        if isinstance(gap.motion, HarmonicWall):
            found |= {f"{name}.{part}": getattr(gap.motion, part) for part in OF_WALL}
    moving = {name: value for name, value in found.items() if name.endswith(".omega")}
    if not waves and len(set(moving.values())) == 1:
        found["omega"] = next(iter(moving.values()))
    return found


def _strength(waves: list[Harmonic]) -> float:
    """Return the largest amplitude of the loads, with the sign of the load."""
    loads = np.concatenate([np.atleast_1d(np.asarray(wave.amplitude)) for wave in waves])
    return float(loads[int(np.argmax(np.abs(loads)))])


def value_of(system: MechanicalSystem | ImpactSystem, name: str) -> float:
    """Return the value of a number by its name.

    Raises
    ------
    ValueError
        For a name that there is not, with those that there are.
    """
    if isinstance(system, ImpactSystem):
        own = values_of(system)
        return own[name] if name in own else parameter(system, name)
    known = values_of(system)
    if name not in known:
        hint = "" if known else ": zivi.ParametricSystem(build, {...}) gives numbers names"
        raise ValueError(
            f"unknown parameter {name!r}; the parameters are {', '.join(known) or 'none'}{hint}"
        )
    return known[name]


def with_values(system: System, values: Mapping[str, float]) -> System:
    """Return the same system with other values of some numbers."""
    if isinstance(system, ImpactSystem):
        return _mass_with(system, values)  # type: ignore[return-value]
    new: Any = system
    own = _parameters(system)
    given = {name: value for name, value in values.items() if name in own}
    if given:
        new = system.replace(**given)
        if isinstance(system, ParametricSystem) and np.any(system.e != system._built.e):
            new = _with_e(new, system.e)
    known = values_of(system) if len(given) < len(values) else {}
    for name, value in values.items():
        if name in given:
            continue
        if name not in known:
            value_of(system, name)
        if name in friction_numbers(new):
            new = with_friction_numbers(new, {name: value})
        elif name == "e" or name.startswith("e."):
            new = _with_e(new, _moved_e(new, name, value))
        else:
            assert isinstance(new, LinearSystem)
            new = _with_number(new, name, value, known[name])
    return new  # type: ignore[no-any-return]


def _mass_with(system: ImpactSystem, values: Mapping[str, float]) -> ImpactSystem:
    """Return one mass with other values: a step over 1 may go to an e that no system has."""
    e, new = values.get("e", system.e), system
    if not 0.0 <= system.e <= 1.0:
        new = ImpactSystem(system.force, e=1.0, wall=system.wall)
    for name, value in values.items():
        if name != "e":
            new = with_value(new, name, value)
    if new.e != e:
        new = with_value(new, "e", min(max(e, 0.0), 1.0))
        new._e = e
    return new


def _moved_e(system: MechanicalSystem, name: str, value: float) -> Array:
    e = system.e
    if name == "e":
        e[:] = value
    else:
        e[system.gap_names.index(name.removeprefix("e."))] = value
    return e


def _with_e(system: MechanicalSystem, e: Array) -> MechanicalSystem:
    """Return a copy with other coefficients of restitution: a difference may step over 1."""
    new = object.__new__(type(system))
    vars(new).update(vars(system))
    new._e = np.asarray(e, np.float64)
    return new


def _with_number(system: LinearSystem, name: str, value: float, now: float) -> LinearSystem:
    parts, gaps = system.excitation, list(system.gaps)
    waves = any(isinstance(part, Harmonic) for part in parts)
    if name in ("omega", "F", "amplitude", "phase") and waves:
        parts = tuple(
            _wave(part, name, value, now) if isinstance(part, Harmonic) else part for part in parts
        )
    else:
        for i, gap in enumerate(gaps):
            assert isinstance(gap, LinearGap)
            gaps[i] = _moved_gap(gap, system.gap_names[i], name, value)
    return system._with(parts, tuple(gaps))


def _wave(part: Harmonic, name: str, value: float, now: float) -> Harmonic:
    if name == "omega":
        return dataclasses.replace(part, omega=value)
    if name == "phase":
        return dataclasses.replace(part, phase=part.phase + value - now)
    if now == 0.0:
        raise ValueError(f"{name} must not be 0: the direction of the load would be undefined")
    return dataclasses.replace(part, amplitude=np.asarray(part.amplitude) * (value / now))


def _moved_gap(gap: LinearGap, own: str, name: str, value: float) -> LinearGap:
    if name == f"{own}.offset":
        return LinearGap(gap.normal, value, gap.motion, gap.name)
    wall = gap.motion
    part = "omega" if name == "omega" else name.removeprefix(f"{own}.")
    if isinstance(wall, HarmonicWall) and part in OF_WALL and (name in ("omega", f"{own}.{part}")):
        wall = dataclasses.replace(wall, **{part: value})
        return LinearGap(gap.normal, gap.offset, wall, gap.name)
    return gap


def frequency_of(system: MechanicalSystem | ImpactSystem) -> float | None:
    """Return the angular frequency of the excitation; None if unknown."""
    if isinstance(system, ImpactSystem):
        return excitation(system)[0]
    core: Any = core_of(system)
    found = {abs(it.omega) for it in getattr(core, "excitation", ()) if isinstance(it, Harmonic)}
    walls = [getattr(gap, "motion", None) for gap in core.gaps]
    found |= {abs(it.omega) for it in walls if isinstance(it, HarmonicWall) and it.amplitude}
    found.discard(0.0)
    if len(found) != 1 or not math.isfinite(next(iter(found))):
        return None
    return float(found.pop())


def period_of(
    system: MechanicalSystem | ImpactSystem,
    period: float | str | None,
    *,
    or_free: bool = False,
) -> float:
    """Return the period of the excitation; raise a ValueError if unknown."""
    if period is not None:
        if not (period := finite("period", period)) > 0.0:
            raise ValueError(f"period must be > 0, got {period}")
        return period
    omega = frequency_of(system)
    if omega is None:
        what = "force" if isinstance(system, ImpactSystem) else "system"
        hint = "; period='free' finds it for an autonomous system" if or_free else ""
        raise ValueError(
            f"period must be given (s): the {what} does not have a single excitation of known "
            f"period{hint}"
        )
    return 2.0 * math.pi / omega


# Systems with other numbers, and the derivatives of the equations by them.

STEPS = (1e-5, 2e-3)
"""Of a difference of second order, and of one of sixth, relative to the parameter."""
SHORTER_STEPS = (1.0, 1e-2, 1e-4)
"""Parts of the step that are tried near the end of a rest."""


def flow_of(system: MechanicalSystem | ImpactSystem, method: SwitchedRK) -> Flow:
    """Return the motions of a system with given contacts."""
    if isinstance(system, ImpactSystem):
        return MassFlow(system, method)
    core = core_of(system)
    if core.channel_names:
        return friction_flow_of(core, method)
    if is_exact(core):
        assert isinstance(core, LinearSystem)
        flow: Flow = LinearFlow(core)
    else:
        flow = NonlinearFlow(core, method)
    flow.e = system.e
    return flow


def moved_frame(frame: Frame, values: Mapping[str, float]) -> Frame:
    """Return the frame of the system with other values of some numbers."""
    return frame_of(frame, with_values(frame.system, values))


def frame_of(frame: Frame, system: MechanicalSystem | ImpactSystem) -> Frame:
    """Return the frame of a system that differs by some numbers."""
    flow = flow_of(system, frame.method)
    return dataclasses.replace(frame, system=system, flow=flow, length=length_of(frame, system))


def length_of(frame: Frame, system: MechanicalSystem | ImpactSystem) -> float:
    """Return the length of the period of such a system."""
    return frame.length if frame.free else frame.length * _stretch(frame, system)


def _stretch(frame: Frame, system: MechanicalSystem | ImpactSystem) -> float:
    """Return by which factor the period changes."""
    before, after = frequency_of(frame.system), frequency_of(system)
    if before is not None and after is not None:
        return before / after
    if before is not None and isinstance(system, ImpactSystem):
        raise ValueError("period: the excitation does not have a single period")
    # a number of a system of functions that is the frequency, or the period, of its forces
    turns = frame.length / (2.0 * math.pi)
    now, then = values_of(frame.system), values_of(system)
    for name, value in now.items():
        if value == then[name] or value == 0.0 or then[name] == 0.0:
            continue
        count = turns * value * (1.0 if frame.turn is None else 2.0)
        if round(count) >= 1 and abs(count - round(count)) < 1e-9 * count:
            return value / then[name]
        count = frame.length / value
        if name in ("T", "period") and abs(count - round(count)) < 1e-9:
            return then[name] / value
    return 1.0


def by_parameter(frame: Frame, y: Array, name: str, *, precise: bool = False) -> Array:
    """Return the derivative of the equations by a parameter, by central differences."""
    value = value_of(frame.system, name)
    h = STEPS[precise] * max(abs(value), 1e-2)
    if isinstance(frame.flow, MassFlow) and not is_resting(frame.word):
        return mass_column(evaluate(frame, y, name=name), name)

    def at(steps: float) -> Array:
        moved = moved_frame(frame, {name: value + steps * h})
        return evaluate(moved, y, slopes=False).residual

    def centred(steps: float) -> Array:
        return np.asarray((at(steps) - at(-steps)) / (2.0 * steps * h), np.float64)

    if not precise:
        for k in SHORTER_STEPS:
            try:
                return centred(k)
            except FlightError:
                # an accumulation that is thrown off there: only the convergence depends on it
                continue
        return centred(1e-6)
    return 1.5 * centred(1) - 0.6 * centred(2) + 0.1 * centred(3)


def ahead(terms: Terms, name: str) -> Array:
    """Return the derivative of the equations by a parameter, by a difference of first order."""
    frame, value = terms.frame, value_of(terms.frame.system, name)
    for k in SHORTER_STEPS:
        h = k * 1e-2 * STEPS[0] * max(abs(value), 1e-2)
        try:
            moved = evaluate(moved_frame(frame, {name: value + h}), terms.y, slopes=False)
        except FlightError:
            continue
        return np.asarray((moved.residual - terms.residual) / h, np.float64)
    return by_parameter(frame, terms.y, name)


def is_resting(word: Word) -> bool:
    """Whether a gap is closed at some time."""
    return any(it.contacts for it in word)


def mass_column(terms: Terms, name: str) -> Array:
    """Return the derivative of the equations of one mass, whose flights have it."""
    frame, x = terms.frame, terms.x
    flow, longer = frame.flow, _longer(frame, name)
    assert isinstance(flow, MassFlow)
    if isinstance(terms, MassTerms):
        return terms.column(name, longer)
    rows = np.zeros((len(x), 4))
    if name == "e":
        ends = terms.flights.z
        rows[:, 3] = [z[1] * (it.kind == "I") for z, it in zip(ends, frame.word, strict=True)]
    else:
        moved = flow.fly((), x[:, 0], x[:, 1:-1], x[:, -1], name).by
        assert moved is not None
        e = float(flow.e[0])
        for row, (dx, dv), it in zip(rows, moved, frame.word, strict=True):
            row[2:] = (-dx, e * dv) if it.kind == "I" else (-dx, -dv)
            # the condition there: zero distance, zero velocity, or a fixed time of a section
            row[0] = dx if it.kind == "I" else dv if isinstance(frame.section, int) else 0.0
    rows[-1, 1] += longer
    return rows.ravel()


def _longer(frame: Frame, name: str) -> float:
    """Return the derivative of the length by a parameter."""
    trend = trend_of(frame, name)
    return trend * frame.length / value_of(frame.system, name) if trend else 0.0


def trend_of(frame: Frame, name: str) -> int:
    """Return the sign of the dependence of the period on a parameter: 1, -1 or 0."""
    omega, its_name = excitation(frame.system)
    if frame.free or name == "e" or (omega is not None and its_name != name):
        return 0
    if not (value := value_of(frame.system, name)):
        return 0
    ratio = _stretch(frame, with_values(frame.system, {name: 1.25 * value}))
    return (ratio > 1.0) - (ratio < 1.0)


# Whether the solution of a word's equations is a motion, and how far it is from none.
#
# A motion has negative speeds of gaps before impacts, positive gaps in flight, positive forces of
# contacts, contacts that last, positive impulses of contacts that an impact leaves closed.

LOOKS = np.unique(np.concatenate([np.linspace(0.0, 1.0, 65), np.geomspace(1e-5, 1e-2, 10)]))
"""Parts of a segment at which gaps and forces are looked at."""
FLAT = 1e-4
"""A gap that stays below this part of the coordinates has their rounding."""
MARGIN_CLOSE = 1e-13
"""How near two times of a minimum are when it is found."""
OUT = {
    "grazing": "The impact at t = {t:.9g} s would open the gap at {value:.3g}, not close it.",
    "interior_impact": "A gap is {value:.3g} < 0 in flight, at t = {t:.9g} s.",
    "contact_ends": "The force of a contact is {value:.3g} < 0 at t = {t:.9g} s.",
    "end_of_rest": "The contact from t = {t:.9g} s would last {value:.3g} s < 0.",
    "rest_appears": "The force holds the mass after an impact at t = {t:.9g} s: {value:.3g} < 0.",
    "opening": "An impact at t = {t:.9g} s would pull at a contact, with {value:.3g} < 0.",
    "simultaneous": "At t = {t:.9g} s two events have changed places, by {value:.3g} < 0.",
    "slip_grazing": "The slip speed at t = {t:.9g} s does not fall to zero but rises from it, with "
    "the rate {value:.3g} < 0.",
    "stick_appears": "A slip speed is {value:.3g} < 0 in slip, at t = {t:.9g} s.",
    "slip_appears": "The force of a stick passes the static limit at t = {t:.9g} s.",
    "stick_vanishes": "The stick from t = {t:.9g} s would last {value:.3g} s < 0.",
    "slip_vanishes": "The slip from t = {t:.9g} s would last {value:.3g} s < 0.",
    "turn_sticks": "At t = {t:.9g} s the static limit holds where the slip would turn.",
}
"""What is not there in a motion, by the event at which it begins."""
OUT_OF_MASS = {
    "grazing": "The impact at t = {t:.9g} s would leave the wall at {u:.3g} m/s < 0.",
    "rest_appears": "After the plastic impact at t = {t:.9g} s the force holds the mass at the "
    "wall.",
    "interior_impact": "The flight goes behind the wall, to {value:.3g} m at t = {t:.9g} s.",
}
"""The same of one mass."""


class Constraint(NamedTuple):
    """Something that must be positive."""

    kind: str
    segment: int
    gap: int
    t: float
    value: float
    size: float
    """What is large of its kind."""


@dataclasses.dataclass(frozen=True)
class Margins:
    """Quantities that are positive for an admissible solution."""

    terms: Terms

    @functools.cached_property
    def lows(self) -> list[Constraint]:
        """All that must be positive; of gaps and forces their minima."""
        found = [*self._events(), *self._lasting(), *self._kinks()]
        for s in range(len(self.terms.frame.word)):
            found += self.between(s)
        return found

    @property
    def least(self) -> Constraint | None:
        """The least margin relative to its scale."""
        return min(self.lows, key=lambda it: it.value / it.size, default=None)

    def why_not(self, rounding: float = 1e-11, *, grazing: bool = False) -> str | None:
        """Return why it is inadmissible; None if it is admissible.

        Where it grazes all of its impacts may be as slow as rounding: it counts by other speeds, as
        always that of one mass.
        """
        lows, mass = self.lows, isinstance(self.terms.frame.flow, MassFlow)
        if lows and (grazing or mass):
            limit = -rounding * float(row_sizes(self.terms)[-2])
            lows = [it for it in lows if it.kind != "grazing" or it.value < limit]
        out = [it for it in lows if it.value <= -rounding * it.size]
        if not out:
            return None
        # for one mass, a vanishing impact hides minima with x < 0
        dying = [it for it in out if mass and it.kind == "grazing"]
        least = min(dying or out, key=lambda it: it.value / it.size)
        why = (OUT | OUT_OF_MASS if mass else OUT)[least.kind]
        u = float(self.terms.frame.flow.e[least.gap]) * least.value
        return why.format(t=least.t, value=least.value, u=u)

    @property
    def depth(self) -> float:
        """How far the nearest grazing is: the least minimum of a gap or height of an impact."""
        terms, heights = self.terms, [math.inf]
        if terms.flights.lows is not None:
            return self._depth_of_mass()
        for s, segment in enumerate(terms.frame.word):
            if segment.kind in "ISZ":
                pull = abs(self._pull(s, segment.gap))
                heights.append(terms.rates[s] ** 2 / (2.0 * pull) if pull else math.inf)
        gaps = [abs(low.value) for low in self.lows if low.kind == "interior_impact"]
        return float(min([*heights, *gaps]))

    def _depth_of_mass(self) -> float:
        """Return that of one mass: a force that presses hides none."""
        terms = self.terms
        touches = [abs(low.value) for low in self.lows if low.kind == "interior_impact"]
        lowest = min(touches, default=math.inf)
        if terms.frame.word[0].kind == "P":
            return lowest
        v, pull = terms.flights.z[:, 1], terms.flights.last[:, 1]
        pulled = pull > 0.0
        return min(lowest, float(np.min(v[pulled] ** 2 / (2.0 * pull[pulled]), initial=np.inf)))

    def _pull(self, s: int, gap: int) -> float:
        """Return the acceleration of a gap before an impact."""
        terms = self.terms
        t0, t1 = terms.x[s, 0], terms.x[s, -1]
        h = 1e-4 * (t1 - t0)
        times = np.array([t1 - h, t1])
        z = terms.frame.flow.path(terms.frame.word[s].contacts, t0, terms.x[s, 1:-1], times)
        rates = terms.frame.flow.gaps(times, z)[1][:, gap]
        return float((rates[1] - rates[0]) / h) if h else math.inf

    def _events(self) -> list[Constraint]:
        terms, found = self.terms, []
        hits = [s for s, it in enumerate(terms.frame.word) if it.kind in "ISZ"]
        fastest = float(np.max(np.abs(terms.rates[hits]), initial=0.0)) or 1.0
        for s, segment in enumerate(terms.frame.word):
            found += self._end_of_slip(s) if segment.kind in "KT" else []
        for s in hits:
            segment, t = terms.frame.word[s], float(terms.x[s, -1])
            found.append(Constraint("grazing", s, segment.gap, t, -float(terms.rates[s]), fastest))
            if not segment.kept:
                continue
            largest = float(np.max(np.abs(terms.impulses[s]), initial=1e-300))
            for gap, impulse in zip(segment.kept, terms.impulses[s][1:], strict=True):
                found.append(Constraint("opening", s, gap, t, float(impulse), largest))
        return found

    def _end_of_slip(self, s: int) -> list[Constraint]:
        """Return the rate at which a slip ends, and the level past the static limit if it turns."""
        terms = self.terms
        flow, segment, t = terms.frame.flow, terms.frame.word[s], float(terms.x[s, -1])
        ends = terms.flights.first, terms.flights.last
        size = max(float(np.abs(it[:, flow.n :]).max()) for it in ends) or 1.0
        own = Constraint("slip_grazing", s, segment.gap, t, -float(terms.rates[s]), size)
        if segment.kind == "K":
            return [own]
        stuck = tuple(sorted({*segment.contacts, segment.gap} - {-1 - segment.gap}))
        level = flow.reaction(stuck, segment.gap, t, terms.flights.z[s])
        size = max(size, abs(level.value))
        return [own, Constraint("turn_sticks", s, segment.gap, t, -level.value, size)]

    def _lasting(self) -> list[Constraint]:
        terms, found = self.terms, []
        for s, segment in enumerate(terms.frame.word):
            kind = "end_of_rest" if segment.contacts else "simultaneous"
            if terms.frame.flow.channels:
                before = terms.frame.word[s - 1]
                same = before.gap == segment.gap and segment.kind != "P"
                stuck = "stick" if segment.kind == "B" else "slip"
                kind = f"{stuck}_vanishes" if same else "simultaneous"
            t = float(terms.x[s, 0])
            last = float(terms.x[s, -1]) - t
            if kind != "simultaneous" or last < 0.0:
                found.append(Constraint(kind, s, segment.gap, t, last, abs(terms.length)))
        return found

    def _kinks(self) -> list[Constraint]:
        """Look for gaps that are least where an impact of another one turns them."""
        terms, found = self.terms, []
        frame, word = terms.frame, terms.frame.word
        for s, segment in enumerate(word):
            others = [i for i in range(frame.flow.m) if i not in (segment.gap, *segment.contacts)]
            if segment.kind not in "IS" or not others:
                continue
            t, last = terms.x[s, -1:], s + 1 == len(word)
            before = frame.flow.path(segment.contacts, float(terms.x[s, 0]), terms.x[s, 1:-1], t)
            after = terms.x[(s + 1) % len(word), None, 1:-1]
            if last and frame.turn is not None:
                after = after @ frame.turn.T
            gaps, rates = frame.flow.gaps(t, before)
            turned = frame.flow.gaps(t, after)[1]
            size = max(float(np.max(np.abs(before[0, : frame.flow.n]))), 1e-300)
            for i in others:
                if rates[0, i] < 0.0 <= turned[0, i]:
                    found.append(
                        Constraint("simultaneous", s, i, float(t[0]), float(gaps[0, i]), size)
                    )
        return found

    def behind(self) -> list[Constraint]:
        """Return the minima next to impacts that open: the gap is below zero since they do."""
        word, found = self.terms.frame.word, []
        for s, segment in enumerate(word):
            if segment.kind != "I" or not self.terms.rates[s] > 0.0:
                continue
            for at, which in ((s, -1), ((s + 1) % len(word), 0)):
                own = [
                    it
                    for it in self.lows
                    if it[:3] == ("interior_impact", at, segment.gap) and it.value < 0.0
                ]
                found += sorted(own, key=lambda it: it.t)[which:][:1]
        return found

    def between(self, s: int, gap: int | None = None) -> list[Constraint]:
        """Find minima of open gaps and of contact forces in a segment, of one gap or of all."""
        terms = self.terms
        flow, segment = terms.frame.flow, terms.frame.word[s]
        t0, t1 = float(terms.x[s, 0]), float(terms.x[s, -1])
        if t1 <= t0:
            return []
        touches = "stick_appears" if flow.channels else "interior_impact"
        lows, times = terms.flights.lows, t0 + (t1 - t0) * LOOKS
        if lows is not None and not segment.contacts:
            speeds = float(terms.flights.first[s, 0]), float(terms.flights.last[s, 0])
            at_ends = self._at_ends(s, 0, speeds, float(terms.flights.z[s, 0]), self._distance)
            return [*self._of_mass(s, *lows[s]), *at_ends]
        z = flow.path(segment.contacts, t0, terms.x[s, 1:-1], times)
        gaps, rates = flow.gaps(times, z, segment.contacts)
        part = slice(flow.n, None) if flow.channels else slice(flow.n)
        found, widest = [], float(np.max(np.abs(z[:, part])))
        # at a lift-off the rate of its gap is zero up to rounding: no minimum
        lifted = terms.frame.word[s - 1].gap if terms.frame.word[s - 1].kind in "LB" else -1
        for i in range(flow.m):
            if i in segment.contacts or gap not in (None, i):
                continue
            # a gap of a short flight is a difference of coordinates
            size = max(float(np.max(np.abs(gaps[:, i]))), FLAT * widest, 1e-300)
            turns = np.flatnonzero((rates[:-1, i] < 0.0) & (rates[1:, i] >= 0.0))
            for k in turns[(turns > 0) | (i != lifted)]:
                t, value = self._minimum(s, i, times[k : k + 2], rates[k : k + 2, i])
                found.append(Constraint(touches, s, i, t, value, size))
            if not flow.channels:
                ends = float(rates[0, i]), float(rates[-1, i])
                found += self._at_ends(s, i, ends, float(gaps[-1, i]), size)
        if segment.held:
            found += self._forces(s, times, z, gap)
        return found

    def _at_ends(
        self, s: int, gap: int, rates: tuple[float, float], value: float, size: float
    ) -> list[Constraint]:
        """Return the minimum of a gap where a period without events ends and begins.

        Its rate vanishes there up to rounding, which may hide it from both sides.
        """
        frame, (first, last) = self.terms.frame, rates
        if frame.word[s].kind != "P" or frame.turn is not None or not last < 0.0 <= first:
            return []
        t = float(self.terms.x[s, -1])
        return [Constraint("interior_impact", s, gap, t, value, size)]

    @functools.cached_property
    def _distance(self) -> float:
        return float(row_sizes(self.terms)[1])

    def _of_mass(self, s: int, t: float, height: float) -> list[Constraint]:
        """Return the lowest minimum of one mass; where an impact is plastic whether it leaves."""
        terms, found = self.terms, []
        if math.isfinite(height):
            size = self._distance
            found.append(Constraint("interior_impact", s, 0, float(t), float(height), size))
        if terms.frame.flow.e[0] == 0.0 and terms.frame.word[s].kind == "I":
            pulls = terms.flights.first[:, 1]
            begin, size = float(terms.x[s - 1, -1]), float(np.max(np.abs(pulls)))
            found.append(Constraint("rest_appears", s, 0, begin, float(pulls[s]), size))
        return found

    def _minimum(self, s: int, gap: int, times: Array, rates: Array) -> tuple[float, float]:
        """Find where the rate of a gap vanishes between two times."""
        terms = self.terms
        frame, t0, z0 = terms.frame, float(terms.x[s, 0]), terms.x[s, 1:-1]

        def look(t: float) -> tuple[float, float]:
            contacts = frame.word[s].contacts
            z = frame.flow.path(contacts, t0, z0, np.array([t]))
            value, rate = frame.flow.gaps(np.array([t]), z, contacts)
            return float(value[0, gap]), float(rate[0, gap])

        return _zero(look, times, rates)

    def _forces(self, s: int, times: Array, z: Array, gap: int | None) -> list[Constraint]:
        terms = self.terms
        flow, segment = terms.frame.flow, terms.frame.word[s]
        forces = flow.reactions(segment.contacts, times, z)
        found, ends = [], "slip_appears" if flow.channels else "contact_ends"
        for k, i in enumerate(segment.held):
            if gap not in (None, i):
                continue
            own = forces[:, k]
            size = max(float(np.max(np.abs(own))), 1e-300)
            # a stick between its two events vanishes where its level does at its begin
            if not flow.channels or (i, i) != (segment.gap, terms.frame.word[s - 1].gap):
                found.append(Constraint(ends, s, i, float(times[0]), float(own[0]), size))
            if i != segment.gap:
                found.append(Constraint(ends, s, i, float(times[-1]), float(own[-1]), size))
            inner = np.flatnonzero((own[1:-1] < own[:-2]) & (own[1:-1] <= own[2:])) + 1
            for j in inner:
                low = self._least_force(s, i, times[j - 1 : j + 2])
                found.append(Constraint(ends, s, i, *low, size))
        return found

    def _least_force(self, s: int, gap: int, times: Array) -> tuple[float, float]:
        terms = self.terms
        frame, t0, z0 = terms.frame, float(terms.x[s, 0]), terms.x[s, 1:-1]
        contacts = frame.word[s].contacts

        def look(t: float) -> tuple[float, float]:
            z = frame.flow.path(contacts, t0, z0, np.array([t]))[0]
            force = frame.flow.reaction(contacts, gap, t, z)
            return force.value, float(force.by_t + force.by_z @ frame.flow.rate(contacts, t, z))

        ends = times[[0, -1]]
        return _zero(look, ends, np.array([look(float(t))[1] for t in ends]))


def _zero(look: object, times: Array, rates: Array) -> tuple[float, float]:
    """Find where the second number that a function gives vanishes, and the first there."""
    assert callable(look)
    low, high = float(times[0]), float(times[1])
    low_rate, high_rate = float(rates[0]), float(rates[1])
    t, side = low, 0
    value, rate = look(t)
    for _ in range(60):
        last = t
        if high_rate != low_rate:
            t = high - high_rate * (high - low) / (high_rate - low_rate)
        value, rate = look(t)
        if rate == 0.0 or abs(t - last) < MARGIN_CLOSE * max(1.0, abs(t)):
            break
        # the Illinois rule: an end that stays for the second time counts half
        if (rate > 0.0) == (high_rate > 0.0):
            high, high_rate = t, rate
            low_rate *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, low_rate = t, rate
            high_rate *= 0.5 if side < 0 else 1.0
            side = -1
    return t, float(value)


# The solutions of a word's equations over a parameter: points, tangents, located events.

CORRECTIONS = 10
TOLERANCE = 1e-12
CLOSE = 1e-12
"""How near two places of an event are, in scaled unknowns, when it is found."""
MOST_SECANTS = 20
ENOUGH = 1e-10
"""A residual at which an iteration that stalls has found what rounding allows."""
STALE = 0.05
"""Where the residual falls by less, the derivative by the parameter is computed again."""


class Placed(Protocol):
    """A point of a curve of solutions."""

    @property
    def z(self) -> Array: ...  # noqa: D102
    @property
    def tangent(self) -> Array: ...  # noqa: D102


AnyPoint = TypeVar("AnyPoint", bound=Placed)
AnyPointCo = TypeVar("AnyPointCo", bound=Placed, covariant=True)


class Solutions(Protocol[AnyPointCo]):
    """A curve of solutions."""

    def correct(self, guess: Array, normal: Array) -> AnyPointCo | None:
        """Solve in the hyperplane through a guess with a normal; None if that fails."""


@dataclasses.dataclass(frozen=True)
class Point:
    """A solution, in scaled unknowns ``z = (y, p)``."""

    z: Array
    terms: Terms
    tangent: Array
    value: float
    corrections: int
    residual: float

    @functools.cached_property
    def margins(self) -> Margins:
        """Quantities that are positive for an admissible solution."""
        return Margins(self.terms)

    @functools.cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """The multipliers, of the half map of a symmetric word."""
        return multipliers_of(self.terms, half=True)

    @functools.cached_property
    def doubling(self) -> float:
        """The sign of det J(pi)."""
        return float(np.linalg.slogdet(self.terms.matrix(-1.0))[0])

    @functools.cached_property
    def pairs(self) -> float:
        """The product of all products of two multipliers less 1: zero where a pair turns."""
        own = self.multipliers[self.multipliers != 0.0]
        if not np.all(np.isfinite(own)) or len(own) < 2:
            return 1.0
        if len(own) == 2:
            return float(np.real(own[0] * own[1])) - 1.0
        i, j = np.triu_indices(len(own), 1)
        return float(np.real(np.prod(own[i] * own[j] - 1.0)))

    @functools.cached_property
    def turning(self) -> float:
        """How far the complex pair nearest the unit circle is from it; NaN without one."""
        own = self.multipliers[np.imag(self.multipliers) > 1e-9]
        if not len(own) or not np.all(np.isfinite(own)):
            return float("nan")
        sizes = np.abs(own) - 1.0
        return float(sizes[int(np.argmin(np.abs(sizes)))])


class Path:
    """The solutions of one word over one parameter."""

    def __init__(self, frame: Frame, name: str, y: Array, width: float) -> None:
        self.frame, self.name = frame, name
        unknowns, self.sizes = sizes_of(evaluate(frame, y))
        self.scale = np.append(unknowns, width)
        self.flights = 0

    def scaled(self, y: Array, value: float) -> Array:
        """Return unknowns and parameter as one scaled vector."""
        return np.asarray(np.append(y, value) / self.scale, np.float64)

    def frame_at(self, value: float) -> Frame:
        """Return the frame of the system with a value of the parameter."""
        return moved_frame(self.frame, {self.name: value})

    def column(self, terms: Terms) -> Array:
        """Return the derivative of the equations by the parameter."""
        if isinstance(terms.frame.flow, MassFlow):
            if not is_resting(terms.frame.word):
                return mass_column(terms, self.name)
            self.flights += len(terms.frame.word)
            return ahead(terms, self.name)
        self.flights += 2 * len(terms.frame.word)
        return by_parameter(terms.frame, terms.y, self.name)

    def evaluate(self, z: Array, *, derives: bool = False) -> tuple[Terms, Array]:
        """Return the equations at a point, and their scaled residual."""
        full = z * self.scale
        frame = self.frame_at(float(full[-1]))
        self.flights += len(frame.word)
        terms = evaluate(frame, full[:-1], name=self.name if derives else None)
        return terms, terms.residual / self.sizes

    def matrix(self, terms: Terms, column: Array, normal: Array | None = None) -> Array:
        """Return the scaled derivative by unknowns and parameter, with a normal as its last row."""
        n = len(column)
        full = np.empty((n + (normal is not None), n + 1))
        whole = full[:n]
        whole[:, :-1], whole[:, -1] = terms.matrix(), column
        whole *= self.scale
        whole /= self.sizes[:, None]
        if normal is not None:
            full[-1] = normal
        return full

    def correct(self, guess: Array, normal: Array, tolerance: float = TOLERANCE) -> Point | None:
        """Solve in the hyperplane through a guess with a normal; None if that fails."""
        if isinstance(self.frame.impulses, MassImpulses):
            return self._correct_mass(guess, normal, tolerance)
        z, column = guess.copy(), None
        before, stalled = np.inf, False
        for step in range(CORRECTIONS):
            try:
                terms, residual = self.evaluate(z, derives=column is None)
                error = float(np.abs(residual).max())
                if column is None or STALE * before < error:
                    # only the convergence depends on it
                    column = self.column(terms)
            except (FlightError, ValueError):
                return None
            full = self.matrix(terms, column, normal)
            # near a grazing one step may stall before the next ones converge
            stalls = error >= 0.5 * before
            enough = error <= max(tolerance, terms.frame.flow.accuracy)
            if enough or (stalls and stalled and error <= ENOUGH):
                return self._point(z, terms, full, step, error)
            before, stalled = error, stalls
            right = np.empty(len(z))
            right[:-1], right[-1] = residual, normal @ (z - guess)
            try:
                z = z - np.linalg.solve(full, right)
            except np.linalg.LinAlgError:
                return None
            # also false for NaN
            near = float(np.abs(z - guess).max()) <= 1.0
            if not near:
                return None
        return None

    def _correct_mass(self, guess: Array, normal: Array, tolerance: float) -> Point | None:
        """Do the same in the extension."""
        frame, name, trend = self.frame, self.name, self._trend
        system: ImpactSystem = frame.system

        def at(value: float) -> tuple[Any, float, float, float]:
            nonlocal system
            system = with_values(frame.system, {name: value})
            length = length_of(frame, system)
            longer = trend * length / value if trend else 0.0
            return system._spec, length, system.e, longer

        tolerance = max(tolerance, frame.flow.accuracy)
        count, found = corrected(
            at, frame.system, frame.method, name, (guess, normal),
            (self.scale, self.sizes), CORRECTIONS, (tolerance, ENOUGH, STALE),
        )  # fmt: skip
        self.flights += count * len(frame.word)
        if found is None:
            return None
        z, tangent, steps, error, numbers = found
        full = z * self.scale
        frame, y = frame_of(frame, system), full[:-1]
        assert isinstance(frame.impulses, MassImpulses)
        evaluated = frame.impulses.evaluated(y, float(y[-2]), *numbers)
        terms = MassTerms(frame, y, found=evaluated)
        return Point(z, terms, tangent, float(full[-1]), steps, error)

    @functools.cached_property
    def _trend(self) -> int:
        return trend_of(self.frame, self.name)

    def _point(self, z: Array, terms: Terms, full: Array, step: int, error: float) -> Point | None:
        right = np.zeros(len(z))
        right[-1] = 1.0
        try:
            null = np.linalg.solve(full, right)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(null)):
            return None
        tangent = np.asarray(null / np.linalg.norm(null), np.float64)
        return Point(z, terms, tangent, float(z[-1] * self.scale[-1]), step, error)

    def start(self, y: Array, value: float) -> Point:
        """Return the point at a solution, its tangent towards larger values where it has one."""
        z = self.scaled(y, value)
        terms, residual = self.evaluate(z, derives=True)
        tangent = np.linalg.svd(self.matrix(terms, self.column(terms)))[2][-1]
        if tangent[-1] < 0.0:
            tangent = -tangent
        error = float(np.max(np.abs(residual)))
        return Point(z, terms, np.asarray(tangent, np.float64), value, 0, error)

    def at_value(self, guess: Array, value: float) -> Point | None:
        """Return the point with a value of the parameter, near a guess."""
        normal, guess = np.zeros(len(guess)), guess.copy()
        normal[-1], guess[-1] = 1.0, value / self.scale[-1]
        return self.correct(guess, normal)


def bordered(terms: Terms, factor: complex) -> tuple[Any, Any]:
    """Return the borders of a nearly singular matrix: its left and right singular vectors."""
    left, _, right = np.linalg.svd(terms.matrix(factor))
    return left[:, -1], right[-1].conj()


def sigma(terms: Terms, factor: complex, borders: tuple[Any, Any]) -> Any:
    """Return a smooth number that vanishes where the matrix is singular."""
    matrix = terms.matrix(factor)
    b, c = borders
    n = len(b)
    whole = np.zeros((n + 1, n + 1), matrix.dtype)
    whole[:n, :n], whole[:n, n], whole[n, :n] = matrix, b, c.conj()
    right = np.zeros(n + 1)
    right[n] = 1.0
    return np.linalg.solve(whole, right)[n]


def located(
    path: Solutions[AnyPoint], one: AnyPoint, other: AnyPoint, test: Callable[[AnyPoint], float]
) -> AnyPoint | None:
    """Find where a test function vanishes between two points, by secants in a bracket."""
    chord = other.z - one.z
    length = float(np.linalg.norm(chord))
    normal = chord / length
    low, high = (0.0, test(one)), (1.0, test(other))
    if not low[1] * high[1] < 0.0:
        return None
    best, last, before, near = None, high, low, one.z
    at = 0.0
    for _ in range(50):
        part = secant(last, before, low[0], high[0])
        point = path.correct(near + (part - at) * chord, normal)
        if point is None:
            # a part of the bracket that cannot be computed lies past the event
            high = (part, -low[1])
            last, before = high, low
            if high[0] - low[0] < 1e-12:
                return best
            continue
        if point.tangent @ one.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)  # type: ignore[type-var]
        value, best, near, at = test(point), point, point.z, part
        before, last = last, (part, value)
        if (value > 0.0) == (low[1] > 0.0):
            low = last
        else:
            high = last
        moved = min(abs(last[0] - before[0]), high[0] - low[0]) * length
        if value == 0.0 or moved < CLOSE:
            break
    return best


def located_near(path: Path, start: Point, test: Callable[[Point], float]) -> Point | None:
    """Find where a test function vanishes near a point, by secants along the arc."""
    normal, before, last = start.tangent, (0.0, test(start)), (1e-4, 0.0)
    for _ in range(MOST_SECANTS):
        point = path.correct(start.z + last[0] * normal, normal)
        if point is None:
            return None
        last = (last[0], test(point))
        moved, rise = last[0] - before[0], last[1] - before[1]
        if last[1] == 0.0 or abs(moved) < 1e-13 or rise == 0.0:
            return point
        before, last = last, (last[0] - last[1] * moved / rise, 0.0)
    return None
