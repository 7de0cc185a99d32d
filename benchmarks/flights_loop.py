"""The impact oscillator by hand: `flights_loop.c`, and the same in Python for numba."""

from __future__ import annotations

import ctypes
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cball
import zivi

SOURCE = Path(__file__).with_name("flights_loop.c")

Loop = Callable[[float], tuple[int, float]]
"""From x = 1 m at rest to a time: the number of impacts, and the speed after the last (m/s)."""


def in_c(force: zivi.LinearForce, e: float, directory: Path, flags: tuple[str, ...]) -> Loop | None:
    """Compile the loop in C, where there is a compiler."""
    compiler = cball.compiler()
    if compiler is None:
        return None
    path = directory / f"flights{len(flags)}.so"
    build = [compiler, "-std=c99", *flags, "-shared", "-fPIC", str(SOURCE), "-o", str(path), "-lm"]
    subprocess.run(build, check=True)
    run = ctypes.CDLL(str(path)).oscillator_run
    run.restype = ctypes.c_size_t
    numbers = (force.stiffness, force.damping, force.gravity, force.amplitude, force.omega, e)
    oscillator, end = (ctypes.c_double * 6)(*numbers), (ctypes.c_double * 2)()
    real = ctypes.c_double

    def loop(t1: float) -> tuple[int, float]:
        return run(oscillator, real(1.0), real(0.0), real(t1), end), end[1]

    return loop


def in_numba(force: zivi.LinearForce, e: float) -> Loop | None:
    """Write the loop in Python and compile it, where numba is installed."""
    try:
        import numba
    except ImportError:
        return None
    k, c, g, amplitude, w = (
        force.stiffness,
        force.damping,
        force.gravity,
        force.amplitude,
        force.omega,
    )
    size = (k - w * w) ** 2 + (c * w) ** 2
    rate, wd = c / 2, math.sqrt(k - c * c / 4)
    P, Q, lift = amplitude * (k - w * w) / size, amplitude * c * w / size, -g / k
    step = 0.05 * math.tau / max(w, wd)
    cos, sin, exp = math.cos, math.sin, math.exp

    @numba.njit
    def forced(t: float) -> tuple[float, float]:
        C, S = cos(w * t), sin(w * t)
        return P * C + Q * S + lift, w * (Q * C - P * S)

    @numba.njit
    def at(t0: float, a: float, b: float, tau: float) -> tuple[float, float]:
        C, S, fade = cos(wd * tau), sin(wd * tau), exp(-rate * tau)
        x, v = forced(t0 + tau)
        x += fade * (a * C + b * S)
        return x, v + fade * ((wd * b - rate * a) * C - (wd * a + rate * b) * S)

    @numba.njit
    def loop(t1: float) -> tuple[int, float]:
        t0, x, v, impacts = 0.0, 1.0, 0.0, 0
        while True:
            px, pv = forced(t0)
            a = x - px
            b = (v - pv + rate * a) / wd
            low, high, away = 0.0, step, at(t0, a, b, step)[0]
            while away > 0.0 and t0 + high < t1:
                low, high = high, high + step
                away = at(t0, a, b, high)[0]
            tau = 0.5 * (low + high)
            speed = 0.0
            for _ in range(60):
                away_now, speed = at(t0, a, b, tau)
                if away_now > 0.0:
                    low = tau
                else:
                    high = tau
                following = tau - away_now / speed
                if not low < following < high:
                    following = 0.5 * (low + high)
                if abs(following - tau) <= 1e-15 * (t0 + tau):
                    break
                tau = following
            if away > 0.0 or t0 + tau > t1:
                return impacts, v
            t0, x, v, impacts = t0 + tau, 0.0, -e * speed, impacts + 1

    compiled: Any = loop
    compiled(10.0)
    return compiled
