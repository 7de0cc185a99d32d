"""Methods: frozen, validated settings, each with the call that runs it."""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Callable
from typing import Any, ClassVar, Protocol, TypeAlias

from zivi import _zivi
from zivi._check import Array, real, whole
from zivi.dense import LinearPath, Path, PenetratingPath
from zivi.events import Event
from zivi.system import ImpactSystem

__all__ = ["ExplicitEuler", "Method", "MoreauJean", "SwitchedRK", "ThetaGamma"]

Report = Callable[[int, int], None]
"""Called with the number of steps done and their total."""

FLIGHTS = ("auto", "rk", "series")
"""How free flight can be computed."""
SOLVERS = ("exact", "newton", "outer")
"""How a step can find its signs."""
MAX_LINEARISATIONS = 1000

Settings: TypeAlias = tuple[float, tuple[float, float], int, float, float | None, int, int, str]
"""The settings of `SwitchedRK` in their order."""


@dataclasses.dataclass(frozen=True)
class Course:
    """What a run is asked for, beside its system and its method.

    Parameters
    ----------
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float)
        Initial state.
    t_eval : ndarray or None
        Times of the samples; a method of fixed steps samples its steps whatever is asked for.
    tstops : ndarray
        Times where the force is not smooth, ascending; none for a method of fixed steps.
    events : tuple of Event
        Events of the user.
    dense : bool
        Whether the motion between the samples is wanted.
    drawn : bool
        Whether samples between the steps are wanted, so that lines draw the motion.
    report : callable or None
        Told the progress.
    """

    t_span: tuple[float, float]
    y0: tuple[float, float]
    t_eval: Array | None
    tstops: Array
    events: tuple[Event, ...]
    dense: bool
    drawn: bool
    report: Report | None

    @property
    def event_specs(self) -> list[tuple[Any, int, int | None, tuple[bool, float] | None]]:
        """The events as the core takes them."""
        return [(e.function, e.direction, e.terminal, e.level) for e in self.events]


class Method(Protocol):
    """Anything that `simulate` can run."""

    def _integrate(self, system: ImpactSystem, course: Course) -> _zivi.RunRecord: ...


class _FixedSteps:
    """A method that knows the motion at its steps only."""

    def _path(self, kappa: float, t: Array, samples: dict[str, Array]) -> Path:
        return LinearPath(t, samples["s"], samples["v"], kappa)


