"""Named parameters, numbers of friction and contact laws: values, systems with other values."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, cast

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import finite
from zivi.base.habits import closest
from zivi.system.gap import HarmonicWall, Hertz, HuntCrossley, SpringDamper
from zivi.system.impact_law import (
    GivenRestitutions,
    NewtonImpact,
    law_parameters,
    law_with,
    same_function,
)
from zivi.system.linear import LinearSystem
from zivi.system.mass import ImpactSystem, NativeForce, ParametricForce, check_system
from zivi.system.mechanism import (
    MechanicalSystem,
    Model,
    check_free,
    check_names,
    check_planar,
    check_rigid,
)
from zivi.system.model_parts import Partials
from zivi.system.table import refuse_tables

# Mechanical systems whose numbers have names, by a function that builds them.

STEP = 5e-4
"""The step of a difference by a parameter, relative to it."""
MOVES = (-3, -2, -1, 1, 2, 3)
"""Where the systems of a difference lie, in steps."""
WEIGHTS = (45 / 60, -9 / 60, 1 / 60)
"""Weights of the differences across one to three steps."""


class ParametricSystem(MechanicalSystem):
    """A `MechanicalSystem` with named parameters, which a function of yours builds.

    `zivi.sensitivity` differentiates with respect to these names. It uses sixth-order central
    differences of masses, forces and gaps; the motion itself is not finite-differenced.

    Parameters
    ----------
    build : callable
        ``build(name=value, ...) -> MechanicalSystem``. Impact laws and the numbers of contact laws
        may depend on the parameters.
    parameters : dict of str to float
        Names and values.

    Raises
    ------
    TypeError
        If `build` does not return a `MechanicalSystem`.
    ValueError
        If a value is not finite.

    See Also
    --------
    zivi.symbolic.system : exact derivatives, compiled.

    Notes
    -----
    The function is called once for each set of parameters. Derivatives by its parameters are
    differences of the functions of the systems that it returns, to a relative 1e-12.

    Examples
    --------
    >>> def drop(mass, floor):
    ...     gap = zivi.LinearGap([1.0], -floor, name="floor")
    ...     return zivi.MechanicalSystem(mass=mass, force=[-9.81 * mass], gaps=[gap], e=0.5)
    >>> system = zivi.ParametricSystem(drop, {"mass": 2.0, "floor": 0.1})
    >>> s = zivi.sensitivity(system, (0, 0.6), ([1.1], [0.0]), wrt=("mass", "floor"))
    >>> s.impacts["dt"][0].round(6)  # of sqrt(2 (1.1 - floor)/g)
    array([ 0.      , -0.225762])
    """

    _chosen_e: GivenRestitutions | None = None

    def __init__(
        self, build: Callable[..., MechanicalSystem], parameters: Mapping[str, float]
    ) -> None:
        if not callable(build):
            raise TypeError(f"build must be a function of the parameters, got {build!r}")
        if not isinstance(parameters, Mapping) or not parameters:
            raise TypeError(f"parameters must be a dict of names and values, got {parameters!r}")
        self._build = build
        self._parameters = {
            str(name): finite(f"parameters[{name!r}]", value) for name, value in parameters.items()
        }
        self._built = self._at({})
        built = self._built
        self._gaps, self._gap_names, self._e = built.gaps, built.gap_names, built._e
        self._n, self._coordinates = built._n, built._coordinates
        self._joints, self._channels = built._joints, built._channels
        self._impact_law, self._paradox = built._impact_law, built._paradox
        self._controls = built._controls
        self.derived = built.derived

    def _at(self, moved: Mapping[str, float]) -> MechanicalSystem:
        system = self._build(**(self._parameters | dict(moved)))
        if not isinstance(system, MechanicalSystem):
            raise TypeError(
                f"build must return a zivi.MechanicalSystem, got {type(system).__name__}"
            )
        return system if self._chosen_e is None else system.replace(e=self._chosen_e)

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values."""
        return dict(self._parameters)

    def replace(self, e: GivenRestitutions | None = None, **parameters: float) -> ParametricSystem:
        """Return the same system with other values of some parameters.

        Parameters
        ----------
        e : float or sequence, optional
            Coefficients of restitution that replace those of `build`; the parameter ``e`` if the
            system has one.
        **parameters
            New values by name.

        Returns
        -------
        ParametricSystem
            A new system.

        Raises
        ------
        KeyError
            For a name that is no parameter.
        """
        if e is not None and "e" in self._parameters:
            parameters["e"], e = cast("float", e), None
        check_names(parameters, self._parameters)
        new = object.__new__(type(self))
        values = self._parameters | parameters
        chosen = self._chosen_e if e is None else e
        new.__setstate__({"build": self._build, "parameters": values, "e": chosen})
        return new

    def _new_model(self, n: int) -> Model:
        return self._built.model(n)

    def partials(self, model: Model, wanted: Collection[str] | None = None) -> Partials:
        """Return the systems with moved parameters.

        Raises
        ------
        ValueError
            If a parameter changes the names or the kinds of the gaps, or the contact law of a gap
            that is a function.
        """
        differences = []
        for name, value in self._parameters.items():
            h = (value + STEP * (abs(value) or 1.0)) - value
            systems = [self._at({name: value + k * h}) for k in MOVES]
            for system in systems:
                if system.gap_names != self._gap_names:
                    raise ValueError(f"parameters: {name!r} must not change the names of gaps")
            specs = [system.model(model.layout.n).spec for system in systems]
            impacts = _moved_impacts(self, systems)
            contacts = _moved_contacts(name, h, self, systems)
            differences.append(_zivi.Moved(h, specs, impacts, contacts))
        return Partials(_zivi.Partials.differences(differences), self._parameters)

    def __repr__(self) -> str:
        return f"ParametricSystem({self._built!r}, parameters={self._parameters!r})"

    def __getstate__(self) -> dict[str, Any]:
        chosen = {} if self._chosen_e is None else {"e": self._chosen_e}
        return {"build": self._build, "parameters": self._parameters, **chosen}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._chosen_e = state.get("e")
        ParametricSystem.__init__(self, state["build"], state["parameters"])


