"""Gains that are computed: from what is requested of a loop to a controller that does it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import finite, not_negative, positive
from zivi.base.habits import hinted
from zivi.control.design_law import Law
from zivi.control.design_search import LARGEST, Asked, Found, feasible_time, least_limit, search
from zivi.control.design_time import Landing
from zivi.control.loop_arguments import check_delay
from zivi.control.twisting import TwistingRegulator, TwistingTracker
from zivi.simulation.run import pair
from zivi.system.transform import coefficients

__all__ = ["GainDesign", "InfeasibleError", "best_ratio", "design_regulator", "design_tracker"]


class InfeasibleError(ValueError):
    """No gains do what is requested.

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
        Bound M of the unknown force (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts.
    quiet : float
        Bound of the errors of the measured velocity (m/s).
    settling_time : float
        The mass rests before it, whatever the unknown force does within its bound (s); with
        ``rest="practical"`` it stays `within` from then on.
    rest : {"exact", "practical"}
        Whether the mass comes to exact rest: ``M < (min(U, D) - e^2 D)/(1 + e^2)``.
    within : float
        How far from the wall the mass still gets after `settling_time` (m), 0 if it rests.
    rising, falling : float
        Net accelerations U and D towards the wall of a mass that rises and of one that falls
        (m/s^2).
    u_min, u_max : float
        The control stays between them, ends included (m/s^2); with a delay so does the 0 of the
        first periods.
    """

    kind: Literal["tracker", "regulator"]
    mu1: float
    mu2: float
    h: float
    e: float
    bound: float
    delay: int
    quiet: float
    settling_time: float
    rest: Literal["exact", "practical"]
    within: float
    rising: float
    falling: float
    u_min: float
    u_max: float

    @property
    def peak(self) -> float:
        """Largest absolute control (m/s^2)."""
        return max(-self.u_min, self.u_max)

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
        given: dict[str, Any] = {"h": self.h, "e": self.e, "ahead": 1 + self.delay}
        given |= {"quiet": self.quiet} | settings
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


@hinted("design")
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
    quiet: float = 0.0,
    rest: Literal["exact", "practical"] = "exact",
) -> GainDesign:
    """Compute gains and sampling period of a tracker that lands in time.

    The reference rests; one that moves is captured in about 5 sqrt(Delta/(R mu1)), see
    choose_gains.md.

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
        The known force, constant: what acts while a delay keeps the control away, and what the
        actuator has to bear (m/s^2).
    force_ref : float, optional
        Largest force on a reference that moves (m/s^2), for the actuator only.
    u_limits : float or (float, float), optional
        What the actuator can: the largest absolute control, or its range, which holds 0 (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0.
    quiet : float
        Bound of the errors of the measured velocity, >= 0 (m/s): 5 standard deviations, say. The
        controller's landing has it as its dead zone.
    rest : {"exact", "practical"}
        Whether the mass has to come to exact rest, or may go on in bounces of some periods, which
        asks for less where `e` is near 1: ``within`` of the design tells how high.

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

    Notes
    -----
    Promised is rest for any unknown force within `bound`, one that follows the motion included, on
    a wall with this `e`, under this constant known force, from `start` or a better one, with exact
    positions and velocities (or errors within `quiet`) and with the design's own settings. Without
    a delay that is a theorem, with one it is what 2000 of 2000 adversarial runs did.

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
    return _design(law, (settling_time, bound, start, quiet), u_limits, delay, rest)


@hinted("design")
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
    quiet: float = 0.0,
    rest: Literal["exact", "practical"] = "exact",
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
        What the actuator can: the largest absolute control, or its range, which holds 0 (m/s^2).
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0.
    quiet : float
        Bound of the errors of the measured velocity, >= 0 (m/s): 5 standard deviations, say. The
        controller's landing has it as its dead zone.
    rest : {"exact", "practical"}
        Whether the mass has to come to exact rest, or may go on in bounces of some periods, which
        asks for less where `e` is near 1: ``within`` of the design tells how high.

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

    Notes
    -----
    Promised is rest for any unknown force within `bound`, one that follows the motion included, on
    a wall with this `e`, under this constant known force, from `start` or a better one, with exact
    positions and velocities (or errors within `quiet`) and with the design's own settings. Without
    a delay that is a theorem, with one it is what 2000 of 2000 adversarial runs did.

    Examples
    --------
    >>> design = zivi.design_regulator(1.5, e=0.5, bound=1.0)
    >>> 0 < design.mu2 < design.mu1
    True
    """
    e, _ = _restitution(e, kappa)
    law = Law("regulator", e, finite("force", force), None)
    return _design(law, (settling_time, bound, start, quiet), u_limits, delay, rest)


def _design(
    law: Law,
    asked: tuple[Any, Any, Any, Any],
    u_limits: Any,
    delay: Any,
    rest: Any,
) -> GainDesign:
    settling_time, bound, start, quiet = asked
    time = positive("settling_time", settling_time)
    bound, quiet = not_negative("bound", bound), not_negative("quiet", quiet)
    state = pair("start", start, "(x, xdot)")
    if not (all(map(math.isfinite, state)) and state[0] >= 0.0):
        raise ValueError(f"start must be finite with x >= 0, got {start!r}")
    if rest not in ("exact", "practical"):
        raise ValueError(f"rest must be 'exact' or 'practical', got {rest!r}")
    landing = Landing(law.e, law.force, bound, state, check_delay(delay), quiet)
    wanted = Asked(law, landing, time, _limits(u_limits), rest == "exact")
    found = search(wanted)
    if found is None:
        raise _infeasible(wanted)
    return _design_of(wanted, found)


def _design_of(asked: Asked, found: Found) -> GainDesign:
    law, landing = asked.law, asked.landing
    mu1, mu2 = law.gains(found.braking, found.falling)
    u_min, u_max = law.controls(mu1, mu2, landing.delay > 0)
    return GainDesign(
        kind=law.kind,
        mu1=mu1,
        mu2=mu2,
        h=found.h,
        e=law.e,
        bound=landing.bound,
        delay=landing.delay,
        quiet=landing.quiet,
        settling_time=found.time,
        rest="exact" if found.height == 0.0 else "practical",
        within=found.height,
        rising=found.braking,
        falling=found.falling,
        u_min=u_min,
        u_max=u_max,
    )


def _infeasible(asked: Asked) -> InfeasibleError:
    """Say what the actuator can."""
    low, high = asked.limits
    needs = f"no gains rest within {asked.time:g} s"
    if math.isinf(low) and math.isinf(high):
        return InfeasibleError(f"{needs} that are at most {LARGEST:g} m/s^2", None, None)
    time, peak = feasible_time(asked), least_limit(asked)
    needs += f" with a control from {low:g} to {high:g} m/s^2"
    if peak is not None:
        needs += f" (|u| <= {peak:.4g} does)"
    if time is None:
        return InfeasibleError(f"{needs}: it is too weak for any settling time", None, peak)
    time = _rounded_up(time)
    return InfeasibleError(f"{needs}: feasible is settling_time >= {time:.6g} s", time, peak)


def _rounded_up(time: float) -> float:
    """Give the next number of 6 digits."""
    digits = 10.0 ** (5 - math.floor(math.log10(time)))
    return math.ceil(time * digits) / digits


def _limits(u_limits: Any) -> tuple[float, float]:
    if u_limits is None:
        return -math.inf, math.inf
    if np.ndim(u_limits) == 0:
        limit = positive("u_limits", u_limits)
        return -limit, limit
    low, high = pair("u_limits", u_limits, "(u_min, u_max)")
    if not (low <= 0.0 <= high and low < high):
        raise ValueError(
            f"u_limits must be (u_min, u_max) with u_min <= 0 <= u_max, got {u_limits!r}"
        )
    return low, high


def _restitution(e: float | None, kappa: float | None) -> tuple[float, float]:
    e, kappa = coefficients(e, kappa)
    if not 0.0 < e < 1.0:
        raise ValueError(f"e must be in (0, 1), got {e}")
    return e, kappa


def _check_kind(kind: Any) -> None:
    if kind not in ("tracker", "regulator"):
        raise ValueError(f"kind must be 'tracker' or 'regulator', got {kind!r}")
