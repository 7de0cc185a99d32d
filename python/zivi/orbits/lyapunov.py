"""Lyapunov exponents, and the response of linear systems without impacts."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.table import ResultTable, Tabulated, counted
from zivi.derivatives.result import OrbitStatus
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.flows import MassFlow, fly, impact_maps, is_exact
from zivi.orbits.orbit import with_failed
from zivi.orbits.path import frequency_of, value_of
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem, check_rigid
from zivi.system.parameters import check_newton

# Lyapunov exponents, from the derivatives of one impact by the last.

ACCURATE = SwitchedRK(rtol=1e-9, atol=1e-11)
PIECES = 200
"""Intervals of a run without impacts, or of a system without excitation."""
LOST = 1e-14
"""What rounding leaves of a direction that a contact has taken away, as a part of the others."""


EXPONENT_MESSAGES = {
    OrbitStatus.COMPLETED: "The exponents are means over the run.",
    OrbitStatus.RESTS: "The run comes to rest: nothing is left of a difference.",
    OrbitStatus.RUN_ENDED: "The run ended early: exponents are not available.",
    OrbitStatus.NOT_DIFFERENTIABLE: "Some derivative along the run does not exist.",
}


@dataclasses.dataclass(frozen=True, repr=False)
class Lyapunov(Tabulated):
    """Lyapunov exponents of a run.

    Attributes
    ----------
    exponents : ndarray
        The exponents (1/s), the largest first: two, or 2n of n coordinates. Minus infinity if
        perturbations vanish: for a run that rests, and for directions removed by a contact.
    duration : float
        The time over which they are means (s), from an impact to an impact.
    n_impacts : int
        Impacts in it.
    status : OrbitStatus
        ``COMPLETED``, ``RESTS``, or ``RUN_ENDED`` when the run ended early; of a mechanical system
        also ``NOT_DIFFERENTIABLE``.
    trajectory : Trajectory or None
        The run; None of a mechanical system, which is run piece by piece.
    """

    exponents: Array
    duration: float
    n_impacts: int
    status: OrbitStatus
    trajectory: Trajectory | None

    @property
    def success(self) -> bool:
        """Whether there are exponents of a motion that does not rest."""
        return self.status is OrbitStatus.COMPLETED

    @property
    def message(self) -> str:
        """Summary of the run and the number of exponents that are NaN."""
        known = EXPONENT_MESSAGES.get(self.status, f"The run ended: {self.status.name.lower()}.")
        if self.trajectory is not None and not self.trajectory.success:
            known += f" {self.trajectory.message}"
        return with_failed(known, self._failed_text())

    def _failed_text(self) -> str:
        numbers = {
            "not known": int(np.isnan(self.exponents).sum()),
            "minus infinity": int(np.isneginf(self.exponents).sum()),
        }
        total = len(self.exponents)
        return ", ".join(f"{n} of {total} exponents are {what}" for what, n in numbers.items() if n)

    def __repr__(self) -> str:
        values = ", ".join(f"{it:.6g}" for it in self.exponents)
        failed = f", {text}" if (text := self._failed_text()) else ""
        over = f"over {self.duration:.6g} s, {counted(self.n_impacts, 'impact')}{failed}"
        return f"<Lyapunov {values} 1/s {over}: {self.status.name.lower()}>"

    def _table(self) -> ResultTable:
        """Describe the dataset of the exponents."""
        fields = {"exponents": ("exponent", "1/s", "Lyapunov exponents")}
        attrs = {"duration": self.duration, "n_impacts": self.n_impacts}
        return ResultTable(
            "Lyapunov exponents", fields, {}, {}, attrs | {"status": self.status.name}
        )


@hinted("settled")
def lyapunov_exponents(
    system: ImpactSystem | MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    transient: float = 0.0,
    *,
    piece: float | None = None,
    method: SwitchedRK = ACCURATE,
    progress: bool | None = None,
) -> Lyapunov:
    r"""Compute the Lyapunov exponents of a motion.

    The derivatives of time and speed after an impact by those after the last are multiplied and
    kept orthogonal (QR). Their determinants are known, so without damping the sum of the exponents
    is :math:`(2 k \ln e + \ln (u_0/u_k))/t` over `k` impacts; their difference is a smooth
    mean over the time.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        What moves.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float) or (array_like, array_like)
        Initial distance (m) and velocity (m/s); of a mechanical system ``(q0, qdot0)``.
    transient : float
        Time at the start that does not count, >= 0 (s).
    piece : float, optional
        Of a mechanical system the time over which derivatives are taken before they are made
        orthogonal, by default the period of the excitation, else a 200th of the span (s).
    method : SwitchedRK
        Tolerances.
    progress : bool, optional
        Show a progress bar; by default on a terminal only.

    Returns
    -------
    Lyapunov
        A run that comes to rest after the transient has exponents of minus infinity: what it did
        before that belongs to a transient, whatever its sign.

    Raises
    ------
    ValueError
        If `transient` is out of range.

    See Also
    --------
    periodic_orbit : Floquet multipliers of periodic motions.
    bifurcation_diagram : attractors over a parameter.

    Notes
    -----
    Perturbations are carried through impacts by the saltation matrix and reorthonormalised; the
    exponents are the mean logarithmic growth rates.

    References
    ----------
    P. C. Mueller, Calculation of Lyapunov exponents for dynamic systems with discontinuities,
    Chaos, Solitons and Fractals 5, 1995.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> found = zivi.lyapunov_exponents(
    ...     zivi.ImpactSystem(table, e=0.5), (0, 900), (0.1, 2.0), transient=300)
    >>> found.exponents.round(2)  # ln(1/2)/(2 pi)
    array([-0.11, -0.11])
    """
    span = pair("t_span", t_span, "(t0, t1)")
    if not 0.0 <= finite("transient", transient) < span[1] - span[0]:
        raise ValueError(f"transient must be >= 0 and shorter than t_span, got {transient}")
    if isinstance(system, MechanicalSystem):
        check_rigid(system, "Lyapunov exponents")
        return _mechanism_exponents(system, span, y0, transient, piece, method, progress)
    if piece is not None:
        raise ValueError("piece is for a zivi.MechanicalSystem: one mass goes impact by impact")
    check_newton(system)
    run = simulate(system, span, y0, method, progress=progress)
    since = span[0] + transient
    if not run.success:
        return Lyapunov(np.full(2, np.nan), 0.0, 0, OrbitStatus.RUN_ENDED, run)
    if run.rest_time is not None or np.any(run.zeno_times >= since):
        return Lyapunov(np.full(2, -np.inf), 0.0, len(run.impacts), OrbitStatus.RESTS, run)
    rows = np.column_stack([run.resolved_impacts["t"], run.resolved_impacts["xdot_after"]])
    rows = rows[rows[:, 0] >= since]
    if len(rows) < 2:
        return _in_flight(system, run, since, span[1], method)
    states = np.column_stack([0.0 * rows[:-1, 0], rows[:-1, 1]])
    flights = MassFlow(system, method).fly((), rows[:-1, 0], states, rows[1:, 0])
    # of (t, u): x is 0
    maps = list(impact_maps(flights, system.e)[:, ::2, ::2])
    duration = float(rows[-1, 0] - rows[0, 0])
    return Lyapunov(_means(maps, rows[:, 0]), duration, len(maps), OrbitStatus.COMPLETED, run)


def _mechanism_exponents(
    system: MechanicalSystem,
    span: tuple[float, float],
    y0: Any,
    transient: float,
    piece: float | None,
    method: SwitchedRK,
    progress: bool | None,
) -> Lyapunov:
    """Multiply the derivatives of the pieces of a run."""
    length = piece_of(system, piece, span[1] - span[0] - transient)
    with ProgressBar(progress) as bar:
        maps, times, n_impacts, status = flow_maps(
            system, span, y0, transient, length, method, bar.report
        )
    duration = float(times[-1] - times[0])
    if not maps:
        nothing = np.full(2 * len(state_of(y0, system._n)[0]), np.nan)
        return Lyapunov(nothing, 0.0, n_impacts, status, None)
    return Lyapunov(_means(maps, times), duration, n_impacts, status, None)


def _in_flight(
    system: ImpactSystem, run: Trajectory, start: float, end: float, method: SwitchedRK
) -> Lyapunov:
    """Multiply the flows over the parts of a run without impacts."""
    times = np.linspace(start, end, PIECES + 1)
    rows = np.column_stack([times[:-1], run(times[:-1]).T, times[1:]])
    maps = list(fly(system, rows, method)[1])
    means = _means(maps, times)
    return Lyapunov(means, end - start, 0, OrbitStatus.COMPLETED, run)


def _means(maps: list[Array], times: Array) -> Array:
    """Return the exponents: their exact sum, and smoothed means of their differences.

    Where multipliers are complex two take turns, and a plain mean of their difference
    converges like 1/t. One with the weights ``exp(-1/(s (1 - s)))`` converges faster than any power
    for periodic motions (S. Das and others, Quantitative quasiperiodicity, Nonlinearity 30, 2017).
    """
    size = len(maps[0])
    # directions along coordinates alone would stay in planes that modes span
    generic = np.cos(1.0 + np.arange(size * size)).reshape(size, size)
    frame = np.eye(2) if size == 2 else np.linalg.qr(generic)[0]
    logs = np.empty((len(maps), size))
    with np.errstate(divide="ignore"):  # a contact takes directions away
        for log, each in zip(logs, maps, strict=True):
            frame, upper = np.linalg.qr(each @ frame)
            sizes = np.abs(np.diag(upper))
            log[:] = np.log(np.where(sizes > LOST * sizes.max(), sizes, 0.0))
    lengths = np.diff(times)
    part = (times[:-1] + 0.5 * lengths - times[0]) / (times[-1] - times[0])
    weights = np.exp(-1.0 / (part * (1.0 - part)))
    smooth = weights @ logs / float(weights @ lengths)
    if np.isfinite(smooth).all():  # else the sum depends on the first directions
        total = float(np.sum(logs)) / float(times[-1] - times[0])
        smooth += (total - float(smooth.sum())) / size
    return np.asarray(np.sort(smooth)[::-1], np.float64)


# Lyapunov exponents of mechanical systems, from the derivatives of a run piece by piece.


def piece_of(system: MechanicalSystem, piece: float | None, duration: float) -> float:
    """Return the length of an interval: by default the period of the excitation."""
    if piece is not None:
        if not 0.0 < finite("piece", piece) <= duration:
            raise ValueError(f"piece must be > 0 and within t_span, got {piece}")
        return piece
    omega = frequency_of(system)
    own = duration / PIECES if omega is None else 2.0 * np.pi / omega
    return float(min(own, duration))


def flow_maps(
    system: MechanicalSystem,
    span: tuple[float, float],
    y0: Any,
    transient: float,
    piece: float,
    method: SwitchedRK,
    report: Any = None,
) -> tuple[list[Array], Array, int, OrbitStatus]:
    """Run a span in pieces: their state-transition matrices, the times between them, impacts, how.

    A piece that a tie of impacts or a corner makes not differentiable ends the list.
    """
    state = state_of(y0, system._n)
    count = max(1, round((span[1] - span[0] - transient) / piece))
    first = span[0] + transient
    times = np.linspace(first, span[1], count + 1)
    before = max(1, round(transient / piece)) if transient else 0
    ends = np.concatenate([np.linspace(span[0], first, before + 1), times[1:]])
    maps: list[Array] = []
    n_impacts = 0
    for k, (start, end) in enumerate(itertools.pairwise(ends)):
        s: Any = sensitivity(
            system,
            (float(start), float(end)),
            state,
            ("q0", "qdot0"),
            method,
            dense_output=False,
            progress=False,
        )
        sol = s.trajectory
        if not sol.success:
            return maps, times[: len(maps) + 1], n_impacts, OrbitStatus.RUN_ENDED
        state = sol.q[-1], sol.qdot[-1]
        if report is not None:
            report(k + 1, len(ends) - 1)
        if k < before:
            continue
        if not np.all(np.isfinite(s.final)):
            return maps, times[: len(maps) + 1], n_impacts, OrbitStatus.NOT_DIFFERENTIABLE
        n_impacts += len(np.unique(sol.impacts["group"]))
        maps.append(s.monodromy)
    return maps, times, n_impacts, OrbitStatus.COMPLETED


# Response of linear systems without impacts, and its grazing amplitude.


def response_amplitude(system: LinearSystem, gap: str, omegas: ArrayLike) -> Array:
    r"""Return the amplitude of a gap in the steady response without impacts.

    .. math:: R = | n \cdot (K - \omega^2 M + i \omega C)^{-1} p - w |

    Parameters
    ----------
    system : LinearSystem
        A system with `Harmonic` loads or walls of one frequency.
    gap : str
        The name of a gap.
    omegas : array_like
        Angular frequencies (rad/s).

    Returns
    -------
    ndarray
        Amplitudes, of the shape of `omegas`.

    Raises
    ------
    ValueError
        For another gap, loads of several frequencies, or dry friction.

    See Also
    --------
    grazing_curve : loads at which the response touches a gap.
    LinearSystem : the system of the response.

    Notes
    -----
    Each frequency costs one solution of a linear system of n complex equations.

    Examples
    --------
    >>> system = zivi.LinearSystem(
    ...     1.0, 0.1, 1.0, excitation=zivi.Harmonic([1.0], 0.8),
    ...     gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")], e=0.8)
    >>> zivi.response_amplitude(system, "stop", [1.0]).round(9)  # 1/c at resonance
    array([10.])
    """
    own, normal = _gap(system, gap)
    value_of(system, "omega")
    omega = real_array("omegas", omegas)
    load = np.zeros(len(system.M), np.complex128)
    for part in system.excitation:
        if isinstance(part, Harmonic):
            load = load + np.asarray(part.amplitude) * np.exp(1j * part.phase)
    wall: Any = own.motion
    moved = wall.amplitude * np.exp(1j * wall.phase) if isinstance(wall, HarmonicWall) else 0.0
    found = [
        abs(normal @ np.linalg.solve(system.K - w * w * system.M + 1j * w * system.C, load) - moved)
        for w in omega.ravel()
    ]
    return np.asarray(found, np.float64).reshape(omega.shape)


def grazing_curve(system: LinearSystem, gap: str, omegas: ArrayLike) -> Array:
    """Return the load at which the motion without impacts touches a gap, in closed form.

    Parameters
    ----------
    system : LinearSystem
        A system with `Harmonic` loads of one frequency and walls that do not move.
    gap : str
        The name of a gap.
    omegas : array_like
        Angular frequencies (rad/s), shape (k,).

    Returns
    -------
    ndarray
        Rows ``(omega, F)``, shape (k, 2); `F` as in `continue_orbit`, the largest amplitude.

    Raises
    ------
    ValueError
        As for `response_amplitude`, and if the gap is not open at rest.

    See Also
    --------
    response_amplitude : the steady response of one gap.
    continue_curve : bifurcations in two parameters.

    Notes
    -----
    The motion without impacts is linear in the load, so each frequency costs one solution of a
    linear system of n complex equations.

    References
    ----------
    A. B. Nordmark, Non-periodic motion caused by grazing incidence, J. Sound Vib. 145, 1991.

    Examples
    --------
    >>> system = zivi.LinearSystem(
    ...     1.0, 0.1, 1.0, excitation=zivi.Harmonic([1.0], 0.8),
    ...     gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")], e=0.8)
    >>> zivi.grazing_curve(system, "stop", [1.0]).round(9)
    array([[1. , 0.1]])
    """
    own, normal = _gap(system, gap)
    if own.motion is not None:
        raise ValueError(f"gap {gap!r} must not move: its load would not be in proportion")
    constant = np.zeros(len(system.M))
    for part in system.excitation:
        if isinstance(part, np.ndarray):
            constant = constant + part
    rest = own.offset
    if np.any(constant):
        rest = float(normal @ np.linalg.solve(system.K, constant)) + own.offset
    if not rest > 0.0:
        raise ValueError(f"gap {gap!r} must be open at rest, it is {rest:.6g}")
    omega = np.atleast_1d(real_array("omegas", omegas))
    strength = value_of(system, "F")
    return np.column_stack([omega, strength * rest / response_amplitude(system, gap, omega)])


def _gap(system: LinearSystem, gap: str) -> tuple[LinearGap, Array]:
    if not is_exact(system):
        raise TypeError(f"system must be a zivi.LinearSystem under waves, got {system!r}")
    if system.channel_names:
        raise ValueError(
            "system must be without friction, whose response is not linear in the load, got the "
            f"channels {', '.join(system.channel_names)}; zivi.periodic_orbit finds the response"
        )
    if gap not in system.gap_names:
        raise ValueError(f"gap must be one of {', '.join(system.gap_names)}, got {gap!r}")
    own = system.gaps[system.gap_names.index(gap)]
    assert isinstance(own, LinearGap)
    return own, own.normal
