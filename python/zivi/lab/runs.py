"""Runs for the settings of the page, and their key figures."""

from __future__ import annotations

import dataclasses
import math
import warnings
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.base.status import ModelWarning
from zivi.control.closed_loop import Controller, simulate_closed_loop
from zivi.control.loop_run import ClosedLoop
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import ExplicitTwisting, TwistingRegulator, TwistingTracker
from zivi.lab.settings import (
    Ball,
    Belt,
    Regulator,
    Settings,
    Tracker,
    check_settings,
    landing_of,
    observer_of,
)
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import ExplicitEuler, SwitchedRK, ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap import DryFriction
from zivi.system.mass import Force, ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem

# The twisting regulator with the signs of the sample: what the implicit one is compared to.


class ExplicitRegulator:
    """u = -mu1 - mu2 sgn(xdot), with the sign of the measured velocity."""

    def __init__(self, mu1: float, mu2: float, h: float) -> None:
        self.mu1, self.mu2, self.h = mu1, mu2, h

    def step(self, x: float, xdot: float, force: float) -> float:
        """Return the control for the next period."""
        sign = math.copysign(1.0, xdot) if xdot else 0.0
        return -self.mu1 - self.mu2 * sign


# A reference drawn by hand, and the explicit law that follows what it is given.


class Drawn:
    """Heights at equal times, joined smoothly: x_r, its velocity and its acceleration.

    From height to height x_r = a + (b - a) (10 z^3 - 15 z^4 + 6 z^5), 0 <= z <= 1.
    """

    def __init__(self, heights: tuple[float, ...], t_end: float) -> None:
        self.heights, self.piece = heights, t_end / (len(heights) - 1)

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Return the reference at time t."""
        k = min(int(t / self.piece), len(self.heights) - 2)
        z = min(t / self.piece - k, 1.0)
        start, rise = self.heights[k], self.heights[k + 1] - self.heights[k]
        x = start + rise * z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
        xdot = rise * 30.0 * z**2 * (1.0 - z) ** 2 / self.piece
        return max(x, 0.0), xdot, rise * 60.0 * z * (1.0 - z) * (1.0 - 2.0 * z) / self.piece**2


class ExplicitFollower:
    """ExplicitTwisting with its reference reset at each sample to the one that is given."""

    x_ref = xdot_ref = float("nan")

    def __init__(self, mu1: float, mu2: float, *, h: float, e: float) -> None:
        self.law, self.h = ExplicitTwisting(mu1, mu2, h=h, e=e), h

    def step(self, x: float, xdot: float, force: float, force_ref: float) -> float:
        """Return the control for the next period; x < 0 is treated as 0."""
        return self.law.step(max(x, 0.0), xdot, force, force_ref)

    def step_to(
        self,
        x: float,
        xdot: float,
        force: float,
        now: tuple[float, float, float],
        after: tuple[float, float, float],
        acceleration: float,
    ) -> float:
        """Return the control for the reference now and after the period."""
        self.law.reset(*now[:2])
        self.x_ref, self.xdot_ref = after[:2]
        return self.step(x, xdot, force, acceleration)


# A mass at a spring on a belt: its runs, their lines, their numbers, their motion.

FAR = 1000.0
"""How far the wall is from the mass with the explicit sign, which never meets it (m)."""


class SignedSlip:
    """Spring, damper and explicit sign of the slip speed, FAR above a wall."""

    def __init__(self, stiffness: float, damping: float, limit: float, speed: float) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.limit, self.speed = limit, speed

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Return the acceleration of the unit mass."""
        smooth = -self.stiffness * (x - FAR) - self.damping * xdot
        return float(smooth + self.friction(xdot))

    def friction(self, xdot: Any) -> Any:
        """Return the force of the belt."""
        return -self.limit * np.sign(xdot - self.speed)


