"""Methods: frozen, validated settings, each with the call that runs it."""

import dataclasses
from collections.abc import Callable
from typing import Protocol

from zivi import _zivi
from zivi._check import real
from zivi.system import ImpactSystem

__all__ = ["ExplicitEuler", "Method", "ThetaGamma"]

Report = Callable[[int, int], None]
"""Called with the number of steps done and their total."""

SOLVERS = ("exact", "newton", "outer")
"""How a step can find its signs."""
MAX_LINEARISATIONS = 1000


class Method(Protocol):
    """Anything that `simulate` can run."""

    def _integrate(
        self,
        system: ImpactSystem,
        t_span: tuple[float, float],
        y0: tuple[float, float],
        report: Report | None,
    ) -> _zivi.RunRecord: ...


@dataclasses.dataclass(frozen=True)
class ThetaGamma:
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
        All give the same trajectory where they succeed. A step in which the solver fails is
        taken by the exact one and counted in ``failed_steps``.
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

    def _integrate(
        self,
        system: ImpactSystem,
        t_span: tuple[float, float],
        y0: tuple[float, float],
        report: Report | None,
    ) -> _zivi.RunRecord:
        return _zivi.simulate_theta_gamma(
            system._spec,
            kappa=system.kappa,
            h=self.h,
            theta=self.theta,
            gamma=self.gamma,
            solver=self.solver,
            linearisations=self.linearisations,
            span=t_span,
            state=y0,
            progress=report,
        )


@dataclasses.dataclass(frozen=True)
class ExplicitEuler:
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

    def _integrate(
        self,
        system: ImpactSystem,
        t_span: tuple[float, float],
        y0: tuple[float, float],
        report: Report | None,
    ) -> _zivi.RunRecord:
        return _zivi.simulate_explicit_euler(
            system._spec,
            kappa=system.kappa,
            h=self.h,
            span=t_span,
            state=y0,
            progress=report,
        )
