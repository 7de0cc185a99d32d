"""Equality rows of mechanical systems: closed chains and prescribed motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, all_of, read_only
from zivi.base.habits import hinted
from zivi.system.gap import Unchanging, own
from zivi.system.model_parts import (
    Compiled,
    Evaluation,
    Part,
    differenced,
    evaluated,
    number_part,
    part,
)


@hinted("Equality")
class Equality(Unchanging):
    r"""An equation between the coordinates, kept exactly: a joint that closes a chain, or a drive.

    .. math::

        \varphi(t, q) = 0, \qquad G \dot q + \varphi_t = 0, \qquad G \ddot q + c = 0,
        \qquad c = \dot q^T H \dot q + 2 \varphi_{tq} \dot q + \varphi_{tt}

    with the gradient :math:`G` and the matrix :math:`H` of second derivatives. The row acts on the
    system with the force :math:`G^T \mu`, whose multiplier :math:`\mu` is in
    ``constraint_forces`` of a result. A coordinate that moves as prescribed has
    :math:`\varphi = q_i - s(t)`.

    Parameters
    ----------
    value : callable, float or compiled
        :math:`\varphi`: ``value(t, q) -> float``, or compiled as the parts of a
        `MechanicalSystem`. A number c with a constant gradient: :math:`\varphi = G q + c`.
    gradient : array_like, callable or compiled
        :math:`G`, of shape (n,): an array, ``gradient(t, q)``, or compiled.
    curvature : callable, float or None
        ``curvature(t, q, qdot) -> float``, the number :math:`c`. By default it is
        finite-differenced from gradient and rate, to about 1e-10 of its terms.
    rate : callable, float or None
        ``rate(t, q) -> float``, the derivative :math:`\varphi_t` with respect to time. Default 0;
        a row that depends on time needs it.
    name : str
        Name in results, tables and errors. Default ``"pin"``.

    Raises
    ------
    ValueError, TypeError
        If a part is neither a number, an array nor callable, or a number is not finite.

    See Also
    --------
    zivi.consistent : move a state onto the equality rows.
    zivi.symbolic.system : rows as formulas, with all derivatives generated.

    Notes
    -----
    The rows are eliminated from the equations of motion and of impacts; the state is projected
    onto them after each step and impact, in the metric of the masses. Dependent rows are allowed
    where they agree: of all multipliers those of least norm are reported.

    References
    ----------
    E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, chapter VII.

    Examples
    --------
    A pendulum of 1 m in Cartesian coordinates:

    >>> rod = zivi.Equality(
    ...     lambda t, q: 0.5 * (q @ q - 1.0),
    ...     lambda t, q: q,
    ...     curvature=lambda t, q, qdot: qdot @ qdot,
    ...     name="rod",
    ... )
    >>> pendulum = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], equalities=[rod])
    >>> sol = zivi.simulate(pendulum, (0, 3), ([1.0, 0.0], [0.0, 0.0]))
    >>> bool(abs(np.hypot(*sol.q.T) - 1.0).max() < 1e-14)
    True
    """

    def __init__(
        self,
        value: Callable[[float, Array], float] | float | Any,
        gradient: Callable[[float, Array], ArrayLike] | ArrayLike | Any,
        curvature: Callable[[float, Array, Array], float] | float | Any | None = None,
        rate: Callable[[float, Array], float] | float | Any | None = None,
        name: str = "pin",
    ) -> None:
        self.value, self.gradient = value, own(gradient)
        self.curvature, self.rate = curvature, rate
        self._name = str(name)
        called = f"equality {self._name!r}"
        row = part(f"gradient of {called}", gradient, "t, q")
        self._row: Part = row
        if isinstance(row, np.ndarray):
            self._row = read_only(np.atleast_1d(row))
            if self._row.ndim != 1 or not np.any(self._row):
                raise ValueError(
                    f"gradient of {called} must be a vector, not zero, got {row.tolist()}"
                )
        self._phi = self._value_part(called, value)
        self._phi_t = number_part(f"rate of {called}", 0.0 if rate is None else rate, "t, q")
        self._bias = (
            differenced(self._row, self._phi_t)
            if curvature is None
            else number_part(f"curvature of {called}", curvature, "t, q, qdot")
        )

    def _value_part(self, called: str, value: Any) -> Part:
        """Read the value; a number is the constant of a linear row."""
        read = number_part(f"value of {called}", value, "t, q")
        if not isinstance(read, np.ndarray):
            return read
        row, constant = self._row, float(read)
        if not isinstance(row, np.ndarray):
            raise TypeError(
                f"value of {called} must be a function (t, q), got {value!r}; a number needs a "
                "gradient that is an array"
            )
        return lambda t, q: float(row @ q) + constant

    @property
    def name(self) -> str:
        """Name in results, tables and errors."""
        return self._name

    def _parts(self) -> tuple[Part, Part, Part, Part]:
        """Return value, gradient, curvature and rate."""
        return self._phi, self._row, self._bias, self._phi_t

    def _is_flat(self) -> bool:
        """Whether the gradient is constant."""
        return isinstance(self._row, np.ndarray)

    def in_modes(self, shapes: Array) -> Equality:
        """Return the row of modal amplitudes; its gradient must be an array."""
        value, rate, bias = evaluated(self._phi, 0), evaluated(self._phi_t, 0), self._bias
        if isinstance(bias, Compiled):
            raise TypeError(f"curvature of equality {self._name!r} must not be compiled here")

        def curvature(t: float, q: Array, qdot: Array) -> float:
            if isinstance(bias, np.ndarray):
                return float(bias)
            return float(bias(t, shapes @ q, shapes @ qdot))

        return Equality(
            lambda t, q: float(value(t, shapes @ q, q)),
            np.asarray(self._row) @ shapes,
            curvature,
            lambda t, q: float(rate(t, shapes @ q, q)),
            self._name,
        )

    def __repr__(self) -> str:
        return f"Equality(name={self._name!r})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("value", "gradient", "curvature", "rate", "name")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Equality.__init__(self, **state)


def equalities_of(given: Any) -> tuple[Equality, ...]:
    """Read the equality rows: one or a sequence."""
    return all_of("equalities", given, Equality)


# Whether a state obeys the rows.

AGREES = 1e-6
"""What a row may leave at the start, relative to its terms: it is projected away."""
FLOOR = 1e-9
"""The same where the terms are smaller than one."""


def violations(here: Evaluation, q: Array, qdot: Array) -> tuple[Array, Array]:
    """Return what positions and velocities leave of the rows, in units of what may be left.

    Parameters
    ----------
    here : Evaluation
        The system at the state.
    q, qdot : ndarray
        The state, of shape (n,).

    Returns
    -------
    (ndarray, ndarray)
        Of shape (k,): 1 is the most that is allowed.
    """
    sizes = np.abs(here.equality_gradients).sum(axis=1)
    positions = sizes * np.max(np.abs(q), initial=0.0)
    speeds = sizes * np.max(np.abs(qdot), initial=0.0) + np.abs(here.equality_rates)
    floor = FLOOR * np.maximum(sizes, 1.0)
    rates = here.equality_gradients @ qdot + here.equality_rates
    far = np.abs(here.equalities) / (AGREES * positions + floor)
    return far, np.abs(rates) / (AGREES * speeds + floor)


def check_equalities(names: tuple[str, ...], here: Evaluation, q: Array, qdot: Array) -> None:
    """Raise a ValueError that names the row which a start does not obey."""
    remedy = "; use zivi.consistent(system, q, qdot) to move the state onto the rows"
    far, fast = violations(here, q, qdot)
    for name, value, part_of in zip(names, here.equalities, far, strict=True):
        if not part_of <= 1.0:
            raise ValueError(
                f"q0 must obey equality {name!r}, whose value is {value:.6g} at the start{remedy}"
            )
    rates = here.equality_gradients @ qdot + here.equality_rates
    for name, rate, part_of in zip(names, rates, fast, strict=True):
        if not part_of <= 1.0:
            raise ValueError(
                f"qdot0 must obey equality {name!r}, whose rate is {rate:.6g} at the start{remedy}"
            )
