"""Mechanical systems, and the model that calls functions for their variable parts only."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import math
import numbers
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import (
    Array,
    check_arguments,
    finite,
    of_three,
    read_only,
    real_array,
    switch,
)
from zivi.base.habits import attribute_error, hinted
from zivi.system.gap import (
    IMPACT_LAWS,
    PARADOXES,
    Channel,
    ContactLaw,
    DryFriction,
    Gap,
    HarmonicWall,
    LinearGap,
    MovingWall,
    Slip,
    compliant_gaps,
    joints_of,
    one_of,
)
from zivi.system.impact_law import (
    GivenRestitutions,
    ImpactLaw,
    Restitutions,
    core_of,
    laws_of,
    restitutions,
    written,
)
from zivi.system.mass import ImpactSystem, force_spec
from zivi.system.model_parts import (
    Compiled,
    Equality,
    Evaluation,
    Layout,
    Part,
    Partials,
    compiled_part,
    equalities_of,
    part,
)
from zivi.system.table import Table, declared_breaks

if TYPE_CHECKING:
    from zivi.base.machine_code import Native

# Parts of a system combined into one model, which calls functions for variable parts only.


Evaluate: TypeAlias = Callable[[float, Array, Array], Array]
"""``(t, q, qdot)`` to the row of a `Layout`, a new one at each call."""

# Forces of mechanical systems that take inputs from a table.

C_FORM = "void (double t, double *q, double *qdot, double *u, double *out)"


class DrivenForce(Compiled):
    """A compiled force with an additional argument, the inputs of a table."""

    def __init__(self, address: int, owner: object, inputs: Table) -> None:
        # the same arguments as those of a part with data: addresses, of which one more is given
        super().__init__(address, 0, owner)
        self.inputs = inputs


def driven(force: Any, inputs: Any) -> Part:
    """Return a force ``F(t, q, qdot, u)`` with its inputs as one of (t, q, qdot)."""
    if not isinstance(inputs, Table):
        raise TypeError(f"inputs must be a zivi.Table, got {inputs!r}")
    compiled = compiled_part("force", force)
    if compiled is not None:
        low_level = isinstance(force, tuple)  # of SciPy: its last argument is its own data
        if compiled.data is None or low_level:
            raise TypeError(f"force with inputs, compiled, must have the signature {C_FORM}")
        return DrivenForce(compiled.address, force, inputs)
    if not callable(force):
        raise TypeError(
            f"force must be a function (t, q, qdot, u) of the inputs, or compiled {C_FORM}, "
            f"got {type(force).__name__}"
        )
    check_arguments("force", force, "t, q, qdot, u")
    core, size = inputs._core, inputs.width or 1

    def evaluated(t: float, q: Array, qdot: Array) -> Any:
        u = np.empty(size)
        core.fill(t, u)
        return force(t, q, qdot, u)

    return evaluated


# The parts of a system as a model of the extension, which computes what needs no function.


@dataclasses.dataclass
class PartPlaces:
    """The row of an evaluation: constants in their places, functions for the others.

    Parameters
    ----------
    layout : Layout
        Numbers of coordinates, gaps and channels of friction.
    """

    layout: Layout

    def __post_init__(self) -> None:
        self.row = np.zeros(self.layout.size)
        self.views = self.layout.views(self.row)
        self.functions: list[_zivi.Part] = []

    def add(self, name: str, given: Part, view: Array, arguments: int = 3) -> None:
        """Write a constant into its place, or keep the function of a variable vector or matrix."""
        read = functools.partial(_read_array, name, view.shape)
        if isinstance(given, np.ndarray):
            view[...] = read(given).reshape(view.shape)
        else:
            self._call(given, view, view.shape, arguments, read)

    def add_number(self, name: str, given: Part, view: Array, arguments: int = 3) -> None:
        """Write a constant into its place, or keep the function of a variable number."""
        if isinstance(given, np.ndarray):
            view[0] = given[()]
        else:
            self._call(given, view, (), arguments, functools.partial(_read_number, name))

    def _call(
        self, given: Any, view: Array, shape: tuple[int, ...], arguments: int, read: Any
    ) -> None:
        start = (view.ctypes.data - self.row.ctypes.data) // self.row.itemsize
        if isinstance(given, DrivenForce):
            table = given.inputs._core
            found = _zivi.Part.driven(start, view.size, given.address, table)
        elif isinstance(given, Compiled):
            found = _zivi.Part.compiled(start, view.size, given.address, given.data)
        else:
            found = _zivi.Part.python(
                start, shape, given, takes_velocities=arguments == 3, read=read
            )
        self.functions.append(found)


def _read_array(name: str, shape: tuple[int, ...], result: Any) -> Array:
    """Read what a function returned; an error names the part."""
    one = math.prod(shape) == 1
    if np.shape(result) != shape and not (one and np.size(result) == 1):
        raise ValueError(f"{name} must have shape {shape}, got {np.shape(result)}")
    read = np.empty(shape)
    try:
        read[...] = np.reshape(result, shape) if one else result
    except (TypeError, ValueError):
        raise TypeError(f"{name} must hold real numbers, got {result!r}") from None
    return read.ravel()


def _read_number(name: str, result: Any) -> Array:
    read = np.empty(1)
    try:
        read[0] = result
    except (TypeError, ValueError):
        told = f"{name} must be one number, got {type(result).__name__}"
        if shape := np.shape(result):
            raise ValueError(f"{told} of shape {shape}") from None
        raise TypeError(told) from None
    return read


def model_of_parts(
    layout: Layout,
    mass: Part,
    force: Part,
    gaps: Sequence[Gap],
    slips: Sequence[tuple[Channel, Slip]] = (),
    equalities: Sequence[Equality] = (),
    *,
    steady: bool = False,
) -> _zivi.Model:
    """Return the model of parts: constants, flat gaps and belts call no function.

    Parameters
    ----------
    layout : Layout
        Numbers of coordinates, gaps and channels of friction.
    mass, force : Part
        Mass matrix and force.
    gaps : sequence of Gap
        The gaps.
    slips : sequence of (Channel, Slip)
        The channels of friction.
    equalities : sequence of Equality
        The equality rows.
    steady : bool
        Whether mass, force, gradients and rates are constants.

    Raises
    ------
    ValueError, TypeError
        If a constant has another shape; the error names the part.
    """
    places = PartPlaces(layout)
    places.add("mass", mass, places.views["mass"], 2)
    places.add("force", force, places.views["force"], 3)
    added = [_add_gap(places, i, gap) for i, gap in enumerate(gaps)]
    belts: list[tuple[int, _zivi.Wall]] = []
    for c, (channel, slip) in enumerate(slips):
        if isinstance(slip.motion, HarmonicWall):
            belts.append((c, slip.motion._spec()))
        _add_channel(places, c, channel, slip)
    for i, row in enumerate(equalities):
        _add_equality(places, i, row)
    is_flat = all(isinstance(gap, LinearGap) for gap in gaps)
    is_flat = is_flat and all(row._is_flat() for row in equalities)
    return _zivi.Model.parts(
        (layout.n, layout.m, layout.p, layout.k),
        places.row,
        gaps=[flat for flat in added if flat is not None],
        belts=belts,
        without_static=[c for c, (_, slip) in enumerate(slips) if slip.static is None],
        functions=places.functions,
        steady=steady,
        constant=isinstance(mass, np.ndarray) and is_flat and not slips,
        owner=(mass, force, tuple(gaps), tuple(slips), tuple(equalities)),
    )


FlatGap: TypeAlias = "tuple[int, list[float], float, _zivi.Wall | None]"
"""Number, normal, offset and moving wall of a flat gap."""


def _add_gap(places: PartPlaces, i: int, gap: Gap) -> FlatGap | None:
    """Add a gap; return the parts of a flat one."""
    views, called = places.views, f"of gap {gap.name!r}" if gap.name else f"of gap {i}"
    value, gradient, curvature, rate = gap._parts()
    if isinstance(gap, LinearGap):
        places.add(f"gradient {called}", gap.normal, views["gradients"][i])
        motion = gap.motion
        if isinstance(motion, MovingWall):
            places.functions.append(_zivi.Part.wall(i, motion._at))
            motion = None
        return i, gap.normal.tolist(), gap.offset, None if motion is None else motion._spec()
    places.add_number(f"value {called}", value, views["gaps"][i : i + 1], 2)
    places.add(f"gradient {called}", gradient, views["gradients"][i], 2)
    places.add_number(f"curvature {called}", curvature, views["curvatures"][i : i + 1])
    places.add_number(f"rate {called}", rate, views["rates"][i : i + 1], 2)
    return None


def _add_equality(places: PartPlaces, i: int, row: Equality) -> None:
    """Add the parts of an equality row."""
    value, gradient, curvature, rate = row._parts()
    called, views = f"of equality {row.name!r}", places.views
    one = slice(i, i + 1)
    places.add_number(f"value {called}", value, views["equalities"][one], 2)
    places.add(f"gradient {called}", gradient, views["equality_gradients"][i], 2)
    places.add_number(f"curvature {called}", curvature, views["equality_curvatures"][one])
    places.add_number(f"rate {called}", rate, views["equality_rates"][one], 2)


def _add_channel(places: PartPlaces, c: int, channel: Channel, slip: Slip) -> None:
    """Add the parts of a channel of friction."""
    own, row, held, most, k = (
        places.views[name][c : c + 1]
        for name in ("slip_rates", "tangents", "limits", "static_limits", "slip_curvatures")
    )
    at_gap = channel.gap is not None
    called = f"of gap {channel.name!r}" if at_gap else f"of friction {channel.name!r}"
    prefix, name = ("tangent_", "mu") if at_gap else ("", "limit")
    places.add(f"{'tangent' if at_gap else 'direction'} {called}", slip.direction, row[0], 2)
    if not isinstance(slip.motion, HarmonicWall):
        places.add_number(f"{prefix}curvature {called}", slip.curvature, k)
        places.add_number(f"{prefix}velocity {called}", slip.rate, own, 2)
    if slip.by_speed is None:
        places.add_number(f"{name} {called}", slip.limit, held)
    else:
        read = functools.partial(_read_number, f"{name} {called}")
        places.functions.append(_zivi.Part.of_speed(c, slip.by_speed, read))
    if slip.static is not None:
        places.add_number(f"{name}_static {called}", slip.static, most)


# Checks of a mechanical system without a state: gaps, mass, names.

MAX_SIZE = 256
"""Most coordinates, and most gaps with the channels of friction."""


def gaps_of(gaps: Any) -> tuple[Gap, ...]:
    """Read the gaps: one or a sequence."""
    several = (gaps,) if isinstance(gaps, Gap) else gaps
    if not isinstance(several, Iterable):
        raise TypeError(f"gaps must be a sequence of zivi.Gap, got {type(gaps).__name__}")
    several = tuple(several)
    for i, gap in enumerate(several):
        if not isinstance(gap, Gap):
            raise TypeError(f"gaps[{i}] must be a zivi.Gap or zivi.LinearGap, got {gap!r}")
    if len(several) > MAX_SIZE:
        raise ValueError(f"gaps must be at most {MAX_SIZE}, got {len(several)}")
    return several


def check_size(name: str, given: Any) -> None:
    """Raise a ValueError for an array of more coordinates than a system may have."""
    shape = getattr(given, "shape", ())
    if isinstance(shape, tuple) and max(shape, default=0) > MAX_SIZE:
        raise ValueError(f"{name} must be for at most {MAX_SIZE} coordinates, got shape {shape}")


def matrix_of(mass: Array) -> Array:
    """Check a constant mass matrix."""
    check_size("mass", mass)
    matrix = mass.reshape(1, 1) if mass.size == 1 else mass
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise ValueError(f"mass must have shape (n, n) with n >= 1, got {mass.shape}")
    check_mass(matrix)
    return read_only(matrix)


def check_mass(matrix: Array, names: Sequence[str] | None = None) -> None:
    """Reject a mass matrix that is not symmetric and positive definite; name a coordinate of it."""
    if not np.isfinite(matrix).all():
        raise ValueError(f"mass must be finite, got {matrix.tolist()}")
    skew = np.abs(matrix - matrix.T).max()
    if skew > 1e-10 * np.abs(matrix).max():
        raise ValueError(f"mass must be symmetric, got {matrix.tolist()}")
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        told = f"mass must be positive definite, got one with the eigenvalue {values[0]:.6g}"
        if names is not None:
            light = names[int(np.argmax(np.abs(vectors[:, 0])))]
            told += f" along coordinate {light!r}: give its body a mass and an inertia"
        raise ValueError(told) from None


def distinct_names(what: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return names that all differ."""
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        raise ValueError(f"names of {what} must differ, got {twice[0]!r} twice")
    return tuple(names)


