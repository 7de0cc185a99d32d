"""What acts: twisting controllers for a mass with impacts."""

from __future__ import annotations

import copy
import enum
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Never, Self, TypeVar

import numpy as np

from zivi import _zivi
from zivi._check import Array, real, switch, whole
from zivi.transform import coefficients

__all__ = ["ExplicitTwisting", "TickStatus", "TwistingRegulator", "TwistingTracker"]

BRANCHES = ("positive", "nearest")
"""How a tracker lifts what it measures."""
DEPTH = 0.1
"""How far behind the wall a measurement may lie by default (m)."""
ANY_KAPPA = 0.5
TICKS = ("step", "step_to")
Controller = TypeVar("Controller")
MAX_AHEAD = 10**9
"""Periods of the longest horizon, as of the longest run."""


class TickStatus(enum.IntFlag):
    """What was done to the last sample and to the control; ``0`` is nothing."""

    CLAMPED = 1
    """The measured position was negative by at most ``depth`` and was taken as 0."""
    SATURATED = 2
    """The control was cut to ``u_limits``."""
    REFUSED = 4
    """In a closed loop: the sample was refused, the last control was held."""


class _Shared:
    """Settings and state: what the controllers have in common beside their ticks."""

    _settings: dict[str, Any]

    if TYPE_CHECKING:  # the extension's classes have them

        @property
        def _status(self) -> int: ...
        @property
        def _signs(self) -> Sequence[float]: ...
        def _get_state(self) -> tuple[Any, ...]: ...
        def _set_state(self, state: Any, /) -> None: ...

    def _number(self, name: str) -> float:
        value = self._settings[name]
        return _without_wall() if value is None else float(value)

    def _on(self, kappa: float) -> Self:
        """Give the controller on a wall; itself if it knows one."""
        if self._settings["kappa"] is not None:
            return self
        attributes = {name: it for name, it in self.__dict__.items() if name not in TICKS}
        settings = self._settings | {"kappa": kappa}
        if settings.get("kappa_ref", kappa) is None:
            settings["kappa_ref"] = kappa
        this: Any = self
        twin: Any = _rebuilt(type(self), attributes | {"_settings": settings}, self.state)
        if hasattr(this, "x_ref"):
            twin.reset(this.x_ref, this.xdot_ref)
        return twin  # type: ignore[no-any-return]

    @property
    def mu1(self) -> float:
        """Gain on the sign of the position (m/s^2)."""
        return self._number("mu1")

    @property
    def mu2(self) -> float:
        """Gain on the sign of the velocity (m/s^2)."""
        return self._number("mu2")

    @property
    def h(self) -> float:
        """Sampling period (s)."""
        return self._number("h")

    @property
    def e(self) -> float:
        """Coefficient of restitution of the plant's wall."""
        return coefficients(None, self.kappa)[0]

    @property
    def kappa(self) -> float:
        """``(1 - e)/(1 + e)`` of the plant's wall."""
        return self._number("kappa")

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as they are given to the constructor."""
        return dict(self._settings)

    @property
    def signs(self) -> Array:
        """Multipliers of the last tick, those of the regulator or all six (a copy)."""
        return np.array(self._signs)

    @property
    def status(self) -> TickStatus:
        """What was done to the last sample and to the control."""
        return TickStatus(self._status)

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores the controller exactly."""
        return self._get_state()

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        if not _is_state(state):
            raise ValueError(f"state must be what a controller's state gave, got {state!r}")
        self._set_state(state)

    def copy(self) -> Self:
        """Copy the controller: the same settings, the same state."""
        twin: Self = _rebuilt(type(self), dict(self.__dict__), self.state)
        return twin

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        attributes = copy.deepcopy(self.__dict__, memo)
        twin: Self = _rebuilt(type(self), attributes, self.state)
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), self.__dict__, self.state)

    def __repr__(self) -> str:
        shown = {name: value for name, value in self._settings.items() if value is not None}
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in shown.items())})"


class _Following(_Shared):
    """What the controllers with a reference have in common."""

    @property
    def e_ref(self) -> float:
        """Coefficient of restitution of the reference's wall."""
        return coefficients(None, self.kappa_ref)[0]

    @property
    def kappa_ref(self) -> float:
        """``(1 - e)/(1 + e)`` of the reference's wall."""
        return self._number("kappa_ref")


class _Landing(_Shared):
    """What the controllers that land have in common."""

    @property
    def landing(self) -> bool:
        """Whether the control ends in exact rest in a sampled loop."""
        return bool(self._settings["landing"])

    @property
    def ahead(self) -> int:
        """Horizon of the landing, in sampling periods."""
        return int(self._settings["ahead"])


