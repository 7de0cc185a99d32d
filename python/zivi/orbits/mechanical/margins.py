"""Whether the solution of a word's equations is a motion, and how far it is from none.

A motion has negative speeds of gaps before impacts, positive gaps in flight, positive forces of
contacts, contacts that last, positive impulses of contacts that an impact leaves closed.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.equations import Terms, row_sizes

__all__ = ["OUT", "Low", "Margins"]

LOOKS = np.unique(np.concatenate([np.linspace(0.0, 1.0, 65), np.geomspace(1e-5, 1e-2, 10)]))
"""Parts of a segment at which gaps and forces are looked at."""
FLAT = 1e-4
"""A gap that stays below this part of the coordinates has their rounding."""
CLOSE = 1e-13
"""How near two times of a minimum are when it is found."""
OUT = {
    "grazing": "The impact at t = {t:.9g} s would open the gap at {value:.3g}, not close it.",
    "interior_impact": "A gap is {value:.3g} < 0 in flight, at t = {t:.9g} s.",
    "contact_ends": "The force of a contact is {value:.3g} < 0 at t = {t:.9g} s.",
    "end_of_rest": "The contact from t = {t:.9g} s would last {value:.3g} s < 0.",
    "rest_appears": "The force holds the mass after an impact at t = {t:.9g} s: {value:.3g} < 0.",
    "opening": "An impact at t = {t:.9g} s would pull at a contact, with {value:.3g} < 0.",
    "simultaneous": "At t = {t:.9g} s two events have changed places, by {value:.3g} < 0.",
}
"""What is not there in a motion, by the event at which it begins."""


class Low(NamedTuple):
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
    """What must be positive of a solution."""

    terms: Terms

    @functools.cached_property
    def lows(self) -> list[Low]:
        """All that must be positive; of gaps and forces their minima."""
        found = [*self._events(), *self._lasting(), *self._kinks()]
        for s in range(len(self.terms.frame.word)):
            found += self.between(s)
        return found

    @property
    def least(self) -> Low | None:
        """What is least, relative to its size."""
        return min(self.lows, key=lambda it: it.value / it.size, default=None)

    def why_not(self, rounding: float = 1e-11, *, grazing: bool = False) -> str | None:
        """Say why it is no motion; None if it is one.

        Where it grazes all of its impacts may be as slow as rounding: it counts by other speeds.
        """
        lows = self.lows
        if grazing:
            limit = -rounding * float(row_sizes(self.terms)[-2])
            lows = [it for it in lows if it.kind != "grazing" or it.value < limit]
        least = min(lows, key=lambda it: it.value / it.size, default=None)
        if least is None or least.value > -rounding * least.size:
            return None
        return OUT[least.kind].format(t=least.t, value=least.value)

    @property
    def depth(self) -> float:
        """How far the nearest grazing is: the least minimum of a gap or height of an impact."""
        terms, heights = self.terms, [math.inf]
        for s, segment in enumerate(terms.frame.word):
            if segment.kind in "ISZ":
                pull = abs(self._pull(s, segment.gap))
                heights.append(terms.rates[s] ** 2 / (2.0 * pull) if pull else math.inf)
        gaps = [abs(low.value) for low in self.lows if low.kind == "interior_impact"]
        return float(min([*heights, *gaps]))

    def _pull(self, s: int, gap: int) -> float:
        """Give the acceleration of a gap before an impact."""
        terms = self.terms
        t0, t1 = terms.x[s, 0], terms.x[s, -1]
        h = 1e-4 * (t1 - t0)
        times = np.array([t1 - h, t1])
        z = terms.frame.flow.path(terms.frame.word[s].contacts, t0, terms.x[s, 1:-1], times)
        rates = terms.frame.flow.gaps(times, z)[1][:, gap]
        return float((rates[1] - rates[0]) / h) if h else math.inf

    def _events(self) -> list[Low]:
        terms, found = self.terms, []
        hits = [s for s, it in enumerate(terms.frame.word) if it.kind in "ISZ"]
        fastest = float(np.max(np.abs(terms.rates[hits]), initial=0.0)) or 1.0
        for s in hits:
            segment, t = terms.frame.word[s], float(terms.x[s, -1])
            found.append(Low("grazing", s, segment.gap, t, -float(terms.rates[s]), fastest))
            if not segment.kept:
                continue
            largest = float(np.max(np.abs(terms.impulses[s]), initial=1e-300))
            for gap, impulse in zip(segment.kept, terms.impulses[s][1:], strict=True):
                found.append(Low("opening", s, gap, t, float(impulse), largest))
        return found

    def _lasting(self) -> list[Low]:
        terms, found = self.terms, []
        for s, segment in enumerate(terms.frame.word):
            kind = "end_of_rest" if segment.contacts else "simultaneous"
            t = float(terms.x[s, 0])
            last = float(terms.x[s, -1]) - t
            if segment.contacts or last < 0.0:
                found.append(Low(kind, s, segment.gap, t, last, abs(terms.length)))
        return found

    def _kinks(self) -> list[Low]:
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
                    found.append(Low("simultaneous", s, i, float(t[0]), float(gaps[0, i]), size))
        return found

    def behind(self) -> list[Low]:
        """Give the minima next to impacts that open: the gap is below zero since they do."""
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

    def between(self, s: int) -> list[Low]:
        """Look for minima of open gaps, and of the forces of contacts, in a segment."""
        terms = self.terms
        flow, segment = terms.frame.flow, terms.frame.word[s]
        t0, t1 = float(terms.x[s, 0]), float(terms.x[s, -1])
        if t1 <= t0:
            return []
        if (lows := terms.flights.lows) is not None:
            return self._of_mass(s, *lows[s])
        times = t0 + (t1 - t0) * LOOKS
        z = flow.path(segment.contacts, t0, terms.x[s, 1:-1], times)
        gaps, rates = flow.gaps(times, z)
        found, widest = [], float(np.max(np.abs(z[:, : flow.n])))
        # at a lift-off the rate of its gap is zero up to rounding: no minimum
        lifted = terms.frame.word[s - 1].gap if terms.frame.word[s - 1].kind == "L" else -1
        for i in range(flow.m):
            if i in segment.contacts:
                continue
            # a gap of a short flight is a difference of coordinates
            size = max(float(np.max(np.abs(gaps[:, i]))), FLAT * widest, 1e-300)
            turns = np.flatnonzero((rates[:-1, i] < 0.0) & (rates[1:, i] >= 0.0))
            for k in turns[(turns > 0) | (i != lifted)]:
                t, value = self._minimum(s, i, times[k : k + 2], rates[k : k + 2, i])
                found.append(Low("interior_impact", s, i, t, value, size))
        if segment.contacts:
            found += self._forces(s, times, z)
        return found

    @functools.cached_property
    def _distance(self) -> float:
        return float(row_sizes(self.terms)[1])

    def _of_mass(self, s: int, t: float, height: float) -> list[Low]:
        """Give the lowest minimum of one mass; where an impact is plastic whether it leaves."""
        terms, found = self.terms, []
        if math.isfinite(height):
            size = self._distance
            found.append(Low("interior_impact", s, 0, float(t), float(height), size))
        if terms.frame.flow.e[0] == 0.0 and terms.frame.word[s].kind == "I":
            pulls = terms.flights.first[:, 1]
            begin, size = float(terms.x[s - 1, -1]), float(np.max(np.abs(pulls)))
            found.append(Low("rest_appears", s, 0, begin, float(pulls[s]), size))
        return found

    def _minimum(self, s: int, gap: int, times: Array, rates: Array) -> tuple[float, float]:
        """Find where the rate of a gap vanishes between two times."""
        terms = self.terms
        frame, t0, z0 = terms.frame, float(terms.x[s, 0]), terms.x[s, 1:-1]

        def look(t: float) -> tuple[float, float]:
            z = frame.flow.path(frame.word[s].contacts, t0, z0, np.array([t]))
            value, rate = frame.flow.gaps(np.array([t]), z)
            return float(value[0, gap]), float(rate[0, gap])

        return _zero(look, times, rates)

    def _forces(self, s: int, times: Array, z: Array) -> list[Low]:
        terms = self.terms
        flow, segment = terms.frame.flow, terms.frame.word[s]
        forces = flow.reactions(segment.contacts, times, z)
        found = []
        for k, i in enumerate(segment.contacts):
            own = forces[:, k]
            size = max(float(np.max(np.abs(own))), 1e-300)
            found.append(Low("contact_ends", s, i, float(times[0]), float(own[0]), size))
            if i != segment.gap:
                found.append(Low("contact_ends", s, i, float(times[-1]), float(own[-1]), size))
            inner = np.flatnonzero((own[1:-1] < own[:-2]) & (own[1:-1] <= own[2:])) + 1
            for j in inner:
                low = self._least_force(s, i, times[j - 1 : j + 2])
                found.append(Low("contact_ends", s, i, *low, size))
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
        if rate == 0.0 or abs(t - last) < CLOSE * max(1.0, abs(t)):
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