def _moved_impacts(
    system: ParametricSystem, moved: Sequence[MechanicalSystem]
) -> list[tuple[int, list[_zivi.ImpactLaw]]]:
    """Return the impact laws that a parameter moves, by gap."""
    found = []
    for i, law in enumerate(system.laws):
        laws = [other.laws[i] for other in moved]
        if any(other != law for other in laws):
            found.append((i, [other._core for other in laws]))
    return found


def _moved_contacts(
    name: str, h: float, system: ParametricSystem, moved: Sequence[MechanicalSystem]
) -> list[tuple[int, int, float]]:
    """Return the derivatives of the numbers of contact laws: gap, number, derivative."""
    kinds = {i: (kind, law) for i, kind, _, law in system._compliant()}
    numbers: dict[int, list[list[float]]] = {i: [] for i in kinds}
    for other in moved:
        given = other._compliant()
        same = [it[0] for it in given] == list(kinds) and all(
            kinds[i][0] == kind and same_function(kinds[i][1], law) for i, kind, _, law in given
        )
        if not same:
            raise ValueError(
                f"parameters: {name!r} must not change the kind of a contact law, nor one that is "
                "a function; use numbers of zivi.SpringDamper, zivi.Hertz or zivi.HuntCrossley"
            )
        for i, _, coefficients, _ in given:
            numbers[i].append(coefficients)
    found = []
    for i, values in numbers.items():
        for number, column in enumerate(zip(*values, strict=True)):
            slope = sum(w * (column[3 + k] - column[2 - k]) for k, w in enumerate(WEIGHTS)) / h
            if slope != 0.0:
                found.append((i, number, slope))
    return found


# The parameters of a system by their names: numbers, values, systems with other values.

INITIAL = {"x0": -1, "xdot0": -2, "t0": -3}
"""What the extension calls the initial state; parameters of the impact law go down from -4."""
OF_LAW = -4


def check_differentiable(system: Any) -> None:
    """Reject systems other than one mass and one wall; the message names the alternative."""
    if isinstance(system, MechanicalSystem):
        raise TypeError(
            "only a zivi.ImpactSystem, one mass above one wall, is supported; for a "
            "zivi.MechanicalSystem, zivi.sensitivity computes derivatives and the monodromy matrix"
        )
    check_system(system)
    check_smooth(system)


def check_smooth(system: Any) -> None:
    """Reject compliant gaps and friction at gaps, which orbits do not support."""
    mechanical = isinstance(system, MechanicalSystem)
    if not mechanical:
        check_planar_friction(system)
        return
    check_rigid(system, "derivatives and orbits")
    check_planar_friction(system)
    channels = system._channels
    if channels and (system.m or any(it.gap is not None for it in channels)):
        raise NotImplementedError(
            "orbits of systems with gaps do not support dry friction, got the channels "
            f"{', '.join(system.channel_names)}; zivi.sensitivity has derivatives and the "
            "monodromy matrix of their runs, diagrams and basins support them"
        )


def check_planar_friction(system: Any) -> None:
    """Reject what derivatives do not support: equality rows, rotations in space, cones."""
    if not isinstance(system, MechanicalSystem):
        if system.friction:
            raise NotImplementedError(
                "derivatives, orbits, diagrams and basins do not support the friction of a "
                "zivi.ImpactSystem: use a zivi.MechanicalSystem with friction=[...]"
            )
        return
    check_free(system, "derivatives")
    check_planar(system, "derivatives")
    if not system.channel_names:
        return
    for name, value in (("impact_law", "newton"), ("paradox", "stop")):
        if (given := getattr(system, name)) != value:
            raise NotImplementedError(
                f"derivatives with friction need {name}={value!r}, got {given!r}"
            )