@dataclasses.dataclass(frozen=True)
class ThetaGamma(_FixedSteps):
    r"""The theta-gamma scheme with implicit set-valued signs.

    .. math::

        v^+ &= v + h\,\lambda_s f / R, \qquad R = 1 - \kappa \lambda_s \lambda_v \\
        s^+ &= s + h R\,(\theta v^+ + (1-\theta) v) \\
        \lambda_s &\in \mathrm{sgn}\,s_\gamma, \quad \lambda_v \in \mathrm{sgn}\,v_\gamma, \quad
        z_\gamma = \gamma z^+ + (1-\gamma) z

    The default :math:`\theta = \gamma = 1` is implicit Euler, the only member that reaches rest
    exactly. First order away from the accumulation; the time of the Zeno point is approached
    like :math:`h \log(1/h)`. The force is taken at :math:`t + \theta h` and, if it depends on the
    state, found together with the end of the step: to 1e-12 of its size, in at
    most 20 trials along the selected solution and 60 on each sign pattern.

    Parameters
    ----------
    h : float
        Step size, > 0 (s). The last step is shortened to end at the end of the span.
    theta, gamma : float
        In (0, 1].
    solver : {"exact", "newton", "outer"}
        How the signs are found: by the exact case analysis; by the general VI solver on the
        nonlinear inclusion ("inner linearisation"); or by affine VIs one after another, each
        linearised at the solution of the last, without a merit function ("outer linearisation").
        A step in which the solver fails is taken by the exact one and counted in
        ``failed_steps``. Where a step has one solution, always when the force pulls towards the
        wall, all give the same. Under an outward force a step may have several: the exact
        analysis selects by a rule, the solvers take the one they come to from the present signs,
        and the trajectories may part there.
    linearisations : int
        For ``solver="outer"``: at most so many affine VIs in a step, >= 1.

    Raises
    ------
    ValueError
        If a setting is out of range. `simulate` also raises it for a system with ``e = 0``,
        where :math:`R` may vanish.

    Examples
    --------
    >>> zivi.ThetaGamma(h=1e-3)
    ThetaGamma(h=0.001, theta=1.0, gamma=1.0, solver='exact', linearisations=20)
    """

    h: float
    theta: float = 1.0
    gamma: float = 1.0
    solver: str = "exact"
    linearisations: int = 20

    def __post_init__(self) -> None:
        for name in ("h", "theta", "gamma"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        if self.solver not in SOLVERS:
            raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {self.solver!r}")
        if isinstance(self.linearisations, bool) or not isinstance(self.linearisations, int):
            raise TypeError(f"linearisations must be an integer, got {self.linearisations!r}")
        if not 1 <= self.linearisations <= MAX_LINEARISATIONS:
            raise ValueError(
                f"linearisations must be from 1 to {MAX_LINEARISATIONS}, got {self.linearisations}"
            )
        _zivi.check_theta_gamma(self.h, self.theta, self.gamma, 0.0)

    def _integrate(self, system: ImpactSystem, course: Course) -> _zivi.RunRecord:
        return _zivi.simulate_theta_gamma(
            system._spec,
            wall=(system.e, system.kappa),
            h=self.h,
            theta=self.theta,
            gamma=self.gamma,
            solver=self.solver,
            linearisations=self.linearisations,
            span=course.t_span,
            state=course.y0,
            events=course.event_specs,
            progress=course.report,
        )


@dataclasses.dataclass(frozen=True)
class ExplicitEuler(_FixedSteps):
    r"""Baseline: explicit Euler on the transformed field with explicit signs.

    .. math:: v^+ = v + h\,\mathrm{sgn}(s) f / R, \qquad s^+ = s + h R v, \qquad
              \mathrm{sgn}\,0 = +1

    It passes the accumulation of impacts but never rests: it chatters.

    Parameters
    ----------
    h : float
        Step size, > 0 (s).

    Raises
    ------
    ValueError
        If `h` is out of range. `simulate` also raises it for a system with ``e = 0``.

    Examples
    --------
    >>> zivi.ExplicitEuler(h=1e-3)
    ExplicitEuler(h=0.001)
    """

    h: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "h", real("h", self.h))
        _zivi.check_theta_gamma(self.h, 1.0, 1.0, 0.0)

    def _integrate(self, system: ImpactSystem, course: Course) -> _zivi.RunRecord:
        return _zivi.simulate_explicit_euler(
            system._spec,
            wall=(system.e, system.kappa),
            h=self.h,
            span=course.t_span,
            state=course.y0,
            events=course.event_specs,
            progress=course.report,
        )


