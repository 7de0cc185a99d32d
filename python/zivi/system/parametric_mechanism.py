"""Mechanical systems whose numbers have names, by a function that builds them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import zivi._zivi as _zivi
from zivi.base.check import finite
from zivi.system.impact_law import GivenRestitutions
from zivi.system.mechanism import MechanicalSystem, Model, check_names
from zivi.system.partials import Partials

__all__ = ["ParametricSystem"]

STEP = 5e-4
"""The step of a difference by a parameter, relative to it."""
MOVES = (-3, -2, -1, 1, 2, 3)
"""Where the systems of a difference lie, in steps."""


class ParametricSystem(MechanicalSystem):
    """A `MechanicalSystem` with named parameters, which a function of yours builds.

    `zivi.sensitivity` takes derivatives by these names, as central differences of sixth order of
    the numbers of the system (masses, forces, gaps), not of its motion.

    Parameters
    ----------
    build : callable
        ``build(name=value, ...) -> MechanicalSystem``. Coefficients of restitution must not depend
        on the parameters: derivatives by them are those by ``"e"``.
    parameters : dict of str to float
        Names and values.

    Raises
    ------
    TypeError
        If `build` gives no `MechanicalSystem`.
    ValueError
        If a value is not finite.

    See Also
    --------
    zivi.symbolic.system : exact derivatives, compiled.

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
            raise TypeError(f"build must give a zivi.MechanicalSystem, got {type(system).__name__}")
        return system if self._chosen_e is None else system.replace(e=self._chosen_e)

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values."""
        return dict(self._parameters)

    def replace(self, e: GivenRestitutions | None = None, **parameters: float) -> ParametricSystem:
        """Give the same system with other values of some parameters.

        Parameters
        ----------
        e : float or sequence, optional
            Other coefficients of restitution than those that `build` gives; the parameter ``e``
            where there is one.
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
            parameters["e"], e = cast(float, e), None
        check_names(parameters, self._parameters)
        new = object.__new__(type(self))
        values = self._parameters | parameters
        chosen = self._chosen_e if e is None else e
        new.__setstate__({"build": self._build, "parameters": values, "e": chosen})
        return new

    def model(self, n: int) -> Model:
        """Give what the extension integrates."""
        return self._built.model(n)

    def partials(self, model: Model) -> Partials:
        """Give the systems with moved parameters.

        Raises
        ------
        ValueError
            If a parameter moves a coefficient of restitution or changes the gaps.
        """
        differences = []
        for name, value in self._parameters.items():
            h = (value + STEP * (abs(value) or 1.0)) - value
            systems = [self._at({name: value + k * h}) for k in MOVES]
            for system in systems:
                if system.gap_names != self._gap_names or system.laws != self.laws:
                    raise ValueError(
                        f"parameters: {name!r} must move neither gaps' names nor e: derivatives by "
                        "coefficients of restitution are those by 'e'"
                    )
            models = [system.model(model.layout.n) for system in systems]
            differences.append(_zivi.Moved(h, [moved.spec for moved in models]))
        return Partials(_zivi.Partials.differences(differences), self._parameters)

    def __repr__(self) -> str:
        return f"ParametricSystem({self._built!r}, parameters={self._parameters!r})"

    def __getstate__(self) -> dict[str, Any]:
        chosen = {} if self._chosen_e is None else {"e": self._chosen_e}
        return {"build": self._build, "parameters": self._parameters, **chosen}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._chosen_e = state.get("e")
        ParametricSystem.__init__(self, state["build"], state["parameters"])
