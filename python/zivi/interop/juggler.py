"""A juggler for people who learn controllers: an environment of gymnasium."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import finite, integer
from zivi.base.extras import needed
from zivi.system.mass import coefficients

if TYPE_CHECKING:
    import gymnasium

__all__ = ["juggler"]

GRAVITY = 9.81


def juggler(
    *,
    e: float = 0.7,
    h: float = 0.02,
    height: float = 0.5,
    u_max: float = 5.0,
    steps: int = 500,
) -> gymnasium.Env[Any, Any]:
    r"""Make an environment: keep a ball bouncing to a height, by a bounded acceleration.

    .. math:: \ddot x = -9.81 + u, \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    The control is held over a period, in which the motion is exact, through any number of impacts
    and through Zeno points. Impacts dissipate energy, which the control must restore in time. It
    passes gymnasium's own checker.

    Parameters
    ----------
    e : float
        Coefficient of restitution, in [0, 1].
    h : float
        Period of a step, > 0 (s).
    height : float
        The height to which the ball shall bounce, > 0 (m).
    u_max : float
        The largest control, > 0 (m/s^2).
    steps : int
        Steps of an episode, >= 1; it is truncated then, and never ends before.

    Returns
    -------
    gymnasium.Env
        Action: one number in [-1, 1], the control as a part of `u_max`. Observation: ``x / height``
        and ``xdot`` as a part of the speed of a fall from there. Reward: minus the relative error
        of the energy, at best 0. ``info``: time ``t`` (s), control ``u`` (m/s^2), number of
        ``impacts`` of the step, and whether the control is ``saturated``: an action outside [-1, 1]
        is clipped. ``reset(options={"y0": (x, xdot)})`` starts from a state, else a random one. An
        action that is not finite is rejected. It pickles.

    Raises
    ------
    ImportError
        If gymnasium is missing, the extra ``gym``.
    ValueError, TypeError
        For an argument out of range.

    See Also
    --------
    zivi.Striker : a controller for this task.

    Examples
    --------
    >>> env = zivi.interop.juggler(e=0.5)
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step([0.5])
    >>> info["u"], terminated
    (2.5, False)
    """
    wall = coefficients(finite("e", e), None)
    positive = {"h": h, "height": height, "u_max": u_max}
    numbers = {name: finite(name, value) for name, value in positive.items()}
    for name, value in numbers.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be > 0, got {value}")
    if integer("steps", steps) < 1:
        raise ValueError(f"steps must be >= 1, got {steps}")
    made: gymnasium.Env[Any, Any] = _juggler()(wall, steps=steps, **numbers)
    return made


@functools.cache
def _juggler() -> type[Any]:
    """Make the class, which needs its base."""
    gym: Any = needed("gymnasium", "environments")

    class Juggler(gym.Env):  # type: ignore[misc]
        """A ball above a wall, and a bounded acceleration."""

        metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 gymnasium's name

        def __init__(
            self, wall: tuple[float, float], *, h: float, height: float, u_max: float, steps: int
        ) -> None:
            self._wall = wall
            self._restitution = _zivi.Restitution.of_both(*wall)
            self._h, self._steps, self._u_max = h, steps, u_max
            self._height, self._speed = height, math.sqrt(2.0 * GRAVITY * height)
            self._state, self._k = (height, 0.0), 0
            low = np.array([0.0, -np.inf], np.float32)
            high = np.array([np.inf, np.inf], np.float32)
            self.observation_space = gym.spaces.Box(low, high, dtype=np.float32)
            self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

        def __reduce__(self) -> tuple[Any, ...]:
            state = {name: it for name, it in self.__dict__.items() if name != "_restitution"}
            made = (self._wall, self._h, self._height, self._u_max, self._steps)
            return _rebuilt, made, state

        def _observed(self) -> Any:
            x, xdot = self._state
            return np.array([x / self._height, xdot / self._speed], np.float32)

        def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
            super().reset(seed=seed)
            start = (options or {}).get("y0")
            if start is None:
                drawn = self.np_random.uniform((0.2, -0.5), (1.5, 0.5))
                start = drawn * (self._height, self._speed)
            x, xdot = (finite("y0", float(it)) for it in start)
            if x < 0.0:
                raise ValueError(f"y0 must have x >= 0, got {x}")
            self._state, self._k = (x, xdot), 0
            return self._observed(), {"t": 0.0, "u": 0.0, "impacts": 0, "saturated": False}

        def step(self, action: Any) -> tuple[Any, float, bool, bool, Any]:
            number = np.ravel(action)
            if number.size != 1 or not np.isfinite(number[0]):
                raise ValueError(f"action must be one finite number, got {action!r}")
            u = self._u_max * float(np.clip(number[0], -1.0, 1.0))
            row = np.array([[*self._state, u - GRAVITY, self._h]])
            end = _zivi.ballistic_motion(row, self._restitution)
            x, xdot, impacts = (float(it[0]) for it in (end.x, end.xdot, end.n_impacts))
            self._state, self._k = (x, xdot), self._k + 1
            energy = (0.5 * xdot * xdot + GRAVITY * x) / (GRAVITY * self._height)
            info = {"t": self._k * self._h, "u": u, "impacts": int(impacts)}
            info["saturated"] = bool(abs(number[0]) > 1.0)
            return self._observed(), -abs(energy - 1.0), False, self._k >= self._steps, info

    return Juggler


def _rebuilt(
    wall: tuple[float, float], h: float, height: float, u_max: float, steps: int
) -> gymnasium.Env[Any, Any]:
    made: gymnasium.Env[Any, Any] = _juggler()(wall, h=h, height=height, u_max=u_max, steps=steps)
    return made
