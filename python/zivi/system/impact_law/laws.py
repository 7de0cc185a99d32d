"""Impact laws of a few numbers, and the base class of all."""

from __future__ import annotations

import dataclasses
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array


@dataclasses.dataclass(frozen=True)
class ImpactLaw:
    r"""Speed after an impact: base class of `NewtonImpact` and the other laws.

    .. math:: \dot x^+ = e(v)\,v, \qquad v = -\dot x^- > 0, \qquad 0 \le e(v) \le 1

    A law is given to `ImpactSystem` or `MechanicalSystem` as its `e`.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, real(field.name, getattr(self, field.name)))
        _ = self._core

    @property
    def _core(self) -> _zivi.ImpactLaw:
        """The law for the core, created once."""
        made: _zivi.ImpactLaw | None = self.__dict__.get("_made")
        if made is None:
            values = [getattr(self, field.name) for field in dataclasses.fields(self)]
            made = self.__dict__["_made"] = _zivi.ImpactLaw(type(self).__name__, values)
        return made

    def __getstate__(self) -> dict[str, Any]:
        # the object of the core is created again
        return {name: value for name, value in self.__dict__.items() if name != "_made"}

    @property
    def limit(self) -> float:
        """The coefficient of restitution of slow impacts, in the limit ``v -> 0``.

        Between 0 and 1 impacts accumulate as a geometric chain, whose end is extrapolated; with 1
        they do not accumulate; with 0 faster than any such chain.
        """
        limit = self._core.limit
        return np.nan if limit is None else limit

    def after(self, v: ArrayLike) -> Array:
        """Return the speed after an impact (m/s).

        Parameters
        ----------
        v : array_like
            Speed before it, >= 0 (m/s), any shape.

        Returns
        -------
        ndarray
            Of the shape of `v`.

        Raises
        ------
        ValueError
            If a speed is negative or not finite.

        Examples
        --------
        >>> zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25).after([1.0, 16.0])
        array([0.5, 4. ])
        """
        return self._at(v, self._core.after)

    def slope(self, v: ArrayLike) -> Array:
        """Return the derivative of the speed after an impact by the speed `v` before it."""
        return self._at(v, self._core.slope)

    def _described(self) -> dict[str, Any]:
        """Return plain values that describe the law."""
        return {"name": type(self).__name__, **dataclasses.asdict(self)}

    def _scaled(self, factor: float) -> Self:
        """Return the law with its first coefficient multiplied."""
        first = dataclasses.fields(self)[0].name
        return dataclasses.replace(self, **{first: factor * getattr(self, first)})

    def _at(self, v: ArrayLike, of: Any) -> Array:
        speeds = real_array("v", v)
        if not (np.all(speeds >= 0.0) and np.all(np.isfinite(speeds))):
            raise ValueError("v must be finite and >= 0, a speed")
        at: Array = np.where(speeds > 0.0, of(np.ravel(speeds)).reshape(speeds.shape), 0.0)
        return at


@dataclasses.dataclass(frozen=True)
class NewtonImpact(ImpactLaw):
    r"""Newton's impact law: one coefficient of restitution for all speeds.

    .. math:: \dot x^+ = -e\,\dot x^-

    ``zivi.ImpactSystem(force, e=zivi.NewtonImpact(0.5))`` is ``zivi.ImpactSystem(force, e=0.5)``.

    Parameters
    ----------
    e : float
        Coefficient of restitution in [0, 1]: 0 plastic, 1 elastic.

    Raises
    ------
    ValueError
        If `e` is out of range.

    See Also
    --------
    SpeedDependentImpact : restitution that depends on the speed.
    Restitution : restitution as a function of the speed.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    >>> zivi.NewtonImpact(0.5).limit
    0.5
    """

    e: float


@dataclasses.dataclass(frozen=True)
class SpeedDependentImpact(ImpactLaw):
    r"""A coefficient of restitution that is a power of the speed of the impact.

    .. math:: \dot x^+ = -e(v)\,\dot x^-, \qquad v = -\dot x^-, \qquad
              e(v) = \min\!\left(e_0\,(v/v_0)^{-k},\ e_{\max}\right)

    With ``k > 0`` fast impacts lose the larger share, for example in a contact that yields: ``k =
    1/4`` for a sphere far above the yield point (Johnson, Contact Mechanics, 1985, section 11.5).
    Without the cap :math:`e_{\max} \le 1` slow ones would gain energy.

    The limit of slow impacts, `limit` = :math:`e` as :math:`v \to 0`, decides about rest:

    - ``k > 0`` and ``e_max = 1``: the limit is 1. Speeds fall to
      :math:`v_* = v_0 e_0^{1/k}`, below which nothing is lost: the mass keeps bouncing with flights
      of :math:`2 v_*/g`, impacts do not accumulate, and it never rests.
    - ``k > 0`` and ``e_max < 1``: from :math:`v_0 (e_0/e_{\max})^{1/k}` down the law is Newton's
      with ``e_max``. The chain of impacts is geometric there, and a run jumps over it as usual.
    - ``k < 0``: the limit is 0. Below :math:`v_*` (above it, with ``e_max = 1``, impacts are
      lossless) each impact loses a larger share than the previous one, so that the times of flight
      sum up faster than any geometric series. There is no jump: a run computes the few impacts
      until what is left of their time is below rounding, and rests.

    `SwitchedRK` supports the law in `simulate`, `simulate_batch` and `sensitivity`, for a mass and
    for mechanical systems. All other functions require Newton's law and raise an error.

    Parameters
    ----------
    e0 : float
        Coefficient of restitution at `v0`, in [0, 1].
    v0 : float
        Speed, > 0 (m/s).
    k : float
        Exponent, < 1: from 1 on a faster impact would have no faster rebound.
    e_max : float
        Largest coefficient, from `e0` to 1: that of slow impacts for ``k > 0``, of fast ones for
        ``k < 0``.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    NewtonImpact : constant restitution.
    Restitution : any function of the speed.

    References
    ----------
    T. Schwager and T. Poeschel, Coefficient of normal restitution of viscous particles and cooling
    rate of granular gases, Phys. Rev. E 57, 1998.

    K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.

    Examples
    --------
    >>> law = zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25)
    >>> law.limit
    1.0
    >>> ball = zivi.ImpactSystem(-9.81, e=law)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
    >>> bool(sol.success), sol.rest_time, len(sol.zeno_times)  # bounces for good
    (True, None, 0)
    >>> round(float(sol.impacts["xdot_after"][-1]), 4)  # v0 e0^(1/k) = 1/16
    0.0625
    """

    e0: float
    v0: float
    k: float
    e_max: float = 1.0


def law_parameters(law: ImpactLaw) -> dict[str, float]:
    """Names and values of the parameters of a law."""
    return {field.name: getattr(law, field.name) for field in dataclasses.fields(law)}