def _rebuilt(kind: type[Any], attributes: dict[str, Any], state: tuple[Any, ...]) -> Any:
    # by the constructor of the class of ours: a subclass may have one of its own
    ours: Any = next(base for base in kind.__mro__ if base.__module__ == __name__)
    controller = ours.__new__(kind, **attributes["_settings"])
    controller.__dict__.update(attributes)
    controller.state = state
    return controller


def _is_state(state: Any) -> bool:
    try:
        s, v, side, u, signs, bits = state
        numbers = [float(number) for number in (s, v, side, u, *signs)]
        return (
            all(map(math.isfinite, numbers))
            and abs(side) == 1.0
            and s * side >= 0.0
            and len(signs) == 6
            and all(abs(sign) <= 1.0 for sign in signs)
            and bits in range(4)
        )
    except (TypeError, ValueError):
        return False


def _common(
    mu1: float,
    mu2: float,
    h: float,
    kappa: float | None,
    bound: float | None,
    depth: float,
    u_limits: Sequence[float] | None,
) -> dict[str, Any]:
    """Return settings as plain numbers; their ranges are checked in the core."""
    limits = None
    if u_limits is not None:
        try:
            low, high = u_limits
        except (TypeError, ValueError):
            message = f"u_limits must be two numbers (u_min, u_max), got {u_limits!r}"
            raise TypeError(message) from None
        limits = (real("u_min", low), real("u_max", high))
    return {
        "mu1": real("mu1", mu1),
        "mu2": real("mu2", mu2),
        "h": real("h", h),
        "kappa": kappa,
        "bound": None if bound is None else real("bound", bound),
        "depth": real("depth", depth),
        "u_limits": limits,
    }


def _core(settings: dict[str, Any]) -> dict[str, Any]:
    """Translate settings for the extension."""
    given = dict(settings)
    limits = given.pop("u_limits")
    if given["kappa"] is None:  # any wall, until it is known; then the gains are checked too
        given |= {"kappa": ANY_KAPPA, "bound": None}
    if given.get("kappa_ref", ANY_KAPPA) is None:
        given["kappa_ref"] = ANY_KAPPA
    return given | {"actuator": (-math.inf, math.inf) if limits is None else limits}


def _plant_kappa(e: float | None, kappa: float | None) -> float | None:
    """Return what is given of the plant's wall, None if nothing is."""
    return None if e is None and kappa is None else coefficients(e, kappa)[1]


def _without_wall(*_: Any, **__: Any) -> Never:
    raise ValueError(
        "the controller has no e: give it e= or kappa=; zivi.simulate_closed_loop gives it the "
        "plant's"
    )


def _with_wall(controller: Controller) -> Controller:
    """Keep a controller from ticking that does not know a wall yet."""
    it: Any = controller
    if it._settings["kappa"] is None:
        names = [name for name in TICKS if hasattr(controller, name)]
        it.__dict__.update(dict.fromkeys(names, _without_wall))
    return controller


def _reference_kappa(
    e_ref: float | None, kappa_ref: float | None, plant: float | None
) -> float | None:
    if e_ref is None and kappa_ref is None:
        return plant
    e = None if e_ref is None else real("e_ref", e_ref)
    kappa = None if kappa_ref is None else real("kappa_ref", kappa_ref)
    try:
        return coefficients(e, kappa)[1]
    except ValueError as error:
        raise ValueError(re.sub(r"\b(e|kappa)\b", r"\1_ref", str(error))) from None


def _horizon(landing: Any, ahead: Any) -> int:
    """Return the horizon of a landing in periods."""
    switch("landing", landing)
    periods = whole("ahead", ahead)
    if not 1 <= periods <= MAX_AHEAD:
        raise ValueError(
            f"ahead must be >= 1 (1 + the periods of delay) and at most {MAX_AHEAD:.0e}, "
            f"got {ahead}"
        )
    if periods > 1 and not landing:
        raise ValueError(f"ahead is of the landing: with landing=False it must be 1, got {ahead}")
    return periods


