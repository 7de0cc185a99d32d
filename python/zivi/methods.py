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
    state, found together with the end of the step: to 1e-12 of the largest force of the run, in at
    most 20 trials along the selected solution and 60 on each sign pattern.

    Parameters
    ----------
    h : float
        Step size, > 0 (s). The last step is shortened to end at the end of the span.
    theta, gamma : float
        In (0, 1].
    solver : {"exact"}
        How the signs are found: the exact case analysis.

    Raises
    ------
    ValueError
        If a setting is out of range. `simulate` also raises it for a system with ``e = 0``,
        where :math:`R` may vanish.

    Examples
    --------
    >>> zivi.ThetaGamma(h=1e-3)
    ThetaGamma(h=0.001, theta=1.0, gamma=1.0, solver='exact')
    """

    h: float
    theta: float = 1.0
    gamma: float = 1.0
    solver: str = "exact"

    def __post_init__(self) -> None:
        for name in ("h", "theta", "gamma"):
            object.__setattr__(self, name, real(name, getattr(self, name)))
        if self.solver != "exact":
            raise ValueError(f"solver must be 'exact', got {self.solver!r}")
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
