"""The word and the unknowns that the end of a run shows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.accumulation import after_event
from zivi.orbits.mechanical.by_parameter import flow_of
from zivi.orbits.mechanical.equations import Frame
from zivi.orbits.mechanical.flow import Flow, uncoupled
from zivi.orbits.mechanical.word import Segment
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem

__all__ = ["MOST_MULTIPLE", "TOLERANCES", "NotDifferentiable", "recent", "repeating", "shown"]

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
