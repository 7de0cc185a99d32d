"""From a guess of a word and its unknowns to an orbit, and whether it is a motion."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.equations import (
    Frame,
    Solution,
    Terms,
    evaluate,
    newton,
    row_sizes,
)
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.multipliers import multipliers_of
from zivi.orbits.mechanical.orbit import CONTACT, IMPACT, MechanicalOrbit
from zivi.orbits.mechanical.run_word import left_at_once
from zivi.orbits.mechanical.symmetry import whole_word
from zivi.orbits.mechanical.word import Segment, Word

__all__ = ["canonical", "failed", "least", "orbit_of", "rolled", "solve", "weaker_reason"]

SAME = 2e-4
"""Parts of an orbit that differ by less, relative to its size, may be one shorter orbit."""
NEAR = 0.05
"""Parts of a guess that differ by less may be."""


def solve(frame: Frame, y: Array, multiple: int, most: int = 20) -> MechanicalOrbit:
    """Solve for an orbit, reduce it to its least period, and look whether it is a motion."""
    try:
        found = newton(frame, y, most)
        steps = found.iterations
        frame, multiple, found = least(frame, multiple, y, found, most)
    except (FlightError, ValueError) as error:
        return failed(frame, y, multiple, f"A flight could not be computed: {error}")
    if not found.converged:
        why = f"Newton's iteration did not converge: the residual is {found.residual:.3g}."
        return orbit_of(found.terms, multiple, found.residual, steps, why, found=False)
    terms = canonical(found.terms, multiple)
    why_not = Margins(terms).why_not()
    orbit = orbit_of(terms, multiple, found.residual, steps, why_not)
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


def orbit_of(
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
