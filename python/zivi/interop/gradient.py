"""A run as a function of some of its parameters, with its derivative: for optimisers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, integer, real_array
from zivi.derivatives.result import OrbitStatus, Sensitivity
from zivi.derivatives.sensitivity import sensitivity
from zivi.interop.function import ParameterFunction
from zivi.interop.moved import MassRun, MechanicalRun, Moved, run_of
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair
from zivi.system.mass import ImpactSystem, check_system
from zivi.system.mechanism import MechanicalSystem

__all__ = ["RunFunction", "RunPoint", "run_function"]

Output: TypeAlias = Literal[
    "final",
    "positions",
    "velocities",
    "zeno_time",
    "liftoff_time",
    "impact_time",
    "impact_speed",
]
OUTPUTS = (
    "final",
    "positions",
    "velocities",
    "zeno_time",
    "liftoff_time",
    "impact_time",
    "impact_speed",
)
SAMPLED = ("positions", "velocities")
Outside: TypeAlias = Literal["inf", "nan", "raise"]
OUTSIDE = ("inf", "nan", "raise")
DEFAULT = SwitchedRK(rtol=1e-9, atol=1e-11)


class RunPoint(NamedTuple):
    """What a run gives at one point of its parameters.

    Attributes
    ----------
    value : float or ndarray
        The value.
    derivative : ndarray
        Its derivative.
    status : OrbitStatus
        ``COMPLETED`` and ``GRAZING`` come with a value; ``OUT_OF_DOMAIN``, ``NO_EVENT`` and
        ``RUN_ENDED`` do not.
    message : str
        What happened.
    """

    value: float | Array
    derivative: Array
    status: OrbitStatus
    message: str


@dataclasses.dataclass(frozen=True)
class RunFunction(ParameterFunction[RunPoint]):
    """A result of a run as a function of parameters.

    Calling it, ``f(p)``, gives ``(value, derivative)``, as `scipy.optimize.minimize` takes with
    ``jac=True`` where the value is a number. `fun` and `jac` are what
    `scipy.optimize.least_squares` and `scipy.optimize.root` take. There are no second derivatives.

    Where there is no result, because a parameter is out of its range (as it may be in a line
    search), the force raises an ArithmeticError or a ValueError, the run ends early, or it has no
    such event, the value is infinite and the derivative NaN: optimisers shorten their step then.
    `evaluate` says why.

    Attributes
    ----------
    output : str
        What the value is.
    number : int
        Of which event.
    times : ndarray or None
        The times of the samples (s).
    outside : str
        What is given where there is no result.
    """

    run: MassRun | MechanicalRun
    output: Output
    number: int
    times: Array | None
    outside: Outside
    method: SwitchedRK

    @property
    def wrt(self) -> tuple[str, ...]:
        """What the entries of ``p`` are, tuple of str."""
        return self.run.wrt

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value.

        Of times and speeds (), of a final state (2,), of n samples (n,). With nq coordinates of a
        mechanical system (2, nq) and (n, nq).
        """
        own = (len(self.run.state[0]),) if isinstance(self.run, MechanicalRun) else ()
        if self.output == "final":
            return (2, *own)
        return () if self.times is None else (len(self.times), *own)

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

        Raises
        ------
        ValueError
            For a parameter out of its range.
        """
        return self._solved(*self.run.at(self._point(p)))

    def _solved(self, system: Any, span: tuple[float, float], state: Any) -> Sensitivity:
        dense = self.times is not None
        found: Sensitivity = sensitivity(
            system, span, state, self.wrt, self.method, dense_output=dense, progress=False
        )
        return found

    def evaluate(self, p: ArrayLike) -> RunPoint:
        """Give the value and its derivative, and how the run went.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        RunPoint
            ``value``, ``derivative``, ``status``, ``message``.

        Raises
        ------
        ValueError
            If `p` has not as many entries as `wrt`; with ``outside="raise"`` where there is no
            result.
        """
        found: RunPoint = self._at(p)
        return found

    def _computed(self, p: Array) -> RunPoint:
        try:
            moved = self.run.at(p)
            self._check_span(moved)
            s = self._solved(*moved)
        except (ArithmeticError, ValueError) as error:
            if self.outside == "raise":
                raise
            return self._nothing(OrbitStatus.OUT_OF_DOMAIN, str(error) or type(error).__name__)
        return self._of_run(s)

    def _check_span(self, moved: Moved) -> None:
        start = moved[1][0]
        if self.times is not None and start > self.times[0]:
            raise ValueError(f"t0 must be <= the first of times, {self.times[0]}, got {start}")

    def _of_run(self, s: Sensitivity) -> RunPoint:
        told = "The run was differentiated."
        ended = not s.trajectory.success
        if self.output == "final" or self.times is not None:
            if ended:
                return self._nothing(OrbitStatus.RUN_ENDED, s.trajectory.message)
            return RunPoint(*self._states(s), s.status, told)
        values, rates = _events(s, self.output)
        if self.number >= min(len(values), len(rates)):
            if ended:
                return self._nothing(OrbitStatus.RUN_ENDED, s.trajectory.message)
            name = self.output.replace("_", " ")
            return self._nothing(
                OrbitStatus.NO_EVENT, f"The run has no {name} number {self.number}."
            )
        value, derivative = float(values[self.number]), np.array(rates[self.number])
        return RunPoint(value, derivative, s.status, told)

    def _states(self, s: Sensitivity) -> tuple[Array, Array]:
        """Give the final state, or samples."""
        if self.times is None:
            sol: Any = s.trajectory
            x, v = (sol.x, sol.xdot) if hasattr(sol, "x") else (sol.q, sol.qdot)
            return np.stack([x[-1], v[-1]]), s.final
        of = int(self.output == "velocities")
        samples = np.ascontiguousarray(s.trajectory(self.times)[of])
        return samples, s.jacobian(self.times, KINDS[of])

    def _nothing(self, status: OrbitStatus, message: str) -> RunPoint:
        """Give what stands for a value where there is none."""
        if self.outside == "raise":
            raise ValueError(message)
        value = np.full(self.shape, np.inf if self.outside == "inf" else np.nan)
        derivative = np.full((*self.shape, len(self.wrt)), np.nan)
        return RunPoint(float(value) if value.ndim == 0 else value, derivative, status, message)


KINDS: tuple[Literal["position"], Literal["velocity"]] = ("position", "velocity")


def _events(s: Sensitivity, output: Output) -> tuple[Array, Array]:
    """Give the times or speeds of events, and their derivatives."""
    sol: Any = s.trajectory
    if output == "zeno_time":
        return sol.zeno["t"], s.zeno_times
    if output == "liftoff_time":
        return sol.liftoffs["t"], s.liftoff_times
    if output == "impact_time":
        return sol.impacts["t"], s.impacts["dt"]
    return sol.impacts["speed_after"], s.impacts["du"]


def run_function(
    system: ImpactSystem | MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    wrt: Sequence[str],
    output: Output = "final",
    number: int = 0,
    *,
    times: ArrayLike | None = None,
    outside: Outside = "inf",
    method: SwitchedRK = DEFAULT,
) -> RunFunction:
    """Make a function of parameters that gives a result of a run and its derivative.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        What moves.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float) or (array_like, array_like)
        Initial distance (m) and velocity (m/s); of a mechanical system ``(q0, qdot0)``.
    wrt : sequence of str
        Names of the parameters, as in `zivi.sensitivity`.
    output : str
        The ``"final"`` state; ``"positions"`` or ``"velocities"`` at `times`; or of an event
        ``"zeno_time"``, ``"liftoff_time"``, ``"impact_time"`` (s), or ``"impact_speed"``, the speed
        after an impact (m/s).
    number : int
        Of which event of the run, from 0.
    times : array_like, optional
        Ascending times within the run, of positions or velocities (s).
    outside : {"inf", "nan", "raise"}
        What is given where there is no result: an infinite value, which optimisers take for a step
        that is too long, NaN, or a ValueError.
    method : SwitchedRK
        Tolerances.

    Returns
    -------
    RunFunction
        ``f(p) -> (value, derivative)``, with `RunFunction.fun` and `RunFunction.jac`.

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
    >>> f.evaluate([1.0, 1.2]).status  # no coefficient of restitution
    <OrbitStatus.OUT_OF_DOMAIN: 9>

    Parameters from measured positions, with ``scipy.optimize.least_squares``:

    >>> t = np.linspace(0, 1, 20)
    >>> model = zivi.interop.run_function(ball, (0, 1), (1, 0), ["x0", "e"], "positions", times=t)
    >>> measured = model.fun([1.1, 0.6])
    >>> found = scipy.optimize.least_squares(
    ...     lambda p: model.fun(p) - measured, [1.0, 0.5], jac=model.jac)  # doctest: +SKIP
    """
    if not isinstance(system, MechanicalSystem):
        check_system(system)
    span, names = pair("t_span", t_span, "(t0, t1)"), (wrt,) if isinstance(wrt, str) else tuple(wrt)
    run = run_of(system, span, y0, names)
    if output not in OUTPUTS:
        told = ", ".join(repr(name) for name in OUTPUTS)
        raise ValueError(f"output must be one of {told}, got {output!r}")
    if integer("number", number) < 0:
        raise ValueError(f"number must be >= 0, got {number}")
    if outside not in OUTSIDE:
        raise ValueError(f"outside must be 'inf', 'nan' or 'raise', got {outside!r}")
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"method must be a zivi.SwitchedRK, got {method!r}")
    samples = _sampled(times, output, span)
    return RunFunction(run, output, number, samples, outside, method)


def _sampled(times: ArrayLike | None, output: Output, span: tuple[float, float]) -> Array | None:
    """Check the times of samples, which some outputs need and the others do not take."""
    if output not in SAMPLED:
        if times is not None:
            raise ValueError(f"times are those of 'positions' or 'velocities', not of {output!r}")
        return None
    if times is None:
        raise ValueError(f"times must be given for output={output!r}")
    array = np.array(real_array("times", times), ndmin=1)
    within = array.ndim == 1 and len(array) and np.all(np.diff(array) > 0.0)
    if not within or not (span[0] <= array[0] and array[-1] <= span[1]):
        raise ValueError(f"times must be ascending and within t_span = {span}, got {times!r}")
    array.flags.writeable = False
    return array