def coordinates_of(names: Sequence[str] | None, n: int | None) -> tuple[str, ...] | None:
    """Read the names of the coordinates; their number is checked if it is known."""
    if names is None:
        return None
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"coordinates must be a sequence of names, got {names!r}")
    if n is not None and len(names) != n:
        raise ValueError(f"coordinates must be {n} names, got {len(names)}")
    return distinct_names("coordinates", list(names))


def check_free(system: MechanicalSystem, what: str) -> None:
    """Raise a NotImplementedError for equality rows, which `what` rejects."""
    if system.equality_names:
        raise NotImplementedError(
            f"equality rows are not supported by {what}; use minimal coordinates, got "
            f"{', '.join(map(repr, system.equality_names))}"
        )


def check_rigid(system: MechanicalSystem, what: str) -> None:
    """Raise a NotImplementedError for compliant gaps or equality rows, which `what` rejects."""
    check_free(system, what)
    for i, *_ in system._compliant():
        raise NotImplementedError(
            f"{what} take rigid gaps, got gap {system.gap_names[i]!r} with a contact law: use "
            "zivi.simulate, or a batch of runs"
        )


def check_cones(system: MechanicalSystem) -> None:
    """Raise a ValueError for choices that friction in two directions does not have."""
    name = next((it.name for it in system._channels if it.row is not None), None)
    chosen = {"impact_law": (system.impact_law, "newton"), "paradox": (system.paradox, "stop")}
    for argument, (value, known) in chosen.items():
        if name is not None and value != known:
            raise ValueError(
                f"{argument} must be {known!r} with two tangents, which gap {name!r} has, got "
                f"{value!r}"
            )


