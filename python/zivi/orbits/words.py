"""Event sequences of runs, and orbits of mechanical systems from them."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.equations import (
    Frame,
    Solution,
    Terms,
    after_event,
    evaluate,
    multipliers_of,
    newton,
    row_sizes,
    whole_word,
)
from zivi.orbits.flows import FlightError, Flow, Segment, Word, uncoupled
from zivi.orbits.orbit import CONTACT, IMPACT, MechanicalOrbit
from zivi.orbits.path import Margins, flow_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem

__all__ = [
    "MOST_MULTIPLE",
    "TOLERANCES",
    "NotDifferentiable",
    "canonical",
    "failed",
    "least",
    "orbit_of_word",
    "recent",
    "repeating",
    "rolled",
    "shown",
    "solve_word",
    "weaker_reason",
]

# The word and the unknowns that the end of a run shows.

MOST_MULTIPLE, MOST_EVENTS = 64, 256
TOLERANCES = (1e-6, 1e-4, 1e-2)
ROUNDING = 1e-12
"""How near two events are that are one, relative to the time."""
BEFORE = 1e-9
"""How long before an impact of several gaps a run is looked at (s)."""


class NotDifferentiable(Exception):  # noqa: N818
    """What a run settled on has no derivatives."""

    def __init__(self, why: str, frame: Frame, x: Array, count: int) -> None:
        super().__init__(why)
        self.frame, self.x, self.count = frame, x, count


class Happened(NamedTuple):
    """An event of a run; of the kind ``C`` where several gaps are hit, or come to rest, at once."""

    t: float
    kind: str
    gap: int
    opened: tuple[int, ...] = ()


def recent(
    system: MechanicalSystem,
    run: MechanicalTrajectory,
    multiple: int | None,
    period: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array, int, str]:
    """Give the frame and the unknowns of the last period of the motion of a run, and tell it.

    Raises
    ------
    ValueError
        If the run is too short, or ended early.
    NotDifferentiable
        If its last period has what no word describes.
    """
    if not run.success:
        raise ValueError(f"start: the run ended early: {run.message}")
    flow = flow_of(system, method)
    events = _events(system, flow, run)
    count, repeats = 1, multiple
    if free:
        length, end = _free_length(run, events)
    else:
        span = float(run.t[-1] - run.t[0])
        if span < (multiple or 1) * period * (1.0 - 1e-9):
            raise ValueError(f"start: the run must last a period, {period:.6g}, got {span:.6g}")
        repeats = multiple or _repeats(run, events, period)
        count = repeats or 1
        length, end = count * period, _quiet(run, events, count * period)
        # a flight of more than a period, or a motion without events
        near = repeats is None and any(it.t > end - 4.0 * period for it in events)
        while near and length < 4.0 * period and (count + 1) * period <= span:
            if any(end - length < it.t <= end for it in events):
                break
            count += 1
            length, end = count * period, _quiet(run, events, count * period)
    inside = [it for it in events if end - length < it.t <= end]
    several = next((it.t for it in inside if it.kind == "C"), None)
    if several is not None:
        why = f"Several gaps are hit, or come to rest, at once, at t = {several:.9g} s."
        frame, x = _smooth(system, flow, run, length, end, free, method)
        x[0, 0] = x[0, -1]
        raise NotDifferentiable(f"{why} The motion has no derivatives there.", frame, x, count)
    if len(inside) > MOST_EVENTS:
        raise ValueError(f"start: a word has at most {MOST_EVENTS} events, got {len(inside)}")
    told = "" if free else shown(count, len(inside), "event", repeats=bool(repeats))
    if not inside:
        return *_smooth(system, flow, run, length, end, free, method), count, told
    shift = 0.0 if free else _floor(float(inside[0].t) / period) * period
    frame, x = _unknowns(system, flow, run, inside, length, free, method)
    # far from t = 0 times have fewer digits
    x[:, [0, -1]] -= shift
    return frame, x, count, told


def _floor(number: float) -> float:
    return float(np.floor(number))


def _events(system: MechanicalSystem, flow: Flow, run: MechanicalTrajectory) -> list[Happened]:
    """Give what happens in a run, impacts of accumulations as one event, in order."""
    found: list[Happened] = []
    rows: Any = run.resolved_impacts
    lifts: Any = run.liftoffs
    zenos: Any = run.zeno
    for row in run.zeno:
        # a gap that lifts off and is closed in the same instant, by rounding, stays closed
        near = ROUNDING * max(1.0, abs(float(row["t"])))
        (own,) = np.nonzero((lifts["gap"] == row["gap"]) & (np.abs(lifts["t"] - row["t"]) <= near))
        if len(own) < 2:
            continue
        lifts = np.delete(lifts, own[:-1])
        zenos = zenos[zenos["t"] != row["t"]]
        rows = rows[(rows["gap"] != row["gap"]) | (np.abs(rows["t"] - row["t"]) > near)]
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
    closings = [(float(row["t"]), int(row["gap"])) for row in zenos]
    left = {(float(it["t"]), int(it["gap"])) for it in lifts[left_at_once(run, lifts)]}
    lifts = lifts[~left_at_once(run, lifts)]
    for corner in run.corners:
        t = float(corner["t"])
        kept = _closed(run, max(t - BEFORE, float(run.t[0])))
        new = [int(i) for i in np.flatnonzero(corner["gaps"]) if i not in kept]
        if len(new) != 1:
            found.append(Happened(t, "C", -1))
        elif all(gap != new[0] or abs(at - t) > ROUNDING * max(1.0, abs(t)) for at, gap in left):
            closings.append((t, new[0]))
    found += [Happened(float(it["t"]), "L", int(it["gap"])) for it in lifts]
    found.sort(key=lambda it: it.t)
    for t, gap in sorted(closings):
        found = _accumulated(found, t, gap, float(system.e[gap]))
    return found


def left_at_once(run: MechanicalTrajectory, lifts: Any) -> Any:
    """Tell which gaps lift off where they are hit: others are closed, and their forces pull."""
    near = ROUNDING * np.maximum(1.0, np.abs(lifts["t"]))
    apart = np.abs(lifts["t"][:, None] - run.corners["t"])
    return np.any(apart <= near[:, None], axis=1)


def _accumulated(found: list[Happened], zeno: float, gap: int, e: float) -> list[Happened]:
    """Replace the impacts of an accumulation by one event, at the first of them."""
    last = [k for k, it in enumerate(found) if it.t <= zeno and it.kind == "I" and it.gap == gap]
    if not last:
        return found
    first = last[-1]
    if e == 0.0:
        return [*found[:first], found[first]._replace(kind="S"), *found[first + 1 :]]
    while first > 0 and found[first - 1].kind == "I" and found[first - 1].gap == gap:
        first -= 1
    chain = found[first]._replace(kind="Z")
    return [*found[:first], chain, *found[last[-1] + 1 :]]


def _busy(run: MechanicalTrajectory, events: list[Happened]) -> list[tuple[float, float]]:
    """Give the spans of time of accumulations, which a window must not cut."""
    spans = []
    for row in run.zeno:
        begins = [it.t for it in events if it.kind == "Z" and it.gap == row["gap"]]
        begin = [t for t in begins if t < row["t"]]
        if begin:
            spans.append((begin[-1], float(row["t"])))
    return spans


def _quiet(
    run: MechanicalTrajectory, events: list[Happened], length: float, *, repeats: bool = True
) -> float:
    """Give the middle of the longest pause shortly before the end of a run."""
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


def _repeats(run: MechanicalTrajectory, events: list[Happened], period: float) -> int | None:
    """Give after how many periods the state repeats; None if it does not."""
    end, begin = _quiet(run, events, period, repeats=False), float(run.t[0])
    most = min(MOST_MULTIPLE, int((end - begin) / period))
    times = np.maximum(end - period * np.arange(most + 1), begin)
    return repeating(run(times).transpose(1, 0, 2).reshape(most + 1, -1), run.q, run.qdot)


def repeating(states: Array, *parts: Array) -> int | None:
    """Give after how many periods states, a row each, repeat; None if they do not.

    Positions and velocities are compared with the largest of a run, or of the states.
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
    """Say what the end of a run holds, for an orbit that was not found from it."""
    last, hold = ("period", "holds") if multiple == 1 else (f"{multiple} periods", "hold")
    many = f"{events or 'no'} {what}{'s' * (events != 1)}"
    told = "" if repeats else ", and nothing repeats to a hundredth"
    return f"The last {last} of the run {hold} {many}{told}; give multiple=, or a longer run."


