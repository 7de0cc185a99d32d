"""Linear systems of several coordinates, from matrices or from modal data, and their loads."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, integer, read_only, real_array
from zivi.base.habits import hinted
from zivi.system.gap import DryFriction, Gap, LinearGap, MovingWall, joints_of
from zivi.system.impact_law import GivenRestitutions, written
from zivi.system.mechanism import MechanicalSystem, Model, check_names
from zivi.system.model_parts import Equality, Layout, equalities_of
from zivi.system.table import Table, declared_breaks

# Loads of linear systems: constants, waves, tables.


@hinted("Harmonic")
@dataclasses.dataclass(frozen=True, eq=False)
class Harmonic:
    r"""A harmonic load, :math:`p \cos(\omega t + \varphi)`.

    Parameters
    ----------
    amplitude : array_like
        :math:`p`, a force for each coordinate, shape (n,).
    omega : float
        :math:`\omega` (rad/s).
    phase : float
        :math:`\varphi` (rad).

    Raises
    ------
    ValueError
        If a number is not finite.

    See Also
    --------
    Table : tabulated loads.
    LinearSystem : the argument ``excitation``.

    Notes
    -----
    The load enters the power series of a flight exactly; it limits the step to two radians of its
    phase.

    Examples
    --------
    >>> zivi.Harmonic([0.0, 2.0], 3.0)
    Harmonic(amplitude=[0.0, 2.0], omega=3.0, phase=0.0)
    """

    amplitude: ArrayLike
    omega: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        amplitude = np.atleast_1d(real_array("amplitude", self.amplitude))
        if amplitude.ndim != 1 or not np.all(np.isfinite(amplitude)):
            raise ValueError(f"amplitude must be a finite vector, got {amplitude.tolist()}")
        object.__setattr__(self, "amplitude", read_only(amplitude))
        for name in ("omega", "phase"):
            object.__setattr__(self, name, finite(name, getattr(self, name)))

    def __repr__(self) -> str:
        amplitude = np.asarray(self.amplitude).tolist()
        return f"Harmonic(amplitude={amplitude}, omega={self.omega}, phase={self.phase})"


Excitation: TypeAlias = "ArrayLike | Harmonic | Table | Sequence[ArrayLike | Harmonic | Table]"
"""A constant load (n,), a `Harmonic`, a `Table` of shape (k, n), or several of them."""


def parts_of(excitation: Any, n: int) -> tuple[Array | Harmonic | Table, ...]:
    """Read the parts of a load and check their sizes."""
    if excitation is None:
        return ()
    named = (Harmonic, Table)
    several = isinstance(excitation, list | tuple) and any(
        isinstance(it, named) or np.ndim(it) > 0 for it in excitation
    )
    parts: list[Array | Harmonic | Table] = []
    for part in excitation if several else [excitation]:
        if isinstance(part, Harmonic):
            size: tuple[int, ...] = np.shape(part.amplitude)
        elif isinstance(part, Table):
            size = (part.width or 1,)
        else:
            part = np.atleast_1d(real_array("excitation", part))
            if not np.all(np.isfinite(part)):
                raise ValueError(f"excitation must be finite, got {part.tolist()}")
            size = part.shape
        if size != (n,):
            raise ValueError(f"excitation must have a number for each of {n} loads, got {part!r}")
        parts.append(part)
    return tuple(parts)


def projected(part: Array | Harmonic | Table, shapes: Array) -> Array | Harmonic | Table:
    """Return the modal load of a part."""
    if isinstance(part, Harmonic):
        return dataclasses.replace(part, amplitude=shapes.T @ np.asarray(part.amplitude))
    if isinstance(part, Table):
        values = part.values.reshape(len(part.times), -1) @ shapes
        return Table(part.times, values, part.kind, part.extend)
    modal: Array = shapes.T @ part
    return modal


# Linear systems of several coordinates, from their matrices or from modal data.


@hinted("LinearSystem")
class LinearSystem(MechanicalSystem):
    r"""A linear system from its matrices, within linear gaps.

    .. math:: M \ddot q + C \dot q + K q = p(t) + \sum_i \lambda_i n_i, \qquad
        0 \le \lambda_i \perp g_i = n_i \cdot q + c_i - w_i(t) \ge 0

    A `MechanicalSystem` that needs no interpreter; impacts, accumulations, rest and lift-off as
    there.

    Parameters
    ----------
    M, C, K : array_like
        Mass, symmetric and positive definite, damping and stiffness, shape (n, n); numbers for one
        coordinate. `C` need not be proportional (nor symmetric: gyroscopic terms), `K` may be
        singular. None for `C` is no damping.
    excitation : array_like, Harmonic, Table, or a sequence of them
        The load :math:`p(t)`, a sum: constants of shape (n,), `Harmonic`, `Table` of n columns.
    gaps : sequence of LinearGap
        The gaps; walls may move (`HarmonicWall`, `Table`; with a `MovingWall` the interpreter is
        called).
    e : float or array_like
        As for `MechanicalSystem`.
    modes : int, optional
        So many modes of the lowest frequencies instead of all coordinates, of symmetric `K`: the
        coordinates of runs are then the modal amplitudes, :math:`q = \Phi \eta` with the columns
        of ``shapes``, :math:`\Phi^T M \Phi = 1`.
    coordinates : sequence of str, optional
        As for `MechanicalSystem`.
    equalities : sequence of Equality
        Rows with constant gradients that are kept exactly. Their matrices are factored once; forces
        are then evaluated by the interpreter.
    friction : sequence of DryFriction
        Dry friction in joints and on belts, for example ``DryFriction([1.0, 0.0], limit=0.8)``.
        Forces are then evaluated by the interpreter.

    Attributes
    ----------
    M, C, K : ndarray
        The matrices in the coordinates of runs.
    shapes : ndarray or None
        The shapes :math:`\Phi` of the modes, if the coordinates are their amplitudes.
    excitation : tuple
        The parts of the load.

    Raises
    ------
    ValueError, TypeError
        If a shape is another one, `M` is not positive definite, a number is not finite, or a gap is
        no `LinearGap`.

    See Also
    --------
    MechanicalSystem : nonlinear systems.
    response_amplitude : the response without impacts.

    Notes
    -----
    Flights are power series in the modes, or in all coordinates with their damping; steps turn the
    fastest mode by two radians. The cost of a step is :math:`O(n^2)`, and :math:`O(n)` for modal
    data.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    Two masses between springs, the second one before a stop:

    >>> system = zivi.LinearSystem(
    ...     np.eye(2), 0.02 * np.eye(2), [[2, -1], [-1, 2]],
    ...     excitation=zivi.Harmonic([1.0, 0.0], omega=0.95),
    ...     gaps=[zivi.LinearGap([0, -1], 0.5, name="stop")], e=0.7,
    ... )
    >>> sol = zivi.simulate(system, (0, 20), ([0, 0], [0, 0]))
    >>> len(sol.impacts) > 3
    True
    """

    derived = True

    def __init__(
        self,
        M: ArrayLike,
        C: ArrayLike | None,
        K: ArrayLike,
        *,
        excitation: Excitation | None = None,
        gaps: Sequence[LinearGap] = (),
        e: GivenRestitutions = 0.0,
        modes: int | None = None,
        coordinates: Sequence[str] | None = None,
        equalities: Sequence[Equality] = (),
        friction: Sequence[DryFriction] = (),
    ) -> None:
        mass = _square("M", M)
        n = len(mass)
        zero = np.zeros((n, n))
        matrices = mass, zero if C is None else _square("C", C, n), _square("K", K, n)
        shapes = None if modes is None else _lowest(matrices[0], matrices[2], modes)
        rows = _linear_rows(equalities)
        gaps = _linear_gaps(gaps)
        parts = parts_of(excitation, n)
        self._set(matrices, parts, gaps, e, coordinates, shapes, rows, joints_of(friction))

    def _set(
        self,
        matrices: tuple[Array, Array, Array],
        parts: tuple[Array | Harmonic | Table, ...],
        gaps: tuple[LinearGap, ...],
        e: Any,
        coordinates: Sequence[str] | None,
        shapes: Array | None,
        rows: tuple[Equality, ...] = (),
        joints: tuple[DryFriction, ...] = (),
    ) -> None:
        """Store checked arguments; with shapes, transform them to modal amplitudes."""
        self._shapes = None if shapes is None else read_only(shapes)
        if shapes is not None:
            mass, damping, stiffness = (shapes.T @ it @ shapes for it in matrices)
            matrices = mass, damping, stiffness
            parts = tuple(projected(part, shapes) for part in parts)
            gaps = tuple(gap.with_normal(gap.normal @ shapes) for gap in gaps)
            rows = tuple(row.in_modes(shapes) for row in rows)
            joints = tuple(joint.in_modes(shapes) for joint in joints)
        for array in (*matrices, *parts):
            if isinstance(array, np.ndarray):
                read_only(array)
        self._matrices, self._excitation = matrices, parts
        force = functools.partial(_load_vector, matrices, parts)
        super().__init__(
            mass=matrices[0],
            force=force,
            gaps=gaps,
            e=e,
            coordinates=coordinates,
            equalities=rows,
            friction=joints,
        )

    @property
    def M(self) -> Array:  # noqa: N802
        """The mass matrix in the coordinates of runs."""
        return self._matrices[0]

    @property
    def C(self) -> Array:  # noqa: N802
        """The damping matrix."""
        return self._matrices[1]

    @property
    def K(self) -> Array:  # noqa: N802
        """The stiffness matrix."""
        return self._matrices[2]

    @property
    def shapes(self) -> Array | None:
        """The shapes of the modes, if the coordinates are their amplitudes."""
        return self._shapes

    @property
    def excitation(self) -> tuple[Array | Harmonic | Table, ...]:
        """The parts of the load."""
        return self._excitation

    @classmethod
    def modal(
        cls,
        frequencies: ArrayLike,
        damping: ArrayLike,
        shapes: ArrayLike | None = None,
        *,
        excitation: Excitation | None = None,
        gaps: Sequence[LinearGap] = (),
        e: GivenRestitutions = 0.0,
    ) -> LinearSystem:
        r"""Make a system of modal data, whose coordinates are the modal amplitudes.

        .. math:: \ddot \eta_k + 2 \zeta_k \omega_k \dot \eta_k + \omega_k^2 \eta_k
            = \phi_k \cdot p(t), \qquad g_i = n_i \cdot \sum_k \phi_k \eta_k + c_i

        Parameters
        ----------
        frequencies : array_like
            :math:`\omega_k` (rad/s), >= 0, shape (r,).
        damping : float or array_like
            Damping ratios :math:`\zeta_k`, of shape (r,), or one for all.
        shapes : array_like, optional
            The mode shapes, normalised to modal masses of 1, at the points where there are gaps
            and loads: a column for each mode, shape (points, r). Gaps and excitation are given at
            these points. By default they are given in the modal amplitudes.
        excitation, gaps, e
            As for `LinearSystem`, with a number for each point.

        Raises
        ------
        ValueError
            If a shape is another one or a frequency is negative.

        Examples
        --------
        >>> blade = zivi.LinearSystem.modal(
        ...     [10.0, 62.0], 0.01, [[1.0, -1.0]],
        ...     excitation=zivi.Harmonic([5.0], omega=9.5),
        ...     gaps=[zivi.LinearGap([-1.0], 0.1, name="stop")], e=0.6,
        ... )
        >>> blade.K
        array([[ 100.,    0.],
               [   0., 3844.]])
        """
        omega = np.atleast_1d(real_array("frequencies", frequencies))
        ratio = real_array("damping", damping)
        if omega.ndim != 1 or not np.all(np.isfinite(omega)) or np.any(omega < 0):
            raise ValueError(f"frequencies must be finite and >= 0, got {omega.tolist()}")
        r = len(omega)
        if ratio.shape not in ((), (r,)) or not np.all(np.isfinite(ratio)):
            raise ValueError(f"damping must be finite, one number or {r}, got {ratio.tolist()}")
        matrices = np.eye(r), np.diag(2 * ratio * omega), np.diag(omega**2)
        at = np.eye(r) if shapes is None else np.atleast_2d(real_array("shapes", shapes))
        if at.ndim != 2 or at.shape[1] != r or not np.all(np.isfinite(at)):
            raise ValueError(
                f"shapes must be finite, a column for each of {r} modes, got {at.shape}"
            )
        points = len(at)
        parts = tuple(projected(part, at) for part in parts_of(excitation, points))
        at_points = []
        for gap in _linear_gaps(gaps):
            if gap.normal.shape != (points,):
                raise ValueError(
                    f"normals of gaps must have a number for each of {points} points, "
                    f"got {gap.normal.tolist()}"
                )
            at_points.append(gap.with_normal(gap.normal @ at))
        system = cls.__new__(cls)
        system._set(matrices, parts, tuple(at_points), e, None, None)
        system._shapes = None if shapes is None else read_only(at)
        return system

    @overload
    def at(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Any: ...
    @overload
    def at(self, *, omega: float) -> LinearSystem: ...
    @overload
    def at(self, *, omega: ArrayLike) -> Any: ...

    @hinted("at")
    def at(self, t: Any = None, q: Any = None, qdot: Any = None, *, omega: Any = None) -> Any:
        """Return the same system excited at another frequency, or evaluate it.

        Parameters
        ----------
        t, q, qdot
            Time and state (see `MechanicalSystem.at`), without `omega`.
        omega : float or array_like
            The angular frequency of its `Harmonic` loads (rad/s), which must be common to all; an
            array returns a list of systems for `simulate_batch`.

        Raises
        ------
        ValueError
            If there is no `Harmonic`, or they have different frequencies.
        """
        if omega is None:
            return super().at(t, q, qdot)
        if t is not None:
            raise TypeError("at must have a time and a state, or omega")
        known = {part.omega for part in self.excitation if isinstance(part, Harmonic)}
        if len(known) != 1:
            raise ValueError(
                "at(omega=...) needs Harmonic loads of one frequency, "
                f"got {sorted(known) if known else 'none'}"
            )
        values = real_array("omega", omega)
        if values.ndim == 0:
            return self._at_frequency(finite("omega", float(values)))
        return [self._at_frequency(finite("omega", float(it))) for it in values.ravel()]

    def replace(self, **changes: Any) -> LinearSystem:
        """Return the same system with other arguments.

        Parameters
        ----------
        **changes
            ``M``, ``C``, ``K``, ``excitation``, ``gaps``, ``e``, ``coordinates``, ``friction``,
            arguments of `LinearSystem`; for a modal system they refer to the modal amplitudes, like
            its attributes. Or ``omega``, the angular frequency of its `Harmonic` loads (rad/s; see
            `at`).

        Returns
        -------
        LinearSystem
            A new system; this one does not change.

        Raises
        ------
        KeyError
            For another name.
        ValueError, TypeError
            As for `LinearSystem` and `at`.

        Examples
        --------
        >>> load = zivi.Harmonic([1.0], omega=2.0)
        >>> system = zivi.LinearSystem([[1.0]], [[0.1]], [[4.0]], excitation=load)
        >>> system.replace(K=[[9.0]], omega=3.0).excitation[0].omega
        3.0
        """
        matrices = ("M", "C", "K")
        known = (
            *matrices,
            "excitation",
            "gaps",
            "e",
            "coordinates",
            "equalities",
            "friction",
            "omega",
        )
        check_names(changes, known)
        n, state = len(self.M), self.__getstate__()
        given = [
            np.zeros((n, n)) if changes.get(name, it) is None else changes.get(name, it)
            for name, it in zip(matrices, state["matrices"], strict=True)
        ]
        state["matrices"] = tuple(
            _square(name, it, n) for name, it in zip(matrices, given, strict=True)
        )
        if "excitation" in changes:
            state["parts"] = parts_of(changes["excitation"], n)
        if "gaps" in changes:
            state["gaps"] = _linear_gaps(changes["gaps"])
        if "equalities" in changes:
            state["rows"] = _linear_rows(changes["equalities"])
        if "friction" in changes:
            state["joints"] = joints_of(changes["friction"])
        state |= {name: changes[name] for name in ("e", "coordinates") if name in changes}
        new = object.__new__(type(self))
        new.__setstate__(state)
        return new if "omega" not in changes else new.at(omega=finite("omega", changes["omega"]))

    def _at_frequency(self, omega: float) -> LinearSystem:
        return self._with(
            tuple(
                dataclasses.replace(part, omega=omega) if isinstance(part, Harmonic) else part
                for part in self.excitation
            ),
            self._gaps,
        )

    def _with(
        self, excitation: tuple[Array | Harmonic | Table, ...], gaps: tuple[Gap, ...]
    ) -> LinearSystem:
        """Return a copy with other parts of the load and gaps, of the same kinds."""
        new = object.__new__(type(self))
        vars(new).update(vars(self))
        new._excitation, new._gaps = excitation, gaps
        new._force = functools.partial(_load_vector, self._matrices, excitation)
        new._given = {"mass": new.M, "force": new._force}
        new._kept_model = new._kept_mechanism = None
        return new

    def _new_model(self, n: int) -> Model:
        called = any(isinstance(getattr(gap, "motion", None), MovingWall) for gap in self._gaps)
        if called or self._equalities or self._joints:
            return super()._new_model(n)
        return Model.native(Layout(n, self.m), self._linear_spec())

    def _linear_spec(self) -> _zivi.Model:
        constants = [part for part in self.excitation if isinstance(part, np.ndarray)]
        waves = [part for part in self.excitation if isinstance(part, Harmonic)]
        tables = [part._core for part in self.excitation if isinstance(part, Table)]
        gaps = [
            (gap.normal.tolist(), gap.offset, None if gap.motion is None else gap.motion._spec())
            for gap in self._gaps
            if isinstance(gap, LinearGap)
        ]
        return _zivi.Model.linear(
            self.M.ravel().tolist(),
            self.C.ravel().tolist(),
            self.K.ravel().tolist(),
            load=np.sum([np.zeros(len(self.M)), *constants], axis=0).tolist(),
            waves=[(np.asarray(it.amplitude).tolist(), it.omega, it.phase) for it in waves],
            tables=tables,
            gaps=gaps,
        )

    def _breaks(self, span: tuple[float, float]) -> Array:
        walls = [getattr(gap, "motion", None) for gap in self._gaps]
        return declared_breaks(span, self.excitation, walls)

    def __getstate__(self) -> dict[str, Any]:
        return {
            "matrices": self._matrices,
            "parts": self._excitation,
            "gaps": self._gaps,
            "e": self._e,
            "coordinates": self._coordinates,
            "shapes": self._shapes,
            **({"rows": self._equalities} if self._equalities else {}),
            **({"joints": self._joints} if self._joints else {}),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        shapes = state["shapes"]
        self._set(**{**state, "shapes": None})
        self._shapes = None if shapes is None else read_only(shapes)

    def __repr__(self) -> str:
        gaps = ", ".join(self.gap_names)
        held = f", equalities=({', '.join(self.equality_names)})" if self._equalities else ""
        held += f", friction=({', '.join(self.channel_names)})" if self._joints else ""
        return f"LinearSystem(n={len(self.M)}, gaps=({gaps}), e={written(self._e)}{held})"


def _square(name: str, given: Any, n: int | None = None) -> Array:
    matrix = real_array(name, given)
    matrix = matrix.reshape(1, 1) if matrix.size == 1 else matrix
    size = len(matrix) if n is None else n
    if matrix.shape != (size, size) or not size:
        raise ValueError(f"{name} must have shape {(size, size)}, got {matrix.shape}")
    if not np.all(np.isfinite(matrix)):
        raise ValueError(f"{name} must be finite")
    return matrix


def _load_vector(
    matrices: tuple[Array, Array, Array],
    parts: Sequence[Array | Harmonic | Table],
    t: float,
    q: Array,
    qdot: Array,
) -> Array:
    """Return the forces, for a system that needs the interpreter because of a `MovingWall`."""
    _, damping, stiffness = matrices
    force: Array = -stiffness @ q - damping @ qdot
    for part in parts:
        if isinstance(part, Harmonic):
            force = force + np.asarray(part.amplitude) * np.cos(part.omega * t + part.phase)
        elif isinstance(part, Table):
            u = np.empty(part.width or 1)
            part._core.fill(t, u)
            force = force + u
        else:
            force = force + part
    return force


def _linear_gaps(gaps: Any) -> tuple[LinearGap, ...]:
    several = (gaps,) if isinstance(gaps, Gap) else tuple(gaps)
    for i, gap in enumerate(several):
        if not isinstance(gap, LinearGap):
            raise TypeError(f"gaps[{i}] must be a zivi.LinearGap, got {gap!r}")
        if gap._slips:
            raise NotImplementedError(
                f"gaps[{i}] must be without friction; use a zivi.MechanicalSystem for friction"
            )
    return several


def _linear_rows(equalities: Any) -> tuple[Equality, ...]:
    rows = equalities_of(equalities)
    for row in rows:
        if not row._is_flat():
            raise ValueError(
                f"equality {row.name!r} of a LinearSystem must have an array as gradient; use a "
                "zivi.MechanicalSystem for other rows"
            )
    return rows


def _lowest(mass: Array, stiffness: Array, modes: Any) -> Array:
    """Return the shapes of the modes of the lowest frequencies."""
    from scipy.linalg import eigh

    count, n = integer("modes", modes), len(mass)
    if not 1 <= count <= n:
        raise ValueError(f"modes must be from 1 to {n}, got {count}")
    if np.max(np.abs(stiffness - stiffness.T)) > 1e-10 * np.max(np.abs(stiffness), initial=0.0):
        raise ValueError("K must be symmetric to have modes")
    _, shapes = eigh(stiffness, mass, subset_by_index=(0, count - 1))
    return np.ascontiguousarray(shapes)