def check_rotations(system: MechanicalSystem, what: str) -> None:
    """Raise a NotImplementedError for rotations whose coordinates change during a run."""
    remedy = "differences of zivi.simulate" if what == "derivatives" else "zivi.simulate"
    for body in system._rotations():
        raise NotImplementedError(
            f"{what} cannot be used with body {body!r}, which rotates in space; use {remedy} "
            "with zivi.SwitchedRK"
        )


def check_planar(system: MechanicalSystem, what: str) -> None:
    """Raise a NotImplementedError for motion in space that `what` does not take.

    That are gaps with two tangents, and rotations whose coordinates change during a run.
    """
    check_rotations(system, what)
    for channel in system._channels:
        if channel.row is not None:
            raise NotImplementedError(
                f"{what} cannot be used with gap {channel.name!r}, which has two tangents; use "
                "zivi.simulate with zivi.SwitchedRK or zivi.MoreauJean, or one tangent"
            )


def check_compliant(e: Any, laws: Sequence[ContactLaw | None], names: Sequence[str]) -> None:
    """Reject a restitution for a compliant gap: its contact law determines the rebound."""
    soft = [i for i, law in enumerate(laws) if law is not None]
    several = isinstance(e, Sequence) or np.ndim(e) > 0
    if not soft or (not several and (len(soft) < len(laws) or e == 0)):
        return
    for i in soft:
        if not several or not isinstance(e[i], numbers.Real) or e[i] != 0:
            raise ValueError(
                f"e of gap {names[i]!r} must be 0, got {e[i] if several else e}: the gap is "
                "compliant, and its contact law determines the rebound"
            )


# The matrix through which controls act on a mechanical system.