def check_newton(system: Any) -> None:
    """Reject as `check_differentiable`, and another impact law than Newton's."""
    check_differentiable(system)
    _ = system.e  # which says what takes another
    refuse_tables(system, "this")


def of_force(force: Any) -> dict[str, float]:
    """Names and values of the parameters of a force, in the order of the extension."""
    if isinstance(force, NativeForce):
        return force._numbers()
    if isinstance(force, ParametricForce):
        return dict(force.parameters)
    if isinstance(force, int | float):
        return {"force": float(force)}
    return {}


def parameters_of(system: ImpactSystem) -> dict[str, float]:
    """Names and values of the parameters of the force and of the wall."""
    values = of_force(system.force)
    if isinstance(system.wall, HarmonicWall):
        wall = dataclasses.asdict(system.wall)
        values |= {f"wall.{name}": value for name, value in wall.items()}
    return values


def names_of(system: ImpactSystem) -> list[str]:
    """All names by which a run of the system can be differentiated."""
    return [*INITIAL, *of_law(system), *parameters_of(system)]


def of_law(system: ImpactSystem) -> dict[str, float]:
    """Names and values of the parameters of the impact law: ``e``, or as ``law.e0``."""
    law = system.law
    if isinstance(law, NewtonImpact):
        return {"e": system.e}
    return {f"law.{name}": value for name, value in law_parameters(law).items()}


def codes_of(system: ImpactSystem, names: tuple[str, ...]) -> list[int]:
    """Return the numbers by which the extension knows names; a ValueError lists the names."""
    known = {**INITIAL} | {name: OF_LAW - i for i, name in enumerate(of_law(system))}
    known |= {name: number for number, name in enumerate(parameters_of(system))}
    for name in names:
        if name not in known:
            raise ValueError(_unknown(system, name))
    return [known[name] for name in names]


def parameter(system: ImpactSystem, name: str) -> float:
    """Return the value of a parameter of the system, those of its impact law included."""
    values = {**of_law(system), **parameters_of(system)}
    if name not in values:
        raise ValueError(_unknown(system, name, start=False))
    return values[name]


def with_value(system: ImpactSystem, name: str, value: float) -> ImpactSystem:
    """Return the same system with another value of a parameter."""
    force, wall = system.force, system.wall
    if isinstance(force, NativeForce) and name in force._numbers():
        return system._under(force._moved(name, value))
    parameter(system, name)
    if name == "e":
        return system._with(e=value)
    if name.startswith("law."):
        return system._with(e=law_with(system.law, name.removeprefix("law."), value))
    if name.startswith("wall."):
        assert isinstance(wall, HarmonicWall)
        moved = dataclasses.replace(wall, **{name.removeprefix("wall."): value})
        return system._with(wall=moved)
    if isinstance(force, ParametricForce):
        return system._with(force=force.replace(**{name: value}))
    return system._with(force=value)


def excitation(system: ImpactSystem) -> tuple[float | None, str | None]:
    """Return the angular frequency of the excitation, and its name; None if nothing excites."""
    found = {}
    force = system.force
    if isinstance(force, NativeForce) and (omega := force._excitation) is not None:
        found["omega"] = omega
    if isinstance(system.wall, HarmonicWall) and system.wall.amplitude != 0.0:
        found["wall.omega"] = abs(system.wall.omega)
    values = set(found.values())
    if len(values) != 1 or 0.0 in values:
        return None, None
    name = next(iter(found)) if len(found) == 1 else None
    return values.pop(), name


def _unknown(system: ImpactSystem, name: str, *, start: bool = True) -> str:
    names = names_of(system) if start else [*of_law(system), *parameters_of(system)]
    hint = ""
    if close := closest(name, names):
        hint = f"; did you mean {close!r}?"
    elif isinstance(system.force, int | float):
        hint = (
            "; a constant force is the one parameter force: zivi.LinearForce(gravity=9.81, ...) "
            "has gravity, stiffness, damping"
        )
    elif not of_force(system.force):
        hint = (
            "; a plain callable does not have parameters: name them with "
            "zivi.ParametricForce(f, parameters={...})"
        )
    return f"unknown parameter {name!r}; the parameters are {', '.join(names)}{hint}"


# The numbers of friction and contact laws by name, and systems with other values.


