"""Settings, state, copies and control limits of controllers and observers."""

from __future__ import annotations

import copy
import enum
import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Never, Self, TypeVar

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, integer, real, real_array, switch
from zivi.base.habits import attribute_error
from zivi.system.mass import coefficients

# Ranges of controls.


def limits_of(limits: Any) -> Array | None:
    """Read the range of each control."""
    if limits is None:
        return None
    rows = real_array("u_limits", limits)
    if rows.ndim != 2 or rows.shape[1] != 2 or not (rows[:, 0] < rows[:, 1]).all():
        raise ValueError(f"u_limits must be pairs (u_min, u_max) with u_min < u_max, got {limits}")
    return rows


def limit_pairs(limits: Array | None) -> list[tuple[float, float]] | None:
    """Return the arguments of the extension."""
    return None if limits is None else [(float(low), float(high)) for low, high in limits]


# Base of controllers and observers: settings, state, copies and pickles.

_DEPTH, _HORIZON = _zivi.CONTROL_SETTINGS["TwistingTracker"]
DEPTH: float = _DEPTH.default
"""How far behind the wall a measurement may lie by default (m)."""
HORIZON: float = _HORIZON.default
"""Periods over which a step is planned by default."""
ANY_KAPPA = 0.5
TICKS = ("step", "step_to")
Controller = TypeVar("Controller")
MOST_DELAY = 64
"""Periods of the longest delay of a controller that predicts."""
MAX_AHEAD = 10**9
"""Periods of the longest horizon, as of the longest run."""


class TickStatus(enum.IntFlag):
    """Flags of the last control update: treatment of sample and control; ``0`` is nothing."""

    CLAMPED = 1
    """The measured position was negative by at most ``depth`` and was taken as 0."""
    SATURATED = 2
    """The control was cut to ``u_limits``."""
    REFUSED = 4
    """In a closed loop: the sample was refused, the last control was held."""
    UNSOLVED = 8
    """The general solver that was asked for found no signs; the exact ones were taken."""
    LATCH_LOST = 16
    """A contact that a `GapTracker` held opened: `force` is less than what its model lacks."""


# plain numbers: flag operators are ten times slower, and this runs at every update
_REFUSED = int(TickStatus.REFUSED)


def is_controller_state(state: Any) -> bool:
    """Whether a pickled state is one of a controller."""
    try:
        s, v, side, u, signs, bits = state
        numbers = [float(number) for number in (s, v, side, u, *signs)]
        return (
            all(map(math.isfinite, numbers))
            and abs(side) == 1.0
            and s * side >= 0.0
            and len(signs) == 6
            and all(abs(sign) <= 1.0 for sign in signs)
            and 0 <= bits < 16
            and not bits & _REFUSED
        )
    except (TypeError, ValueError):
        return False


def are_under_way(rest: tuple[Any, ...], delay: int) -> bool:
    """Whether the stored controls fit a delay."""
    try:
        ((controls, references, due),) = rest
        numbers = [float(it) for it in (*controls, *(it for pair in references for it in pair))]
        lengths = len(controls) == len(references) == delay and len(numbers) == 3 * delay
        return lengths and all(map(math.isfinite, numbers)) and 0 <= due <= delay
    except (TypeError, ValueError):
        return False