def _free_length(run: MechanicalTrajectory, events: list[Happened]) -> tuple[float, float]:
    """Give after how long a motion that nothing excites repeats, and where it is looked at."""
    end, begin = float(run.t[-1]), float(run.t[0])
    own = [it for it in events if it.t > 0.5 * (begin + end)]
    if len(own) < 3:
        times = np.linspace(0.5 * (begin + end), end, 20_001)
        q, qdot = run(times)
        j = int(np.argmax(np.ptp(q, axis=0)))
        tops = np.flatnonzero((qdot[:-1, j] > 0.0) & (qdot[1:, j] <= 0.0))
        if len(tops) < 2:
            raise ValueError("start: the run shows no two equal events, nor two highest points")
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
                return length, _quiet(run, events, length)
    raise ValueError("start: the run does not repeat itself to a hundredth")


def _smooth(
    system: MechanicalSystem,
    flow: Flow,
    run: MechanicalTrajectory,
    length: float,
    end: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array]:
    """Give the unknowns of a motion without events: one segment, with the letter P."""
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


def _closed(run: MechanicalTrajectory, t: float) -> tuple[int, ...]:
    at = run.resample(np.array([t]))
    return tuple(int(i) for i in np.flatnonzero(at.contacts[0]))


def _unknowns(
    system: MechanicalSystem,
    flow: Flow,
    run: MechanicalTrajectory,
    events: list[Happened],
    length: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array]:
    contacts = _closed(run, events[0].t - 1e-9 * length)
    word, rows = [], []
    for it in events:
        after = {*contacts} - {*it.opened}
        after = after | {it.gap} if it.kind in "SZ" else after - {it.gap}
        segment = Segment(contacts, it.kind, it.gap, tuple(sorted(after)))
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