class TwistingRegulator(_zivi.Regulator, _Landing):
    r"""The twisting regulator: brings the mass to rest at the wall in finite time.

    .. math::

        \dot s = R v, \qquad
        \dot v = R^{-1} \left( \mathrm{sgn}(s) F - \mu_1\,\mathrm{sgn}\,s
                 - \mu_2\,\mathrm{sgn}\,v \right)

    with the signs taken implicitly, at the end of the sampling period; in physical terms
    :math:`u = -\mu_1 - \mu_2\,\mathrm{sgn}\,\dot x`. With ``landing`` the sign is as much of the
    brake as stops the mass :math:`N` periods ahead,

    .. math::

        \ddot x = F + u = -\min(\max(\dot x / (N h), D), U), \qquad
        D = \mu_1 - \mu_2 - F, \quad U = \mu_1 + \mu_2 - F

    and a sampled loop ends in exact rest for every :math:`e < 1`; without it the step is solved as
    in the paper, whose plan to end a period on the wall a held control misses. Finite-time stable
    for every force bounded by :math:`M` when

    .. math:: M - \mu_1 \frac{1 - e^2}{1 + e^2} < \mu_2 < \mu_1 - M

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. Without either, the controller takes the plant's in
        `simulate_closed_loop`, and cannot tick by itself.
    bound : float, optional
        A bound :math:`M` of the force (m/s^2). The gains are then checked against it.
    depth : float
        Measurements down to ``-depth`` (m) are sensor noise and are taken as 0; deeper ones are
        refused.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2): the control is cut to it.
    landing : bool
        Whether the control ends in exact rest in a sampled loop; False is the paper's tick.
    ahead : int
        The horizon :math:`N` of the landing, >= 1: one more than the periods from a measurement
        to the moment when its control acts.

    Raises
    ------
    ValueError
        If a setting is out of range, or the gains do not suffice for `bound`.

    Examples
    --------
    >>> regulator = zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, bound=0.9)
    >>> regulator.step(1.0, -0.5, 0.0)  # falling: -mu1 + mu2
    -1.0
    >>> zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, bound=2.5)
    Traceback (most recent call last):
        ...
    ValueError: mu1 must be greater than mu2 + bound = 4.5 m/s^2 for bound = 2.5, got 3.0
    """

    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
        landing: bool = True,
        ahead: int = 1,
    ) -> Self:
        kappa = _plant_kappa(e, kappa)
        settings = _common(mu1, mu2, h, kappa, bound, depth, u_limits)
        horizon = _horizon(landing, ahead)
        self = super().__new__(cls, **_core(settings), ahead=horizon if landing else None)
        self._settings = settings | {"landing": bool(landing), "ahead": horizon}
        return _with_wall(self)


