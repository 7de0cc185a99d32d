"""The problems of the work-precision benchmark, each with the state that it truly ends in."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zivi

DATA = Path(__file__).resolve().parent.parent / "tests" / "data" / "reference_trajectories.json"

TITLES = {
    "B1_ball": "the paper's ball",
    "T1_tab_G1.5": "table, 1.5 g",
    "T3_tab_G3": "table, 3 g",
    "O2_osc_stick": "oscillator that sticks",
    "O4_p1_w2.2": "oscillator, period 1",
}
"""The references that are taken and what they are called."""

UNTIL = {"T1_tab_G1.5": "3.7"}
"""Where a run ends in flight instead of at rest: a key of the reference's samples."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """One motion above a wall."""

    key: str
    title: str
    zeno: bool
    """Whether impacts accumulate."""
    force: zivi.LinearForce
    e: float
    span: tuple[float, float]
    state: tuple[float, float]
    end: tuple[float, float]
    rest: float | None
    """Time from which the mass rests until the end, the error's measure where it does."""

    def system(self, force: Any = None) -> zivi.ImpactSystem:
        """Put the mass above its wall, under another program for the same force if given."""
        return zivi.ImpactSystem(self.force if force is None else force, e=self.e)

    def error(self, x: float, xdot: float, rest: float | None) -> float:
        """Larger error of the final position (m) and velocity (m/s), and of the time of rest."""
        errors = [abs(x - self.end[0]), abs(xdot - self.end[1])]
        if self.rest is not None:
            errors.append(math.inf if rest is None else abs(rest - self.rest))
        return max(errors)

    def python_force(self) -> Callable[[float, float, float], float]:
        """Write the force as a user's function ``f(t, x, xdot)``."""
        k, c, g, a, omega, phase = dataclasses.astuple(self.force)[:6]
        cos = math.cos

        def force(t: float, x: float, xdot: float) -> float:
            return float(-k * x - c * xdot - g + a * cos(omega * t + phase))

        return force

    @property
    def length(self) -> float:
        """Length of the span (s)."""
        return self.span[1] - self.span[0]

    @property
    def pace(self) -> float:
        """Time between two looks at the force at rest, twenty in a period of it (s)."""
        if self.force.amplitude == 0.0:
            return self.length
        return 2.0 * math.pi / self.force.omega / 20.0


def _referenced(key: str, case: dict[str, Any]) -> Problem:
    end, at = case["t_end"], (case["x_end"], case["xdot_end"])
    rests = case["at_rest_at_end"]
    if key in UNTIL:
        end, at, rests = float(UNTIL[key]), tuple(case["samples"][UNTIL[key]]), False
    return Problem(
        key=key.partition("_")[0],
        title=TITLES[key],
        zeno=bool(case["zeno"]),
        force=zivi.LinearForce(**case["force"]),
        e=case["e"],
        span=(case["t0"], end),
        state=(case["x0"], case["xdot0"]),
        end=at,
        rest=case["zeno"][-1] if rests else None,
    )


def period_one(periods: float = 8.7) -> Problem:
    r"""Put a damped mass on a vibrating table that it hits once in every period.

    With :math:`\ddot x = -c \dot x - g + A \cos(\omega t)` the motion between two impacts is

    .. math:: x = X(t) + C (e^{-c \tau} - 1) - g \tau / c + D, \qquad
              X = \mathrm{Re}\, Z e^{i \omega t}, \quad Z = A / (-\omega^2 + i c \omega)

    It repeats after a period :math:`T` if :math:`C = g T / (c (e^{-c T} - 1))`, and its impacts
    give back what they should, :math:`\dot x(0) = -e\,\dot x(T)`, if the table's part of the
    velocity at an impact is :math:`\dot X = c C (1 + e\,e^{-c T}) / (1 + e) + g / c`. Of the two
    phases with that velocity the one that attracts is taken.
    """
    c, g, e, omega, amplitude = 0.3, 9.81, 0.7, 2.0 * math.pi, 1.2 * 9.81
    period = 1.0
    decay = math.expm1(-c * period)
    shift = g * period / (c * decay)
    wanted = c * shift * (1.0 + e * (1.0 + decay)) / (1.0 + e) + g / c
    z = amplitude / complex(-(omega**2), c * omega)
    size, angle = abs(z), math.atan2(z.imag, z.real)
    # X' = -omega |Z| sin(omega t + angle)
    theta = math.pi - math.asin(-wanted / (omega * size))
    start = (theta - angle) / omega
    away = periods % 1.0 * period

    def table(t: float) -> tuple[float, float]:
        phase = omega * t + angle
        return size * math.cos(phase), -omega * size * math.sin(phase)

    def orbit(tau: float) -> tuple[float, float]:
        x = table(start + tau)[0] - table(start)[0] + shift * math.expm1(-c * tau) - g * tau / c
        xdot = table(start + tau)[1] - c * shift * math.exp(-c * tau) - g / c
        return x, xdot

    return Problem(
        key="T4",
        title="table with drag, period 1",
        zeno=False,
        force=zivi.LinearForce(damping=c, gravity=g, amplitude=amplitude, omega=omega),
        e=e,
        span=(start, start + periods * period),
        state=(0.0, orbit(0.0)[1]),
        end=orbit(away),
        rest=None,
    )


def problems() -> dict[str, Problem]:
    """Give all problems by their keys, those with a Zeno point first."""
    with DATA.open() as file:
        cases = json.load(file)
    found = [_referenced(key, cases[key]) for key in TITLES]
    return {it.key: it for it in [*found, period_one()]}
