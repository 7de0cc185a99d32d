"""Runs and solutions of VIs as differentiable functions of parameters."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, integer, is_sparse, real_array, vector
from zivi.derivatives.mechanical_sensitivity import MechanicalRun, Moved, SmoothMassRun, smooth_run
from zivi.derivatives.result import OrbitStatus, Sensitivity
from zivi.derivatives.sensitivity import sensitivity
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair
from zivi.system.mass import ImpactSystem, check_system
from zivi.system.mechanism import MechanicalSystem
from zivi.vi.derivatives import VIDerivative, solution_derivative
from zivi.vi.solve import solve_vi
from zivi.vi.types import VIOptions, VIResult

__all__ = [
    "ControlledFunction",
    "ParameterFunction",
    "RunFunction",
    "RunPoint",
    "SolutionFunction",
    "SolutionPoint",
    "controlled_function",
    "run_function",
    "solution_function",
]

# Base class of functions of parameters with derivatives.

Point = TypeVar("Point", bound=NamedTuple)


@dataclasses.dataclass(frozen=True)
class ParameterFunction(ABC, Generic[Point]):
    """A function of parameters whose value comes with its derivative; the last point is kept."""

    _last: dict[bytes, Any] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    @abstractmethod
    def wrt(self) -> tuple[str, ...]:
        """Names of the entries of ``p``, tuple of str."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """The shape of the value."""

    @abstractmethod
    def evaluate(self, p: ArrayLike) -> Point:
        """Return the value, its derivative and the diagnostics."""

    @abstractmethod
    def _computed(self, p: Array) -> Point:
        """Compute a point that is not cached."""

    def _at(self, p: ArrayLike) -> Any:
        values = self._point(p)
        key = values.tobytes()
        found: Any = self._last.get(key)
        if found is None:
            found = self._computed(values)
            self._last.clear()
            self._last[key] = found
        # who changes what is given does not change what is kept
        value = np.copy(found.value) if self.shape else found.value
        return found._replace(value=value, derivative=found.derivative.copy())

    def _point(self, p: ArrayLike) -> Array:
        values = real_array("p", p).ravel()
        if len(values) != len(self.wrt):
            raise ValueError(f"p must have {len(self.wrt)} entries, got {len(values)}")
        return values

    def __call__(self, p: ArrayLike) -> tuple[Any, Array]:
        """Return the value and its derivative, of the shapes `shape` and ``(*shape, len(wrt))``."""
        found: Any = self.evaluate(p)
        return found.value, found.derivative

    def fun(self, p: ArrayLike) -> Array:
        """Return the value as a vector, for `scipy.optimize.least_squares`.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        ndarray
            One-dimensional.
        """
        found: Any = self.evaluate(p)
        return np.ravel(found.value)

    def jac(self, p: ArrayLike) -> Array:
        """Return the derivative as a matrix; the run of `fun` at the same point is reused.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        ndarray
            A row for each entry of `fun`, a column for each of `wrt`.
        """
        found: Any = self.evaluate(p)
        derivative: Array = found.derivative
        return derivative.reshape(-1, len(self.wrt))


# A run as a function of some of its parameters, with its derivative: for optimisers.

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
    """Value and derivative of a run at one parameter point.

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
    ``jac=True`` where the value is a number. `fun` and `jac` are arguments of
    `scipy.optimize.least_squares` and `scipy.optimize.root`. There are no second derivatives.

    Where there is no result, because a parameter is out of its range (as it may be in a line
    search), the force raises an ArithmeticError or a ValueError, the run ends early, or it has no
    such event, the value is infinite and the derivative NaN: optimisers shorten their step then.
    `evaluate` returns the reason.

    Attributes
    ----------
    output : str
        What the value is.
    number : int
        Of which event.
    times : ndarray or None
        The times of the samples (s).
    outside : str
        Value of failed runs.
    """

    run: SmoothMassRun | MechanicalRun
    output: Output
    number: int
    times: Array | None
    outside: Outside
    method: SwitchedRK

    @property
    def wrt(self) -> tuple[str, ...]:
        """Names of the entries of ``p``, tuple of str."""
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
        """Return the value and its derivative, and how the run went.

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
            If `p` and `wrt` differ in length; with ``outside="raise"`` if the run fails.
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
        values, rates = _event_derivatives(s, self.output)
        if self.number >= min(len(values), len(rates)):
            if ended:
                return self._nothing(OrbitStatus.RUN_ENDED, s.trajectory.message)
            name = self.output.replace("_", " ")
            return self._nothing(
                OrbitStatus.NO_EVENT, f"The run ended before {name} number {self.number}."
            )
        value, derivative = float(values[self.number]), np.array(rates[self.number])
        return RunPoint(value, derivative, s.status, told)

    def _states(self, s: Sensitivity) -> tuple[Array, Array]:
        """Return the final state, or samples."""
        if self.times is None:
            sol: Any = s.trajectory
            x, v = (sol.x, sol.xdot) if hasattr(sol, "x") else (sol.q, sol.qdot)
            return np.stack([x[-1], v[-1]]), s.final
        of = int(self.output == "velocities")
        samples = np.ascontiguousarray(s.trajectory(self.times)[of])
        return samples, s.jacobian(self.times, KINDS[of])

    def _nothing(self, status: OrbitStatus, message: str) -> RunPoint:
        """Return the substitute for a value of a failed run."""
        if self.outside == "raise":
            raise ValueError(message)
        value = np.full(self.shape, np.inf if self.outside == "inf" else np.nan)
        derivative = np.full((*self.shape, len(self.wrt)), np.nan)
        return RunPoint(float(value) if value.ndim == 0 else value, derivative, status, message)


