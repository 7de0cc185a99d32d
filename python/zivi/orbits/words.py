"""Event sequences of runs, and orbits from them."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.equations import (
    Frame,
    Solution,
    Terms,
    after_event,
    evaluate,
    impact_rows,
    multipliers_of,
    newton,
    row_sizes,
    sizes_of,
    whole_word,
)
from zivi.orbits.flows import FlightError, Flow, MassFlow, Segment, Word, held_of, uncoupled
from zivi.orbits.orbit import (
    CONTACT,
    IMPACT,
    ORBIT_IMPACT,
    MechanicalOrbit,
    PeriodicOrbit,
    middle_of,
    resting_frame,
)
from zivi.orbits.path import Margins, flow_of, is_resting
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem

# The word and the unknowns that the end of a run shows.

MOST_MULTIPLE, MOST_EVENTS = 64, 256
TOLERANCES = (1e-6, 1e-4, 1e-2)
SAME_TIME = 1e-12
"""How near two events are that are one, relative to the time."""
BEFORE = 1e-9
"""How long before an impact of several gaps a run is looked at (s)."""


class NotDifferentiable(Exception):  # noqa: N818
    """Raised if the attractor of a run is not differentiable."""

    def __init__(self, why: str, frame: Frame, x: Array, count: int) -> None:
        super().__init__(why)
        self.frame, self.x, self.count = frame, x, count


class Happened(NamedTuple):
    """An event of a run; kind ``C``: several gaps are hit or come to rest simultaneously."""

    t: float
    kind: str
    gap: int
    opened: tuple[int, ...] = ()
    speed: float = math.nan
    """Of the gap before the impact, where the run tells it."""
    slip: int = 0
    """The direction of slip of a channel of dry friction after it."""


NO_CORNERS, NO_OPENINGS = np.empty(0, [("t", "f8")]), np.empty(0, [("t", "f8"), ("gap", "i8")])


class MassTables:
    """The run of one mass since a time, with the tables of a mechanism."""

    corners, openings = NO_CORNERS, NO_OPENINGS

    def __init__(self, run: Trajectory, since: float = -math.inf) -> None:
        self.run, self.t, self.success, self.message = run, run.t, run.success, run.message
        self.since = since

    def __getattr__(self, name: str) -> Any:
        late = self.t >= self.since
        if name == "q":
            return self.run.x[late, None]
        if name == "qdot":
            return self.run.xdot[late, None]
        rows = impact_rows(self.run) if name == "resolved_impacts" else getattr(self.run, name)
        setattr(self, name, rows[rows["t"] >= self.since])
        return vars(self)[name]

    def __call__(self, t: Any) -> Array:
        """Return the states at times, shape (2, ..., 1)."""
        return self.run(t)[..., None]


AnyRun: TypeAlias = MechanicalTrajectory | MassTables


def recent(
    system: Any,
    run: MechanicalTrajectory | Trajectory | MassTables,
    multiple: int | None,
    period: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array, int, str]:
    """Return the frame and the unknowns of the last period of the motion of a run, and tell it.

    Raises
    ------
    ValueError
        If the run is too short, or ended early.
    NotDifferentiable
        If its last period has what no word describes.
    """
    if isinstance(run, Trajectory):
        since = -math.inf if free else float(run.t[-1]) - 2 * MOST_MULTIPLE * period
        return recent(system, MassTables(run, since), multiple, period, free, method)
    what, mass = ("impact", True) if isinstance(run, MassTables) else ("event", False)
    if not run.success:
        raise ValueError(f"start: the run ended early: {run.message}")
    flow = flow_of(system, method)
    events = _events_of(flow, run, period if mass and not free else math.inf)
    count, repeats = 1, multiple
    if free:
        length, end = _free_length(run, events)
    else:
        span = float(run.t[-1] - run.t[0])
        if span < (multiple or 1) * period * (1.0 - 1e-9) and not mass:
            raise ValueError(f"start: the run must last a period, {period:.6g}, got {span:.6g}")
        repeats = multiple or _periods_to_repeat(run, events, period)
        count = repeats or 1
        length, end = count * period, _longest_pause(run, events, count * period)
        # a flight of more than a period, or a motion without events
        near = repeats is None and any(it.t > end - 4.0 * period for it in events)
        while near and length < 4.0 * period and (count + 1) * period <= span:
            if any(end - length < it.t <= end for it in events):
                break
            count += 1
            length, end = count * period, _longest_pause(run, events, count * period)
    inside = [it for it in events if end - length < it.t <= end]
    several = next((it.t for it in inside if it.kind == "C"), None)
    if several is not None:
        why = f"Several gaps are hit, or come to rest, at once, at t = {several:.9g} s."
        frame, x = _smooth(system, flow, run, length, end, free, method)
        x[0, 0] = x[0, -1]
        raise NotDifferentiable(f"{why} The motion is not differentiable there.", frame, x, count)
    if len(inside) > MOST_EVENTS:
        raise ValueError(f"start: a word has at most {MOST_EVENTS} events, got {len(inside)}")
    told = "" if free else shown(count, len(inside), what, repeats=bool(repeats))
    if not inside:
        return *_smooth(system, flow, run, length, end, free, method), count, told
    shift = 0.0 if free else _floor(float(inside[0].t) / period) * period
    frame, x = _unknowns(system, flow, run, inside, length, free, method)
    # far from t = 0 times have fewer digits
    x[:, [0, -1]] -= shift
    return frame, x, count, told


def _floor(number: float) -> float:
    return float(np.floor(number))


def _events_of(flow: Flow, run: AnyRun, longest: float = math.inf) -> list[Happened]:
    """Return the events of a run in order; a Zeno accumulation counts as one event.

    Impacts more than `longest` before the end of an accumulation stay separate events.
    """
    rows: Any = run.resolved_impacts
    lifts: Any = run.liftoffs
    zenos: Any = run.zeno
    for row in run.zeno:
        # a gap that lifts off and is closed in the same instant, by rounding, stays closed
        near = SAME_TIME * max(1.0, abs(float(row["t"])))
        (own,) = np.nonzero((lifts["gap"] == row["gap"]) & (np.abs(lifts["t"] - row["t"]) <= near))
        if len(own) < 2:
            continue
        lifts = np.delete(lifts, own[:-1])
        zenos = zenos[zenos["t"] != row["t"]]
        rows = rows[(rows["gap"] != row["gap"]) | (np.abs(rows["t"] - row["t"]) > near)]
    if isinstance(run, MassTables):
        pairs = zip(rows["t"].tolist(), rows["speed_before"].tolist(), strict=True)
        found = [Happened(t, "I", 0, (), speed) for t, speed in pairs]
    else:
        found = _hits_of_gaps(flow, run, rows)
    closings = [(float(row["t"]), int(row["gap"])) for row in zenos]
    left = {(float(it["t"]), int(it["gap"])) for it in lifts[left_at_once(run, lifts)]}
    lifts = lifts[~left_at_once(run, lifts)]
    for corner in run.corners:
        t = float(corner["t"])
        kept = _closed(run, max(t - BEFORE, float(run.t[0])))
        new = [int(i) for i in np.flatnonzero(corner["gaps"]) if i not in kept]
        if len(new) != 1:
            found.append(Happened(t, "C", -1))
        elif all(gap != new[0] or abs(at - t) > SAME_TIME * max(1.0, abs(t)) for at, gap in left):
            closings.append((t, new[0]))
    found += [Happened(float(it["t"]), "L", int(it["gap"])) for it in lifts]
    found += _ends_of_slips(run) if flow.channels else []
    found.sort(key=lambda it: it.t)
    for t, gap in sorted(closings):
        found = _merge_accumulation(found, t, gap, float(flow.e[gap]), t - longest)
    return found


def _ends_of_slips(run: Any) -> list[Happened]:
    """Return the ends of slips and sticks of a run, without the modes in which it begins."""
    found = []
    for it in run.transitions:
        before, after = int(it["before"]), int(it["after"])
        if abs(before) <= 1:
            kind = "K" if after == 0 else "B" if before == 0 else "T"
            found.append(Happened(float(it["t"]), kind, int(it["channel"]), slip=after))
    return found


def _hits_of_gaps(flow: Flow, run: MechanicalTrajectory, rows: Any) -> list[Happened]:
    """Return the impacts of a mechanism; simultaneous ones where their order matters."""
    found: list[Happened] = []
    for group in np.unique(rows["group"]):
        own = rows[rows["group"] == group]
        # one that grazes has no speed
        fastest = float(np.min(own["speed_before"]))
        hit = own[own["speed_before"] <= (1e-9 * fastest if fastest < 0.0 else fastest)]
        t = float(own["t"][0])
        hits = [int(gap) for gap in np.unique(hit["gap"])]
        before = run(max(t - BEFORE, float(run.t[0]))).ravel()
        if len(hits) < len(hit) or not uncoupled(flow, hits, t, before):
            found.append(Happened(t, "C", -1))
            continue
        opened = run.openings["gap"][np.abs(run.openings["t"] - t) <= 1e-12 * max(1.0, abs(t))]
        found += [Happened(t, "I", gap, tuple(int(it) for it in opened)) for gap in hits]
    return found


def left_at_once(run: AnyRun, lifts: Any) -> Any:
    """Return which lift-offs coincide with an impact that involves other closed gaps."""
    near = SAME_TIME * np.maximum(1.0, np.abs(lifts["t"]))
    apart = np.abs(lifts["t"][:, None] - run.corners["t"])
    return np.any(apart <= near[:, None], axis=1)


def _merge_accumulation(
    found: list[Happened], zeno: float, gap: int, e: float, since: float
) -> list[Happened]:
    """Replace the impacts of an accumulation since a time by one event, at the first of them."""
    last = [k for k, it in enumerate(found) if it.t <= zeno and it.kind == "I" and it.gap == gap]
    if not last:
        return found
    first = last[-1]
    if e == 0.0:
        return [*found[:first], found[first]._replace(kind="S"), *found[first + 1 :]]
    while first > 0 and found[first - 1].kind == "I" and found[first - 1].gap == gap:
        if found[first - 1].t < since:
            break
        first -= 1
    chain = found[first]._replace(kind="Z")
    return [*found[:first], chain, *found[last[-1] + 1 :]]


def _busy(run: AnyRun, events: list[Happened]) -> list[tuple[float, float]]:
    """Return the spans of time of accumulations, which a window must not cut."""
    spans = []
    for row in run.zeno:
        begins = [it.t for it in events if it.kind == "Z" and it.gap == row["gap"]]
        begin = [t for t in begins if t < row["t"]]
        if begin:
            spans.append((begin[-1], float(row["t"])))
    return spans


def _longest_pause(
    run: AnyRun, events: list[Happened], length: float, *, repeats: bool = True
) -> float:
    """Return the middle of the longest pause shortly before the end of a run."""
    end = float(run.t[-1])
    begin = max(end - length, float(run.t[0]) + length)
    busy = _busy(run, events)
    if repeats:  # an accumulation that the run does not complete is known from a length before
        busy += [(start + length, stop + length) for start, stop in busy]
    pauses, last = [], begin
    for start, stop in sorted([*busy, *((it.t, it.t) for it in events), (end, end)]):
        if start > last:
            pauses.append((last, min(start, end)))
        last = max(last, stop)
    low, high = max(pauses, key=lambda it: it[1] - it[0], default=(end, end))
    return 0.5 * (low + high)


def _periods_to_repeat(run: AnyRun, events: list[Happened], period: float) -> int | None:
    """Return after how many periods the state repeats; None if it does not."""
    end, begin = _longest_pause(run, events, period, repeats=False), float(run.t[0])
    most = min(MOST_MULTIPLE, int((end - begin) / period))
    if isinstance(run, MassTables):
        most = min(MOST_MULTIPLE, int((end - begin) / period / 2.0))
    times = np.maximum(end - period * np.arange(2 * most + 1), begin)
    states = run(times).transpose(1, 0, 2).reshape(len(times), -1)
    m = repeating(states[: most + 1], run.q, run.qdot)
    # a chaotic motion comes near itself once, by chance
    again = m is None or repeating(states[: 2 * m + 1 : m][[0, -1]], run.q, run.qdot)
    return m if again or not isinstance(run, MassTables) else None


def repeating(states: Array, *parts: Array) -> int | None:
    """Return after how many periods states, a row each, repeat; None if they do not.

    Positions and velocities are compared relative to the largest of a run or of the states.
    """
    parts = parts or tuple(np.hsplit(states, 2))
    sizes = [float(np.max(np.abs(part))) or 1.0 for part in parts]
    scale = np.repeat(sizes, states.shape[1] // 2)
    apart = np.max(np.abs(states[1:] - states[0]) / scale, axis=1)
    for tolerance in TOLERANCES:
        near = np.flatnonzero(apart <= tolerance)
        if len(near):
            return int(near[0]) + 1
    return None


def shown(multiple: int, events: int, what: str = "impact", *, repeats: bool = True) -> str:
    """Describe the end of a run from which no orbit was found."""
    last, hold = ("period", "holds") if multiple == 1 else (f"{multiple} periods", "hold")
    many = f"{events or 'no'} {what}{'s' * (events != 1)}"
    told = "" if repeats else ", and nothing repeats to a hundredth"
    return f"The last {last} of the run {hold} {many}{told}; give multiple=, or a longer run."


def _free_length(run: AnyRun, events: list[Happened]) -> tuple[float, float]:
    """Return the period of an autonomous motion, and the time of its section."""
    end, begin = float(run.t[-1]), float(run.t[0])
    own = [it for it in events if it.t > 0.5 * (begin + end)]
    if len(own) < 3:
        times = np.linspace(0.5 * (begin + end), end, 20_001)
        q, qdot = run(times)
        j = int(np.argmax(np.ptp(q, axis=0)))
        tops = np.flatnonzero((qdot[:-1, j] > 0.0) & (qdot[1:, j] <= 0.0))
        if len(tops) < 2:
            raise ValueError("start: the run does not show two equal events or two equal maxima")
        v, h = qdot[:, j], times[1] - times[0]
        exact = times[tops] + v[tops] / (v[tops] - v[tops + 1]) * h
        return float(exact[-1] - exact[-2]), float(exact[-1])
    times = np.array([it.t for it in own])
    kinds = np.array([(ord(it.kind), it.gap) for it in own])
    states = run(0.5 * (times[1:] + times[:-1])).transpose(1, 0, 2).reshape(len(own) - 1, -1)
    scale = float(np.max(np.abs(states))) or 1.0
    for tolerance in TOLERANCES:
        # the last events may be of an accumulation that the run does not complete
        for last in range(len(own) - 2, 0, -1):
            same = np.all(kinds[:last] == kinds[last], axis=1)
            apart = np.max(np.abs(states[:last] - states[last]), axis=1)
            (near,) = np.nonzero(same & (apart <= tolerance * scale))
            if len(near):
                length = float(times[last] - times[near[-1]])
                return length, _longest_pause(run, events, length)
    raise ValueError("start: the run does not repeat itself to a hundredth")


def _smooth(
    system: Any,
    flow: Flow,
    run: AnyRun,
    length: float,
    end: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array]:
    """Return the unknowns of a motion without events: one segment, with the letter P."""
    contacts = _closed(run, end)
    z = run(end).ravel()
    section: float | int
    if free:
        t, section = 0.0, int(np.argmax(np.ptp(run.q, axis=0)))
    else:
        # far from t = 0 the phase of the excitation has fewer digits
        t = section = float(end % length)
    x = np.concatenate([[t - length], z, [t]])[None]
    word = (Segment(contacts, "P", -1, contacts),)
    return Frame(system, flow, word, method, length, free, None, section), x


def _closed(run: AnyRun, t: float) -> tuple[int, ...]:
    if isinstance(run, MassTables):
        return () if run(t).any() else (0,)
    if len(run.channel_names):
        return _slipping(run, t)
    at = run.resample(np.array([t]))
    return tuple(int(i) for i in np.flatnonzero(at.contacts[0]))


def _slipping(run: Any, t: float) -> tuple[int, ...]:
    """Return the channels that stick at a time, and those that slip backwards as -1 - c."""
    modes = np.ones(len(run.channel_names), int)
    for it in run.transitions:
        if it["t"] <= t:
            modes[it["channel"]] = it["after"]
    found = [c if mode == 0 else -1 - c for c, mode in enumerate(modes.tolist()) if mode < 1]
    return tuple(sorted(found))


def _unknowns(
    system: Any,
    flow: Flow,
    run: AnyRun,
    events: list[Happened],
    length: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array]:
    contacts = _closed(run, events[0].t - 1e-9 * length)
    word, rows = [], []
    for it in events:
        after = {*contacts} - {*it.opened}
        after = after | {it.gap} if it.kind in "SZK" else after - {it.gap}
        if it.kind in "KBT":
            after = after - {-1 - it.gap} | ({-1 - it.gap} if it.slip < 0 else set())
        segment = Segment(contacts, it.kind, it.gap, tuple(sorted(after)))
        if isinstance(run, MassTables):
            before = np.array([0.0, 0.0 if it.kind == "L" else it.speed])
        else:
            before = run(max(it.t - 1e-9 * length, float(run.t[0]))).ravel()
        rows.append(after_event(system, method, flow, segment, it.t, before, length))
        word.append(segment)
        contacts = segment.after
    after_all = np.array(rows)
    x = np.empty((len(word), 2 * flow.n + 2))
    x[:, -1] = [it.t for it in events]
    x[:, :-1] = np.roll(after_all, 1, axis=0)
    x[0, 0] -= length
    return Frame(system, flow, tuple(word), method, length, free), x


# From a guess of a word and its unknowns to an orbit, and whether it is a motion.

SAME = 2e-4
"""Parts of an orbit that differ by less, relative to its size, may be one shorter orbit."""
NEAR = 0.05
"""Parts of a guess that differ by less may be."""


FOUND = "The orbit was found, and a simulation follows it."


def solve_word(frame: Frame, y: Array, multiple: int, most: int = 20) -> Any:
    """Solve for an orbit, reduce it to its least period, and look whether it is a motion."""
    try:
        found = newton(frame, y, most)
        steps = found.iterations
        frame, multiple, found = least(frame, multiple, y, found, most)
    except (FlightError, ValueError) as error:
        return failed(frame, y, multiple, f"A flight could not be computed: {error}")
    if not found.converged:
        near = f"in {steps} steps: the residual is {found.residual:.3g}."
        why = f"Newton's iteration did not converge {near}"
        return orbit_of_word(found.terms, multiple, found.residual, steps, why, found=False)
    return checked(canonical(found.terms, multiple), multiple, found.residual, steps)


def checked(terms: Terms, multiple: int, residual: float, steps: int) -> Any:
    """Look whether an orbit is a motion: its signs, and one simulation of it."""
    why_not = Margins(terms).why_not()
    orbit = orbit_of_word(terms, multiple, residual, steps, why_not)
    reason = None if why_not else weaker_reason(orbit)
    if reason is None:
        return orbit
    left = OrbitStatus.LEFT_ADMISSIBLE
    return dataclasses.replace(orbit, admissible=False, status=left, message=reason)


def least(
    frame: Frame, multiple: int, guess: Array, found: Solution, most: int
) -> tuple[Frame, int, Solution]:
    """Return the solution over the least period: the one given, or one that it repeats."""
    word = frame.word
    flies = len(word) == 1 and word[0].kind == "P"
    count = len(word) if frame.free else multiple if flies else math.gcd(len(word), multiple)
    if frame.turn is not None:
        return frame, multiple, found
    for parts in _primes(count):
        length = len(word) if flies else len(word) // parts
        if any(word[k] != word[k % length] for k in range(len(word))):
            continue
        y = found.terms.y if found.converged else guess
        apart, mean = (_of_flight if flies else _equal_parts)(frame, y, parts, found.terms)
        if apart > (NEAR if found.converged else 5.0 * NEAR):
            continue
        section = frame.section
        if isinstance(section, float):
            section = float(mean[0, -1])
        part = dataclasses.replace(
            frame, word=word[:length], length=found.terms.length / parts, section=section
        )
        try:
            single = newton(part, part.joined(mean, found.terms.length / parts), most)
        except (FlightError, ValueError):
            continue
        if not single.converged:
            continue
        if found.converged and _moved(single.terms, mean) > max(SAME, 0.5 * apart):
            continue
        if found.converged and apart > SAME:
            continue
        fewer = multiple if frame.free else multiple // parts
        return least(part, fewer, single.terms.y, single, most)
    return frame, multiple, found


def _primes(number: int) -> list[int]:
    found = [p for p in range(2, number + 1) if number % p == 0]
    return [p for p in found if all(p % q for q in range(2, p))]


def _equal_parts(frame: Frame, y: Array, parts: int, terms: Terms) -> tuple[float, Array]:
    """Return how far equal parts of an orbit differ, and their mean."""
    x, length = frame.split(y)
    rows = x.reshape(parts, -1, x.shape[1]).copy()
    shift = length / parts * np.arange(parts)
    rows[:, :, 0] -= shift[:, None]
    rows[:, :, -1] -= shift[:, None]
    sizes = row_sizes(terms)
    sizes[[0, -1]] = length / parts
    apart = float(np.max(np.ptp(rows, axis=0) / sizes))
    return apart, rows.mean(axis=0)


def _of_flight(frame: Frame, y: Array, parts: int, terms: Terms) -> tuple[float, Array]:
    """Return how far the state after a part of a motion without events differs, and that part."""
    x, length = frame.split(y)
    x[0, -1] = x[0, 0] + length / parts
    end = frame.flow.path(frame.word[0].contacts, float(x[0, 0]), x[0, 1:-1], x[0, -1:])[0]
    return float(np.max(np.abs(end - x[0, 1:-1]) / row_sizes(terms)[1:-1])), x


def _moved(terms: Terms, mean: Array) -> float:
    return float(np.max(np.abs(terms.x - mean) / row_sizes(terms)))


def canonical(terms: Terms, multiple: int) -> Terms:
    """Rotate the event sequence so that it ends with the event of the smallest phase."""
    frame = terms.frame
    if frame.turn is not None or (isinstance(frame.section, int) and frame.free):
        return terms
    x, length = terms.x, terms.length
    period = length / multiple
    if frame.free:
        first, shift = 0, -float(x[0, -1])
    else:
        ends = x[:, -1] % period
        first = int(np.argmin(ends))
        shift = float(ends[first] - x[first, -1])
    if first == 0 and shift == 0.0:
        return terms
    word, turned = rolled(frame.word, x, length, first)
    turned[:, [0, -1]] += shift
    section = float(turned[0, -1]) if all(it.kind == "P" for it in word) else frame.section
    if frame.free:
        section = frame.section
    new = dataclasses.replace(frame, word=word, section=section)
    return evaluate(new, new.joined(turned, length))


def rolled(word: Word, x: Array, length: float, first: int) -> tuple[Word, Array]:
    """Return a word and its segments from another one on."""
    turned = np.roll(x, -first, axis=0) + 0.0
    turned[len(x) - first :, [0, -1]] += length
    return word[first:] + word[:first], turned


def orbit_of_word(
    terms: Terms,
    multiple: int,
    residual: float,
    iterations: int,
    why_not: str | None,
    *,
    found: bool = True,
    message: str = FOUND,
    multipliers: NDArray[np.complex128] | None = None,
) -> Any:
    """Make the orbit that the equations describe."""
    left = OrbitStatus.LEFT_ADMISSIBLE if found else OrbitStatus.NOT_CONVERGED
    status = OrbitStatus.COMPLETED if why_not is None else left
    known = (multiple, residual, iterations, status, why_not or message)
    if isinstance(terms.frame.flow, MassFlow):
        return orbit_of_mass(terms, *known, multipliers)
    return orbit_of_mechanism(terms, *known)


def orbit_of_mechanism(
    terms: Terms, multiple: int, residual: float, iterations: int, status: OrbitStatus, message: str
) -> MechanicalOrbit:
    """Make the orbit of a mechanical system, or that of one mass with its word."""
    frame = terms.frame
    word, x, impulses = whole_word(terms)
    length = terms.length * (1 if frame.turn is None else 2)
    zenos = {s: it.zeno for s, it in terms.accumulations.items()}
    return MechanicalOrbit(
        system=frame.system,
        period=length / multiple,
        multiple=multiple,
        segments=_segments(word, x, frame.flow.m),
        impacts=_impacts(terms, word, x, impulses),
        contacts=_contacts(word, x, length, zenos),
        zeno_times=np.array(sorted(zenos.values())),
        liftoff_times=np.array([x[s, -1] for s, it in enumerate(word) if it.kind == "L"]),
        multipliers=multipliers_of(terms),
        residual=residual,
        iterations=iterations,
        depth=math.nan if status is OrbitStatus.NOT_CONVERGED else Margins(terms).depth,
        admissible=status is OrbitStatus.COMPLETED,
        status=status,
        message=message,
        _frame=frame,
        _y=terms.y,
        _word=word,
        _starts=x[:, :-1].copy(),
    )


def _segments(word: Word, x: Array, m: int) -> Any:
    found = np.zeros(len(word), [("t0", "f8"), ("t1", "f8"), ("contacts", "?", (m,))])
    found["t0"], found["t1"] = x[:, 0], x[:, -1]
    for s, segment in enumerate(word):
        found["contacts"][s, list(segment.held)] = True
    return found


def _impacts(terms: Terms, word: Word, x: Array, impulses: list[Array]) -> Any:
    rows = []
    count = len(terms.frame.word)
    for s, segment in enumerate(word):
        if segment.kind not in "ISZ":
            continue
        before = -float(terms.rates[s % count])
        e = 0.0 if segment.kind == "S" else float(terms.frame.flow.e[segment.gap])
        rows.append((x[s, -1], segment.gap, e * before, float(impulses[s][0])))
        if (chain := terms.accumulations.get(s)) is not None:
            own = chain.impacts[chain.impacts["gap"] == segment.gap]
            rows += [(it["t"], it["gap"], it["speed_after"], it["impulse"]) for it in own]
    return np.array(rows, IMPACT)


def _contacts(word: Word, x: Array, length: float, zenos: dict[int, float]) -> Any:
    rows, count = [], len(word)
    for s, segment in enumerate(word):
        new = [gap for gap in held_of(segment.after) if gap not in segment.contacts]
        for gap in new:
            begin = zenos.get(s, float(x[s, -1]))
            for k in range(s + 1, s + 1 + count):
                if gap not in word[k % count].after:
                    end = float(x[k % count, -1]) + length * (k // count)
                    rows.append((begin, end, gap))
                    break
    return np.array(rows, CONTACT)


def weaker_reason(orbit: Any) -> str | None:
    """Return where a simulation over one period leaves an orbit; None if it does not."""
    run = _simulated_mass(orbit) if isinstance(orbit, PeriodicOrbit) else orbit.trajectory
    if not run.success:
        return f"A simulation of it ends early: {run.message}"
    t0, length = float(run.t[0]), orbit.multiple * orbit.period
    flips = [(it.kind, it.gap, t) for it, t in _in_order(orbit, t0, length)]
    if orbit._frame.flow.channels:
        return _other_slips(orbit, run, t0, length)
    hits = [(float(t), int(gap)) for t, gap in _hits(run)]
    mine = [(t, gap) for kind, gap, t in flips if kind in "IS"]
    chains = [(t, gap) for kind, gap, t in flips if kind == "Z"]
    for start, gap in chains:
        ends = run.zeno["t"][(run.zeno["gap"] == gap) & (run.zeno["t"] > start)]
        if not len(ends):
            return "A simulation lacks an accumulation of the orbit."
        inside = [hit for hit in hits if start - 1e-6 * length <= hit[0] <= ends[0]]
        if any(hit[1] != gap for hit in inside):
            return "A simulation has impacts of other gaps within an accumulation."
        hits = [hit for hit in hits if hit not in inside]
    if len(hits) != len(mine):
        return f"A simulation has {len(hits)} impacts within the period, the orbit {len(mine)}."
    lifts = sum(kind == "L" for kind, _, _ in flips)
    at_once = left_at_once(run, run.liftoffs) if len(run.corners) else ()
    seen = len(run.liftoffs) - int(np.count_nonzero(at_once))
    if seen != lifts:
        return f"A simulation has {seen} lift-offs, the orbit {lifts}."
    largest = np.abs(orbit.multipliers[np.isfinite(orbit.multipliers)])
    near = 1e6 * orbit._frame.method.rtol * max(1.0, float(np.max(largest, initial=0.0)))
    for (t, gap), (when, whose) in zip(hits, mine, strict=True):
        if gap != whose or abs(t - when) > max(near, 1e-7) * length:
            return "A simulation has its impacts at other times than the orbit."
    return None


def _other_slips(orbit: Any, run: Any, t0: float, length: float) -> str | None:
    """Return where a simulation has other slips and sticks than an orbit."""
    mine = [(t, it.kind, it.gap) for it, t in _in_order(orbit, t0, length) if it.kind in "KBT"]
    # where it begins a channel that sticks may slip by rounding
    seen = [it for it in _ends_of_slips(run) if t0 + 1e-9 * length < it.t <= t0 + length]
    if [it[1:] for it in mine] != [(it.kind, it.gap) for it in seen]:
        events = " ".join(it.kind for it in seen) or "none"
        return f"A simulation has other slips and sticks within the period: {events}."
    near = max(1e6 * orbit._frame.method.rtol, 1e-7) * length
    if any(abs(one[0] - other.t) > near for one, other in zip(mine, seen, strict=True)):
        return "A simulation has its slips and sticks at other times than the orbit."
    return None


def _simulated_mass(orbit: PeriodicOrbit) -> MassTables:
    """Simulate an orbit of one mass from the middle of a flight or of its rest."""
    frame, length = orbit._frame, orbit.multiple * orbit.period
    x = frame.split(orbit._y)[0]
    t, z = middle_of(frame.flow, frame.word, x[:, :-1], x[:, -1])
    state = frame.flow.initial(z)
    return MassTables(
        simulate(frame.system, (t, t + length), state, frame.method, dense_output=False)
    )


def _in_order(orbit: Any, t0: float, length: float) -> list[tuple[Segment, float]]:
    if isinstance(orbit, PeriodicOrbit):
        word, times = orbit._frame.word, orbit._frame.split(orbit._y)[0][:, -1]
    else:
        word, times = orbit._word, orbit.segments["t1"]
    ends = [(it, t0 + (t - t0) % length) for it, t in zip(word, times.tolist(), strict=True)]
    return sorted(ends, key=lambda it: it[1])


def _hits(run: Any) -> list[tuple[float, int]]:
    """Return the impacts of a run: of each the time and the gap that was hit."""
    rows = run.resolved_impacts
    if isinstance(run, MassTables):
        return [(t, 0) for t in rows["t"].tolist()]
    found = []
    for group in np.unique(rows["group"]):
        own = rows[rows["group"] == group]
        fastest = float(np.min(own["speed_before"]))
        # one that grazes has no speed
        hit = own[own["speed_before"] <= (1e-9 * fastest if fastest < 0.0 else fastest)]
        found += [(float(it["t"]), int(it["gap"])) for it in hit]
    return found


def failed(
    frame: Frame,
    y: Array,
    multiple: int,
    message: str,
    status: OrbitStatus = OrbitStatus.NOT_CONVERGED,
) -> Any:
    """Return the placeholder for a flight that cannot be computed."""
    x, length = frame.split(y)
    n = frame.flow.n
    if isinstance(frame.flow, MassFlow):
        speeds = x[:, 2] if frame.free else np.roll(x[:, 2], -1)
        times = x[:, 0] if frame.free else x[:, 3]
        impacts = _mass_impacts(times, speeds, np.full(len(x), np.nan))
        return new_mass_orbit(frame, y, multiple, length, impacts, status, message)
    return MechanicalOrbit(
        system=frame.system,
        period=length * (1 if frame.turn is None else 2) / multiple,
        multiple=multiple,
        segments=_segments(frame.word, x, frame.flow.m),
        impacts=np.empty(0, IMPACT),
        contacts=np.empty(0, CONTACT),
        zeno_times=np.empty(0),
        liftoff_times=np.empty(0),
        multipliers=np.full(2 * n, np.nan, np.complex128),
        residual=math.inf,
        iterations=0,
        depth=math.nan,
        admissible=False,
        status=status,
        message=message,
        _frame=frame,
        _y=y,
        _word=frame.word,
        _starts=x[:, :-1].copy(),
    )


# Orbits of one mass: views of their words.


def new_mass_orbit(
    frame: Frame,
    y: Array,
    multiple: int,
    length: float,
    impacts: NDArray[np.void],
    status: OrbitStatus,
    message: str,
    **known: Any,
) -> PeriodicOrbit:
    """Make an orbit of one mass; unknown fields have the values of an empty orbit."""
    smooth = all(it.kind == "P" for it in frame.word)
    rests = is_resting(frame.word)
    none: dict[str, Any] = {"multipliers": np.full(2, np.nan + 0j), "iterations": 0}
    none |= {"residual": math.inf, "depth": math.inf if rests else math.nan}
    return PeriodicOrbit(
        system=frame.system,
        kind="resting" if rests else "flight" if smooth else "impacting",
        period=length / multiple,
        multiple=multiple,
        impacts=impacts[:0] if smooth else impacts,
        admissible=status in (OrbitStatus.COMPLETED, OrbitStatus.RESTS),
        status=status,
        message=message,
        _frame=frame,
        _y=y,
        **none | known,
    )


def _mass_impacts(times: Array, speeds: Array, before: Array) -> NDArray[np.void]:
    impacts = np.empty(len(times), ORBIT_IMPACT)
    impacts["t"], impacts["u"], impacts["xdot_before"] = times, speeds, before
    impacts["xdot_after"] = speeds
    return impacts


def orbit_of_mass(
    terms: Terms,
    multiple: int,
    residual: float,
    iterations: int,
    status: OrbitStatus,
    message: str,
    multipliers: NDArray[np.complex128] | None = None,
) -> PeriodicOrbit:
    """Make the orbit of one mass that the equations describe."""
    frame, x, rates = terms.frame, terms.x, np.asarray(terms.rates)
    known: dict[str, Any] = {"residual": residual, "iterations": iterations}
    if any(it.kind == "L" for it in frame.word):
        impacts, times = _from_lift_off(terms, terms.length / multiple)
        known |= times
    elif frame.free:
        impacts = _mass_impacts(x[:, 0], x[:, 2], np.roll(rates, 1))
    else:
        impacts = _mass_impacts(x[:, 3], np.roll(x[:, 2], -1), rates)
    values = multipliers_of(terms) if multipliers is None else multipliers
    if not np.all(np.isfinite(values)):
        values = np.array([np.inf, 0.0], np.complex128)
    elif frame.free:
        values = np.append(values, 1.0)
    if not is_resting(frame.word):
        known["depth"] = Margins(terms).depth
    known["multipliers"] = values
    return new_mass_orbit(frame, terms.y, multiple, terms.length, impacts, status, message, **known)


def _from_lift_off(terms: Terms, period: float) -> tuple[NDArray[np.void], dict[str, float]]:
    """Return the impacts from the lift-off of the smallest phase on, its time, that of the rest."""
    word, x, k, e = terms.frame.word, terms.x, len(terms.x), float(terms.frame.flow.e[0])
    lifts = [s for s, it in enumerate(word) if it.kind == "L"]
    first = min(lifts, key=lambda s: (float(x[s, -1]) / period + 1e-9) % 1.0)
    lift, rows, zeno = float(x[first, -1]), [], math.nan
    for j in range(first + 1, first + k):
        s, turn = j % k, terms.length * (j // k)
        if word[s].kind not in "ISZ":
            continue
        before, chain = float(terms.rates[s]), terms.accumulations.get(s)
        after = 0.0 if word[s].kind == "S" else -e * before
        zeno = turn + (float(x[s, -1]) if chain is None else chain.zeno)
        rows.append((turn + x[s, -1], after, before, after))
        for it in () if chain is None else chain.impacts:
            rows.append((turn + it["t"], it["speed_after"], it["speed_before"], it["speed_after"]))
    shift = lift % period - lift
    impacts = np.array(rows, ORBIT_IMPACT)
    impacts["t"] += shift
    return impacts, {"liftoff_time": lift + shift, "zeno_time": zeno + shift}


# Orbits that rest: they start at a lift-off, and one simulation is the start of the equations.

MOST_PERIODS = 64
REST_LOOKS = 256


def cycle_of(lifts: Array, period: float) -> tuple[int, int] | None:
    """Return the first two lift-offs with the same phase, None if there are none.

    The motion after a lift-off is a function of its phase, so it repeats from there on.
    """
    turns = (lifts - lifts[:, None]) / period
    whole = np.rint(turns)
    same = (np.abs(turns - whole) < 1e-8) & (whole >= 1.0)
    ends = np.flatnonzero(same.any(axis=0))
    return (int(np.flatnonzero(same[:, ends[0]])[-1]), int(ends[0])) if len(ends) else None


def earliest(lifts: Array, period: float) -> int:
    """Return the lift-off of the smallest phase, with which a cycle of several begins."""
    return int(np.argmin((lifts / period + 1e-9) % 1.0))


def _before_lift_off(flow: MassFlow, phase: float, period: float) -> float | None:
    """Return when the force last holds the mass before it lifts off; None if it never holds."""
    times = phase + period * np.arange(REST_LOOKS + 1) / REST_LOOKS
    holds = flow.reactions((0,), times, np.zeros((len(times), 2)))[:, 0] >= 0.0
    (rises,) = np.nonzero(holds[:-1] & ~holds[1:])
    # else the force may be positive between two looks
    place = rises if len(rises) else np.flatnonzero(holds)
    return float(times[place[0]]) if len(place) else None


def resting_orbit(
    system: ImpactSystem,
    method: SwitchedRK,
    period: float,
    phase: float = 0.0,
    most: int | None = None,
) -> PeriodicOrbit:
    """Simulate the motion that lifts off first after a time, until it does so at the same phase.

    At most a given number of periods is simulated, first two, and the motion must return to that
    lift-off. By default it may do so from another one on, within `MOST_PERIODS`.
    """
    flow, longest = MassFlow(system, method), most or MOST_PERIODS
    begin = _before_lift_off(flow, phase, period)
    none, empty = OrbitStatus.NOT_CONVERGED, np.empty(0, ORBIT_IMPACT)
    frame = resting_frame(system, method, period)
    if begin is None:
        why = "The mass never stays at rest."
        return new_mass_orbit(frame, np.empty(0), 1, period, empty, none, why)
    for periods in sorted({min(it, longest) for it in (2, 8, longest)}):
        span = (begin, begin + periods * period)
        run = simulate(system, span, (0.0, 0.0), method)
        lifts, zenos = run.liftoff_times, run.zeno_times
        cycle = cycle_of(lifts, period)
        if (cycle is not None and len(zenos)) or not len(lifts):
            break
    if not len(lifts):
        rests, y = OrbitStatus.RESTS, np.array([-period, 0.0, 0.0, 0.0])
        known = {"multipliers": np.zeros(2, np.complex128), "residual": 0.0}
        why = "The mass rests and never lifts off."
        return new_mass_orbit(frame, y, 1, period, empty, rests, why, **known)
    if cycle is None or not len(zenos) or (most is not None and cycle[0]):
        why = f"The motion after the lift-off does not rest again within {longest} periods."
        if len(lifts) > 1 and len(zenos):
            why = f"The motion lifts off at no phase a second time within {longest} periods."
        return new_mass_orbit(frame, np.empty(0), 1, period, empty, none, why)
    first, end = (float(lifts[i]) for i in cycle)
    multiple, tables = round((end - first) / period), MassTables(run)
    events = [it for it in _events_of(flow, tables, period) if first < it.t <= end]
    try:
        frame, x = _unknowns(system, flow, tables, events, multiple * period, False, method)
        x[:, [0, -1]] -= _floor(x[0, -1] / period) * period  # far from 0 times have fewer digits
        terms = evaluate(frame, frame.joined(x, frame.length))
    except FlightError as error:
        why = f"A flight could not be computed: {error}"
        return new_mass_orbit(frame, np.empty(0), 1, period, empty, none, why)
    residual = float(np.max(np.abs(terms.residual / sizes_of(terms)[1])))
    why = "The motion rests and lifts off again at the same phase."
    return orbit_of_mass(terms, multiple, residual, 0, OrbitStatus.COMPLETED, why)


def renewed(state: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes missing in an orbit of one mass that version 0.2 or older pickled."""
    old, system, y, period = (state[it] for it in ("_frame", "system", "_y", "period"))
    if state["kind"] != "resting":
        frame, new = old.word(system, y, period)
        if (away := state.get("_away")) is not None:
            away = (old.word(system, y + 1e-6 * away, period)[1] - new) / 1e-6
        return {"_frame": frame, "_y": new, "_away": away}
    if (lift := state["liftoff_time"]) is not None:
        rest = lift + old.multiple * period - state["zeno_time"]
        orbit = resting_orbit(system, old.method, period, lift - 0.5 * rest, old.multiple + 1)
        return {"_frame": orbit._frame, "_y": orbit._y}
    rests = state["status"] is OrbitStatus.RESTS
    frame = resting_frame(system, old.method, period, old.start)
    y = np.array([old.start - period, 0.0, 0.0, old.start]) if rests else np.empty(0)
    return {"_frame": frame, "_y": y}
