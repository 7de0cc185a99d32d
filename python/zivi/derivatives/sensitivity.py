"""Derivatives of a run by its initial state, the coefficient of restitution and parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, all_of
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening
from zivi.derivatives.result import KINDS, Nearest, OrbitStatus, Sensitivity
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import argument_text, pair, stop_times
from zivi.simulation.run_result import as_raised, with_partial
from zivi.simulation.trajectory import Trajectory
from zivi.system.kicks import Kick
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import (
    INITIAL,
    check_differentiable,
    check_planar_friction,
    codes_of,
    parameter,
)

if TYPE_CHECKING:
    from zivi.derivatives.mechanical_sensitivity import MechanicalSensitivity

DEFAULT = SwitchedRK()


@dataclasses.dataclass(frozen=True, eq=False)
class _Problem:
    """A run with its parameters."""

    system: ImpactSystem
    span: tuple[float, float]
    state: tuple[float, float]
    wrt: tuple[str, ...]
    method: SwitchedRK
    errsens: bool
    stops: Array
    codes: list[int]
    sizes: Array

    @classmethod
    def of(
        cls,
        system: ImpactSystem,
        span: tuple[float, float],
        state: tuple[float, float],
        wrt: tuple[str, ...],
        method: SwitchedRK,
        errsens: bool,
        stops: Array,
    ) -> _Problem:
        codes = codes_of(system, wrt)
        starts = {"x0": state[0], "xdot0": state[1], "t0": span[1] - span[0]}
        values = [starts[name] if name in INITIAL else parameter(system, name) for name in wrt]
        sizes = np.array([abs(value) or 1.0 for value in values])
        return cls(system, span, state, wrt, method, errsens, stops, codes, sizes)

    def with_wrt(self, wrt: tuple[str, ...]) -> _Problem:
        system, span, state, method = self.system, self.span, self.state, self.method
        return _Problem.of(system, span, state, wrt, method, self.errsens, self.stops)

    def record(
        self, span: tuple[float, float], times: Array, dense: bool, progress: bool | None = False
    ) -> _zivi.SensitivityRecord:
        with ProgressBar(progress, "sensitivity") as bar:
            return _zivi.sensitivity(
                self.system._core,
                self.method._core,
                span,
                _zivi.State(*self.state),
                wrt=self.codes,
                sizes=self.sizes,
                controlled=self.errsens,
                dense=dense,
                drawn=dense,
                tstops=self.stops,
                times=times,
                progress=bar.report,
            )

    def solve(self, dense: bool = False, progress: bool | None = False) -> Sensitivity:
        with listening([self.system._spec, self.system._impact]) as ear:
            record = self.record(self.span, np.empty(0), dense, progress)
        run = record.run
        told = (self.system, self.method, self.span, self.state, self.stops)
        sol = Trajectory._from_record(run, *told)
        error = run.raised
        if error is None and (error := ear.ends(sol.success)):
            sol = as_raised(sol)
        if error is None:
            return self._result(record, sol)
        try:
            raise with_partial(error, sol)
        finally:
            del error, ear

    def _result(self, record: _zivi.SensitivityRecord, sol: Trajectory) -> Sensitivity:
        m = len(self.wrt)
        dt, du = record.impact_dt.reshape(-1, m), record.impact_du.reshape(-1, m)
        # of a run that ended early the last event may lack its derivatives
        n = min(len(dt), len(sol.resolved_impacts))
        impacts = np.empty(n, [("t", "f8"), ("dt", "f8", (m,)), ("du", "f8", (m,))])
        impacts["t"], impacts["dt"], impacts["du"] = sol.resolved_impacts["t"][:n], dt[:n], du[:n]
        limits = [it and Nearest(KINDS[it.limit], it.t, it.depth) for it in record.nearest]
        status = OrbitStatus.GRAZING if record.grazing else OrbitStatus.COMPLETED
        return Sensitivity(
            trajectory=sol,
            wrt=self.wrt,
            final=np.stack([record.x, record.xdot]),
            resolved_impacts=impacts,
            zeno_times=record.zeno_times.reshape(-1, m),
            liftoff_times=record.liftoff_times.reshape(-1, m),
            radius=record.radius,
            limits=limits,
            status=status if sol.success else OrbitStatus.RUN_ENDED,
            n_slopes=record.n_slopes,
            _problem=self,
        )

    def at(self, times: Array) -> Array:
        """Return derivatives at times, of shape (2, m, n)."""
        m = len(self.wrt)
        record = self.record(self.span, times, dense=False)
        if (error := record.run.raised) is not None:
            raise error
        columns = record.samples.reshape(len(times), 2, m).transpose(1, 2, 0).copy()
        for k in np.flatnonzero(np.isnan(columns).any(axis=(0, 1))):
            # where the impacts accumulate the run goes from one to the next, up to there
            columns[:, :, k] = self._ending_at(float(times[k]))
        return columns

    def ending_within(self, t: float, zeno: float) -> Sensitivity:
        """Run up to a time shortly after an impact of an accumulation, from impact to impact."""
        span = (self.span[0], t + 0.25 * (zeno - t))
        return dataclasses.replace(self, span=span).solve()

    def _ending_at(self, t: float) -> Array:
        record = self.record((self.span[0], t), np.empty(0), dense=False)
        return np.stack([record.x, record.xdot])


@overload
def sensitivity(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    kicks: Kick | Sequence[Kick] | None = None,
    progress: bool | None = None,
) -> MechanicalSensitivity: ...


@overload
def sensitivity(
    system: ImpactSystem,
    t_span: Sequence[float],
    y0: ArrayLike,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    kicks: Kick | Sequence[Kick] | None = None,
    progress: bool | None = None,
) -> Sensitivity: ...


@hinted("sensitivity")
def sensitivity(
    system: ImpactSystem | MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    kicks: Kick | Sequence[Kick] | None = None,
    progress: bool | None = None,
) -> Sensitivity:
    r"""Simulate a system with the derivatives of the run, through impacts and Zeno points.

    The variational equations are solved in the steps of the run. At an impact

    .. math::

        dt &= -\frac{X^-}{\dot x^-}, \qquad dv^- = V^- + a^- dt, \qquad
        du = -e\,dv^- - \dot x^-\,de \\
        X^+ &= -u\,dt, \qquad V^+ = du - a^+ dt

    (the saltation matrix, with :math:`X = dx/dq`, :math:`V = d\dot x/dq`), a Zeno time has the
    derivative of its extrapolation, all derivatives are zero at rest and are reinitialised at
    lift-off. For an `ImpactLaw` the factor of :math:`dv^-` is its slope.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The force and the wall. The force is a number, a `LinearForce`, a `ParametricForce`, or any
        callable, whose derivatives with respect to time and state are then central differences. For
        a `MechanicalSystem` they are derived by SymPy (`zivi.symbolic.system`) or central
        differences.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float)
        Initial distance from the wall (m) and velocity (m/s); of a `MechanicalSystem`
        ``(q0, qdot0)``.
    wrt : sequence of str, optional
        Names of the columns: ``"x0"``, ``"xdot0"``, ``"t0"`` (the start moves, the end does
        not), ``"e"``, the fields of `LinearForce` or the parameters of a `ParametricForce`,
        ``"force"`` for a number, those of a `HarmonicWall` as ``"wall.amplitude"``, of another
        impact law than Newton's as ``"law.e0"``. Of a
        `MechanicalSystem` ``"q0"`` and ``"qdot0"`` (all coordinates), ``"q0.x"`` or ``"q0[0]"``
        (one), ``"t0"``, ``"e"`` (of all gaps together), ``"e.floor"`` or ``"e[0]"`` (of one), the
        names of its parameters, and numbers of its dry friction: ``"belt.limit"``,
        ``"belt.static"``, ``"belt.velocity"`` of a `DryFriction`, ``"floor.mu"``,
        ``"floor.mu_static"``, ``"floor.e_t"`` of a gap. By default the initial state.
    method : SwitchedRK
        Tolerances and order.
    errsens : bool
        Whether the steps are adapted to the errors of the columns too (their absolute tolerances
        are those of the state divided by the size of the parameter).
    dense_output : bool
        Whether the trajectory keeps the motion between its samples.
    tstops : array_like, optional
        Times of jumps of the force or one of its derivatives (s; see `simulate`). They are
        fixed: what moves them is not differentiated by.
    kicks : Kick or sequence of Kick, optional
        Impulses at given times, as for `simulate`. Their times are fixed. Functions of the state
        are differenced; the derivatives are products of those between kicks.
    progress : bool, optional
        Show a progress bar once a run lasts longer than a second; by default on a terminal only.

    Returns
    -------
    Sensitivity
        The run and its derivatives; of a `MechanicalSystem` a `MechanicalSensitivity`.

    Raises
    ------
    ValueError
        For a name that is no parameter here: the error lists those that are.
    TypeError
        For another method than `SwitchedRK`.
    Exception
        Whatever the force raises.

    See Also
    --------
    simulate : a run without derivatives.
    periodic_orbit : periodic motions and their stability.
    zivi.interop.run_function : value and derivative for optimisers.

    Notes
    -----
    The variational equations are integrated with the motion. Impacts multiply the derivatives by
    the saltation matrix; Zeno times have the derivative of their extrapolation. The cost grows
    linearly with the number of parameters. The page "Sensitivities and orbits: theory"
    (orbit_theory.md) derives the equations.

    References
    ----------
    M. A. Aizerman and F. R. Gantmakher, On the stability of periodic motions, J. Appl. Math. Mech.
    22, 1958.

    R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
    Springer, 2004.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> s = zivi.sensitivity(ball, (0, 3), (1, 0), wrt=("x0", "e", "force"))
    >>> s.zeno_times.round(6)  # of sqrt(2 x0/g) (1 + e)/(1 - e)
    array([[0.677285, 3.612189, 0.06904 ]])
    """
    mechanical = isinstance(system, MechanicalSystem)
    if not mechanical:
        check_differentiable(system)
    check_planar_friction(system)
    if not isinstance(method, SwitchedRK):
        raise TypeError(
            f"sensitivity needs method=zivi.SwitchedRK(...), got {argument_text(method)}"
        )
    span = pair("t_span", t_span, "(t0, t1)")
    for name, value in (("errsens", errsens), ("dense_output", dense_output)):
        if not isinstance(value, bool):
            raise TypeError(f"{name} must be True or False, got {value!r}")
    stops = stop_times(tstops, method, system, span)
    if wrt is None:
        wrt = ("q0", "qdot0") if mechanical else ("x0", "xdot0")
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if not names or len(set(names)) != len(names):
        raise ValueError(f"wrt must be one or more different names, got {names!r}")
    if kicks is not None and (kicked := all_of("kicks", kicks, Kick)):
        from zivi.derivatives.kicked import differentiate_kicked

        start = y0 if mechanical else pair("y0", y0, "(x0, xdot0)")
        return differentiate_kicked(
            system,
            span,
            start,
            names,
            kicked,
            sensitivity,
            {"method": method, "errsens": errsens, "tstops": stops},
            dense=dense_output,
            progress=progress,
        )
    if isinstance(system, MechanicalSystem):
        from zivi.derivatives.mechanical_sensitivity import differentiate_mechanical

        return differentiate_mechanical(
            system,
            span,
            y0,
            names,
            method,
            errsens=errsens,
            stops=stops,
            dense=dense_output,
            progress=progress,
        )
    state = pair("y0", y0, "(x0, xdot0)")
    problem = _Problem.of(system, span, state, names, method, errsens, stops)
    return problem.solve(dense_output, progress)