def solve_word(frame: Frame, y: Array, multiple: int, most: int = 20) -> MechanicalOrbit:
    """Solve for an orbit, reduce it to its least period, and look whether it is a motion."""
    try:
        found = newton(frame, y, most)
        steps = found.iterations
        frame, multiple, found = least(frame, multiple, y, found, most)
    except (FlightError, ValueError) as error:
        return failed(frame, y, multiple, f"A flight could not be computed: {error}")
    if not found.converged:
        why = f"Newton's iteration did not converge: the residual is {found.residual:.3g}."
        return orbit_of_word(found.terms, multiple, found.residual, steps, why, found=False)
    terms = canonical(found.terms, multiple)
    why_not = Margins(terms).why_not()
    orbit = orbit_of_word(terms, multiple, found.residual, steps, why_not)
    if why_not is not None:
        return orbit
    reason = weaker_reason(orbit)
    if reason is None:
        return orbit
    return dataclasses.replace(
        orbit, admissible=False, status=OrbitStatus.LEFT_ADMISSIBLE, message=reason
    )


def least(
    frame: Frame, multiple: int, guess: Array, found: Solution, most: int
) -> tuple[Frame, int, Solution]:
    """Give the solution over the least period: the one given, or one that it repeats."""
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
        apart, mean = (_of_flight if flies else _parts)(frame, y, parts, found.terms)
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


def _parts(frame: Frame, y: Array, parts: int, terms: Terms) -> tuple[float, Array]:
    """Give how far equal parts of an orbit differ, and their mean."""
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
    """Give how far the state after a part of a motion without events differs, and that part."""
    x, length = frame.split(y)
    x[0, -1] = x[0, 0] + length / parts
    end = frame.flow.path(frame.word[0].contacts, float(x[0, 0]), x[0, 1:-1], x[0, -1:])[0]
    return float(np.max(np.abs(end - x[0, 1:-1]) / row_sizes(terms)[1:-1])), x


def _moved(terms: Terms, mean: Array) -> float:
    return float(np.max(np.abs(terms.x - mean) / row_sizes(terms)))


