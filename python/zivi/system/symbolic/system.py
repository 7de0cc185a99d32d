"""Mechanical systems from their energies, with parameters that need no recompilation."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Iterator, Mapping, MutableMapping, Sequence
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, finite
from zivi.base.formula import normal
from zivi.base.habits import hinted
from zivi.base.machine_code import Native, compile_model
from zivi.system.gap import IMPACT_LAWS, PARADOXES, Channel, ContactLaw, contact_law, one_of
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
from zivi.system.symbolic.derive import Derived, Rubbing, derive, with_states
from zivi.system.symbolic.expressions import c_source, python_source

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