KINDS: tuple[Literal["position"], Literal["velocity"]] = ("position", "velocity")


def _event_derivatives(s: Sensitivity, output: Output) -> tuple[Array, Array]:
    """Return the times or speeds of events, and their derivatives."""
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
    """Make a function of parameters that returns a result of a run and its derivative.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        What moves.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float) or (array_like, array_like)
        Initial distance (m) and velocity (m/s); of a mechanical system ``(q0, qdot0)``.
    wrt : sequence of str
        Names of the parameters (see `zivi.sensitivity`).
    output : str
        The ``"final"`` state; ``"positions"`` or ``"velocities"`` at `times`; or of an event
        ``"zeno_time"``, ``"liftoff_time"``, ``"impact_time"`` (s), or ``"impact_speed"``, the speed
        after an impact (m/s).
    number : int
        Of which event of the run, from 0.
    times : array_like, optional
        Ascending times within the run, of positions or velocities (s).
    outside : {"inf", "nan", "raise"}
        Value of failed runs: infinite, which optimisers treat as a too long step; NaN; or a
        ValueError is raised.
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

    See Also
    --------
    zivi.sensitivity, jax_function : the derivatives themselves; for JAX.

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
    run = smooth_run(system, span, y0, names)
    if output not in OUTPUTS:
        told = ", ".join(repr(name) for name in OUTPUTS)
        raise ValueError(f"output must be one of {told}, got {output!r}")
    if integer("number", number) < 0:
        raise ValueError(f"number must be >= 0, got {number}")
    if outside not in OUTSIDE:
        raise ValueError(f"outside must be 'inf', 'nan' or 'raise', got {outside!r}")
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"method must be a zivi.SwitchedRK, got {method!r}")
    samples = _check_times(times, output, span)
    return RunFunction(run, output, number, samples, outside, method)


def _check_times(
    times: ArrayLike | None, output: Output, span: tuple[float, float]
) -> Array | None:
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


# The final state of a run as a function of controls that are constant over intervals.


@dataclasses.dataclass(frozen=True)
class ControlledFunction(ParameterFunction[RunPoint]):
    """The final state of a run as a function of controls that are constant over intervals.

    Calling it, ``f(u)``, returns ``(value, derivative)``. The run goes from edge to edge, one
    `zivi.sensitivity` for each interval by its initial state and its controls; the derivative by
    all controls is the product of these matrices. `jax_function` accepts this function.

    Attributes
    ----------
    edges : ndarray
        Edges of the N intervals (s), shape (N + 1,).
    controls : tuple of str
        Names of the r controls, parameters of the system.
    """

    system: Any
    y0: Any
    edges: Array
    controls: tuple[str, ...]
    method: SwitchedRK

    @property
    def wrt(self) -> tuple[str, ...]:
        """Names of the entries of ``u``: all controls of the first interval, then of the next."""
        numbers = range(len(self.edges) - 1)
        return tuple(f"{name}[{k}]" for k in numbers for name in self.controls)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the final state: (2,) for one mass, (2, n) for n coordinates."""
        mechanical = isinstance(self.system, MechanicalSystem)
        return (2, len(np.atleast_1d(self.y0[0]))) if mechanical else (2,)

    def evaluate(self, p: ArrayLike) -> RunPoint:
        """Return the final state, its derivative by all controls, and the status.

        Parameters
        ----------
        p : array_like
            Controls, shape (N r,) or (N, r).

        Returns
        -------
        RunPoint
            Infinite where there is no run with these controls.
        """
        found: RunPoint = self._at(p)
        return found

    def gradient(self, u: ArrayLike, weights: ArrayLike) -> Array:
        """Return the gradient of a function of the final state by all controls.

        Parameters
        ----------
        u : array_like
            Controls.
        weights : array_like
            Derivatives of the function by the final state, of the shape `shape`.

        Returns
        -------
        ndarray
            Shape (N r,).
        """
        derivative = self.evaluate(u).derivative
        return np.ravel(weights) @ derivative.reshape(-1, len(self.wrt))

    def _computed(self, p: Array) -> RunPoint:
        r, size = len(self.controls), int(np.prod(self.shape))
        columns, state, status = np.zeros((size, len(p))), self.y0, OrbitStatus.COMPLETED
        for k, end in enumerate(self.edges[1:]):
            span = (float(self.edges[k]), float(end))
            try:
                s = self._over(span, state, p[k * r : (k + 1) * r])
            except (ArithmeticError, ValueError) as error:
                return self._without(OrbitStatus.OUT_OF_DOMAIN, str(error))
            if not s.trajectory.success:
                return self._without(OrbitStatus.RUN_ENDED, s.trajectory.message)
            step = s.final.reshape(size, -1)
            columns = step[:, :size] @ columns
            columns[:, k * r : (k + 1) * r] += step[:, size:]
            status = max(status, s.status)
            sol: Any = s.trajectory
            mechanical = isinstance(self.system, MechanicalSystem)
            state = (sol.q[-1], sol.qdot[-1]) if mechanical else (sol.x[-1], sol.xdot[-1])
        derivative = columns.reshape(*self.shape, len(p))
        return RunPoint(np.array(state), derivative, status, "The run was differentiated.")

    def _over(self, span: tuple[float, float], state: Any, controls: Array) -> Sensitivity:
        """Run over an interval, with derivatives by its initial state and its controls."""
        mechanical = isinstance(self.system, MechanicalSystem)
        run = smooth_run(self.system, span, state, self.controls)
        starts = ("q0", "qdot0") if mechanical else ("x0", "xdot0")
        found: Sensitivity = sensitivity(
            run.at(controls)[0],
            span,
            state,
            (*starts, *self.controls),
            self.method,
            dense_output=False,
            progress=False,
        )
        return found

    def _without(self, status: OrbitStatus, message: str) -> RunPoint:
        derivative = np.full((*self.shape, len(self.wrt)), np.nan)
        return RunPoint(np.full(self.shape, np.inf), derivative, status, message)