@dataclasses.dataclass(frozen=True)
class BeltRun:
    """One run with its plotted quantities.

    Parameters
    ----------
    run : MechanicalTrajectory or Trajectory
        The run.
    x, xdot : ndarray
        Position (m) and velocity (m/s) at its samples.
    slip : ndarray
        Speed relative to the belt (m/s).
    friction : ndarray
        Force of the belt (N).
    sticks : ndarray of bool
        Where the mass sticks.
    speed : float
        Speed of the belt (m/s).
    """

    run: MechanicalTrajectory | Trajectory
    x: Array
    xdot: Array
    slip: Array
    friction: Array
    sticks: NDArray[np.bool_]
    speed: float

    @property
    def t(self) -> Array:
        """Times of the samples (s)."""
        return self.run.t

    @property
    def success(self) -> bool:
        """Whether the end was reached."""
        return self.run.success

    @property
    def message(self) -> str:
        """Message of the run."""
        return self.run.message

    @property
    def stuck(self) -> float:
        """The part of the time in which the mass sticks."""
        if isinstance(self.run, Trajectory):
            return 0.0
        lengths = self.run.stick["t_end"] - self.run.stick["t_start"]
        return float(lengths.sum() / (self.t[-1] - self.t[0])) if len(self.t) > 1 else 0.0

    @property
    def catches(self) -> int:
        """How often the belt catches the mass."""
        return 0 if isinstance(self.run, Trajectory) else len(self.run.stick)


def belt_runs(given: Belt) -> dict[str, BeltRun]:
    """Simulate a mass on a belt with the implicit sign, the explicit one, and `SwitchedRK`."""
    belt = DryFriction(limit=given.limit, static=given.limit + given.extra, velocity=given.speed)
    system = MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot: -given.stiffness * q - given.damping * qdot,
        friction=[belt],
    )
    span, start = (0.0, given.t_end), ([given.x0], [given.xdot0])
    times = np.linspace(0.0, given.t_end, round(given.t_end / given.h) + 1)
    implicit = simulate(system, span, start, ThetaGamma(given.h), progress=False)
    switched = simulate(system, span, start, SwitchedRK(), t_eval=times, progress=False)
    signed = SignedSlip(given.stiffness, given.damping, given.limit, given.speed)
    explicit = simulate(
        ImpactSystem(signed, e=1.0),
        span,
        (FAR + given.x0, given.xdot0),
        ExplicitEuler(given.h),
        progress=False,
    )
    return {
        "implicit": _stuck(implicit, given.speed),
        "explicit": BeltRun(
            explicit,
            explicit.x - FAR,
            explicit.xdot,
            explicit.xdot - given.speed,
            signed.friction(explicit.xdot),
            np.zeros(len(explicit.t), dtype=bool),
            given.speed,
        ),
        "high_order": _stuck(switched, given.speed),
    }


def _stuck(run: MechanicalTrajectory, speed: float) -> BeltRun:
    forces, modes = run.friction_forces[:, 0], run.modes[:, 0]
    return BeltRun(run, run.q[:, 0], run.qdot[:, 0], run.slips[:, 0], forces, modes == 0, speed)


# From settings to runs, with implicit and with explicit signs.

Runs: TypeAlias = dict[str, Trajectory] | dict[str, ClosedLoop] | dict[str, BeltRun]
"""The run of each method or controller, by the name that the page gives it."""


def simulate_settings(settings: Settings) -> Runs:
    """Simulate the settings.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.

    Returns
    -------
    dict
        ``implicit`` and ``explicit``, of a ball and a belt also ``high_order``.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range, with the library's message.
    """
    check_settings(settings)
    if isinstance(settings, Ball):
        return _run_ball(settings)
    if isinstance(settings, Belt):
        return belt_runs(settings)
    if isinstance(settings, Regulator):
        return {name: _loop(settings, made) for name, made in _regulators(settings).items()}
    reference: dict[str, Any] = {
        "y_ref0": (settings.x_ref0, settings.xdot_ref0),
        "force_ref": settings.force_ref,
    }
    if settings.drawn:
        reference = {"reference": Drawn(settings.heights, settings.t_end)}
    trackers = _trackers(settings).items()
    return {name: _loop(settings, made, **reference) for name, made in trackers}


