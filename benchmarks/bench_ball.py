"""Time per step through `zivi.simulate`, everything recorded, beside the C loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

import cball
import timing
import zivi

STEPS = 400_000
REPETITIONS = 15

SCENES = {"moving": 2.4, "to rest": 4.0}
"""End times (s): the ball moves all the time; the issue's ball, at rest from 2.465 s."""


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How far zivi and the C loop are apart (largest difference over the run)."""

    h: float
    rest_zivi: float | None
    rest_c: float | None
    position: float
    velocity: float
    before_the_end: float
    """Largest difference in x, s, x' and v before the last 1e-4 of the way to rest."""

    def check(self) -> None:
        """Refuse to time two programs that do not compute the same."""
        assert self.rest_zivi == self.rest_c, self
        assert self.position < 1e-9, self
        assert self.before_the_end < 1e-9, self
        # in the last few steps before rest a velocity is a quotient of two vanishing numbers
        assert self.velocity < 1e-6, self


@dataclasses.dataclass(frozen=True)
class Scene:
    """Figures of one scene, ns per step."""

    t1: float
    zivi: float
    recording: dict[str, float]
    large: dict[str, float]
    warm: dict[str, float]
    bare: dict[str, float]
    fastest: str
    """Flags of the fastest C loop that records: the one that ratios are to."""
    ratio: float
    ratio_large: float
    """The same to the C loop that asks for large pages, as zivi does."""


def ball(force: Any = cball.FORCE) -> zivi.ImpactSystem:
    """Put the mass of the paper's ball above its wall."""
    return zivi.ImpactSystem(force, kappa=cball.KAPPA)


def simulate(system: zivi.ImpactSystem, t1: float, steps: int) -> zivi.Trajectory:
    """Run `steps` steps of implicit Euler to `t1` (s)."""
    return zivi.simulate(system, (0.0, t1), cball.START, method=zivi.ThetaGamma(h=t1 / steps))


def agreement(build: cball.CBall, t1: float, steps: int) -> Agreement:
    """Run both sides once and compare."""
    sol = simulate(ball(), t1, steps)
    ours = {name: getattr(sol, name) for name in cball.QUANTITIES}
    theirs = build.arrays(cball.problem(t1, t1 / steps))
    assert np.array_equal(ours["t"], theirs["t"])
    assert np.max(theirs["residual"]) < 1e-12
    resting = np.flatnonzero((theirs["s"] == 0.0) & (theirs["v"] == 0.0))
    rest = None if len(resting) == 0 else float(theirs["t"][resting[0]])
    apart = {name: np.abs(ours[name] - theirs[name]) for name in ("x", "xdot", "s", "v")}
    early = ours["t"] < (1.0 - 1e-4) * (t1 if rest is None else rest)
    return Agreement(
        h=t1 / steps,
        rest_zivi=sol.rest_time,
        rest_c=rest,
        position=float(max(apart["x"].max(), apart["s"].max())),
        velocity=float(max(apart["xdot"].max(), apart["v"].max())),
        before_the_end=float(max(values[early].max() for values in apart.values())),
    )


def scene(builds: list[cball.CBall], t1: float, repetitions: int = REPETITIONS) -> Scene:
    """Time zivi and every build of the C loop, in turn."""
    posed = cball.problem(t1, t1 / STEPS)
    system = ball()
    contenders: dict[str, timing.Contender] = {}
    # zivi stands next to each build of the C loop, so that each ratio is of neighbours
    for build in builds:
        contenders[f"zivi|{build.flags}"] = (
            lambda: simulate(system, t1, STEPS),
            timing.nothing,
        )
        contenders[f"recording|{build.flags}"] = (partial(build.run, posed), build.free)
        contenders[f"large|{build.flags}"] = (partial(build.run_large, posed), build.free_large)
    for build in builds:
        used = build.run(posed)
        contenders[f"warm|{build.flags}"] = (partial(build.fill, posed, used), timing.nothing)
        contenders[f"bare|{build.flags}"] = (partial(build.loop, posed), timing.nothing)
    times = timing.interleaved(contenders, repetitions)
    found = timing.medians(times, STEPS)

    def of(kind: str) -> dict[str, float]:
        return {build.flags: found[f"{kind}|{build.flags}"] for build in builds}

    recording = of("recording")
    fastest = min(recording, key=recording.__getitem__)
    return Scene(
        t1=t1,
        zivi=float(np.median(list(of("zivi").values()))),
        recording=recording,
        large=of("large"),
        warm=of("warm"),
        bare=of("bare"),
        fastest=fastest,
        ratio=timing.ratio(times, f"zivi|{fastest}", f"recording|{fastest}"),
        ratio_large=timing.ratio(times, f"zivi|{fastest}", f"large|{fastest}"),
    )


def _forces() -> Iterator[tuple[str, Any]]:
    """Yield the same ball under every kind of force, and one spring-damper-gravity force."""
    spring = zivi.LinearForce(stiffness=2.0, damping=0.1, gravity=9.81)
    yield "number", cball.FORCE
    yield "LinearForce, gravity only", zivi.LinearForce(gravity=9.81)
    yield (
        "LinearForce, gravity and excitation",
        zivi.LinearForce(gravity=9.81, amplitude=1.0, omega=10.0),
    )
    yield "LinearForce, gravity, spring and damper", spring
    yield "Python callable, the same", lambda t, x, xdot: -2.0 * x - 0.1 * xdot - 9.81
    try:
        import numba
    except ImportError:
        return
    signature = numba.float64(numba.float64, numba.float64, numba.float64)
    compiled = numba.cfunc(signature)(lambda t, x, xdot: -2.0 * x - 0.1 * xdot - 9.81)
    yield "numba cfunc, the same", compiled
    try:
        import scipy
    except ImportError:
        return
    # the address with its signature in a capsule is what SciPy calls a low-level callable
    import ctypes

    make = ctypes.pythonapi.PyCapsule_New
    make.restype = ctypes.py_object
    make.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    written = b"double (double, double, double)"
    capsule = make(compiled.address, written, None)
    yield "scipy.LowLevelCallable, the same", scipy.LowLevelCallable(capsule)


def forces() -> dict[str, tuple[float, float]]:
    """Time every kind of force: ns per step and evaluations per step."""
    kinds = {}
    for name, force in _forces():
        kinds[name] = ball(force)
    slow = {name for name in kinds if name.startswith("Python")}
    evaluations = {
        name: simulate(system, 2.4, STEPS).nfev / STEPS for name, system in kinds.items()
    }

    def contender(system: zivi.ImpactSystem) -> timing.Contender:
        return (lambda: simulate(system, 2.4, STEPS)), timing.nothing

    quick = {name: contender(system) for name, system in kinds.items() if name not in slow}
    times = timing.interleaved(quick, 9)
    times |= timing.interleaved({name: contender(kinds[name]) for name in slow}, 3)
    found = timing.medians(times, STEPS)
    return {name: (found[name], evaluations[name]) for name in kinds}
