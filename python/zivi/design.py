"""Gains that are computed: from what is asked of a loop to a controller that does it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi._check import Array, finite, real
from zivi._design_law import Law, settling
from zivi._loop_arguments import check_delay
from zivi.control import TwistingRegulator, TwistingTracker
from zivi.simulate import pair
from zivi.transform import coefficients

__all__ = ["GainDesign", "InfeasibleError", "best_ratio", "design_regulator", "design_tracker"]

RESERVE = 1.2
"""By how much the gains exceed what the bound of the unknown force asks for."""
PART = 0.9
"""Part of the settling time that the law itself takes; sampling takes the rest."""
RATIOS = np.linspace(0.02, 0.98, 193)
LARGEST = 1e12
"""Largest gain that is looked for (m/s^2)."""


class InfeasibleError(ValueError):
    """No gains do what is asked for.

    Attributes
    ----------
    settling_time : float or None
        The least settling time that the actuator allows (s), None if none does.
    peak : float or None
        The least actuator limit for what was asked for (m/s^2), None if none does.
    """

    def __init__(self, message: str, settling_time: float | None, peak: float | None) -> None:
        super().__init__(message)
        self.settling_time, self.peak = settling_time, peak

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.settling_time, self.peak)


@dataclasses.dataclass(frozen=True)
class GainDesign:
    """Gains and sampling period of a controller, and what they are good for.

    Attributes
    ----------
    kind : {"tracker", "regulator"}
        What they are for.
    mu1, mu2 : float
        Gains (m/s^2).
    h : float
        Sampling period (s).
    e : float
        Coefficient of restitution of the wall.
    bound : float
        Bound of the unknown force (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts.
    settling_time : float
        The mass rests before it, whatever the unknown force does within its bound (s).
    rising, falling : float
        Net accelerations towards the wall of a mass that rises and of one that falls (m/s^2).
    peak : float
        Largest control (m/s^2).
    """

    kind: Literal["tracker", "regulator"]
    mu1: float
    mu2: float
    h: float
    e: float
    bound: float
    delay: int
    settling_time: float
    rising: float
    falling: float
    peak: float

    def controller(self, **settings: Any) -> TwistingTracker | TwistingRegulator:
        """Make the controller.

        Parameters
        ----------
        **settings
            Further settings of it, such as ``u_limits``.

        Returns
        -------
        TwistingTracker or TwistingRegulator
        """
        given: dict[str, Any] = {"h": self.h, "e": self.e, "ahead": 1 + self.delay} | settings
        if self.kind == "regulator":
            return TwistingRegulator(self.mu1, self.mu2, **given)
        return TwistingTracker(self.mu1, self.mu2, **({"bound": self.bound} | given))


def best_ratio(e: float, kind: Literal["tracker", "regulator"] = "tracker") -> float:
    r"""Give the ratio of the gains that brings a mass to rest soonest for its largest control.

    .. math::

        \frac{\mu_2}{\mu_1} = \frac{1 - k}{1 + k}, \qquad
        q = \min\left(1, \sqrt{1 + 1/e} - 1\right), \qquad k = e q^2 \text{ or } q^2

    Parameters
    ----------
    e : float
        Coefficient of restitution, in (0, 1).
    kind : {"tracker", "regulator"}
        Of which controller: :math:`k = e q^2` or :math:`k = q^2`.

    Returns
    -------
    float
        The ratio, 0 where it is best to have no second gain (which must be > 0).

    Examples
    --------
    >>> round(zivi.best_ratio(0.5), 3)
    0.577
    """
    _check_kind(kind)
    e = _restitution(e, None)[0]
    q = min(1.0, math.sqrt(1.0 + 1.0 / e) - 1.0)
    k = q * q if kind == "regulator" else e * q * q
    return (1.0 - k) / (1.0 + k)


def design_tracker(
    settling_time: float,
    *,
    e: float | None = None,
    kappa: float | None = None,
    bound: float = 0.0,
    start: ArrayLike = (1.0, 0.0),
    force: float = -9.81,
    force_ref: float | None = None,
    u_limits: float | Sequence[float] | None = None,
    delay: int = 0,
) -> GainDesign:
    """Compute gains and sampling period of a tracker that lands in time.

    The reference rests; one that moves is captured in about 5 sqrt(D/(R mu1)), see control.md.

    Parameters
    ----------
    settling_time : float
        Time after which the mass shall rest on a resting reference, > 0 (s).
    e, kappa : float
        Exactly one of the coefficient of restitution, in (0, 1), and ``(1 - e)/(1 + e)``.
    bound : float
        Bound of the unknown force, >= 0 (m/s^2).
    start : (float, float)
        Distance from the wall (m) and velocity (m/s) from which it shall; or the worst of them.
    force : float
        The known force, for the actuator only (m/s^2).
    force_ref : float, optional
        Largest force on a reference that moves (m/s^2), for the actuator only.
    u_limits : float or (float, float), optional
        What the actuator can: the largest absolute control, or its range (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0.

    Returns
    -------
    GainDesign
        With the least acceleration that does it; ``design.controller()`` makes the tracker.

    Raises
    ------
    InfeasibleError
        If the actuator cannot: its attribute ``settling_time`` is what it can.
    ValueError, TypeError
        For an argument out of range.

    Examples
    --------
    >>> design = zivi.design_tracker(1.5, e=0.5, bound=1.0)
    >>> plant = zivi.ImpactSystem(-9.81 + 0.9, e=0.5)  # 0.9 m/s^2 unknown
    >>> run = zivi.simulate_closed_loop(
    ...     plant, design.controller(), (0, 2), (1, 0), y_ref0=(0, 0), force_model=-9.81
    ... )
    >>> run.rest_time < design.settling_time <= 1.5
    True
    """
    e, _ = _restitution(e, kappa)
    largest = None if force_ref is None else finite("force_ref", force_ref)
    law = Law("tracker", e, finite("force", force), largest)
    return _design(law, settling_time, bound, start, u_limits, delay)


def design_regulator(
    settling_time: float,
    *,
    e: float | None = None,
    kappa: float | None = None,
    bound: float = 0.0,
    start: ArrayLike = (1.0, 0.0),
    force: float = 0.0,
    u_limits: float | Sequence[float] | None = None,
    delay: int = 0,
) -> GainDesign:
    """Compute gains and sampling period of a regulator that lands in time.

    Parameters
    ----------
    settling_time : float
        Time after which the mass shall rest, > 0 (s).
    e, kappa : float
        Exactly one of the coefficient of restitution, in (0, 1), and ``(1 - e)/(1 + e)``.
    bound : float
        Bound of the unknown force, >= 0 (m/s^2).
    start : (float, float)
        Distance from the wall (m) and velocity (m/s) from which it shall; or the worst of them.
    force : float
        The known force, which the regulator leaves to act (m/s^2).
    u_limits : float or (float, float), optional
        What the actuator can: the largest absolute control, or its range (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0.

    Returns
    -------
    GainDesign
        With the least acceleration that does it; ``design.controller()`` makes the regulator.

    Raises
    ------
    InfeasibleError
        If the actuator cannot: its attribute ``settling_time`` is what it can.
    ValueError, TypeError
        For an argument out of range.

    Examples
    --------
    >>> design = zivi.design_regulator(1.5, e=0.5, bound=1.0)
    >>> 0 < design.mu2 < design.mu1
    True
    """
    e, _ = _restitution(e, kappa)
    law = Law("regulator", e, finite("force", force), None)
    return _design(law, settling_time, bound, start, u_limits, delay)


def _design(
    law: Law, settling_time: Any, bound: Any, start: Any, u_limits: Any, delay: Any
) -> GainDesign:
    time, bound = _positive("settling_time", settling_time), finite("bound", bound)
    if bound < 0.0:
        raise ValueError(f"bound must be >= 0 (m/s^2), got {bound}")
    state = pair("start", start, "(x, xdot)")
    if not (all(map(math.isfinite, state)) and state[0] >= 0.0):
        raise ValueError(f"start must be finite with x >= 0, got {start!r}")
    periods, limit = check_delay(delay), _limit(u_limits)
    found = _gains(law, time, bound, state)
    if found is None:
        text = f"no gains up to {LARGEST:g} m/s^2 rest within {time:g} s"
        raise InfeasibleError(text, None, None)
    peak = law.peak(*found)
    if peak > limit:
        raise _infeasible(law, (time, bound, state), peak, limit)
    return _told(law, found, (time, bound, state), periods)


def _gains(
    law: Law, time: float, bound: float, start: tuple[float, float]
) -> tuple[float, float] | None:
    """Give the gains of least acceleration that rest within a time."""

    def enough(mu1: Array) -> NDArray[np.bool_]:
        mu2 = RATIOS * mu1
        rising, falling = law.accelerations(mu1, mu2)
        in_time = settling(law.e, rising, falling, bound, start) <= PART * time
        both: NDArray[np.bool_] = in_time & law.suffices(mu1, mu2, RESERVE * bound)
        return both

    low, high = np.full(RATIOS.shape, -LARGEST_LOG), np.full(RATIOS.shape, LARGEST_LOG)
    possible = enough(np.exp(high))
    if not possible.any():
        return None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        good = enough(np.exp(middle))
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    mu1 = np.exp(high)
    most = np.where(possible, np.maximum(*law.accelerations(mu1, RATIOS * mu1)), np.inf)
    best = int(np.argmin(most))
    return float(mu1[best]), float(RATIOS[best] * mu1[best])


LARGEST_LOG = math.log(LARGEST)
BISECTIONS = 60


def _told(
    law: Law,
    gains: tuple[float, float],
    asked: tuple[float, float, tuple[float, float]],
    delay: int,
) -> GainDesign:
    time, bound, start = asked
    mu1, mu2 = gains
    rising, falling = law.accelerations(np.array(mu1), np.array(mu2))
    kappa = (1.0 - law.e) / (1.0 + law.e)
    periods = 3.0 * (1.0 + 1.0 / kappa) * max(1.0, float(rising / falling))
    h = (1.0 - PART) * time / (periods + 10.0) / (1 + delay)
    law_takes = float(settling(law.e, rising, falling, bound, start))
    sampled = law_takes + ((1 + delay) * periods + 10.0) * h
    return GainDesign(
        kind=law.kind,
        mu1=mu1,
        mu2=mu2,
        h=h,
        e=law.e,
        bound=bound,
        delay=delay,
        settling_time=min(sampled, time),
        rising=float(rising),
        falling=float(falling),
        peak=law.peak(mu1, mu2),
    )


def _infeasible(
    law: Law, asked: tuple[float, float, tuple[float, float]], peak: float, limit: float
) -> InfeasibleError:
    """Say what the actuator can: the peak falls with the settling time."""
    time, bound, start = asked

    def allowed(longer: float) -> bool:
        found = _gains(law, longer, bound, start)
        return found is not None and law.peak(*found) <= limit

    needs = f"{time:g} s need a control of {peak:.4g} m/s^2, the actuator has {limit:g}"
    if not allowed(time * LONGEST):
        return InfeasibleError(f"{needs}: it is too weak for any settling time", None, peak)
    low, high = time, time * LONGEST
    while high > (1.0 + 1e-6) * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if allowed(middle) else (middle, high)
    high = math.ceil(high * 1e4) / 1e4
    text = f"{needs}: feasible is settling_time >= {high:.4f} s"
    return InfeasibleError(text, high, peak)


LONGEST = 1e6


def _limit(u_limits: Any) -> float:
    if u_limits is None:
        return math.inf
    if np.ndim(u_limits) == 0:
        return _positive("u_limits", u_limits)
    low, high = pair("u_limits", u_limits, "(u_min, u_max)")
    if not low < 0.0 < high:
        raise ValueError(
            f"u_limits must be (u_min, u_max) with u_min < 0 < u_max, got {u_limits!r}"
        )
    return min(-low, high)


def _positive(name: str, value: Any) -> float:
    number = real(name, value)
    if not number > 0.0 or math.isnan(number):
        raise ValueError(f"{name} must be > 0, got {value}")
    return finite(name, number)


def _restitution(e: float | None, kappa: float | None) -> tuple[float, float]:
    e, kappa = coefficients(e, kappa)
    if not 0.0 < e < 1.0:
        raise ValueError(f"e must be in (0, 1), got {e}")
    return e, kappa


def _check_kind(kind: Any) -> None:
    if kind not in ("tracker", "regulator"):
        raise ValueError(f"kind must be 'tracker' or 'regulator', got {kind!r}")