class TwistingTracker(_zivi.Tracker, _Following, _Landing):
    r"""The twisting tracker: makes the mass follow a bouncing reference through its Zeno point.

    .. math::

        u = R\,\mathrm{sgn}(s) \left[ -\mu_1\,\mathrm{sgn}\,e_s - \mu_2\,\mathrm{sgn}\,e_v
            + \mathrm{sgn}(s_r) F_r / R_r \right] - \mathrm{sgn}(s)^2 F,
        \qquad e_s = s - s_r, \quad e_v = v - v_r

    with all six signs taken implicitly, at the end of the sampling period, and solved exactly: the
    control follows without chattering. The reference is a mass of its own above a wall, inside
    the controller, that every tick advances by `h`. It starts at rest; see `reset`. Or it is given
    sample by sample: see `step_to`.

    With ``landing`` the control is another one while the reference rests:

    .. math::

        \ddot x = F + u = -\min(\max(\dot x / (N h), D), U), \qquad
        D = \frac{2 (\mu_1 - \mu_2)}{1 + e}, \quad U = \frac{2 e (\mu_1 + \mu_2)}{1 + e}

    (:math:`U < D`: :math:`U` if :math:`\dot x \ge N h U`, else :math:`D`), which are the law's own
    accelerations as the mass falls and rises. A sampled loop ends in exact rest for every
    :math:`0 < e < 1`, also under noise and an unknown force.

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution of the plant's wall, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. Without either, the controller takes the plant's in
        `simulate_closed_loop`, and cannot tick by itself.
    e_ref, kappa_ref : float, optional
        At most one of them, for the reference's wall; by default it is the plant's. Exact
        tracking needs the plant's.
    branch : {"positive", "nearest"}
        How a measurement is lifted to ``(s, v)``: to ``s >= 0``, the reference too, every period
        (the paper); or to the preimage that is nearer to the reference, which itself passes
        through the wall continuously.
    bound : float, optional
        A bound :math:`M` of the force that is not known (m/s^2). The gains are then checked
        against it: :math:`M_e < \mu_2 < \mu_1 - M_e` with :math:`M_e = M (1+e)/(2e)`.
    depth : float
        Measurements down to ``-depth`` (m) are sensor noise and are taken as 0; deeper ones are
        refused.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2): the control is cut to it.
    landing : bool
        Whether the control ends in exact rest in a sampled loop; False is the paper's law, whose
        control at rest is :math:`-F`.
    press : float, optional
        Acceleration towards the wall of a mass at rest, :math:`u = -F - press` (m/s^2): at least
        `bound`, or the unknown force lifts it. By default :math:`D`.
    ahead : int
        The horizon :math:`N` of the landing, >= 1: one more than the periods from a measurement to
        the moment when its control acts.
    horizon : float
        Periods over which the implicit step is planned, >= 1. More, about 3 to 5, are quieter under
        noise and less sharp near an impact.
    shift : bool
        Whether the tick takes the measured velocity half a period back, :math:`\dot x - h F_r/2`,
        in the air: it removes the bias :math:`h^2 |F_r|/2` of the position.

    Raises
    ------
    ValueError
        If a setting is out of range, or the gains do not suffice for `bound`.

    Examples
    --------
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5, bound=5.0)
    >>> tracker.reset(3.0, 3.0)
    >>> round(tracker.step(6.0, 5.0, -9.81, -19.81), 9)
    -33.5
    >>> tracker.x_ref  # the reference is one period ahead now
    3.00298019
    """

    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        e_ref: float | None = None,
        kappa_ref: float | None = None,
        branch: Literal["positive", "nearest"] = "positive",
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
        landing: bool = True,
        press: float | None = None,
        ahead: int = 1,
        horizon: float = 1,
        shift: bool = False,
    ) -> Self:
        if not (isinstance(branch, str) and branch in BRANCHES):
            raise ValueError(f"branch must be one of {', '.join(BRANCHES)}, got {branch!r}")
        kappa = _plant_kappa(e, kappa)
        settings = _common(mu1, mu2, h, kappa, bound, depth, u_limits)
        settings["kappa_ref"] = _reference_kappa(e_ref, kappa_ref, kappa)
        periods = _horizon(landing, ahead)
        quiet: dict[str, Any] = {
            "horizon": real("horizon", horizon),
            "shift": switch("shift", shift),
        }
        if press is not None:
            press = real("press", press)
            if not landing:
                raise ValueError(
                    f"press is of the landing: with landing=False it must be None, got {press}"
                )
        self = super().__new__(
            cls,
            **_core(settings),
            nearest=branch == "nearest",
            ahead=periods if landing else None,
            press=press,
            **quiet,
        )
        self._settings = settings | {
            "branch": branch,
            "landing": bool(landing),
            "press": press,
            "ahead": periods,
            **quiet,
        }
        return _with_wall(self)

    @property
    def branch(self) -> str:
        """How a measurement is lifted."""
        return str(self._settings["branch"])

    @property
    def press(self) -> float | None:
        """Acceleration towards the wall of a mass at rest (m/s^2); None without a landing."""
        accelerations = self._accelerations()
        return None if accelerations is None else accelerations[-1]

    @property
    def horizon(self) -> float:
        """Periods over which the implicit step is planned."""
        return self._number("horizon")

    @property
    def shift(self) -> bool:
        """Whether the measured velocity is taken half a period back in the air."""
        return bool(self._settings["shift"])


class ExplicitTwisting(_zivi.Explicit, _Following):
    r"""Baseline: the twisting tracker with the signs of the sampled state. It chatters.

    .. math::

        u = R \left[ -\mu_1\,\mathrm{sgn}\,(s - s_r) - \mu_2\,\mathrm{sgn}\,(v - v_r)
            + F_r / R_r \right] - F \qquad (s, s_r \ge 0)

    The same interface as `TwistingTracker`, and the same reference inside.

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution of the plant's wall, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. Without either, the controller takes the plant's in
        `simulate_closed_loop`, and cannot tick by itself.
    e_ref, kappa_ref : float, optional
        At most one of them, for the reference's wall; by default it is the plant's.
    bound : float, optional
        A bound of the unknown force (m/s^2), against which the gains are checked as the tracker's.
    depth : float
        Measurements down to ``-depth`` (m) are taken as 0; deeper ones are refused.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2).

    Raises
    ------
    ValueError
        If a setting is out of range.

    Examples
    --------
    >>> baseline = zivi.ExplicitTwisting(30, 17, h=1e-3, kappa=0.5)
    >>> round(baseline.step(0.1, 0.0, -9.81, -9.81), 9)  # above the reference, which rests
    -20.19
    """

    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        e_ref: float | None = None,
        kappa_ref: float | None = None,
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
    ) -> Self:
        kappa = _plant_kappa(e, kappa)
        settings = _common(mu1, mu2, h, kappa, bound, depth, u_limits)
        settings["kappa_ref"] = _reference_kappa(e_ref, kappa_ref, kappa)
        self = super().__new__(cls, **_core(settings))
        self._settings = settings
        return _with_wall(self)