@dataclasses.dataclass(frozen=True, eq=False)
class ControlInputs:
    """The matrix :math:`B` of the forces :math:`B u` of r controls.

    Parameters
    ----------
    names : tuple of str
        Names of the controls; empty until the function has been evaluated once.
    matrix : ndarray or callable
        :math:`B`, of shape (n, r), or a function of the coordinates that returns it.
    """

    names: tuple[str, ...]
    matrix: Array | Callable[[Array], Any]

    @property
    def r(self) -> int:
        """How many controls there are."""
        return len(self.names)

    def known(self, q: Array) -> ControlInputs:
        """Return the same with the names of all controls, and its shape checked at coordinates."""
        shape = np.shape(self.matrix if isinstance(self.matrix, np.ndarray) else self.matrix(q))
        if len(shape) != 2 or shape[0] != len(q) or not shape[1]:
            raise ValueError(f"inputs must have shape ({len(q)}, r), got {shape}")
        if self.names and len(self.names) != shape[1]:
            raise ValueError(f"inputs must have {len(self.names)} columns, got {shape[1]}")
        return self if self.names else dataclasses.replace(self, names=numbered_controls(shape[1]))

    def at(self, q: Array) -> Array:
        """Return the matrix at coordinates, shape (n, r)."""
        if isinstance(self.matrix, np.ndarray):
            return self.matrix
        return np.ascontiguousarray(self.matrix(q), dtype=np.float64)

    def spec(self) -> _zivi.Inputs:
        """Return the system for the extension."""
        if isinstance(self.matrix, np.ndarray):
            return _zivi.Inputs.constant(self.r, self.matrix.ravel().tolist())
        return _zivi.Inputs.callable(self.r, lambda t, q: self.at(q))


def control_inputs(given: Any) -> ControlInputs:
    """Read a matrix, a function of the coordinates, or columns by the names of the controls."""
    if isinstance(given, Mapping):
        names = tuple(str(name) for name in given)
        columns = [np.atleast_1d(real_array(f"inputs[{n!r}]", it)) for n, it in given.items()]
        if not columns or any(it.ndim != 1 or it.shape != columns[0].shape for it in columns):
            raise ValueError("inputs must give columns of one length, one for each control")
        return ControlInputs(names, _finite_matrix(np.column_stack(columns)))
    if callable(given):
        check_arguments("inputs", given, "q")
        return ControlInputs((), given)
    matrix = real_array("inputs", given)
    matrix = matrix.reshape(-1, 1) if matrix.ndim < 2 else matrix
    if matrix.ndim != 2 or not matrix.shape[1]:
        raise ValueError(f"inputs must have shape (n, r), got {matrix.shape}")
    return ControlInputs(numbered_controls(matrix.shape[1]), _finite_matrix(matrix))


def every_coordinate(n: int) -> ControlInputs:
    """Return the inputs of a system without any of its own: a force on each coordinate."""
    return ControlInputs(numbered_controls(n), np.eye(n))


def numbered_controls(r: int) -> tuple[str, ...]:
    """Return default names of controls, their numbers."""
    return tuple(f"u{j}" for j in range(r))


def _finite_matrix(matrix: Array) -> Array:
    if not np.all(np.isfinite(matrix)):
        raise ValueError(f"inputs must be finite, got {matrix.tolist()}")
    return np.ascontiguousarray(matrix)


# Mechanical systems: coordinates that move under forces, within gaps.


@dataclasses.dataclass(frozen=True)
class Model:
    """Model that the extension integrates.

    Parameters
    ----------
    layout : Layout
        Numbers of coordinates, gaps and channels of friction.
    spec : _zivi.Model
        The model, compiled or not; it holds the owner of compiled code.
    evaluate : callable
        The same model for the interpreter.
    friction : _zivi.Friction, optional
        Its friction and compliant gaps, for contact forces.
    """

    layout: Layout
    spec: _zivi.Model
    evaluate: Evaluate
    friction: _zivi.Friction | None = None

    @classmethod
    def of_code(cls, layout: Layout, code: Native, data: int, owner: object) -> Model:
        """Return a model in machine code, with the address of its data and their owner."""
        return cls.native(
            layout, _zivi.Model.compiled(code.address, data=data, owner=(code, owner))
        )

    @classmethod
    def native(cls, layout: Layout, spec: _zivi.Model) -> Model:
        """Return a model that the extension evaluates, each time into another row."""
        size = layout.size

        def evaluate(t: float, q: Array, qdot: Array) -> Array:
            q, qdot = np.ascontiguousarray(q, np.float64), np.ascontiguousarray(qdot, np.float64)
            return spec.evaluate(t, q, qdot, size)

        return cls(layout, spec, evaluate)


ARGUMENTS = (
    *("mass", "force", "gaps", "e", "coordinates", "inputs", "friction", "impact_law", "paradox"),
    *("reentrant", "equalities"),
)
"""The arguments of a system, which `replace` takes too."""


def check_names(changes: Mapping[str, Any], known: Iterable[str]) -> None:
    """Reject unknown names."""
    known = tuple(known)
    for name in changes:
        if name not in known:
            raise KeyError(f"unknown parameter {name!r}; the parameters are {', '.join(known)}")


