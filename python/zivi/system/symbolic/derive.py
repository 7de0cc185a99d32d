"""Equations of motion from energies, by SymPy."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from zivi.base.check import finite
from zivi.base.extras import needed
from zivi.base.formula import CONSTANTS, FormulaError, meant, normal
from zivi.system.gap import Channel, HarmonicWall, tangential_restitution
from zivi.system.symbolic.expressions import UnknownNameError, depends, expression, sound, worked_on
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
        Coefficients there, each one expression or a pair, in slip and in stick.
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
