"""States moved onto the equality rows of a system."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.system.constraints.equality import violations
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation

ITERATIONS = 50
"""Newton steps of a projection at most."""
NOTHING = 1e-12
"""A row whose gradient is below this part of the largest has none but rounding."""
DEPENDENT = 1e-10
"""A row of which the others leave less than this part of `D_aa` follows from them."""


def consistent(
    system: MechanicalSystem, q: ArrayLike, qdot: ArrayLike | None = None, t: float = 0.0
) -> tuple[Array, Array]:
    r"""Project a state onto the equality rows of a system.

    .. math::

        q \leftarrow q - M^{-1} G^T (G M^{-1} G^T)^+ \varphi, \qquad
        \dot q \leftarrow \dot q - M^{-1} G^T (G M^{-1} G^T)^+ (G \dot q + \varphi_t)

    Parameters
    ----------
    system : MechanicalSystem
        The system with its equality rows.
    q : array_like
        Coordinates, of shape (n,), near a configuration that obeys the rows.
    qdot : array_like, optional
        Velocities, of shape (n,). Default 0.
    t : float
        Time (s). Default 0.

    Returns
    -------
    (ndarray, ndarray)
        Coordinates and velocities, of shape (n,), that obey the rows to rounding. The velocities
        are the nearest in the metric of the masses, those after an impulse of the rows.

    Raises
    ------
    ValueError
        If the iteration finds no configuration: start it nearer, or check the rows.

    See Also
    --------
    zivi.Equality : a row.

    Notes
    -----
    Newton's method, at most 50 iterations; the velocities need one. Dependent rows are allowed.

    References
    ----------
    E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, section
    VII.2.

    Examples
    --------
    >>> circle = zivi.Equality(lambda t, q: q @ q - 1.0, lambda t, q: 2.0 * q, name="circle")
    >>> bead = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], equalities=[circle])
    >>> q, qdot = zivi.consistent(bead, [0.6, 0.81], [1.0, 0.0])
    >>> q.round(4), qdot.round(4)
    (array([0.5952, 0.8036]), array([ 0.6457, -0.4783]))
    """
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a mechanical system, got {type(system).__name__}")
    position = np.atleast_1d(real_array("q", q)).astype(float)
    velocity = np.zeros_like(position)
    if qdot is not None:
        velocity = np.atleast_1d(real_array("qdot", qdot)).astype(float)
    time = finite("t", t)
    if not np.isfinite(position).all() or not np.isfinite(velocity).all():
        raise ValueError("q and qdot must be finite")
    here = system.at(time, position, velocity)
    last = np.inf
    for _ in range(ITERATIONS):
        size = float(np.max(np.abs(here.equalities), initial=0.0))
        # as near as rounding lets it come
        if size == 0.0 or (size >= 0.5 * last and _obeys_rows(here, position)):
            break
        last = size
        # off the rows, rows that follow from others on them differ by the square of the distance
        apart = size / (1.0 + float(np.max(np.abs(position))))
        cut = min(max(DEPENDENT, 100.0 * apart**2), 1e-2)
        position = position - _pull(here, here.equalities, cut)
        here = system.at(time, position, velocity)
    else:
        _fail(system, here.equalities)
    if not _obeys_rows(here, position):
        _fail(system, here.equalities)
    for _ in range(2):
        left = here.equality_gradients @ velocity + here.equality_rates
        velocity = velocity - _pull(here, left)
    if not np.all(violations(here, position, velocity)[1] <= 1.0):
        _fail(system, here.equality_gradients @ velocity + here.equality_rates, "rates")
    return position, velocity


def _obeys_rows(here: Evaluation, q: Array) -> bool:
    return bool(np.all(violations(here, q, np.zeros_like(q))[0] <= 1.0))


def _pull(here: Evaluation, right: Array, cut: float = DEPENDENT) -> Array:
    """Return what the rows move by their values: rows that follow from others are left out."""
    gradients = here.equality_gradients
    moved = np.zeros(gradients.shape[1])
    if not len(gradients):
        return moved
    mobility = np.linalg.solve(here.mass, gradients.T)
    d = gradients @ mobility
    basis = _independent(d, cut)
    if not basis:
        return moved
    scale = 1.0 / np.sqrt(np.diag(d)[basis])
    scaled = scale[:, None] * d[np.ix_(basis, basis)] * scale
    moved += mobility[:, basis] @ (scale * np.linalg.solve(scaled, scale * right[basis]))
    return moved


def _independent(d: Array, cut: float) -> list[int]:
    """Choose rows from which the others follow, by a Cholesky factor with pivots."""
    diagonal = np.diag(d)
    acts = diagonal > NOTHING**2 * np.max(diagonal)
    left, factor = np.where(acts, 1.0, 0.0), np.zeros((len(d), 0))
    chosen: list[int] = []
    scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros(len(d)), where=acts)
    while len(chosen) < len(d) and np.max(left) >= cut:
        # of rows that are as independent the one with the largest gradient
        near = left >= 0.5 * np.max(left)
        pivot = int(np.argmax(np.where(near, diagonal, -1.0)))
        column = scale * d[:, pivot] * scale[pivot] - factor @ factor[pivot]
        column /= np.sqrt(left[pivot])
        factor, left = np.column_stack([factor, column]), left - column**2
        left[pivot] = 0.0
        chosen.append(pivot)
    return chosen


def _fail(system: MechanicalSystem, left: Array, what: str = "values") -> None:
    told = ", ".join(
        f"{name!r} {value:.6g}" for name, value in zip(system.equality_names, left, strict=True)
    )
    raise ValueError(
        f"q must be near a state that obeys all equality rows, got the {what} {told} after the "
        "projection; start nearer, or remove rows that contradict each other"
    )
