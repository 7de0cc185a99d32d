"""Methods: frozen, validated settings, each with the call that runs it."""

from __future__ import annotations

import dataclasses
import numbers
from typing import Any, ClassVar, Protocol

from zivi import _zivi
from zivi.base.check import Array, real, whole
from zivi.simulation.dense import LinearPath, Path, PenetratingPath

__all__ = ["ExplicitEuler", "Method", "MoreauJean", "SwitchedRK", "ThetaGamma"]


def _defaults(name: str) -> dict[str, Any]:
    """Give the defaults of a method, which the core knows, as it does the ranges."""
    return {it.name: it.default for it in _zivi.SETTINGS[name]}


class Method(Protocol):
    """Anything that `simulate` can run."""

    @property
    def _core(self) -> _zivi.Method: ...


class _Settings:
    """Settings that the core keeps, and checks, as well."""

    def _checked(self) -> _zivi.Method:
        raise NotImplementedError

    @property
    def _core(self) -> _zivi.Method:
        """The method as the core takes it, made once."""
        if "_made" not in self.__dict__:
            self.__dict__["_made"] = self._checked()
        made: _zivi.Method = self.__dict__["_made"]
        return made

    def __getstate__(self) -> dict[str, Any]:
        # what the core keeps is made anew
        return {name: value for name, value in self.__dict__.items() if name != "_made"}


class _FixedSteps(_Settings):
    """A method that knows the motion at its steps only."""

    def _path(self, kappa: float, t: Array, samples: dict[str, Array]) -> Path:
        return LinearPath(t, samples["s"], samples["v"], kappa)


_THETA_GAMMA = _defaults("ThetaGamma")


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
    theta: float = _THETA_GAMMA["theta"]
    gamma: float = _THETA_GAMMA["gamma"]
    solver: str = _THETA_GAMMA["solver"]
    linearisations: int = _THETA_GAMMA["linearisations"]

    def __post_init__(self) -> None:
        for name in ("h", "theta", "gamma"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        if isinstance(self.linearisations, bool) or not isinstance(self.linearisations, int):
            raise TypeError(f"linearisations must be an integer, got {self.linearisations!r}")
        whole("linearisations", self.linearisations)  # which the extension takes
        _ = self._core

    def _checked(self) -> _zivi.Method:
        return _zivi.ThetaGamma(
            h=self.h,
            theta=self.theta,
            gamma=self.gamma,
            solver=self.solver,
            linearisations=self.linearisations,
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
        _ = self._core

    def _checked(self) -> _zivi.Method:
        return _zivi.ExplicitEuler(h=self.h)


_SWITCHED_RK = _defaults("SwitchedRK")


@dataclasses.dataclass(frozen=True)
class SwitchedRK(_Settings):
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

    rtol: float = _SWITCHED_RK["rtol"]
    atol: float | tuple[float, float] = _SWITCHED_RK["atol"]
    order: int = _SWITCHED_RK["order"]
    max_step: float = _SWITCHED_RK["max_step"]
    first_step: float | None = _SWITCHED_RK["first_step"]
    max_steps: int = _SWITCHED_RK["max_steps"]
    max_impacts: int = _SWITCHED_RK["max_impacts"]
    flights: str = _SWITCHED_RK["flights"]

    def __post_init__(self) -> None:
        for name in ("rtol", "max_step"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        object.__setattr__(self, "atol", _one_or_two("atol", self.atol))
        if self.first_step is not None:
            object.__setattr__(self, "first_step", real("first_step", self.first_step))
        for name in ("order", "max_steps", "max_impacts"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        _ = self._core

    def _checked(self) -> _zivi.Method:
        return _zivi.SwitchedRK(
            rtol=self.rtol,
            atol=self.atol if isinstance(self.atol, tuple) else (self.atol, self.atol),
            order=self.order,
            max_step=self.max_step,
            first_step=self.first_step,
            max_steps=self.max_steps,
            max_impacts=self.max_impacts,
            flights=self.flights,
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


_MOREAU_JEAN = _defaults("MoreauJean")


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
    theta: float = _MOREAU_JEAN["theta"]

    def __post_init__(self) -> None:
        for name in ("h", "theta"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        _ = self._core

    def _checked(self) -> _zivi.Method:
        return _zivi.MoreauJean(h=self.h, theta=self.theta)

    def _path(self, kappa: float, t: Array, samples: dict[str, Array]) -> Path:
        x, xdot = samples["x"], samples["xdot"]
        return PenetratingPath(t, samples["s"], samples["v"], kappa, x=x, xdot=xdot)
