"""Impact laws: the speed after an impact from the speed before it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array

__all__ = [
    "LAWS",
    "GivenRestitutions",
    "ImpactLaw",
    "NewtonImpact",
    "Restitutions",
    "SpeedDependentImpact",
    "core_of",
    "law_parameters",
    "laws_of",
    "restitutions",
    "written",
]


@dataclasses.dataclass(frozen=True)
class ImpactLaw:
    r"""What an impact does to the speed: base class of `NewtonImpact` and `SpeedDependentImpact`.

    .. math:: \dot x^+ = e(v)\,v, \qquad v = -\dot x^- > 0, \qquad 0 \le e(v) \le 1

    A law is given to `ImpactSystem` or `MechanicalSystem` as its `e`.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, real(field.name, getattr(self, field.name)))
        _ = self._core

    @property
    def _core(self) -> _zivi.ImpactLaw:
        """The law as the core takes it, made once."""
        made: _zivi.ImpactLaw | None = self.__dict__.get("_made")
        if made is None:
            values = [getattr(self, field.name) for field in dataclasses.fields(self)]
            made = self.__dict__["_made"] = _zivi.ImpactLaw(type(self).__name__, values)
        return made

    def __getstate__(self) -> dict[str, Any]:
        # what the core keeps is made anew
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
        """Give the speed after an impact (m/s).

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
        """Give the derivative of the speed after an impact by the speed `v` before it."""
        return self._at(v, self._core.slope)

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

    With ``k > 0`` fast impacts lose the larger part, as where a contact yields: ``k = 1/4`` for a
    sphere far above the yield point (Johnson, Contact Mechanics, 1985, section 11.5). Without the
    cap :math:`e_{\max} \le 1` slow ones would gain energy.

    What becomes of ever slower impacts is decided by `limit`, :math:`e` as :math:`v \to 0`:

    - ``k > 0`` and ``e_max = 1``: the limit is 1. Speeds fall to
      :math:`v_* = v_0 e_0^{1/k}`, below which nothing is lost: the mass bounces for good with
      flights of :math:`2 v_*/g`, impacts do not accumulate, and it never rests.
    - ``k > 0`` and ``e_max < 1``: from :math:`v_0 (e_0/e_{\max})^{1/k}` down the law is Newton's
      with ``e_max``. The chain of impacts is geometric there, and a run jumps over it as usual.
    - ``k < 0``: the limit is 0. Below :math:`v_*` (above it, with ``e_max = 1``, nothing is lost)
      each impact takes a larger part than the one before, so that the times of flight sum up faster
      than any geometric series. There is no jump: a run computes the few impacts until what is
      left of their time is below rounding, and rests.

    `SwitchedRK` takes the law in `simulate`, `simulate_batch` and `sensitivity`, of a mass and of
    mechanical systems. Everything else needs Newton's, and says so.

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


def law_class(name: str) -> type[ImpactLaw]:
    """Make the class of a law that only the core knows, from its parameters."""
    parameters = _zivi.IMPACT_LAWS[name]
    fields: list[Any] = [
        (it.name, float) if it.required else (it.name, float, dataclasses.field(default=it.default))
        for it in parameters
    ]
    told = "\n".join(f"{it.name}: {it.meaning} ({it.unit}), {it.range}." for it in parameters)
    kind = dataclasses.make_dataclass(name, fields, bases=(ImpactLaw,), frozen=True)
    kind.__doc__, kind.__module__ = f"The impact law {name} of the core.\n\n{told}", __name__
    return kind


LAWS: dict[str, type[ImpactLaw]] = {
    name: globals().get(name) or law_class(name) for name in _zivi.IMPACT_LAWS
}
"""The class of each law of the core."""
globals().update(LAWS)

GivenRestitutions: TypeAlias = float | ArrayLike | ImpactLaw | Sequence[float | ImpactLaw]
"""What `e` of a mechanical system may be: one for all gaps, or one for each."""

Restitutions: TypeAlias = Array | tuple[ImpactLaw, ...]
"""What the gaps have: coefficients, or laws where one is not Newton's."""


def restitutions(e: Any, m: int) -> Restitutions:
    """Read the coefficients of restitution or the laws of `m` gaps: one for all, one for each."""
    each = list(e) if isinstance(e, list | tuple) else [e]
    if all(isinstance(law, NewtonImpact) or not isinstance(law, ImpactLaw) for law in each):
        numbers = [law.e if isinstance(law, NewtonImpact) else law for law in each]
        return _coefficients(numbers if isinstance(e, list | tuple) else numbers[0], m)
    if not isinstance(e, list | tuple):
        each *= m
    if len(each) != m:
        raise ValueError(f"e must be one law or one for each of the {m} gaps, got {len(each)}")
    return tuple(
        law if isinstance(law, ImpactLaw) else NewtonImpact(real(f"e[{i}]", law))
        for i, law in enumerate(each)
    )


def _coefficients(e: Any, m: int) -> Array:
    given = real_array("e", e)
    if given.ndim == 0:
        given = np.full(m, float(given))
    if given.shape != (m,):
        raise ValueError(f"e must be one number or one for each of the {m} gaps, got {given.shape}")
    for i, value in enumerate(given):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"e[{i}] must be in [0, 1], got {value}")
    return given.copy()


def laws_of(e: Restitutions) -> tuple[ImpactLaw, ...]:
    """Give the law of each gap."""
    return e if isinstance(e, tuple) else tuple(map(NewtonImpact, e.tolist()))


def core_of(e: Restitutions) -> Array | list[_zivi.ImpactLaw]:
    """Give them as the core takes them."""
    return [law._core for law in e] if isinstance(e, tuple) else e


def written(e: Restitutions) -> str:
    """Write them, as ``(0.5, 0.3)``."""
    each = map(repr, e) if isinstance(e, tuple) else (f"{value:g}" for value in e)
    return f"({', '.join(each)})"


def law_parameters(law: ImpactLaw) -> dict[str, float]:
    """Names and values of the parameters of a law."""
    return {field.name: getattr(law, field.name) for field in dataclasses.fields(law)}