def controlled_function(
    system: ImpactSystem | MechanicalSystem,
    edges: ArrayLike,
    y0: Any,
    controls: Sequence[str] | str,
    *,
    method: SwitchedRK = DEFAULT,
) -> ControlledFunction:
    """Return the final state of a run as a function of piecewise constant controls.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The system, with the controls among its parameters.
    edges : array_like
        Increasing edges of the N intervals (s), shape (N + 1,).
    y0 : (float, float) or (array_like, array_like)
        Initial state.
    controls : sequence of str
        Names of the parameters that are controls, as in `zivi.sensitivity`.
    method : SwitchedRK
        Tolerances.

    Returns
    -------
    ControlledFunction
        ``f(u) -> (value, derivative)``, with `ControlledFunction.gradient`.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range.

    See Also
    --------
    run_function : parameters of a whole run.

    Examples
    --------
    >>> push = zivi.ParametricForce(lambda t, x, v, u: u - 9.81, {"u": 0.0})
    >>> ball = zivi.ImpactSystem(push, e=0.5)
    >>> f = zivi.interop.controlled_function(ball, [0.0, 0.1, 0.2], (1.0, 0.0), "u")
    >>> value, derivative = f([2.0, 0.0])
    >>> derivative.round(6)  # of (x, xdot) at 0.2 s
    array([[0.015, 0.005],
           [0.1  , 0.1  ]])
    """
    names = (controls,) if isinstance(controls, str) else tuple(controls)
    times = np.array(real_array("edges", edges))
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0.0):
        raise ValueError(f"edges must be two or more increasing times, got {edges!r}")
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"method must be a zivi.SwitchedRK, got {method!r}")
    if not names:
        raise ValueError("controls must be one or more names of parameters, got none")
    smooth_run(system, (float(times[0]), float(times[-1])), y0, names)
    return ControlledFunction(system, y0, times, names, method)