@dataclasses.dataclass(frozen=True)
class SwitchedRK:
    r"""High order through impacts, Zeno points, rest and lift-off, with error control.

    Free flight is integrated in :math:`(x, \dot x)` by DOP853 or Dormand-Prince 5(4); a step that
    contains an impact is repeated onto it. The accumulation of impacts is extrapolated with its
    known ratios, :math:`t_n = t_\infty - C_1 e^n - C_2 e^{2n} - \dots`, until the Zeno time is
    within the tolerance. At rest the first time is sought at which the force pulls outward.
    ``e`` may be anything in [0, 1].

    Parameters
    ----------
    rtol : float
        Relative tolerance of the local error, from 1e-14 to below 1.
    atol : float or (float, float)
        Absolute tolerances, > 0, of `x` (m) and `xdot` (m/s), or one number for both. In the time
        of an accumulation they allow ``min(atol_x / U, atol_xdot / g)``, with the speed `U` of
        its first impact and the pull `g` at the wall: no result depends on the units.
    order : {8, 5}
        Order of the Runge-Kutta pair.
    max_step : float
        Longest step, > 0 (s). Events shorter than a step, such as a pulse of the force at rest or
        within an accumulation, can be overlooked.
    first_step : float, optional
        The first step, > 0 (s). By default from the force at the start.
    max_steps : int
        Steps, taken and rejected, after which the run ends with `Status.STEP_BUDGET`.
    max_impacts : int
        Impacts of one accumulation, >= 3, after which the run ends with `Status.ZENO_BUDGET`.
    flights : {"auto", "rk", "series"}
        How free flight is computed. ``"rk"``: by the Runge-Kutta pair, within the tolerances.
        ``"series"``: by power series, to rounding, for a force that is a number or a `LinearForce`,
        above a wall at rest or a `HarmonicWall`; the tolerances then apply to the end of an
        accumulation only, `max_step` to the looks of events, and no force is evaluated (`nfev` is
        0). ``"auto"``, the default: by power series where that is possible, else by the pair.

    Raises
    ------
    ValueError
        If a setting is out of range.

    Notes
    -----
    The force is evaluated at ``x`` slightly below 0 in the step that contains an impact, and should
    continue smoothly there; where it raises or is not finite, it is asked at ``x = 0`` instead.
    For `e` close to 1 an accumulation is long: hundreds of impacts at ``e = 0.99``.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, kappa=0.41)
    >>> sol = zivi.simulate(ball, (0, 4), (1, 6), method=zivi.SwitchedRK(rtol=1e-10))
    >>> round(sol.rest_time, 15)
    2.465846631559044
    """

    _takes_tstops: ClassVar[bool] = True

    rtol: float = 1e-6
    atol: float | tuple[float, float] = 1e-9
    order: int = 8
    max_step: float = math.inf
    first_step: float | None = None
    max_steps: int = 1_000_000
    max_impacts: int = 1_000_000
    flights: str = "auto"

    def __post_init__(self) -> None:
        for name in ("rtol", "max_step"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        object.__setattr__(self, "atol", _one_or_two("atol", self.atol))
        if self.first_step is not None:
            object.__setattr__(self, "first_step", real("first_step", self.first_step))
        for name in ("order", "max_steps", "max_impacts"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        if self.flights not in FLIGHTS:
            raise ValueError(f"flights must be 'auto', 'rk' or 'series', got {self.flights!r}")
        _zivi.check_switched_rk(self._settings())

    def _settings(self) -> Settings:
        """Give the settings as the extension takes them."""
        atol = self.atol if isinstance(self.atol, tuple) else (self.atol, self.atol)
        return (
            *(self.rtol, atol, self.order, self.max_step, self.first_step),
            *(self.max_steps, self.max_impacts, self.flights),
        )

    def _integrate(self, system: ImpactSystem, course: Course) -> _zivi.RunRecord:
        return _zivi.simulate_switched_rk(
            system._spec,
            self._settings(),
            wall=(system.e, system.kappa),
            span=course.t_span,
            state=course.y0,
            t_eval=course.t_eval,
            tstops=course.tstops,
            events=course.event_specs,
            dense=course.dense,
            drawn=course.drawn,
            progress=course.report,
        )


def _one_or_two(name: str, value: Any) -> float | tuple[float, float]:
    """Return a number for both components of the state, or one for each."""
    if isinstance(value, numbers.Real):
        return real(name, value)
    try:
        of_x, of_xdot = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number or two, (x, xdot), got {value!r}") from None
    return real(name, of_x), real(name, of_xdot)


@dataclasses.dataclass(frozen=True)
class MoreauJean(_FixedSteps):
    r"""Baseline: Moreau-Jean time stepping with Newton's impact law on velocities.

    .. math::

        \dot x^+ &= \dot x + h f_\theta + P, \qquad
        x^+ = x + h\,(\theta \dot x^+ + (1-\theta)\,\dot x) \\
        0 &\le P \perp \dot x^+ + e\,\dot x \ge 0 \quad
        \text{where } x + h \dot x / 2 \le 0, \text{ else } P = 0

    It passes the accumulation at first order and may penetrate the wall by :math:`O(h)`: `x` is
    reported as it is, also negative. ``e`` may be anything in [0, 1].

    Parameters
    ----------
    h : float
        Step size, > 0 (s).
    theta : float
        In [0, 1].

    Raises
    ------
    ValueError
        If a setting is out of range.

    Examples
    --------
    >>> zivi.MoreauJean(h=1e-3)
    MoreauJean(h=0.001, theta=0.5)
    """

    h: float
    theta: float = 0.5

    def __post_init__(self) -> None:
        for name in ("h", "theta"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        _zivi.check_theta_gamma(self.h, 1.0, 1.0, 0.0)  # the same range of h
        _zivi.check_moreau_jean(self.theta)

    def _integrate(self, system: ImpactSystem, course: Course) -> _zivi.RunRecord:
        return _zivi.simulate_moreau_jean(
            system._spec,
            wall=(system.e, system.kappa),
            h=self.h,
            theta=self.theta,
            span=course.t_span,
            state=course.y0,
            events=course.event_specs,
            progress=course.report,
        )

    def _path(self, kappa: float, t: Array, samples: dict[str, Array]) -> Path:
        x, xdot = samples["x"], samples["xdot"]
        return PenetratingPath(t, samples["s"], samples["v"], kappa, x=x, xdot=xdot)