@hinted("MechanicalSystem")
class MechanicalSystem:
    r"""n coordinates, m gaps that stay open or closed, impacts that obey Newton's law.

    .. math::

        M \ddot q = F(t, q, \dot q) + \sum_i \lambda_i \nabla g_i, \qquad
        0 \le \lambda_i \perp g_i(t, q) \ge 0, \qquad
        \dot g_i^+ = -e_i\,\dot g_i^-

    If several closed gaps are hit simultaneously, the impulses :math:`P \ge 0` solve
    :math:`0 \le P \perp \dot g^+ + e\,\dot g^- \ge 0`, with
    :math:`\dot g^+ = \dot g^- + W P` and :math:`W = N M^{-1} N^T`. Gaps with a tangent, and the
    joints of `friction`, have Coulomb's dry friction: they stick exactly, or slip.

    Parameters
    ----------
    mass : array_like or callable
        :math:`M`, symmetric positive definite, of shape (n, n): an array, ``M(t, q)``, or
        compiled, ``void (double t, double *q, double *qdot, double *out)`` (numba ``@cfunc``,
        `scipy.LowLevelCallable`, ctypes). A number for one coordinate.
    force : array_like or callable
        :math:`F`, of shape (n,), with the Coriolis and centrifugal terms: an array,
        ``F(t, q, qdot)`` or compiled, as the mass.
    gaps : sequence of Gap
        The constraints, `Gap` or `LinearGap`; none is allowed.
    e : float, ImpactLaw or sequence of them
        Coefficients of restitution in [0, 1]: one for all gaps or one for each. Or impact laws, as
        `SpeedDependentImpact`.
    coordinates : sequence of str, optional
        Names of the coordinates for tables and plots; by default ``q0``, ``q1``, ...
    inputs : array_like, callable, dict or Table, optional
        How the controls :math:`u` of `simulate_closed_loop` act, by forces :math:`B u`: the matrix
        :math:`B` of shape (n, r), a function ``B(q)`` of the coordinates, or a dict with a column
        for each control, by name. By default there is a force on each coordinate. A run without
        a controller has none of them. A `Table` is something else: its known values ``u(t)`` are
        a last argument of the force, ``F(t, q, qdot, u)`` with an array of shape (k,), or compiled
        ``void (double t, double *q, double *qdot, double *u, double *out)``.
    friction : sequence of DryFriction
        Dry friction in joints (friction at gaps is an argument of the gaps). `force` must not
        contain it.
    impact_law : {"newton", "poisson", "stronge"}
        What `e` means in an impact with friction: the ratio of speeds, of impulses or of energies.
        With "newton" an impact may gain energy where normal and tangential direction are coupled
        strongly and `e` is large; it is flagged then. "poisson" does not where all gaps of the
        impact have the same `e`; "stronge", which is for one contact at a time, never does.
    paradox : {"stop", "impact"}
        What happens where no finite force keeps a sliding contact (Painleve): the run ends, or an
        impact without collision stops the sliding, which is flagged.
    reentrant : bool
        Whether compiled parts may be called by several threads concurrently (`simulate_batch` and
        batches of loops do so). False for parts that keep memory of their own between or during
        calls (static variables, the state of another library): such batches use one thread.
    equalities : sequence of Equality
        Equations between the coordinates that are kept exactly, closed chains and prescribed
        motion; default none.

    Raises
    ------
    ValueError, TypeError
        For what can be seen without a state. Shapes of the values of functions are checked when
        `simulate` starts.

    See Also
    --------
    zivi.symbolic.system : the same from energies, without derivatives by hand, compiled.

    Notes
    -----
    Contact forces solve a linear complementarity problem with the Delassus matrix of the closed
    gaps; the equations are on the page "Contact and impacts of several gaps" (contact.md). A stage
    of a step factorises the mass matrix, :math:`O(n^3)`, unless it is the matrix of the stage
    before: a constant one is factorised once.

    References
    ----------
    J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in Nonsmooth
    Mechanics and Applications, Springer, 1988.

    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    A ball between a floor and a wall on the right, pushed by 2 N:

    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2),
    ...     force=[2.0, -9.81],
    ...     gaps=[zivi.LinearGap([0, 1], name="floor"), zivi.LinearGap([-1, 0], 0.8, name="wall")],
    ...     e=[0.5, 0.3],
    ...     coordinates=["x", "y"],
    ... )
    >>> box
    MechanicalSystem(coordinates=(x, y), gaps=(floor, wall), e=(0.5, 0.3))

    A mass at a spring on a belt that sticks and slips:

    >>> belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
    >>> zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[belt])
    MechanicalSystem(gaps=(), e=(), friction=(belt))
    """

    derived = False
    """Whether the derivatives were derived, not given: then no differences check them."""
    _inputs: Table | None = None
    _given_inputs: Any = None
    _controls: ControlInputs | None = None
    _channels: tuple[Channel, ...] = ()
    _joints: tuple[DryFriction, ...] = ()
    _equalities: tuple[Equality, ...] = ()
    _impact_law = "newton"
    _paradox = "stop"
    _reentrant = True
    _kept_model: tuple[object, Model] | None = None
    """The model, and the `_revision` at which it was made."""
    _kept_mechanism: tuple[Model, Restitutions, _zivi.Mechanism] | None = None
    _checked_start: tuple[tuple[float, float] | None, bytes] = (None, b"")
    """Span and mass matrix of the last start that passed the checks."""

    def __init__(
        self,
        *,
        mass: Any,
        force: Any,
        gaps: Sequence[Gap] = (),
        e: GivenRestitutions = 0.0,
        coordinates: Sequence[str] | None = None,
        inputs: Any = None,
        friction: Sequence[DryFriction] = (),
        impact_law: str = "newton",
        paradox: str = "stop",
        reentrant: bool = True,
        equalities: Sequence[Equality] = (),
    ) -> None:
        for name, given in (("mass", mass), ("force", force)):
            check_size(name, given)  # before it is copied
        self._given_inputs = inputs
        if inputs is not None and not isinstance(inputs, Table):
            self._controls, inputs = control_inputs(inputs), None
        self._inputs = inputs
        self._gaps = gaps_of(gaps)
        self._mass: Part = part("mass", mass, "t, q")
        self._force: Part = (
            part("force", force, "t, q, qdot") if inputs is None else driven(force, inputs)
        )
        if isinstance(self._mass, np.ndarray):
            self._mass = matrix_of(self._mass)
        if isinstance(self._force, np.ndarray):
            self._force = read_only(np.atleast_1d(self._force))
        parts = {"mass": (self._mass, mass), "force": (self._force, force)}
        self._given = {
            name: read if isinstance(read, np.ndarray) else given
            for name, (read, given) in parts.items()
        }
        self._gap_names = distinct_names(
            "gaps", [gap.name or f"gap{i}" for i, gap in enumerate(self._gaps)]
        )
        self._e: Restitutions = restitutions(e, self.m)
        check_compliant(e, self._contact_laws(), self._gap_names)
        self._joints = joints_of(friction)
        self._equalities = equalities_of(equalities)
        distinct_names("equalities", self.equality_names)
        if len(self._equalities) > MAX_SIZE:
            raise ValueError(f"equalities must be at most {MAX_SIZE}, got {len(self._equalities)}")
        self._channels = self._rubbing()
        self._n = self._known_size()
        if self._n is not None:
            self._know_directions(self._n)
        self._impact_law = one_of("impact_law", impact_law, IMPACT_LAWS)
        self._paradox = one_of("paradox", paradox, PARADOXES)
        self._reentrant = switch("reentrant", reentrant)
        check_cones(self)
        self._coordinates = coordinates_of(coordinates, self._n)

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            raise attribute_error("mechanism", self, name)

    _call_form = "force is called as F(t, q, qdot), a number and two arrays"

    def _known_size(self) -> int | None:
        """Find the number of coordinates, if an array tells it; all must tell the same."""
        told = [("mass", self._mass), ("force", self._force)]
        told += [
            (f"gradient of gap {name!r}", gap._gradient)
            for name, gap in zip(self._gap_names, self._gaps, strict=True)
        ]
        told += [
            (f"{'direction' if channel.gap is None else 'tangent'} of {channel.name!r}", row)
            for channel, row in zip(self._channels, self._directions(), strict=True)
        ]
        told += [(f"gradient of equality {row.name!r}", row._row) for row in self._equalities]
        if self._controls is not None:
            told.append(("inputs", self._controls.matrix))
        arrays = [(name, array) for name, array in told if isinstance(array, np.ndarray)]
        for name, array in arrays:
            check_size(name, array)
        sizes = [(name, len(array)) for name, array in arrays]
        for name, size in sizes:
            if size != sizes[0][1]:
                of, first = sizes[0]
                raise ValueError(
                    f"{name} must be for as many coordinates as {of} ({first}), got {size}"
                )
        return sizes[0][1] if sizes else None

    def _know_directions(self, n: int) -> None:
        """Read how many directions the tangents give that are functions of `n` coordinates."""
        before = [len(gap._slips) for gap in self._gaps]
        for gap in self._gaps:
            gap._know_directions(n)
        if [len(gap._slips) for gap in self._gaps] != before:
            self._channels = self._rubbing()

    def _rubbing(self) -> tuple[Channel, ...]:
        """List the friction channels: first gaps, then joints."""
        named = zip(self._gap_names, self._gaps, strict=True)
        found = [
            Channel(name, i, gap._e_t, row if len(gap._slips) > 1 else None)
            for i, (name, gap) in enumerate(named)
            for row in range(len(gap._slips))
        ]
        found += [
            Channel(joint.name or f"friction{i}", None) for i, joint in enumerate(self._joints)
        ]
        distinct_names(
            "gaps and friction", [*self._gap_names, *(it.name for it in found if it.gap is None)]
        )
        if self.m + len(found) > MAX_SIZE:
            raise ValueError(
                f"gaps and friction must be at most {MAX_SIZE} together, a gap with friction "
                f"counts as two, got {self.m + len(found)}"
            )
        return tuple(found)

    def _slips(self) -> list[Slip]:
        """Return the parts of the channels of friction."""
        of_gaps = [slip for gap in self._gaps for slip in gap._slips]
        return [*of_gaps, *(joint._slip for joint in self._joints)]

    def _directions(self) -> list[Part]:
        return [slip.direction for slip in self._slips()]

    @property
    def friction(self) -> tuple[DryFriction, ...]:
        """The joints with dry friction as given."""
        return self._joints

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels of friction: gaps with friction by their names, then joints."""
        return tuple(channel.label for channel in self._channels)

    @property
    def equalities(self) -> tuple[Equality, ...]:
        """The equality rows as given."""
        return self._equalities

    @property
    def equality_names(self) -> tuple[str, ...]:
        """Names of the equality rows."""
        return tuple(row.name for row in self._equalities)

    @property
    def impact_law(self) -> str:
        """Meaning of `e` in an impact with friction."""
        return self._impact_law

    @property
    def paradox(self) -> str:
        """Behaviour if no finite force maintains a sliding contact (Painlevé paradox)."""
        return self._paradox

    @property
    def reentrant(self) -> bool:
        """Whether several threads may evaluate the system concurrently."""
        return self._reentrant

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """The gaps as given."""
        return self._gaps

    def _breaks(self, span: tuple[float, float]) -> Array:
        """Return the knots of the tables within a span, which it must not leave."""
        walls = [getattr(gap, "motion", None) for gap in self._gaps]
        return declared_breaks(span, [self._inputs], [*walls, *self._motions()])

    def _motions(self) -> list[Any]:
        """Return the prescribed motions of equality rows that are tables or walls."""
        return []

    @property
    def e(self) -> Array:
        """Coefficients of restitution of the gaps; a ValueError for laws other than Newton's."""
        if isinstance(self._e, tuple):
            raise ValueError(
                f"e must be numbers (Newton's impact law), got {written(self._e)}: other laws are "
                "supported by simulate and simulate_batch with SwitchedRK, and by sensitivity"
            )
        return self._e.copy()

    @property
    def laws(self) -> tuple[ImpactLaw, ...]:
        """The impact law of each gap."""
        return laws_of(self._e)

    @property
    def m(self) -> int:
        """Number of gaps."""
        return len(self._gap_names)

    @property
    def gap_names(self) -> tuple[str, ...]:
        """Names of the gaps."""
        return self._gap_names

    def coordinate_names(self, n: int) -> tuple[str, ...]:
        """Return the names of `n` coordinates."""
        return self._coordinates or tuple(f"q{i}" for i in range(n))

    def model(self, n: int) -> Model:
        """Return the model that the extension integrates, for `n` coordinates.

        The model is made once and kept with the system. Two threads that start together may both
        make one, of the same numbers.

        Raises
        ------
        ValueError
            If the system has another number of coordinates.
        """
        kept, state = self._kept_model, self._revision()
        if kept is None or kept[0] is not state or kept[1].layout.n != n:
            if self._n not in (None, n):
                raise ValueError(f"q0 must have {self._n} entries, got {n}")
            if not 1 <= n <= MAX_SIZE:
                raise ValueError(f"q0 must have from 1 to {MAX_SIZE} entries, got {n}")
            self._know_directions(n)
            check_cones(self)
            model, friction = self._new_model(n), self._friction_spec()
            if friction is not None:
                model = dataclasses.replace(model, friction=friction)
            self._kept_model = kept = state, model
        return kept[1]

    def _revision(self) -> object:
        """Return an object that is another one after a change of the system's numbers."""
        return None

    def mechanism(self, model: Model) -> _zivi.Mechanism:
        """Return a model with impact laws and friction, which the extension runs; it is kept."""
        kept = self._kept_mechanism
        if kept is None or kept[0] is not model or kept[1] is not self._e:
            made = _zivi.Mechanism(
                model.spec,
                n=model.layout.n,
                m=model.layout.m,
                e=core_of(self._e),
                friction=model.friction,
                k=model.layout.k,
            )
            kept = model, self._e, made
            if self._kept_model is not None and model is self._kept_model[1]:
                self._kept_mechanism = kept
        return kept[2]

    def _new_model(self, n: int) -> Model:
        """Make the model for `n` coordinates."""
        layout = Layout(n, self.m, len(self._channels), len(self._equalities))
        slips = list(zip(self._channels, self._slips(), strict=True))
        parts = layout, self._mass, self._force, self._gaps, slips, self._equalities
        return Model.native(layout, model_of_parts(*parts, steady=self._is_steady()))

    def _parameter_rows(self, columns: Mapping[str, Array]) -> Array | None:
        """Return the data of the compiled model for each run, None if it has none."""
        return None

    def _contact_laws(self) -> list[ContactLaw | None]:
        """Return the contact law of each gap, None of a rigid one."""
        return [gap.contact for gap in self._gaps]

    def _compliant(self) -> list[tuple[int, str, list[float], Any]]:
        """Return the laws of the compliant gaps: gap, name, numbers, function."""
        return compliant_gaps(self._contact_laws())

    def _friction_spec(self) -> _zivi.Friction | None:
        """Return friction and compliant gaps for the extension; None without any."""
        compliant = self._compliant()
        if not self._channels and not compliant:
            return None
        return _zivi.Friction(
            [(channel.gap, channel.e_t) for channel in self._channels],
            law=self._impact_law,
            impact_without_collision=self._paradox == "impact",
            compliant=compliant,
        )

    def _told(self) -> tuple[str | None, dict[str, float] | None]:
        """Return the mutable properties that a run keeps: the repr and the parameters."""
        # the class first: an AttributeError would search for similar names
        known = hasattr(type(self), "parameters")
        parameters = getattr(self, "parameters", None) if known else None
        return None, dict(parameters) if parameters else None

    def _start_of(self, y0: Any) -> Any:
        """Return the initial state in the coordinates of a run."""
        return y0

    def _rotations(self) -> dict[str, tuple[int, bool]]:
        """Return the first coordinate of each rotation in space by body, and if that is free."""
        return {}

    def _is_steady(self) -> bool:
        """Whether mass, force and gradients are arrays, and no gap moves."""
        parts = (self._mass, self._force)
        still = all(isinstance(gap, LinearGap) and gap.motion is None for gap in self._gaps)
        return (
            still
            and all(isinstance(part, np.ndarray) for part in parts)
            and all(slip.is_steady() for slip in self._slips())
            and not self._equalities
        )

    def _units(self) -> dict[str, list[str]] | None:
        """Return the units of coordinates and gaps, if the system defines them."""
        return None

    def control_inputs(self, q: ArrayLike) -> ControlInputs:
        """Return how controls act: names of the controls, and the matrix ``at(q)``, shape (n, r).

        Parameters
        ----------
        q : array_like
            Coordinates, at which a function `inputs` is evaluated to count the controls.
        """
        there = np.atleast_1d(real_array("q", q))
        if self._controls is None:
            return every_coordinate(len(there))
        return self._controls.known(there)

    def partials(self, model: Model, wanted: Collection[str] | None = None) -> Partials:
        """Return what the extension takes for the partial derivatives of a model.

        Parameters
        ----------
        model : Model
            The model.
        wanted : collection of str, optional
            The parameters whose derivatives are used; by default all.
        """
        return Partials()

    @hinted("at")
    def at(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Evaluation:
        """Evaluate the system.

        Parameters
        ----------
        t : float
            Time.
        q, qdot : array_like
            Coordinates and velocities, of shape (n,).

        Returns
        -------
        Evaluation
            Mass, force, gaps, their gradients, curvatures and rates; the parts of the friction and
            of the equality rows.

        Examples
        --------
        >>> floor = zivi.LinearGap([1])
        >>> ball = zivi.MechanicalSystem(mass=2.0, force=[-19.62], gaps=[floor], e=0.5)
        >>> ball.at(0.0, [0.1], [0.0]).gaps
        array([0.1])
        """
        state = [np.atleast_1d(real_array(name, v)) for name, v in (("q", q), ("qdot", qdot))]
        model = self.model(len(state[0]))
        if state[1].shape != state[0].shape:
            raise ValueError(f"qdot must have shape {state[0].shape}, got {state[1].shape}")
        return model.layout.read(model.evaluate(finite("t", t), *state))

    def replace(self, **changes: Any) -> MechanicalSystem:
        """Return the same system with other arguments.

        Parameters
        ----------
        **changes
            Arguments of `MechanicalSystem` by name; what is not named stays.

        Returns
        -------
        MechanicalSystem
            A new system; this one does not change.

        Raises
        ------
        KeyError
            For a name that is no argument.
        ValueError, TypeError
            As for `MechanicalSystem`.

        Examples
        --------
        >>> floor = zivi.LinearGap([1.0])
        >>> ball = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[floor], e=0.5)
        >>> ball.replace(e=0.8).e
        array([0.8])
        """
        check_names(changes, ARGUMENTS)
        new = object.__new__(type(self))
        new.__setstate__(self.__getstate__() | changes)
        return new

    def __repr__(self) -> str:
        told = (
            [] if self._coordinates is None else [f"coordinates=({', '.join(self._coordinates)})"]
        )
        told.append(f"gaps=({', '.join(self.gap_names)})")
        told.append(f"e={written(self._e)}")
        if self._channels:
            told.append(f"friction=({', '.join(self.channel_names)})")
        if self.equality_names:
            told.append(f"equalities=({', '.join(self.equality_names)})")
        told += [f"{name}={value!r}" for name, value in self._chosen().items()]
        return f"{type(self).__name__}({', '.join(told)})"

    def __getstate__(self) -> dict[str, Any]:
        state = {"gaps": self._gaps, "e": self._e, "coordinates": self._coordinates}
        given = self._given_inputs
        more: dict[str, Any] = {} if given is None else {"inputs": given}
        more |= {"friction": self._joints} if self._joints else {}
        more |= {"equalities": self._equalities} if self._equalities else {}
        return self._given | state | more | self._chosen()

    def _chosen(self) -> dict[str, Any]:
        """Return the options for impacts, paradoxes and threads that differ from their defaults."""
        chosen: dict[str, tuple[Any, Any]] = {
            "impact_law": (self._impact_law, "newton"),
            "paradox": (self._paradox, "stop"),
            "reentrant": (self._reentrant, True),
        }
        return {name: value for name, (value, usual) in chosen.items() if value != usual}

    def __setstate__(self, state: dict[str, Any]) -> None:
        MechanicalSystem.__init__(self, **state)


# A mass above a wall with dry friction, as a mechanical system of one coordinate.


def as_mechanism(system: ImpactSystem) -> MechanicalSystem:
    """Return a mass with friction as a mechanical system: x, its wall as a gap, and a joint."""
    assert system.friction is not None
    return MechanicalSystem(
        mass=1.0,
        force=_force(system.force),
        gaps=[LinearGap([1.0], name="wall")],
        e=system.e,
        coordinates=["x"],
        friction=[system.friction],
    )


def _force(force: Any) -> Any:
    """Return a force of a mass as that of a mechanical system."""
    if isinstance(force, numbers.Real):
        return [float(force)]
    if isinstance(getattr(force, "excitation", None), Table):
        raise NotImplementedError(
            "force must not be excited by a table for a mass with friction: use a "
            "zivi.MechanicalSystem with inputs"
        )
    spec = force_spec(force)
    if (address := spec.address) is None:
        function = of_three("force", force, more_than_y=False)
    elif "void" in str(getattr(force, "signature", "")):
        raise NotImplementedError(
            "force must not have user_data for a mass with friction: use a zivi.MechanicalSystem"
        )
    else:
        function = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 3)(address)

    def along(t: float, q: Any, qdot: Any) -> float:
        _ = spec  # which holds compiled code
        return function(t, float(q[0]), float(qdot[0]))  # type: ignore[no-any-return]

    return along