# The solution of a VI as a function of its parameters, with its derivative: for optimisers.

_STEP = float(np.finfo(float).eps) ** (1 / 3)


class SolutionPoint(NamedTuple):
    """A solution at one point of its parameters.

    Attributes
    ----------
    value : ndarray
        The unknowns; infinite without a solution.
    derivative : ndarray
        By the parameters, of shape (unknowns, parameters); NaN if there is none.
    solution : VIResult
        The solve.
    of : VIDerivative or None
        The derivative with its index sets, `VIDerivative.unclear` among them.
    """

    value: Array
    derivative: Array
    solution: VIResult
    of: VIDerivative | None


@dataclasses.dataclass(frozen=True)
class SolutionFunction(ParameterFunction[SolutionPoint]):
    """The solution of a VI as a function of parameters.

    Calling it, ``f(p)``, gives ``(x, dx/dp)``. `fun` and `jac` are arguments of
    `scipy.optimize.least_squares` and `scipy.optimize.root`; `gradient` is the derivative of a
    function of the solution. Each solve begins at the last solution. Where there is none, or it has
    no derivative, the value is infinite and the derivative NaN.
    """

    F: Callable[[Array, Array], ArrayLike]
    lower: Any
    upper: Any
    x0: Array
    names: tuple[str, ...]
    jacobian: Callable[[Array, Array], Any]
    map_slopes: Callable[[Array, Array], Any] | None
    options: VIOptions | Mapping[str, Any] | None

    @property
    def wrt(self) -> tuple[str, ...]:
        """Names of the entries of ``p``, tuple of str."""
        return self.names

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value, ``(unknowns,)``."""
        return self.x0.shape

    def evaluate(self, p: ArrayLike) -> SolutionPoint:
        """Solve, and differentiate the solution.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        SolutionPoint
            ``value``, ``derivative``, ``solution``, ``of``.

        Raises
        ------
        ValueError
            If `p` has not as many entries as `wrt`.
        """
        found: SolutionPoint = self._at(p)
        return found

    def _computed(self, p: Array) -> SolutionPoint:
        last = next(iter(self._last.values()), None)
        start = last.solution.x if last is not None and last.solution.success else self.x0
        lower, upper = (_evaluate_at(box, p) for box in (self.lower, self.upper))
        solution = solve_vi(
            lambda x: self.F(x, p),
            lower,
            upper,
            start,
            jac=lambda x: self.jacobian(x, p),
            options=self.options,
        )
        nothing = np.full((len(self.x0), len(p)), np.nan)
        if not solution.success:
            return SolutionPoint(np.full(self.shape, np.inf), nothing, solution, None)
        derivative = solution_derivative(
            solution,
            self.jacobian(solution.x, p),
            self._slopes(solution.x, p),
            lower,
            upper,
            dlower=_bound_slopes(self.lower, p, len(self.x0)),
            dupper=_bound_slopes(self.upper, p, len(self.x0)),
        )
        try:
            return SolutionPoint(solution.x, derivative.matrix, solution, derivative)
        except np.linalg.LinAlgError:
            return SolutionPoint(solution.x, nothing, solution, derivative)

    def _slopes(self, x: Array, p: Array) -> Any:
        """Return ``dF/dp``, by central differences unless a function was given."""
        if self.map_slopes is None:
            return _differenced_columns(lambda q: real_array("F(x, p)", self.F(x, q)), p)
        slopes = self.map_slopes(x, p)
        return slopes if is_sparse(slopes) else np.reshape(slopes, (len(x), len(p)))

    def gradient(self, p: ArrayLike, weights: ArrayLike) -> Array:
        """Return the gradient of a function of the solution from its gradient by the unknowns.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.
        weights : array_like
            The gradient of the function by the unknowns.

        Returns
        -------
        ndarray
            Its gradient by the parameters; NaN where the solution has no derivative.
        """
        of = self.evaluate(p).of
        try:
            return of.vjp(weights) if of is not None else np.full(len(self.wrt), np.nan)
        except np.linalg.LinAlgError:
            return np.full(len(self.wrt), np.nan)


def solution_function(
    F: Callable[[Array, Array], ArrayLike],
    lower: Any,
    upper: Any,
    x0: ArrayLike,
    wrt: Sequence[str] | str,
    *,
    jac: Callable[[Array, Array], Any],
    dF: Callable[[Array, Array], Any] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> SolutionFunction:
    """Make a function of parameters that returns the solution of a VI and its derivative.

    Parameters
    ----------
    F : callable
        ``F(x, p)``, the map.
    lower, upper : array_like, callable or None
        Bounds, or functions of ``p`` that return them.
    x0 : array_like
        Where the first solve begins.
    wrt : sequence of str
        Names of the parameters.
    jac : callable
        ``jac(x, p)``, the Jacobian of `F` by the unknowns, dense or sparse.
    dF : callable, optional
        ``dF(x, p)``, its derivatives by the parameters, of shape (unknowns, parameters); by default
        central differences.
    options : VIOptions or dict, optional
        As for `zivi.solve_vi`.

    Returns
    -------
    SolutionFunction
        ``f(p) -> (x, dx/dp)``, with `SolutionFunction.fun`, `SolutionFunction.jac` and
        `SolutionFunction.gradient`; It can be passed to `jax_function`.

    Raises
    ------
    ValueError, TypeError
        For an argument that is not as above.

    See Also
    --------
    zivi.vi.solution_derivative : the derivatives themselves.

    Examples
    --------
    Two firms choose quantities; the price falls with their sum and ``p`` is the cost of the second:

    >>> def profit(x, p):
    ...     return np.array([2 * x[0] + x[1] - 10, x[0] + 2 * x[1] - 10 + p[0]])
    >>> M = np.array([[2.0, 1.0], [1.0, 2.0]])
    >>> f = zivi.interop.solution_function(profit, 0, None, [1, 1], ["cost"], jac=lambda x, p: M)
    >>> f([1.0])
    (array([3.66666667, 2.66666667]), array([[ 0.33333333],
           [-0.66666667]]))
    >>> f.fun([6.0])  # the second sells nothing any more
    array([5., 0.])
    """
    for name, function in (("F", F), ("jac", jac)):
        if not callable(function):
            raise TypeError(f"{name} must be callable, got {type(function).__name__}")
    if dF is not None and not callable(dF):
        raise TypeError(f"dF must be callable or None, got {type(dF).__name__}")
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if not names or not all(isinstance(name, str) for name in names):
        raise ValueError(f"wrt must be names of parameters, got {wrt!r}")
    start = np.atleast_1d(vector("x0", x0, scalar=True)).copy()
    return SolutionFunction(F, lower, upper, start, names, jac, dF, options)


def _evaluate_at(box: Any, p: Array) -> Any:
    return box(p) if callable(box) else box


def _bound_slopes(box: Any, p: Array, n: int) -> Array | None:
    """Return the derivatives of a bound that is a function; of an infinite one zero."""
    if not callable(box):
        return None
    with np.errstate(invalid="ignore"):
        slopes = _differenced_columns(lambda q: np.broadcast_to(np.asarray(box(q), float), (n,)), p)
    return np.nan_to_num(slopes)


def _differenced_columns(function: Callable[[Array], Array], p: Array) -> Array:
    columns = []
    for j, value in enumerate(p):
        ends = np.array([p, p])
        ends[:, j] += _STEP * max(1.0, abs(value)) * np.array([-1.0, 1.0])
        below, above = (function(end) for end in ends)
        columns.append((above - below) / (ends[1, j] - ends[0, j]))
    return np.column_stack(columns)