class Component:
    """Settings, state, copies and pickles of sampled components."""

    _settings: dict[str, Any]
    _is_state: Callable[[Any], bool]
    _kind: str

    if TYPE_CHECKING:  # the extension's classes have them

        def _get_state(self) -> tuple[Any, ...]: ...
        def _set_state(self, state: Any, /) -> None: ...

    else:

        def __getattr__(self, name):
            raise attribute_error("controller", self, name)

    @property
    def h(self) -> float:
        """Sampling period (s)."""
        return float(self._settings["h"])

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as they are given to the constructor."""
        return dict(self._settings)

    @property
    def state(self) -> tuple[Any, ...]:
        """Internal state, which changes at each update; assigning it restores it exactly."""
        return self._get_state()

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        if not type(self)._is_state(state):
            raise ValueError(f"state must be what {self._kind} state gave, got {state!r}")
        self._set_state(state)

    def copy(self) -> Self:
        """Copy it: the same settings, the same state."""
        twin: Self = rebuilt(type(self), dict(self.__dict__), self.state)
        return twin

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        attributes = copy.deepcopy(self.__dict__, memo)
        twin: Self = rebuilt(type(self), attributes, self.state)
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        return rebuilt, (type(self), self.__dict__, self.state)

    def __repr__(self) -> str:
        shown = {name: value for name, value in self._settings.items() if value is not None}
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in shown.items())})"


class Shared(Component):
    """Base class of the controllers, without the control update."""

    _is_state = staticmethod(is_controller_state)
    _kind = "a controller's"

    if TYPE_CHECKING:  # the extension's classes have them

        @property
        def _status(self) -> int: ...
        @property
        def _signs(self) -> Sequence[float]: ...

        _under_way: Any

    def _number(self, name: str) -> float:
        value = self._settings[name]
        return without_wall() if value is None else float(value)

    def _on(self, kappa: float) -> Self:
        """Return the controller on a wall; itself if it knows one."""
        if self._settings["kappa"] is not None:
            return self
        attributes = {name: it for name, it in self.__dict__.items() if name not in TICKS}
        settings = self._settings | {"kappa": kappa}
        if settings.get("kappa_ref", kappa) is None:
            settings["kappa_ref"] = kappa
        this: Any = self
        twin: Any = rebuilt(type(self), attributes | {"_settings": settings}, self.state)
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
    def e(self) -> float:
        """Coefficient of restitution of the plant's wall."""
        return coefficients(None, self.kappa)[0]

    @property
    def kappa(self) -> float:
        """``(1 - e)/(1 + e)`` of the plant's wall."""
        return self._number("kappa")

    @property
    def state(self) -> tuple[Any, ...]:
        """Internal state, which changes at each update; assigning it restores it exactly."""
        under_way = self._under_way if self._settings.get("delay") else None
        return self._get_state() if under_way is None else (*self._get_state(), under_way)

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        delay = self._settings.get("delay", 0)
        own = state[:6] if delay and isinstance(state, tuple) else state
        if not (is_controller_state(own) and (not delay or are_under_way(state[6:], delay))):
            raise ValueError(f"state must be what {self._kind} state gave, got {state!r}")
        self._set_state(own)
        if delay:
            self._under_way = state[6]

    @property
    def signs(self) -> Array:
        """Multipliers of the last tick, those of the regulator or all six (a copy)."""
        return np.array(self._signs)

    @property
    def status(self) -> TickStatus:
        """Status of the last update: treatment of sample and control."""
        return TickStatus(self._status)


class Following(Shared):
    """Base class of the controllers with a reference."""

    @property
    def e_ref(self) -> float:
        """Coefficient of restitution of the reference's wall."""
        return coefficients(None, self.kappa_ref)[0]

    @property
    def kappa_ref(self) -> float:
        """``(1 - e)/(1 + e)`` of the reference's wall."""
        return self._number("kappa_ref")


class LandingController(Shared):
    """Base class of the controllers with a contact-establishing law."""

    @property
    def landing(self) -> bool:
        """Whether the control ends in exact rest in a sampled loop."""
        return bool(self._settings["landing"])

    @property
    def ahead(self) -> int:
        """Horizon of the contact-establishing law, in sampling periods."""
        return int(self._settings["ahead"])

    @property
    def quiet(self) -> float:
        """Dead zone of the contact-establishing law (m/s)."""
        return self._number("quiet")

    @property
    def delay(self) -> int:
        """Periods from a measurement to the moment when its control acts."""
        return int(self._settings["delay"])

    @property
    def solver(self) -> str:
        """How the signs of a step are found."""
        return str(self._settings["solver"])


