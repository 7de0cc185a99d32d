"""Mechanical systems from their energies, derived by SymPy."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Iterable, Iterator, Mapping, MutableMapping, Sequence
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, finite
from zivi.base.expressions import (
    UnknownNameError,
    c_source,
    depends,
    expression,
    python_source,
    sound,
    worked_on,
)
from zivi.base.extras import needed
from zivi.base.formula import CONSTANTS, FormulaError, meant, normal
from zivi.base.habits import hinted
from zivi.base.machine_code import Native, compile_model
from zivi.system.gap import (
    IMPACT_LAWS,
    PARADOXES,
    Channel,
    ContactLaw,
    HarmonicWall,
    contact_law,
    one_of,
    tangential_restitution,
)
from zivi.system.impact_law import GivenRestitutions, Restitutions, restitutions
from zivi.system.mechanism import (
    ControlInputs,
    MechanicalSystem,
    Model,
    check_compliant,
    check_cones,
    control_inputs,
)
from zivi.system.model_parts import Layout, Partials
from zivi.system.table import Table

# Slip speeds and limits of dry friction as expressions, and the derivatives of the speeds.


@dataclasses.dataclass(frozen=True)
class Rubbing:
    """The dry friction arguments of a system, by the names of gaps and joints.

    Parameters
    ----------
    slips : dict
        Slip speeds at gaps.
    mu : dict
        Coefficients there, each one expression or a pair, while slipping and while sticking.
    friction : dict
        For joints: slip speed, limit, and the static limit if it differs.
    e_t : dict
        Tangential restitutions at gaps.
    """

    slips: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    mu: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    friction: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    e_t: Mapping[str, float] = dataclasses.field(default_factory=dict)


NO_FRICTION = Rubbing()


@dataclasses.dataclass(frozen=True)
class SlipExpressions:
    """The expressions of a channel of friction."""

    channel: Channel
    direction: list[Any]
    rate: Any
    curvature: Any
    limit: Any
    static: Any


def slips_of(words: Any, gaps: Sequence[str], given: Rubbing) -> list[SlipExpressions]:
    """Derive the channels of friction: those of gaps in the order of these, then joints."""
    for name, table in (("slips", given.slips), ("mu", given.mu), ("e_t", given.e_t)):
        if not isinstance(table, Mapping):
            raise TypeError(f"{name} must be a dict by the names of gaps, got {table!r}")
        known = gaps if name == "slips" else given.slips
        for gap in table:
            if gap not in known:
                names = ", ".join(map(repr, known)) or "none"
                of = "gaps" if name == "slips" else "slips"
                raise ValueError(f"{name} has unknown key {gap!r}; the {of} are {names}")
    if not isinstance(given.friction, Mapping):
        raise TypeError(f"friction must be a dict by names of joints, got {given.friction!r}")
    found = []
    for i, gap in enumerate(gaps):
        if gap not in given.slips:
            continue
        if gap not in given.mu:
            raise ValueError(f"mu of gap {gap!r} must be given: it has a slip speed")
        e_t = tangential_restitution(f"gap {gap!r}", given.e_t.get(gap, 0.0))
        limits = _several(given.mu[gap], f"mu of gap {gap!r}", 1)
        speeds = given.slips[gap]
        if not isinstance(speeds, list | tuple):
            found.append(_slip(words, Channel(gap, i, e_t), speeds, limits))
            continue
        if len(speeds) not in (1, 2):
            raise ValueError(
                f"slips of gap {gap!r} must be one slip speed or two, got {len(speeds)}"
            )
        if len(speeds) == 2 and e_t:
            raise ValueError(
                f"e_t of gap {gap!r} is not supported with two slip speeds, got {e_t}; use e_t=0, "
                "or one slip speed"
            )
        rows = [None] if len(speeds) == 1 else [0, 1]
        for row, speed in zip(rows, speeds, strict=True):
            found.append(_slip(words, Channel(gap, i, e_t, row), speed, limits))
    for name, told in given.friction.items():
        if name in gaps:
            raise ValueError(f"names of gaps and friction must differ, got {name!r} twice")
        speed, *limits = _several(told, f"friction {name!r}", 2)
        found.append(_slip(words, Channel(name, None), speed, limits))
    return found


def _several(given: Any, what: str, least: int) -> list[Any]:
    """Read one expression or a few: with the static limit, one more than the least."""
    several = list(given) if isinstance(given, tuple | list) else [given]
    if not least <= len(several) <= least + 1:
        forms = {1: "mu or (mu, mu_static)", 2: "(speed, limit) or (speed, limit, static)"}
        raise ValueError(f"{what} must be {forms[least]}, got {given!r}")
    return several


def _slip(words: Any, channel: Channel, speed: Any, limits: Sequence[Any]) -> SlipExpressions:
    r"""Derive :math:`B = \partial w/\partial\dot q`, :math:`\beta` and :math:`k`.

    .. math:: k = \frac{\partial w}{\partial q} \dot q + \frac{\partial w}{\partial t}
    """
    of = "friction" if channel.gap is None else "gap"
    what = f"slip speed of {of} {channel.name!r}"
    w = words.read(what, speed)
    with worked_on(what):
        direction = [w.diff(v) for v in words.w]
        rate = w.subs(dict.fromkeys(words.w, 0))
        along = sum(w.diff(x) * v for x, v in zip(words.q, words.w, strict=True)) + w.diff(words.t)
        is_linear = any(direction) and not any(depends(entry, words.w) for entry in direction)
    if not is_linear:
        raise ValueError(f"{what} must be linear in the velocities and have some")
    name = "limit" if channel.gap is None else "mu"
    held = [words.read(f"{name} of {of} {channel.name!r}", limit) for limit in limits]
    return SlipExpressions(channel, direction, rate, along, held[0], held[-1])


# From the energies of a system to its equations of motion, by SymPy.

LONGEST = 60
"""Characters of a wrong formula that are shown."""


@dataclasses.dataclass(frozen=True)
class Derived:
    """The equations of a system as expressions in ``t``, ``q[i]``, ``w[i]`` and ``p[k]``.

    Parameters
    ----------
    entries : tuple of sympy.Expr
        M, F, g, N, h, g_t and the parts of the friction in the order of a model's row of numbers.
    coordinates, gaps : tuple of str
        Their names.
    parameters : dict
        Names and values of the parameters, in the order of ``p``.
    channels : tuple of Channel
        The places of dry friction.
    controls : tuple of str
        Names of the controls.
    inputs : tuple of sympy.Expr
        The matrix by which they act, row by row.
    equalities : tuple of str
        Names of the equality rows.
    drives : tuple
        Numbers of rows and the tables or walls whose motion they prescribe.
    """

    entries: tuple[Any, ...]
    coordinates: tuple[str, ...]
    gaps: tuple[str, ...]
    parameters: dict[str, float]
    channels: tuple[Channel, ...] = ()
    controls: tuple[str, ...] = ()
    inputs: tuple[Any, ...] = ()
    equalities: tuple[str, ...] = ()
    drives: tuple[tuple[int, Any], ...] = ()

    @property
    def rows(self) -> tuple[Any, ...]:
        """The entries of the equality rows, the last ones."""
        count = len(self.equalities) * (len(self.coordinates) + 3)
        return self.entries[len(self.entries) - count :]

    def partials(self) -> tuple[Any, ...]:
        """Differentiate all entries with respect to time, coordinates, velocities, parameters."""
        sympy = needed("sympy", "symbolic systems")
        n = len(self.coordinates)
        names = ["t", *(f"{letter}[{i}]" for letter in "qw" for i in range(n))]
        names += [f"p[{k}]" for k in range(len(self.parameters))]
        symbols = [sympy.Symbol(name, real=True) for name in names]
        with worked_on("the derivatives of the equations"):
            return tuple(entry.diff(symbol) for symbol in symbols for entry in self.entries)


def derive(
    q: Any,
    T: Any,
    V: Any,
    Q: Any,
    gaps: Any,
    parameters: Mapping[Any, Any] | None,
    *,
    qdot: Any,
    rubbing: Rubbing = NO_FRICTION,
    inputs: Any = None,
    equalities: Any = None,
) -> Derived:
    r"""Derive the equations of motion and the derivatives of gaps and slip speeds.

    With :math:`L = T - V`:

    .. math::

        M = \frac{\partial^2 L}{\partial \dot q^2}, \qquad
        F = Q + \frac{\partial L}{\partial q}
            - \frac{\partial^2 L}{\partial \dot q \partial q} \dot q
            - \frac{\partial^2 L}{\partial \dot q \partial t}, \qquad
        h_i = \dot q^T H_i \dot q + 2 g_{i,tq} \dot q + g_{i,tt}
    """
    sympy = needed("sympy", "symbolic systems")
    given = dict(parameters or {})
    values = {_name_of(key): finite(f"parameters[{key}]", v) for key, v in given.items()}
    words = _Words(sympy, q, qdot, [_name_of(key) for key in given])
    named = _gaps_by_name(gaps)
    kinetic, potential = words.read("T", T), words.read("V", V)
    pushes = [words.read(f"Q[{i}]", entry) for i, entry in enumerate(_forces(words, Q))]
    distances = [words.read(f"gap {name!r}", gap) for name, gap in named.items()]
    n, t, x, w = len(words.q), words.t, words.q, words.w
    with worked_on("T, V, Q and gaps"):
        lagrangian = kinetic - potential
        momenta = [lagrangian.diff(v) for v in w]
        mass = [[momenta[i].diff(w[j]) for j in range(n)] for i in range(n)]
        is_quadratic = not any(depends(entry, w) for row in mass for entry in row)
    if not is_quadratic:
        raise ValueError("T must be quadratic in the velocities: its second derivatives have some")
    for name, g in zip(named, distances, strict=True):
        if g.free_symbols & set(w):
            raise ValueError(
                f"gap {name!r} must depend only on time and coordinates, got velocities"
            )
    held, drives = equalities_by_name(equalities)
    with worked_on("T, V, Q and gaps"):
        force = [
            pushes[i]
            + lagrangian.diff(x[i])
            - sum(momenta[i].diff(x[j]) * w[j] for j in range(n))
            - momenta[i].diff(t)
            for i in range(n)
        ]
    gradients, curvatures, rates = _along_the_motion(words, distances)
    slips = slips_of(words, list(named), rubbing)
    entries = [entry for row in mass for entry in row] + force + distances
    entries += [entry for row in gradients for entry in row]
    entries += [entry for slip in slips for entry in slip.direction]
    entries += curvatures + [slip.curvature for slip in slips]
    entries += rates + [slip.rate for slip in slips]
    entries += [slip.limit for slip in slips] + [slip.static for slip in slips]
    values_of_rows = [words.read(f"equality {name!r}", it) for name, it in held.items()]
    for name, it in zip(held, values_of_rows, strict=True):
        if it.free_symbols & set(w) or not it.free_symbols & set(x):
            raise ValueError(
                f"equality {name!r} must depend on coordinates, not on velocities, got "
                f"{held[name]!r}"
            )
    of_rows = _along_the_motion(words, values_of_rows)
    entries += [*values_of_rows, *(entry for row in of_rows[0] for entry in row)]
    entries += [*of_rows[1], *of_rows[2]]
    try:
        with worked_on("the equations"):
            found = tuple(sound(sympy.sympify(entry)) for entry in entries)
    except FormulaError as error:
        raise FormulaError(f"T, V, Q and gaps: {error}") from None
    channels, columns = tuple(slip.channel for slip in slips), _control_columns(inputs, n)
    controls, matrix = tuple(columns), _inputs(words, columns)
    return Derived(
        found,
        words.names,
        tuple(named),
        values,
        channels,
        controls,
        matrix,
        tuple(held),
        drives,
    )


def _along_the_motion(
    words: _Words, values: Sequence[Any]
) -> tuple[list[list[Any]], list[Any], list[Any]]:
    """Derive gradients, curvatures and rates of functions of time and coordinates."""
    n, t, x, w = len(words.q), words.t, words.q, words.w
    with worked_on("T, V, Q and gaps"):
        gradients = [[g.diff(v) for v in x] for g in values]
        rates = [g.diff(t) for g in values]
        along = [
            sum(grad[j] * w[j] for j in range(n)) + rate
            for grad, rate in zip(gradients, rates, strict=True)
        ]
        curvatures = [sum(y.diff(x[j]) * w[j] for j in range(n)) + y.diff(t) for y in along]
    return gradients, curvatures, rates


def equalities_by_name(given: Any) -> tuple[dict[str, Any], tuple[tuple[int, Any], ...]]:
    """Read equality rows by name: expressions, or pairs with the motion that they follow."""
    if given is None:
        return {}, ()
    if not isinstance(given, Mapping):
        raise TypeError(
            f"equalities must be a dict of expressions by the names of rows, got {given!r}"
        )
    named, drives = {}, []
    for i, (name, row) in enumerate(given.items()):
        if isinstance(row, tuple | list):
            if len(row) != 2 or not isinstance(row[1], Table | HarmonicWall):
                raise TypeError(
                    f"equalities[{name!r}] must be an expression, or (expression, motion) with a "
                    f"zivi.Table or a zivi.HarmonicWall, got {row!r}"
                )
            row, motion = row
            if isinstance(motion, Table):
                motion._wall(f"motion of equality {name!r}")
            drives.append((i, motion))
        named[str(name)] = row
    return named, tuple(drives)


class _Words:
    """The symbols of a user, and those of ours that take their places: real, and named as in C."""

    def __init__(self, sympy: Any, q: Any, qdot: Any, parameters: list[str]) -> None:
        self.sympy = sympy
        given = _sequence(sympy, q)
        if not given:
            raise ValueError("q must hold at least one coordinate")
        self.functions = [item for item in given if not item.is_Symbol]
        for item in self.functions:
            if not (isinstance(item, sympy.core.function.AppliedUndef) and len(item.args) == 1):
                raise TypeError(f"q must hold symbols or functions of time, x(t), got {item}")
        self.given = given
        self.names = tuple(_name_of(item) for item in given)
        times = {item.args[0] for item in self.functions} or {sympy.Symbol("t")}
        if len(times) > 1:
            raise ValueError(f"q must hold functions of one time, got {sorted(map(str, times))}")
        (self.time,) = times
        rates = [f"{name}dot" for name in self.names]
        if qdot is not None:
            rates = [_name_of(item) for item in _sequence(sympy, qdot)]
            if len(rates) != len(given):
                raise ValueError(f"qdot must have {len(given)} entries, got {len(rates)}")
        self.t = sympy.Symbol("t", real=True)
        self.q = [sympy.Symbol(f"q[{i}]", real=True) for i in range(len(given))]
        self.w = [sympy.Symbol(f"w[{i}]", real=True) for i in range(len(given))]
        own = [sympy.Symbol(f"p[{k}]", real=True) for k in range(len(parameters))]
        names = [self.time.name, *self.names, *rates, *parameters]
        for name in CONSTANTS:
            if name in names:
                raise ValueError(
                    f"{name} must not be redefined: it is a predefined number; choose another name"
                )
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(
                f"{', '.join(twice)}: a name must mean one thing, the time, a coordinate, "
                "a velocity or a parameter"
            )
        self.table = dict(zip(names, [self.t, *self.q, *self.w, *own], strict=True))
        self.rates = rates

    def read(self, what: str, given: Any) -> Any:
        """Return a formula or an expression in our symbols; an error names what is unknown."""
        if isinstance(given, str):
            return self._formula(what, given)
        sympy = self.sympy
        try:
            found = sympy.sympify(given, strict=True)
        except (sympy.SympifyError, TypeError, ValueError):
            found = None
        if not isinstance(found, sympy.Expr):
            raise TypeError(f"{what} must be one expression, got {type(given).__name__} {given!r}")
        for item, x, w in zip(self.given, self.q, self.w, strict=True):
            if not item.is_Symbol:
                found = found.subs(sympy.Derivative(item, self.time), w).subs(item, x)
        left = found.atoms(sympy.core.function.AppliedUndef, sympy.Derivative)
        if left:
            raise ValueError(
                f"{what} has {left.pop()}, which is neither a coordinate nor a velocity"
            )
        ours = set(self.table.values())
        unknown = {s for s in found.free_symbols - ours if normal(s.name) not in self.table}
        if unknown:
            raise self._unknown(what, min(str(s) for s in unknown))
        return found.xreplace({s: self.table[normal(s.name)] for s in found.free_symbols - ours})

    def _formula(self, what: str, text: str) -> Any:
        try:
            return expression(text, self.table)
        except UnknownNameError as error:
            raise self._unknown(what, error.name) from None
        except FormulaError as error:
            shown = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
            raise FormulaError(f"{what} must be an expression, got {shown!r}: {error}") from None

    def _unknown(self, what: str, name: str) -> FormulaError:
        parameters = [
            it for it in self.table if it not in (*self.names, *self.rates, self.time.name)
        ]
        near = meant(name, self.table) or f"give parameters={{{name!r}: ...}}"
        return FormulaError(
            f"{what} has {name}, which is not a coordinate ({', '.join(self.names)}), a velocity "
            f"({', '.join(self.rates)}), the time ({self.time.name}), pi or a parameter "
            f"({', '.join(parameters) or 'none'}); {near}"
        )


def _name_of(item: Any) -> str:
    if isinstance(item, str):
        return normal(item)
    name = getattr(item, "name", None) or getattr(getattr(item, "func", None), "__name__", None)
    return normal(str(name or item))


def _sequence(sympy: Any, items: Any) -> list[Any]:
    """Read coordinates: a list of symbols, functions or names, or names in one string."""
    if isinstance(items, str):
        items = items.replace(",", " ").split()
    if not isinstance(items, Iterable):
        items = [items]
    return [sympy.Symbol(_word(item)) if isinstance(item, str) else item for item in items]


def _word(name: str) -> str:
    if not normal(name).isidentifier():
        raise ValueError(f"q must hold names of letters and digits, got {name!r}")
    return normal(name)


def _forces(words: _Words, Q: Any) -> Sequence[Any]:
    n = len(words.names)
    if Q is None:
        return [0] * n
    if isinstance(Q, Mapping):
        by_name = {_name_of(key): entry for key, entry in Q.items()}
        strange = sorted(set(by_name) - set(words.names))
        if strange:
            raise ValueError(
                f"Q has unknown coordinate {strange[0]}; the coordinates are {words.names}"
            )
        return [by_name.get(name, 0) for name in words.names]
    entries = list(Q) if isinstance(Q, Iterable) and not isinstance(Q, str) else [Q]
    if len(entries) != n:
        raise ValueError(
            f"Q must have an entry for each of the {n} coordinates, got {len(entries)}"
        )
    return entries


def _control_columns(inputs: Any, n: int) -> dict[str, Any]:
    """Return the columns of the controls by name, of a dict or a matrix row by row."""
    if inputs is None or isinstance(inputs, Mapping):
        return {str(name): column for name, column in (inputs or {}).items()}
    if hasattr(inputs, "tolist"):
        inputs = inputs.tolist()  # of NumPy and SymPy
    rows = [
        [it] if isinstance(it, str) or not isinstance(it, Iterable) else list(it) for it in inputs
    ]
    r = len(rows[0]) if rows else 0
    if len(rows) != n or not r or any(len(row) != r for row in rows):
        raise ValueError(f"inputs must have shape ({n}, r) or be a dict of columns by name")
    return {f"u{j}": [row[j] for row in rows] for j in range(r)}


def _inputs(words: _Words, inputs: dict[str, Any]) -> tuple[Any, ...]:
    """Read the columns of the controls, as a matrix row by row."""
    n, columns = len(words.names), []
    for name, column in inputs.items():
        entries = list(column) if isinstance(column, Iterable) else [column]
        if isinstance(column, str) or len(entries) != n:
            raise ValueError(f"inputs[{name!r}] must have an entry for each of {n} coordinates")
        read = [words.read(f"inputs[{name!r}][{i}]", entry) for i, entry in enumerate(entries)]
        if any(entry.free_symbols & {words.t, *words.w} for entry in read):
            raise ValueError(f"inputs[{name!r}] must depend on coordinates and parameters only")
        with worked_on(f"inputs[{name!r}]"):
            columns.append([sound(entry) for entry in read])
    return tuple(column[i] for i in range(n) for column in columns)


def with_states(q: Any, T: Any, Q: Any, qdot: Any, states: Any) -> tuple[Any, Any, Any, Any]:
    r"""Return q, T, Q and qdot with first-order states.

    A state z is the velocity of a coordinate of mass 1 that no gap depends on: of
    :math:`T + z^2/2` the equation is :math:`\dot z = Q_z`.
    """
    sympy = needed("sympy", "symbolic systems")
    names = [_name_of(item) for item in _sequence(sympy, states)]
    given = _sequence(sympy, q)
    known = [f"{_name_of(item)}dot" for item in given]
    rates = [*(known if qdot is None else _sequence(sympy, qdot)), *names]
    integrals = {name: f"{name}_integral" for name in names}
    if isinstance(Q, Mapping):
        Q = {integrals.get(_name_of(key), key): entry for key, entry in Q.items()}
        missing = [name for name, integral in integrals.items() if integral not in Q]
        if missing:
            raise ValueError(
                f"Q must have the rate of each state; that of {missing[0]!r} is missing"
            )
    squares = " + ".join(f"{name}**2/2" for name in names)
    if isinstance(T, str):
        T = f"({T}) + {squares}"
    else:
        T = T + sum(sympy.Symbol(name) ** 2 for name in names) / 2
    return [*given, *integrals.values()], T, Q, rates


def _gaps_by_name(gaps: Any) -> dict[str, Any]:
    """Return the gaps by their names."""
    if isinstance(gaps, Mapping):
        return {str(name): gap for name, gap in gaps.items()}
    if isinstance(gaps, str) or not isinstance(gaps, Iterable):
        gaps = [gaps]
    return {f"gap{i}": gap for i, gap in enumerate(gaps)}


# The inputs of symbolic systems: constant columns, or a compiled matrix of the coordinates.


@dataclasses.dataclass(frozen=True)
class SymbolicInputs:
    """Inputs of a symbolic system.

    Parameters
    ----------
    names : tuple of str
        The controls.
    n : int
        Number of coordinates.
    constant : tuple of float or None
        The constant matrix row by row; None if it varies.
    sources : dict
        Else the sources of the function that fills it in.
    """

    names: tuple[str, ...]
    n: int
    constant: tuple[float, ...] | None
    sources: dict[str, str]

    @classmethod
    def of(cls, names: tuple[str, ...], entries: tuple[Any, ...]) -> SymbolicInputs:
        """Keep expressions, n for each control, row by row."""
        n = len(entries) // len(names)
        if all(entry.is_number for entry in entries):
            return cls(names, n, tuple(float(entry) for entry in entries), {})
        return cls(names, n, None, {"c": c_source(entries), "numba": python_source(entries)})

    def made(self, compiler: str, parameters: Any) -> ControlInputs:
        """Compile them; `parameters` has their ``address``."""
        if self.constant is not None:
            return ControlInputs(self.names, np.reshape(self.constant, (self.n, len(self.names))))
        native = compile_model(self.sources, compiler)
        return CompiledInputs(
            self.names, _input_matrix(native, self, parameters), native, parameters
        )


@dataclasses.dataclass(frozen=True, eq=False)
class CompiledInputs(ControlInputs):
    """Inputs whose matrix is compiled.

    Parameters
    ----------
    names, matrix
        As those of `ControlInputs`; the function is the compiled one.
    native : Native
        The compiled function.
    parameters : Parameters
        What it takes.
    """

    native: Native
    parameters: Any

    def spec(self) -> _zivi.Inputs:
        """Return the inputs for the extension."""
        owner = self.native, self.parameters
        address = self.parameters.address
        return _zivi.Inputs.compiled(self.r, self.native.address, address, owner)


def _input_matrix(native: Native, inputs: SymbolicInputs, parameters: Any) -> Any:
    function, shape = native.function, (inputs.n, len(inputs.names))

    def matrix(q: Array) -> Array:
        out, row = np.empty(shape), np.ascontiguousarray(q, dtype=np.float64)
        at = row.ctypes.data
        function(0.0, at, at, out.ctypes.data, parameters.address)
        return out

    return matrix


@dataclasses.dataclass(frozen=True)
class SymbolicEqualities:
    """Equality rows of a symbolic system.

    Parameters
    ----------
    names : tuple of str
        The rows.
    drives : tuple
        Numbers of rows and the motion that they follow.
    sources : dict
        Sources of the function that gives the numbers of the rows alone.
    """

    names: tuple[str, ...]
    drives: tuple[tuple[int, Any], ...]
    sources: dict[str, str]

    @classmethod
    def of(cls, derived: Derived) -> SymbolicEqualities | None:
        """Keep the rows of derived equations; None without any."""
        if not derived.equalities:
            return None
        entries = derived.rows
        sources = {"c": c_source(entries), "numba": python_source(entries)}
        return cls(derived.equalities, derived.drives, sources)


# A mechanical system from its energies, whose parameters can change without compiling.


class Parameters(MutableMapping[str, float]):
    """The parameters of a symbolic system by their names; they can be changed, not added.

    Parameters
    ----------
    values : dict
        Names and values in the order of the compiled function.
    """

    def __init__(self, values: Mapping[str, float]) -> None:
        self._places = {name: k for k, name in enumerate(values)}
        # at least one number: the compiled function gets its address
        self._row = np.array([*values.values(), *([] if values else [0.0])], dtype=np.float64)

    @property
    def address(self) -> int:
        """Where the numbers are."""
        return self._row.ctypes.data

    @property
    def values_as_bytes(self) -> bytes:
        """The numbers at this moment, to be compared with those of another one."""
        return self._row.tobytes()

    def rows(self, columns: Mapping[str, Array]) -> Array:
        """Return a row of all numbers for each run, with these columns instead of some."""
        rows = np.tile(self._row, (len(next(iter(columns.values()))), 1))
        for name, values in columns.items():
            rows[:, self._place(name)] = values
        return rows

    def _place(self, name: Any) -> int:
        if name in self._places:
            return self._places[name]
        key = normal(name if isinstance(name, str) else str(name))
        if key not in self._places:
            known = ", ".join(self._places) or "none"
            raise KeyError(f"unknown parameter {key!r}; the parameters are {known}")
        return self._places[key]

    def __getitem__(self, name: str) -> float:
        return float(self._row[self._place(name)])

    def __setitem__(self, name: str, value: float) -> None:
        self._row[self._place(name)] = finite(f"parameters[{name!r}]", value)

    def __delitem__(self, name: str) -> None:
        raise TypeError("a parameter can be changed, not removed")

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        return repr(dict(self))


@dataclasses.dataclass(frozen=True)
class Equations:
    """The equations of a symbolic system, kept for their derivatives.

    Parameters
    ----------
    derived : Derived
        The expressions.
    """

    derived: Derived

    @functools.cached_property
    def sources(self) -> dict[str, str]:
        """The source of a function that fills in all partial derivatives."""
        entries = self.derived.partials()
        return {"c": c_source(entries), "numba": python_source(entries)}

    @functools.cached_property
    def free(self) -> tuple[dict[str, str], Equations]:
        """The source of the function of masses and forces alone, and these equations."""
        n = len(self.derived.coordinates)
        entries = self.derived.entries[: n * n + n]
        free = dataclasses.replace(self.derived, entries=entries, gaps=(), channels=())
        return {"c": c_source(entries), "numba": python_source(entries)}, Equations(free)


class SymbolicSystem(MechanicalSystem):
    """A compiled `zivi.MechanicalSystem`, returned by `system`.

    Parameters
    ----------
    sources : dict
        The compiled function's source, in C and in Python.
    coordinates, gaps : sequence of str
        Names.
    parameters : dict
        Names and values.
    e : float or array_like
        Coefficients of restitution.
    compiler : str
        As for `system`.
    equations : Equations
        What the function was made of, for derivatives.
    channels : sequence of Channel
        The places of dry friction.
    impact_law, paradox : str
        As for `zivi.MechanicalSystem`.
    inputs : SymbolicInputs or ControlInputs, optional
        How controls act.
    contact : dict, optional
        Contact laws of compliant gaps, by name.
    equalities : SymbolicEqualities, optional
        The equality rows.
    """

    derived = True
    _rows: SymbolicEqualities | None = None
    _last_told: tuple[bytes, Restitutions, str, dict[str, float]] | None = None
    """What was told of the system last, and with which parameters."""

    def __init__(
        self,
        sources: dict[str, str],
        coordinates: Sequence[str],
        gaps: Sequence[str],
        parameters: Mapping[str, float],
        e: GivenRestitutions,
        compiler: str = "auto",
        equations: Equations | None = None,
        channels: Sequence[Channel] = (),
        impact_law: str = "newton",
        paradox: str = "stop",
        inputs: SymbolicInputs | ControlInputs | None = None,
        contact: Mapping[str, ContactLaw] | None = None,
        equalities: SymbolicEqualities | None = None,
    ) -> None:
        self._gaps = ()
        self._gap_names = tuple(gaps)
        self._coordinates = tuple(coordinates)
        self._n = len(self._coordinates)
        self._e = restitutions(e, len(self._gap_names))
        self._contact = contact_laws(contact, self._gap_names)
        check_compliant(e, self._contact_laws(), self._gap_names)
        self._channels = tuple(channels)
        self._impact_law = one_of("impact_law", impact_law, IMPACT_LAWS)
        self._paradox = one_of("paradox", paradox, PARADOXES)
        check_cones(self)
        self._sources, self._compiler, self._equations = sources, compiler, equations
        self._parameters = Parameters(parameters)
        self._native: Native = compile_model(sources, compiler)
        self._rows = equalities
        self._rows_native = (
            None if equalities is None else compile_model(equalities.sources, compiler)
        )
        self._symbolic_inputs = inputs
        if isinstance(inputs, SymbolicInputs):
            self._controls = inputs.made(compiler, self._parameters)
        elif inputs is not None:
            self._controls = inputs

    @property
    def parameters(self) -> Parameters:
        """The parameters by name; a change holds for the runs that start after it."""
        return self._parameters

    @property
    def source(self) -> str:
        """The compiled function, in C."""
        return self._sources["c"]

    def replace(self, e: GivenRestitutions | None = None, **parameters: float) -> SymbolicSystem:
        """Return the same system with other parameters, without compiling.

        Parameters
        ----------
        e : float or array_like, optional
            Other coefficients of restitution.
        **parameters
            Names and values of those that change.

        Returns
        -------
        SymbolicSystem
            A system of its own: this one keeps its parameters.

        Raises
        ------
        KeyError
            For a name that is no parameter.
        """
        other = SymbolicSystem(
            self._sources,
            self._coordinates or (),
            self._gap_names,
            self._parameters,
            self._e if e is None else e,
            self._compiler,
            self._equations,
            self._channels,
            self._impact_law,
            self._paradox,
            self._symbolic_inputs,
            self._contact,
            self._rows,
        )
        other._parameters.update(parameters)
        return other

    def _parameter_rows(self, columns: Mapping[str, Array]) -> Array | None:
        return self._parameters.rows(columns)

    def _contact_laws(self) -> list[ContactLaw | None]:
        return [self._contact.get(name) for name in self._gap_names]

    def _without_gaps(self) -> SymbolicSystem | None:
        """Return the system without gaps and friction, compiled when it is first asked for.

        It is None where the equations are not known.
        """
        if self._equations is None:
            return None
        sources, equations = self._equations.free
        names, numbers = self._coordinates or (), dict(self._parameters)
        return SymbolicSystem(sources, names, (), numbers, 0.0, self._compiler, equations)

    def _new_model(self, n: int) -> Model:
        """Make the model, which reads the current parameter values at each evaluation."""
        layout = Layout(n, self.m, len(self._channels), len(self.equality_names))
        parameters, rows, native = self._parameters, self._rows, self._rows_native
        if rows is None or native is None:
            return Model.of_code(layout, self._native, parameters.address, parameters)
        spec = _zivi.Model.compiled(
            self._native.address,
            data=parameters.address,
            owner=(self._native, native, parameters),
            equalities=native.address,
            drives=[(row, motion._spec()) for row, motion in rows.drives],
            layout=(n, layout.m, layout.p, layout.k),
        )
        return Model.native(layout, spec)

    @property
    def equality_names(self) -> tuple[str, ...]:
        """Names of the equality rows."""
        return () if self._rows is None else self._rows.names

    def _motions(self) -> list[Any]:
        return [] if self._rows is None else [motion for _, motion in self._rows.drives]

    def _told(self) -> tuple[str, dict[str, float]]:
        now = self._parameters.values_as_bytes, self._e
        last = self._last_told
        if last is None or last[0] != now[0] or last[1] is not now[1]:
            self._last_told = last = *now, repr(self), dict(self._parameters)
        return last[2:]

    def partials(self, model: Model, wanted: Collection[str] | None = None) -> Partials:
        """Return the function of the derivatives, compiled when it is first asked for.

        Raises
        ------
        ImportError
            Without SymPy.
        """
        if self._equations is None:
            return super().partials(model)
        native = compile_model(self._equations.sources, self._compiler)
        parameters = self._parameters
        owner = native, parameters
        function = _zivi.Model.compiled(native.address, data=parameters.address, owner=owner)
        spec = _zivi.Partials.function(function, len(parameters))
        return Partials(spec, dict(parameters))

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, parameters={self._parameters!r})"

    def __getstate__(self) -> dict[str, Any]:
        channels: dict[str, Any] = {"channels": self._channels} if self._channels else {}
        inputs = self._symbolic_inputs
        return (
            channels
            | ({} if inputs is None else {"inputs": inputs})
            | ({"contact": self._contact} if self._contact else {})
            | ({} if self._rows is None else {"equalities": self._rows})
            | self._chosen()
            | {
                "sources": self._sources,
                "coordinates": self._coordinates,
                "gaps": self._gap_names,
                "parameters": dict(self._parameters),
                "e": self._e,
                "compiler": self._compiler,
                "equations": self._equations,
            }
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        SymbolicSystem.__init__(self, **state)


def contact_laws(given: Any, gaps: Sequence[str]) -> dict[str, ContactLaw]:
    """Read the contact laws of gaps by their names."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise TypeError(f"contact must be a dict with the law of each gap by name, got {given!r}")
    laws: dict[str, ContactLaw] = {}
    for name, law in given.items():
        if name not in gaps:
            raise ValueError(f"contact[{name!r}] must be of a gap: there are {', '.join(gaps)}")
        if (read := contact_law(f"gap {name!r}", law)) is not None:
            laws[name] = read
    return laws