def _run_ball(ball: Ball) -> dict[str, Trajectory]:
    force = LinearForce(gravity=ball.gravity, amplitude=ball.amplitude, omega=ball.omega)
    system = ImpactSystem(force, e=ball.e)
    methods: dict[str, Method] = {
        "implicit": ThetaGamma(ball.h),
        "explicit": ExplicitEuler(ball.h),
        "high_order": SwitchedRK(),
    }
    span, start = (0.0, ball.t_end), (ball.x0, ball.xdot0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # a ball that flies off is seen to do so
        return {
            name: simulate(system, span, start, method=method, progress=False)
            for name, method in methods.items()
        }


def _regulators(given: Regulator) -> dict[str, Controller]:
    mu1, mu2, h = given.mu1, given.mu2, given.h
    return {
        "implicit": TwistingRegulator(mu1, mu2, h=h, e=given.e, **landing_of(given)),
        "explicit": ExplicitRegulator(mu1, mu2, h=h),
    }


def _trackers(given: Tracker) -> dict[str, Controller]:
    mu1, mu2, h, e = given.mu1, given.mu2, given.h, given.e
    lands = landing_of(given)
    baseline: Any = ExplicitFollower if given.drawn else ExplicitTwisting
    return {
        "implicit": TwistingTracker(mu1, mu2, h=h, e=e, branch=given.branch, **lands),
        "explicit": baseline(mu1, mu2, h=h, e=e),
    }


def _loop(given: Regulator | Tracker, controller: Controller, **reference: Any) -> ClosedLoop:
    constant = given.force + given.disturbance
    force: Force = constant
    if given.amplitude:
        force = LinearForce(gravity=-constant, amplitude=given.amplitude, omega=given.omega)
    observer = ImpactObserver(given.e, given.h, **observer_of(given)) if given.observer else None
    return simulate_closed_loop(
        ImpactSystem(force, e=given.e),
        controller,
        (0.0, given.t_end),
        (given.x0, given.xdot0),
        force_model=given.force,
        noise=(given.noise_x, given.noise_xdot),
        seed=given.seed,
        delay=given.delay,
        observer=observer,
        progress=False,
        **reference,
    )


# Results of the runs in numbers.

NAMES = {
    "implicit": "implicit signs",
    "explicit": "explicit signs",
    "high_order": "SwitchedRK",
}
"""How the page calls the runs."""


def facts(runs: Runs, window: tuple[float, float] | None = None) -> list[dict[str, str]]:
    """Return a row per run: rest, impacts, and the control in the shown interval.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.compute` gave.
    window : (float, float), optional
        Times that are shown (s); all by default.

    Returns
    -------
    list of dict
        From a column's title to its text.
    """
    if any(isinstance(run, BeltRun) for run in runs.values()):
        return [{"": NAMES[name]} | _belt_facts(run, window) for name, run in runs.items()]
    others: dict[str, Any] = {**runs}
    return [
        {"": NAMES[name]} | _wall_facts(name, run) | _control_facts(run, window)
        for name, run in others.items()
    ]


def _belt_facts(run: Any, window: tuple[float, float] | None) -> dict[str, str]:
    start, end = window or (run.t[0], run.t[-1])
    part = (run.t >= start) & (run.t <= end)
    jumps = np.abs(np.diff(run.friction[part])).sum()
    return {
        "sticks": f"{run.stuck:.1%} of the time",
        "caught": f"{run.catches} times",
        "largest |x| (m)": f"{np.abs(run.x[part]).max(initial=0.0):.4g}",
        "Σ|Δ friction| (N)": f"{jumps:.4g}",
    }


def _wall_facts(name: str, run: Trajectory | ClosedLoop) -> dict[str, str]:
    rest = "no" if run.rest_time is None else f"from {run.rest_time:.6g} s"
    infinite = name == "high_order" and len(run.zeno_times) > 0
    impacts = "infinitely many" if infinite else str(len(run.impacts))
    return {"at rest at the end": rest, "impacts": impacts}


def _control_facts(
    run: Trajectory | ClosedLoop, window: tuple[float, float] | None
) -> dict[str, str]:
    if not isinstance(run, ClosedLoop):
        return {}
    start, end = window or (run.t[0], run.t[-1])
    part = (run.t >= start) & (run.t <= end)
    u = run.u[part]
    if len(u) < 2:
        return {}
    variation = float(np.abs(np.diff(u)).sum())
    row = {
        "u (m/s²)": f"{u.min():.4g} .. {u.max():.4g}",
        "Σ|Δu| (m/s²)": f"{variation:.4g}",
        "Σ|Δu| a second (m/s² per s)": f"{variation / (end - start):.3g}",
    }
    if not np.all(np.isnan(run.x_ref)):
        row["largest |x - x_r| (m)"] = f"{float(np.abs(run.error[part]).max()):.2g}"
    if run.xdot_est is not None:
        off = float(np.sqrt(np.mean((run.xdot_est[part] - run.xdot[part]) ** 2)))
        row["observed velocity off by, rms (m/s)"] = f"{off:.2g}"
    return row


def warning_texts(runs: Runs) -> list[str]:
    """Describe the failures: runs that ended early, rejected control updates."""
    said = [f"{NAMES[name]}: {run.message}" for name, run in runs.items() if not run.success]
    counts = {name: str(getattr(run, "updates", "")) for name, run in runs.items()}
    said += [f"{NAMES[name]}: {count}" for name, count in counts.items() if count]
    return said