def rebuilt(kind: type[Any], attributes: dict[str, Any], state: tuple[Any, ...]) -> Any:
    """Return a controller from its pickled attributes and state."""
    # by the constructor of the class of ours: a subclass may have one of its own
    ours: Any = next(base for base in kind.__mro__ if base.__module__.split(".")[0] == "zivi")
    controller = ours.__new__(kind, **attributes["_settings"])
    # settings missing in an old pickle have their defaults
    settings = controller._settings | attributes["_settings"]
    controller.__dict__.update(attributes | {"_settings": settings})
    controller.state = state
    return controller


def common_settings(
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


def core(settings: dict[str, Any]) -> dict[str, Any]:
    """Translate settings for the extension."""
    given = dict(settings)
    limits = given.pop("u_limits")
    if given["kappa"] is None:  # any wall, until it is known; then the gains are checked too
        given |= {"kappa": ANY_KAPPA, "bound": None}
    if given.get("kappa_ref", ANY_KAPPA) is None:
        given["kappa_ref"] = ANY_KAPPA
    return given | {"actuator": (-math.inf, math.inf) if limits is None else limits}


def plant_kappa(e: float | None, kappa: float | None) -> float | None:
    """Return what is given of the plant's wall, None if nothing is."""
    return None if e is None and kappa is None else coefficients(e, kappa)[1]


def without_wall(*_: Any, **__: Any) -> Never:
    """Raise the error of a tick without the restitution of a wall."""
    raise ValueError(
        "e of the controller is not set: pass e= or kappa=; zivi.simulate_closed_loop sets the "
        "plant's"
    )


def with_wall(controller: Controller) -> Controller:
    """Keep a controller from ticking that does not know a wall yet."""
    it: Any = controller
    if it._settings["kappa"] is None:
        names = [name for name in TICKS if hasattr(controller, name)]
        it.__dict__.update(dict.fromkeys(names, without_wall))
    return controller


def reference_kappa(
    e_ref: float | None, kappa_ref: float | None, plant: float | None
) -> float | None:
    """Return kappa of the wall of the reference; by default that of the plant."""
    if e_ref is None and kappa_ref is None:
        return plant
    e = None if e_ref is None else real("e_ref", e_ref)
    kappa = None if kappa_ref is None else real("kappa_ref", kappa_ref)
    try:
        return coefficients(e, kappa)[1]
    except ValueError as error:
        raise ValueError(re.sub(r"\b(e|kappa)\b", r"\1_ref", str(error))) from None


def horizon_of(landing: Any, ahead: Any) -> int:
    """Return the horizon of a contact-establishing law in periods."""
    switch("landing", landing)
    periods = integer("ahead", ahead)
    if not 1 <= periods <= MAX_AHEAD:
        raise ValueError(
            f"ahead must be >= 1 (1 + the periods of delay) and at most {MAX_AHEAD:.0e}, "
            f"got {ahead}"
        )
    if periods > 1 and not landing:
        raise ValueError(f"ahead must be 1 with landing=False, got {ahead}")
    return periods


def delay_of(delay: Any, ahead: int = 1) -> int:
    """Return the delay of a controller that predicts."""
    periods = integer("delay", delay)
    if not 0 <= periods <= MOST_DELAY:
        raise ValueError(f"delay must be from 0 to {MOST_DELAY} periods, got {delay}")
    if periods and ahead != 1:
        raise ValueError(
            f"ahead must not be set with delay = {periods}, which predicts the state, got {ahead}"
        )
    return periods


def quiet_of(landing: Any, quiet: Any) -> float:
    """Return the dead zone of a contact-establishing law; its range is checked in the core."""
    zone = real("quiet", quiet)
    if zone != 0.0 and not landing:
        raise ValueError(f"quiet must be 0 with landing=False, got {zone}")
    return zone
