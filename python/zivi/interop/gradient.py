"""A run as a function of some of its parameters, with its derivative: for optimisers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi._check import Array, real_array, whole
from zivi._parameters import INITIAL, check_differentiable, codes_of, with_value
from zivi.methods import SwitchedRK
from zivi.sensitivity import Sensitivity, sensitivity
from zivi.simulate import pair
from zivi.system import ImpactSystem

__all__ = ["RunFunction", "run_function"]

Output: TypeAlias = Literal["final", "zeno_time", "liftoff_time", "impact_time", "impact_speed"]
OUTPUTS = ("final", "zeno_time", "liftoff_time", "impact_time", "impact_speed")
DEFAULT = SwitchedRK(rtol=1e-9, atol=1e-11)


@dataclasses.dataclass(frozen=True)
class RunFunction:
    """A result of a run as a function of parameters.

    Calling it, ``f(p)``, gives ``(value, derivative)``, as `scipy.optimize` takes with
    ``jac=True`` where the value is a number.

    Attributes
    ----------
    wrt : tuple of str
        What the entries of ``p`` are.
    output : str
        What the value is.
    number : int
        Of which event.
    """

    system: ImpactSystem
    t_span: tuple[float, float]
    y0: tuple[float, float]
    wrt: tuple[str, ...]
    output: Output
    number: int
    method: SwitchedRK

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value: (2,) of a final state, () of a time or a speed."""
        return (2,) if self.output == "final" else ()

    def solve(self, p: ArrayLike) -> Sensitivity:
        """Run with the parameters.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        Sensitivity
            The run and all its derivatives.
        """
        values = real_array("p", p).ravel()
        if len(values) != len(self.wrt):
            raise ValueError(f"p must have {len(self.wrt)} entries, got {len(values)}")
        given = dict(zip(self.wrt, map(float, values), strict=True))
        system, (t0, t1), (x0, v0) = self.system, self.t_span, self.y0
        for name, value in given.items():
            if name not in INITIAL:
                system = with_value(system, name, value)
        start, state = given.get("t0", t0), (given.get("x0", x0), given.get("xdot0", v0))
        return sensitivity(
            system, (start, t1), state, self.wrt, self.method, dense_output=False, progress=False
        )

    def __call__(self, p: ArrayLike) -> tuple[float | Array, Array]:
        """Give the value and its derivative; NaN where the run has no such event."""
        s = self.solve(p)
        if self.output == "final":
            return np.array([s.trajectory.x[-1], s.trajectory.xdot[-1]]), s.final
        values, rates = {
            "zeno_time": (s.trajectory.zeno_times, s.zeno_times),
            "liftoff_time": (s.trajectory.liftoff_times, s.liftoff_times),
            "impact_time": (s.trajectory.impacts["t"], s.impacts["dt"]),
            "impact_speed": (s.trajectory.impacts["xdot_after"], s.impacts["du"]),
        }[self.output]
        if self.number >= min(len(values), len(rates)):
            return np.nan, np.full(len(self.wrt), np.nan)
        return float(values[self.number]), np.array(rates[self.number])


def run_function(
    system: ImpactSystem,
    t_span: Sequence[float],
    y0: ArrayLike,
    wrt: Sequence[str],
    output: Output = "final",
    number: int = 0,
    *,
    method: SwitchedRK = DEFAULT,
) -> RunFunction:
    """Make a function of parameters that gives a result of a run and its derivative.

    Parameters
    ----------
    system : ImpactSystem
        The force and the wall.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float)
        Initial distance (m) and velocity (m/s).
    wrt : sequence of str
        Names of the parameters, as in `zivi.sensitivity`.
    output : {"final", "zeno_time", "liftoff_time", "impact_time", "impact_speed"}
        The final state, or a time (s) or a speed after an impact (m/s).
    number : int
        Of which event of the run, from 0.
    method : SwitchedRK
        Tolerances.

    Returns
    -------
    RunFunction
        ``f(p) -> (value, derivative)``.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> f = zivi.interop.run_function(ball, (0, 9), (1, 0), ["x0", "e"], "zeno_time")
    >>> value, derivative = f([1.0, 0.5])
    >>> round(value, 6), derivative.round(6)
    (1.354571, array([0.677285, 3.612189]))
    """
    check_differentiable(system)
    names = tuple(wrt)
    codes_of(system, names)
    if output not in OUTPUTS:
        told = ", ".join(repr(name) for name in OUTPUTS)
        raise ValueError(f"output must be one of {told}, got {output!r}")
    if whole("number", number) < 0:
        raise ValueError(f"number must be >= 0, got {number}")
    span, state = pair("t_span", t_span, "(t0, t1)"), pair("y0", y0, "(x0, xdot0)")
    return RunFunction(system, span, state, names, output, number, method)