@hinted("symbolic")
def system(
    q: Any,
    *,
    T: Any,
    V: Any = 0,
    Q: Any = None,
    gaps: Any = (),
    parameters: Mapping[Any, float] | None = None,
    e: GivenRestitutions = 0.0,
    qdot: Any = None,
    compiler: str = "auto",
    slips: Mapping[str, Any] | None = None,
    mu: Mapping[str, Any] | None = None,
    friction: Mapping[str, Any] | None = None,
    e_t: Mapping[str, float] | None = None,
    impact_law: str = "newton",
    paradox: str = "stop",
    inputs: Any = None,
    contact: Mapping[str, ContactLaw] | None = None,
    states: Sequence[Any] = (),
    equalities: Mapping[str, Any] | None = None,
) -> SymbolicSystem:
    r"""Derive and compile a mechanical system from its energies.

    .. math::

        \frac{d}{dt}\frac{\partial L}{\partial \dot q} - \frac{\partial L}{\partial q}
        = Q + \sum_i \lambda_i \nabla g_i, \qquad L = T - V, \qquad g_i(t, q) \ge 0

    SymPy derives :math:`M`, :math:`F` (with the Coriolis terms), and the gradients and curvatures
    of the gaps; common subexpressions are computed once. The whole is compiled to one function, by
    a C compiler (the library is kept in a cache, ``ZIVI_CACHE`` or ``~/.cache/zivi``) or by numba:
    a run does not call the interpreter.

    Parameters
    ----------
    q : sequence
        The coordinates: functions of time (``sympy.physics.mechanics.dynamicsymbols``), whose
        velocities are their derivatives; or symbols or names, such as ``"x y"``, whose velocities
        are the symbols ``xdot``, ``ydot``, and the time the symbol ``t``.
    T : sympy.Expr or str
        Kinetic energy, quadratic in the velocities.
    V : sympy.Expr or str
        Potential energy.
    Q : sequence or dict, optional
        Other generalised forces, such as bearing friction: a sequence with one entry per
        coordinate, or a dict by coordinate. They may depend on time, coordinates and velocities.
    gaps : sequence or dict
        Expressions that stay >= 0, in time and coordinates; a dict names them.
    parameters : dict, optional
        Values of all other symbols, by symbol or name.
    e : float or array_like
        Coefficients of restitution in [0, 1], one for all gaps or one for each.
    qdot : sequence, optional
        Other symbols for the velocities than ``xdot``, ...
    compiler : {"auto", "c", "numba"}
        Compiler: the C compiler if one is installed, else numba (``"auto"``).
    slips : dict, optional
        Slip speeds of gaps with dry friction, by their names: linear in the velocities, such as
        ``"xdot + r*thdot - v"``. Their derivatives are derived.
    mu : dict, optional
        Their coefficients of friction: an expression >= 0, or ``(mu, mu_static)``.
    friction : dict, optional
        Dry friction in joints, by names of yours: ``(speed, limit)`` or ``(speed, limit, static)``
        with the static limit.
    e_t : dict, optional
        Tangential restitutions of gaps; by default 0.
    impact_law, paradox : str
        As for `zivi.MechanicalSystem`.
    inputs : dict, array_like or callable, optional
        Controls of closed loops by name: the column of :math:`B` of each, n expressions in
        coordinates and parameters, such as ``{"torque": [1, 0]}``. Or :math:`B` without names,
        of shape (n, r); or a function ``B(q)`` in Python.
    contact : dict, optional
        Contact laws of gaps by their names, which makes them compliant: `zivi.SpringDamper`,
        `zivi.Hertz`, `zivi.HuntCrossley` or a function of depth and rate.
    states : sequence, optional
        First-order states, such as the current of a motor: each is a name that all expressions but
        the gaps may have, and `Q` gives its rate by this name. In results the state is the velocity
        of a last coordinate ``name_integral``: ``sol.qdot[:, n]``.
    equalities : dict, optional
        Expressions in time and coordinates that stay 0, by the names of the rows: the equations of
        a joint that closes a chain, or a drive, ``{"drive": "th - omega*t"}``. A pair
        ``(expression, motion)`` follows a `zivi.Table` or `zivi.HarmonicWall`: the expression
        equals its value. Gradients, curvatures and rates are derived.

    Returns
    -------
    SymbolicSystem
        A `zivi.MechanicalSystem` with ``parameters``, which can be changed, and
        ``replace(name=value)``, both without compiling.

    Raises
    ------
    ValueError, TypeError
        For what is no formula or has a name that is not declared (`FormulaError`), or an energy
        of another form.
    ImportError
        Without SymPy: ``pip install 'zivi[symbolic]'``.
    RuntimeError
        Without a C compiler and numba.

    Examples
    --------
    A pendulum next to a wall:

    >>> pendulum = zivi.symbolic.system(
    ...     "phi",
    ...     T="m*l**2*phidot**2/2",
    ...     V="-m*g*l*cos(phi)",
    ...     gaps={"wall": "l*sin(phi) + d"},
    ...     parameters={"m": 1.0, "l": 0.5, "g": 9.81, "d": 0.1},
    ...     e=0.6,
    ... )
    >>> pendulum.at(0.0, [0.0], [1.0]).gaps
    array([0.1])
    >>> pendulum.parameters["d"] = 0.2  # without compiling
    >>> pendulum.replace(d=0.3).at(0.0, [0.0], [1.0]).gaps
    array([0.3])

    A disc that rolls or slides:

    >>> disc = zivi.symbolic.system(
    ...     "x y th",
    ...     T="m*(xdot**2 + ydot**2)/2 + m*r**2*thdot**2/4",
    ...     V="m*g*y",
    ...     gaps={"floor": "y - r"},
    ...     slips={"floor": "xdot + r*thdot"},
    ...     mu={"floor": "mu"},
    ...     parameters={"m": 1.0, "r": 0.1, "g": 9.81, "mu": 0.3},
    ... )
    >>> disc.at(0.0, [0.0, 0.1, 0.0], [1.0, 0.0, 0.0]).tangents
    array([[1. , 0. , 0.1]])

    A motor with the current i that pushes against a stop:

    >>> motor = zivi.symbolic.system(
    ...     "th",
    ...     T="J*thdot**2/2",
    ...     Q={"th": "k*i", "i": "(U - R*i - k*thdot)/L"},
    ...     states=["i"],
    ...     gaps={"stop": "1 - th"},
    ...     parameters={"J": 0.01, "k": 0.1, "U": 6.0, "R": 2.0, "L": 0.05},
    ... )
    >>> sol = zivi.simulate(motor, (0, 2), ([0, 0], [0, 0]))
    >>> float(sol.qdot[-1, 1].round(6))  # U/R, at rest on the stop
    3.0

    A slider-crank whose crank turns at 3 rad/s:

    >>> crank = zivi.symbolic.system(
    ...     "th ph x",
    ...     T="m*xdot**2/2 + J*thdot**2/2 + J*phdot**2/2",
    ...     equalities={
    ...         "along": "r*cos(th) + l*cos(ph) - x",
    ...         "across": "r*sin(th) + l*sin(ph)",
    ...         "drive": "th - omega*t",
    ...     },
    ...     parameters={"m": 1.0, "J": 0.1, "r": 1.0, "l": 2.5, "omega": 3.0},
    ... )
    >>> q, qdot = zivi.consistent(crank, [0.0, 0.0, 3.5])
    >>> sol = zivi.simulate(crank, (0, 10), (q, qdot))
    >>> float(sol.q[-1, 2].round(12))
    2.450725597313
    """
    if len(states):
        q, T, Q, qdot = with_states(q, T, Q, qdot, states)
    given = {"slips": slips, "mu": mu, "friction": friction, "e_t": e_t}
    rubbing = Rubbing(**{name: {} if it is None else it for name, it in given.items()})
    called = control_inputs(inputs) if callable(inputs) else None
    read = None if called else inputs
    found = derive(
        q, T, V, Q, gaps, parameters, qdot=qdot, rubbing=rubbing, inputs=read, equalities=equalities
    )
    sources = {"c": c_source(found.entries), "numba": python_source(found.entries)}
    return SymbolicSystem(
        sources,
        found.coordinates,
        found.gaps,
        found.parameters,
        e,
        compiler,
        Equations(found),
        found.channels,
        impact_law,
        paradox,
        SymbolicInputs.of(found.controls, found.inputs) if found.controls else called,
        contact,
        SymbolicEqualities.of(found),
    )