def canonical(terms: Terms, multiple: int) -> Terms:
    """Let the word end with the event of the smallest phase, its time within the first period."""
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
    """Give a word and its segments from another one on."""
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
    message: str = "The orbit was found, and a simulation follows it.",
) -> MechanicalOrbit:
    """Make the orbit that the equations describe."""
    frame = terms.frame
    word, x, impulses = whole_word(terms)
    length = terms.length * (1 if frame.turn is None else 2)
    status = OrbitStatus.COMPLETED if why_not is None else OrbitStatus.LEFT_ADMISSIBLE
    if not found:
        status = OrbitStatus.NOT_CONVERGED
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
        depth=Margins(terms).depth if found else math.nan,
        admissible=status is OrbitStatus.COMPLETED,
        status=status,
        message=why_not or message,
        _frame=frame,
        _y=terms.y,
        _word=word,
        _starts=x[:, :-1].copy(),
    )


def _segments(word: Word, x: Array, m: int) -> Any:
    found = np.zeros(len(word), [("t0", "f8"), ("t1", "f8"), ("contacts", "?", (m,))])
    found["t0"], found["t1"] = x[:, 0], x[:, -1]
    for s, segment in enumerate(word):
        found["contacts"][s, list(segment.contacts)] = True
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
        new = [gap for gap in segment.after if gap not in segment.contacts]
        for gap in new:
            begin = zenos.get(s, float(x[s, -1]))
            for k in range(s + 1, s + 1 + count):
                if gap not in word[k % count].after:
                    end = float(x[k % count, -1]) + length * (k // count)
                    rows.append((begin, end, gap))
                    break
    return np.array(rows, CONTACT)


def weaker_reason(orbit: MechanicalOrbit) -> str | None:
    """Say where a simulation over one period leaves an orbit; None if it does not."""
    run = orbit.trajectory
    if not run.success:
        return f"A simulation of it ends early: {run.message}"
    t0, length = float(run.t[0]), orbit.multiple * orbit.period
    flips = [(it.kind, it.gap, t) for it, t in _in_order(orbit, t0, length)]
    hits = [(float(t), int(gap)) for t, gap in _hits(run)]
    mine = [(t, gap) for kind, gap, t in flips if kind in "IS"]
    chains = [(t, gap) for kind, gap, t in flips if kind == "Z"]
    for start, gap in chains:
        ends = run.zeno["t"][(run.zeno["gap"] == gap) & (run.zeno["t"] > start)]
        if not len(ends):
            return "A simulation has no accumulation where the orbit has one."
        inside = [hit for hit in hits if start - 1e-6 * length <= hit[0] <= ends[0]]
        if any(hit[1] != gap for hit in inside):
            return "A simulation has impacts of other gaps within an accumulation."
        hits = [hit for hit in hits if hit not in inside]
    if len(hits) != len(mine):
        return f"A simulation has {len(hits)} impacts within the period, the orbit {len(mine)}."
    lifts = sum(kind == "L" for kind, _, _ in flips)
    seen = len(run.liftoffs) - int(np.count_nonzero(left_at_once(run, run.liftoffs)))
    if seen != lifts:
        return f"A simulation has {seen} lift-offs, the orbit {lifts}."
    largest = np.abs(orbit.multipliers[np.isfinite(orbit.multipliers)])
    near = 1e6 * orbit._frame.method.rtol * max(1.0, float(np.max(largest, initial=0.0)))
    for (t, gap), (when, whose) in zip(hits, mine, strict=True):
        if gap != whose or abs(t - when) > max(near, 1e-7) * length:
            return "A simulation has its impacts at other times than the orbit."
    return None


def _in_order(orbit: MechanicalOrbit, t0: float, length: float) -> list[tuple[Segment, float]]:
    ends = [(it, t0 + (t - t0) % length) for it, t in zip(orbit._word, orbit.segments["t1"],
                                                          strict=True)]  # fmt: skip
    return sorted(ends, key=lambda it: it[1])


def _hits(run: Any) -> list[tuple[float, int]]:
    """Give the impacts of a run: of each the time and the gap that was hit."""
    rows = run.resolved_impacts
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
) -> MechanicalOrbit:
    """Give what there is where no flight can be computed."""
    x, length = frame.split(y)
    n = frame.flow.n
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
