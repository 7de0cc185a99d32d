"""The impact observer on random histories: units, kicks, outliers, a wrong e, missing samples.

A mass bounces under a constant force, of which up to 2 m/s^2 are unknown, at an e of 0.3 to 0.9;
positions are measured every millisecond to 0.1 mm, velocities not unless it is said. The motion is
a closed form (`Flight`), nothing of it is zivi's. Medians over the runs of the rms errors in the
second half of each, while it bounces.

Run as ``python benchmarks/observer_histories.py [runs]``: 100 runs a line take a minute or two.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import zivi

F, H, NOISE, Q_D, DMAX = -9.81, 1e-3, (1e-4, 1e-2), 1e-6, 5.0
"""Known force, period, deviations of the sensor, variance and bound of the unknown force."""
KICKS = (3.0, 5.0, 10.0, 20.0, 30.0, 100.0)
OUTLIERS = (0.05, 0.1, 0.2, 0.3, 0.4)
MISSING = (0.0, 0.05, 0.2, 0.5, 0.8)
WRONG, LONGEST = 0.5, 30
"""A velocity that is wrong by more (m/s) for more samples than these is lost."""
UNITS = {
    "m, s": (1.0, 1.0),
    "mm": (1e3, 1.0),
    "km": (1e-3, 1.0),
    "um": (1e6, 1.0),
    "ms": (1.0, 1e3),
}
"""Numbers of the unit in a metre, and in a second."""


@dataclasses.dataclass(frozen=True)
class Flight:
    """A mass above a wall under a constant acceleration towards it, in closed form."""

    x: float
    xdot: float
    a: float
    e: float

    @property
    def speed(self) -> float:
        """That of the first contact."""
        return math.sqrt(self.xdot**2 - 2 * self.a * self.x)

    @property
    def contact(self) -> float:
        """Time of the first contact."""
        return (self.xdot + self.speed) / -self.a

    @property
    def zeno(self) -> float:
        """Time from which on it rests."""
        return self.contact + 2 * self.e * self.speed / (-self.a * (1 - self.e))

    def at(self, t: np.ndarray) -> np.ndarray:
        """Position and velocity at these times.

        Flight `k` after the first contact starts at ``contact + T (1 - e^k)/(1 - e)``,
        ``T = 2 e V/g``, with the speed ``e^(k + 1) V``.
        """
        e, whole = self.e, self.zeno - self.contact
        part = np.clip((t - self.contact) / whole, 0.0, 1 - 1e-15)
        k = np.floor(np.log1p(-part) / math.log(e))
        since = t - self.contact + whole * np.expm1(k * math.log(e))
        up = e ** (k + 1) * self.speed
        first = self._arc(self.x, self.xdot, t)
        later = np.where(t < self.zeno, self._arc(0.0, up, since), 0.0)
        return np.where(t < self.contact, first, later)

    def _arc(self, x: float, xdot: float | np.ndarray, t: np.ndarray) -> np.ndarray:
        return np.array([x + xdot * t + self.a * t * t / 2, xdot + self.a * t])

    def sample_near(self, k: int) -> int:
        """Find a sample near this one that is 20 or more before an impact."""
        begin, end, length = 0.0, self.contact, 2 * self.e * self.speed / -self.a
        while end <= k * H and length > 50 * H:
            begin, end, length = end, end + length, length * self.e
        latest = math.floor(end / H) - 20
        return max(min(k, latest), math.ceil(begin / H) + 1)


@dataclasses.dataclass
class History:
    """What was, and what was measured of it (NaN where a sample is missing)."""

    t: np.ndarray
    x: np.ndarray
    xdot: np.ndarray
    measured: np.ndarray
    velocities: np.ndarray
    e: float
    d: float
    kicked: int
    """The first sample after the kick, 0 without."""

    def seen(self, *, e: float | None = None, **settings: Any) -> Estimates:
        """Give what the observer makes of it."""
        given = {"noise": NOISE, "q_d": Q_D, "dmax": DMAX, "position_only": True} | settings
        it = zivi.ImpactObserver(self.e if e is None else e, H, **given)
        samples = zip(self.measured.tolist(), self.velocities.tolist(), strict=True)
        rows = [it.step(*sample(x, xdot), F, 0.0) for x, xdot in samples]
        return Estimates(self, np.array(rows), it)


def sample(x: float, xdot: float) -> tuple[float | None, float | None]:
    """Give a measurement as `step` takes it."""
    return (None, None) if math.isnan(x) else (x, xdot)


@dataclasses.dataclass
class Estimates:
    """Rows of position, velocity and unknown force at all samples, and the observer at the end."""

    of: History
    rows: np.ndarray
    observer: zivi.ImpactObserver

    @property
    def off(self) -> np.ndarray:
        """Errors of the velocity (m/s)."""
        return np.abs(self.rows[:, 1] - self.of.xdot)

    @property
    def rms(self) -> tuple[float, float]:
        """Of the errors of velocity and unknown force in the second half."""
        late = slice(len(self.of.t) // 2, None)
        force = self.rows[late, 2] - self.of.d
        return math.sqrt(np.mean(self.off[late] ** 2)), math.sqrt(np.mean(force**2))

    @property
    def found_again(self) -> int:
        """Samples after the kick until the velocity is within 0.5 m/s for good (in flight)."""
        wrong = np.flatnonzero((self.off > WRONG) & ~self.at_impacts)
        return max(int(wrong[-1]) + 1 - self.of.kicked, 0) if len(wrong) else 0

    @property
    def at_impacts(self) -> np.ndarray:
        """The sample after an impact, where noise may have it on the other side of it."""
        rising = np.diff(self.of.xdot, prepend=self.of.xdot[0]) > 0.5 * -F * H
        return rising | np.roll(rising, -1)

    @property
    def lost(self) -> int:
        """The most samples in a row, of those that there are, that leave the velocity wrong."""
        there = np.isfinite(self.of.measured)
        wrong = np.concatenate([[False], (self.off > WRONG)[there], [False]])
        edges = np.flatnonzero(np.diff(wrong.astype(int)))
        return int(max(edges[1::2] - edges[::2], default=0))


Line = Callable[[int], list[Estimates]]
"""So many histories as an observer sees them."""


def drawn(
    rng: np.random.Generator, *, kick: float = 0.0, outliers: float = 0.0, missing: float = 0.0,
    pauses: bool = False, seconds: float = 4.0,
) -> History:  # fmt: skip
    """Draw a mass that bounces until the end and, about half-way, is kicked up in flight.

    Outliers are off by up to 1 m either way. Samples are missing at random, or, in pauses, 50 of
    every 200 in a row.
    """
    e, d = rng.uniform(0.3, 0.9), rng.uniform(-2, 2)
    flight = Flight(rng.uniform(1, 5), rng.uniform(-3, 3), F + d, e)
    t = H * np.arange(int(min(seconds, 0.8 * flight.zeno) / H))
    state, kicked = flight.at(t), 0
    if kick:
        kicked = flight.sample_near(len(t) // 2)
        x, xdot = state[:, kicked]
        state[:, kicked:] = Flight(x, xdot + kick, F + d, e).at(t[kicked:] - t[kicked])
    measured, speeds = (
        it + of * rng.standard_normal(len(t)) for it, of in zip(state, NOISE, strict=True)
    )
    measured += rng.uniform(-1, 1, len(t)) * (rng.random(len(t)) < outliers)
    measured[rng.random(len(t)) < missing] = np.nan
    if pauses:
        measured[np.arange(len(t)) % 200 >= 150] = np.nan
    return History(t, *state, measured, speeds, e, d, kicked)


def in_units(history: History, length: float, time: float, **settings: Any) -> np.ndarray:
    """Estimates, deviations and refusals in other units of length and time, in m and s again."""
    speed, force = length / time, length / time**2
    it = zivi.ImpactObserver(
        history.e, H * time, noise=(NOISE[0] * length, NOISE[1] * speed), q_d=Q_D * force**2,
        dmax=DMAX * force, **settings,
    )  # fmt: skip
    scales, rows = np.array([length, speed, force] * 2), []
    for x, xdot in zip(history.measured.tolist(), history.velocities.tolist(), strict=True):
        estimate = it.step(*sample(x * length, xdot * speed), F * force, 0.0)
        deviations = np.sqrt(np.diag(it.covariance))[:3]
        rows.append([*(np.array([*estimate, *deviations]) / scales), it.e_est, it.n_refused])
    return np.array(rows)


def farthest(one: np.ndarray, other: np.ndarray) -> float:
    """Give the largest difference of rows of `in_units`, of the largest x, x', of |F| and of 1.

    From a tenth of a second on: before, rounding of a position is as much of a force as eps x/t^2.
    """
    x, xdot = np.abs(one[:, :2]).max(axis=0)
    scales = np.array([*[x, xdot, -F] * 2, 1.0, 1.0])
    return float((np.abs(one - other) / scales)[100:].max())


def mixed(seed: int, seconds: float = 4.0) -> History:
    """Draw a history with a kick up or down, outliers and missing samples, each in two of three."""
    rng = np.random.default_rng([5, seed])
    kick = rng.choice([0.0, rng.uniform(3, 100), -rng.uniform(3, 100)])
    outliers, missing = rng.choice([0.0, 1.0], 2, p=[1 / 3, 2 / 3]) * rng.uniform(0, [0.4, 0.8])
    pauses = rng.random() < 0.2
    return drawn(rng, kick=kick, outliers=outliers, missing=missing, pauses=pauses, seconds=seconds)


def wrong_e(seed: int) -> tuple[History, float]:
    """Draw a history, and an e that is wrong by 0.03 to 0.15."""
    rng = np.random.default_rng([4, seed])
    history = drawn(rng)
    believed = history.e + rng.choice([-1, 1]) * rng.uniform(0.03, 0.15)
    return history, float(np.clip(believed, 0.05, 0.99))


def summary(name: str, found: list[Estimates], *more: str) -> None:
    """Print a line: errors, where they are not those of the samples after a kick."""
    lost = sum(it.lost > LONGEST for it in found)
    told = [f"{lost} of {len(found)} lost", *more]
    if not any(it.of.kicked for it in found):
        speed, force = np.median([it.rms for it in found], axis=0)
        worst = max(it.rms[0] for it in found)
        told = [f"x' {speed:.1e} (worst {worst:.1e})", f"d {force:.1e}", *told]
    print(f"{name:42} {', '.join(told)}", flush=True)


def series(kind: int, runs: int, **settings: Any) -> list[History]:
    """Draw so many histories."""
    return [drawn(np.random.default_rng([kind, k]), **settings) for k in range(runs)]


def plain(**settings: Any) -> Line:
    """Give the line of histories without troubles, seen with these settings."""
    return lambda runs: [it.seen(**settings) for it in series(1, runs)]


def believed(**settings: Any) -> Line:
    """Give the line of an e that is wrong."""
    return lambda runs: [it.seen(e=e, se=0.1, **settings) for it, e in map(wrong_e, range(runs))]


def troubled(kind: int, **troubles: Any) -> Line:
    """Give the line of histories with these troubles."""
    return lambda runs: [it.seen() for it in series(kind, runs, **troubles)]


LINES: dict[str, Line] = {
    "`q_d` = 1e-3, the default": plain(q_d=1e-3),
    **{f"`q_d` = {name}": plain(q_d=float(name)) for name in ("1e-4", "1e-5", "1e-6", "1e-7")},
    "velocities with 1e-2 m/s, too": plain(position_only=False),
    "`e` believed wrong by 0.03 to 0.15, learnt": believed(learn_e=True),
    "the same with `se` = 0.1, not learnt": believed(),
    **{f"outliers of up to 1 m, {it:.0%}": troubled(3, outliers=it) for it in OUTLIERS},
    **{f"samples missing, {it:.0%}": troubled(6, missing=it) for it in MISSING},
    "50 of every 200 missing": troubled(6, pauses=True),
}
"""What is drawn and how it is seen, by the name of its row in results/loops.md."""


def main(runs: int = 100) -> None:
    """Print the table."""
    print(f"{runs} runs a line: rms errors of x' (m/s) and d (m/s^2) in the second half")
    for name, line in LINES.items():
        summary(name, line(runs))
    learnt = [abs(it.observer.e_est - it.of.e) for it in believed(learn_e=True)(runs)]
    print(f"e learnt to {np.median(learnt):.1e} (worst {max(learnt):.1e})")
    for kick in KICKS:
        found = [it.seen() for sign in (1, -1) for it in series(2, runs // 2, kick=sign * kick)]
        again = max(it.found_again for it in found)
        summary(f"kick of {kick:g} m/s", found, f"found again after at most {again}")
    found = [mixed(seed).seen() for seed in range(1000)]
    summary("with all of these", found, f"for at most {max(it.lost for it in found)} samples")
    for name, unit in UNITS.items():
        histories = series(7, 10, outliers=0.1, missing=0.2)
        pairs = [(in_units(it, 1.0, 1.0), in_units(it, *unit)) for it in histories]
        print(f"in {name:6} off by {max(farthest(*pair) for pair in pairs):.1e} of x, x', F")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