SLIP, STATIC, BOTH, VELOCITY, RESTITUTION = range(5)
"""Kinds of numbers, as the extension numbers them."""
OF_GAP = {"mu": SLIP, "mu_static": STATIC, "e_t": RESTITUTION}
OF_JOINT = {"limit": SLIP, "static": STATIC, "velocity": VELOCITY}


@dataclasses.dataclass(frozen=True)
class FrictionNumber:
    """A number of a channel of dry friction.

    Parameters
    ----------
    channel : int
        The channel.
    kind : int
        What it is for the extension.
    field : str
        The argument of the gap or the joint.
    value : float
        The number.
    """

    channel: int
    kind: int
    field: str
    value: float


def friction_numbers(system: MechanicalSystem) -> dict[str, FrictionNumber]:
    """Return the numbers of the friction of a system by name: those that are given as numbers.

    Symbolic systems and trees have names of their own for them, among their parameters.
    """
    built = system._built if isinstance(system, ParametricSystem) else system
    if type(built) not in (MechanicalSystem, LinearSystem):
        return {}
    found = {}
    first = len(built._channels) - len(built._joints)
    for c, channel in enumerate(built._channels):
        if channel.gap is None:
            owner: Any = built._joints[c - first]
            given = {field: getattr(owner, field) for field in OF_JOINT}
            kinds, lowest = OF_JOINT, ("limit", "static")
        else:
            given = {"mu_static": None} | built._gaps[channel.gap]._friction
            kinds, lowest = OF_GAP, ("mu", "mu_static")
        for field, kind in kinds.items():
            if not isinstance(given[field], int | float | np.integer | np.floating):
                continue
            both = field == lowest[0] and given[lowest[1]] is None
            number = FrictionNumber(c, BOTH if both else kind, field, float(given[field]))
            found[f"{channel.name}.{field}"] = number
    return found


def with_friction_numbers(
    system: MechanicalSystem, values: Mapping[str, float]
) -> MechanicalSystem:
    """Return the same system with other numbers of friction, by name.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """
    if not values:
        return system
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built_with_friction, system._build, dict(values))
        return ParametricSystem(build, system.parameters)
    numbers = friction_numbers(system)
    first = len(system._channels) - len(system._joints)
    gaps, joints = list(system.gaps), list(system.friction)
    for name, value in values.items():
        number = numbers[name]
        gap = system._channels[number.channel].gap
        owners: list[Any] = joints if gap is None else gaps
        at = number.channel - first if gap is None else gap
        owners[at] = _with_field(owners[at], number.field, float(value))
    return system.replace(gaps=gaps, friction=joints)


def _with_field(owner: Any, field: str, value: float) -> Any:
    """Return the same gap or joint with another number."""
    new = object.__new__(type(owner))
    new.__setstate__(owner.__getstate__() | {field: value})
    return new


def _built_with_friction(
    build: Any, values: Mapping[str, float], **parameters: float
) -> MechanicalSystem:
    return with_friction_numbers(build(**parameters), values)


# The numbers of the contact laws of compliant gaps.


def contact_numbers(system: MechanicalSystem) -> dict[str, tuple[int, int, float]]:
    """Return the numbers of contact laws by name, as ``"floor.k"``: gap, place, value."""
    found = {}
    for gap, law in enumerate(system._contact_laws()):
        for place, (field, value) in enumerate(_numbers_of_law(law).items()):
            found[f"{system.gap_names[gap]}.{field}"] = (gap, place, value)
    return found


def _numbers_of_law(law: Any) -> dict[str, float]:
    return dataclasses.asdict(law) if isinstance(law, SpringDamper | Hertz | HuntCrossley) else {}


def with_contact_numbers(system: MechanicalSystem, values: Mapping[str, float]) -> MechanicalSystem:
    """Return the same system with other numbers of contact laws, by name.

    Raises
    ------
    NotImplementedError
        For a tree or a symbolic system.
    ValueError
        If a number is out of its range.
    """
    if not values:
        return system
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built_with_contacts, system._build, dict(values))
        return ParametricSystem(build, system.parameters)
    if type(system) is not MechanicalSystem:
        raise NotImplementedError(
            f"numbers of contact laws of a {type(system).__name__} are not supported here; use a "
            "zivi.MechanicalSystem or a zivi.ParametricSystem"
        )
    numbers, gaps = contact_numbers(system), list(system.gaps)
    for name, value in values.items():
        gap, place, _ = numbers[name]
        law: Any = gaps[gap].contact
        field = list(_numbers_of_law(law))[place]
        moved = dataclasses.replace(law, **{field: float(value)})
        gaps[gap] = _with_field(gaps[gap], "contact", moved)
    return system.replace(gaps=gaps)


def _built_with_contacts(
    build: Any, values: Mapping[str, float], **parameters: float
) -> MechanicalSystem:
    return with_contact_numbers(build(**parameters), values)
