r"""The map from one impact to the next.

.. math::

    (\varphi, u) \mapsto (\varphi', u'), \qquad \varphi = \omega t \bmod 2\pi

of a driven system with a linear force: with `u > 0` the speed after an impact at the phase
:math:`\varphi` of the excitation, :math:`\varphi'` is the phase of the next impact and `u'` the
speed
after it. Periodic motions are fixed points, their multipliers the eigenvalues of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, integer, real_array
from zivi.base.extras import ProgressBar
from zivi.simulation.batch_result import check_threads
from zivi.system.mass import ImpactSystem, check_system

PARAMETERS = ("stiffness", "damping", "gravity", "amplitude", "omega", "phase", "e")
"""What a map can be differentiated by."""


class ImpactReturn(NamedTuple):
    """The impacts that follow; NaN without an impact.

    Parameters
    ----------
    phase : float or ndarray
        Phases of the next impacts, from 0 to below 2 pi (rad).
    u : float or ndarray
        Speeds after them (m/s).
    jacobian : ndarray, shape (..., 2, 2)
        ``[[dphase'/dphase, dphase'/du], [du'/dphase, du'/du]]``.
    """

    phase: Any
    u: Any
    jacobian: Array


class ImpactMap:
    r"""The map of a system from impact to impact, to rounding; see `impact_map`.

    Parameters
    ----------
    system : ImpactSystem
        With a `LinearForce` of ``omega`` not 0, above a wall at rest or a `HarmonicWall` of the
        same frequency.
    """

    def __init__(self, system: ImpactSystem) -> None:
        check_system(system)
        self.system = system
        _zivi.check_impact_map(system._core)

    def __call__(
        self, phase: ArrayLike, u: ArrayLike, *, threads: int | None = None
    ) -> ImpactReturn:
        """Map impacts to the next.

        Parameters
        ----------
        phase, u : array_like
            Phases ``omega t`` (rad) and speeds after the impacts (m/s), broadcast.
        threads : int, optional
            Number of threads, >= 1; by default the number of cores.

        Returns
        -------
        ImpactReturn
            ``phase``, ``u`` and ``jacobian`` of the next impacts.
        """
        next_, jacobian, _, shape = self._mapped(phase, u, (), threads)
        return ImpactReturn(
            next_[:, 0].reshape(shape)[()],
            next_[:, 1].reshape(shape)[()],
            jacobian.reshape(*shape, 2, 2),
        )

    def duration(self, phase: ArrayLike, u: ArrayLike, *, threads: int | None = None) -> Any:
        """Return the times from impacts to the next (s).

        Parameters
        ----------
        phase, u, threads
            As for a call of the map.

        Returns
        -------
        float or ndarray
        """
        next_, _, _, shape = self._mapped(phase, u, (), threads)
        return next_[:, 2].reshape(shape)[()]

    def by(
        self,
        phase: ArrayLike,
        u: ArrayLike,
        parameters: str | Sequence[str],
        *,
        threads: int | None = None,
    ) -> Array:
        """Differentiate the next impact by parameters of the system.

        Parameters
        ----------
        phase, u, threads
            As for a call of the map.
        parameters : str or sequence of str
            Of ``"stiffness"``, ``"damping"``, ``"gravity"``, ``"amplitude"``, ``"omega"``,
            ``"phase"`` (those of `LinearForce`) and ``"e"``. The wall must be at rest.

        Returns
        -------
        ndarray, shape (..., 2, n)
            Derivatives of the phase and the speed by each parameter, at a fixed phase and speed
            before; shape (..., 2) for a single name.
        """
        names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
        for name in names:
            if name not in PARAMETERS:
                raise ValueError(f"parameters must be of {', '.join(PARAMETERS)}, got {name!r}")
        _, _, derivatives, shape = self._mapped(phase, u, names, threads)
        derivatives = np.swapaxes(derivatives, 1, 2).reshape(*shape, 2, len(names))
        return derivatives[..., 0] if isinstance(parameters, str) else derivatives

    def orbit(
        self,
        phase: ArrayLike,
        u: ArrayLike,
        n: int,
        *,
        skip: int = 0,
        threads: int | None = None,
        progress: bool | None = None,
    ) -> tuple[Array, Array]:
        """Follow the impacts from each start.

        Parameters
        ----------
        phase, u : array_like
            Starts, broadcast.
        n : int
            Impacts that are kept of each orbit, >= 1.
        skip : int
            Impacts before them, >= 0.
        threads : int, optional
            Number of threads, >= 1; by default the number of cores.
        progress : bool, optional
            Whether to show the progress; by default on a terminal.

        Returns
        -------
        phase, u : ndarray, shape (..., n)
            NaN after the last impact.
        """
        return orbits([self], phase, u, n, skip=skip, threads=threads, progress=progress)

    def _mapped(
        self, phase: ArrayLike, u: ArrayLike, names: tuple[str, ...], threads: int | None
    ) -> tuple[Array, Array, Array, tuple[int, ...]]:
        starts, shape = _starts(phase, u)
        mapped = _zivi.map_of_impacts(
            self.system._core,
            starts,
            parameters=list(names),
            threads=check_threads(threads),
        )
        return (*mapped, shape)

    def __repr__(self) -> str:
        return f"ImpactMap({self.system!r})"


def orbits(
    maps: Sequence[ImpactMap],
    phase: ArrayLike,
    u: ArrayLike,
    n: int,
    *,
    skip: int = 0,
    threads: int | None = None,
    progress: bool | None = None,
) -> tuple[Array, Array]:
    """Follow the impacts of many starts, each under its own map or all under one.

    Parameters
    ----------
    maps : sequence of ImpactMap
        One for each start, in the order of their flattened array, or one for all.
    phase, u, n, skip, threads, progress
        As for `ImpactMap.orbit`.

    Returns
    -------
    phase, u : ndarray, shape (..., n)
        NaN after the last impact.
    """
    starts, shape = _starts(phase, u)
    n, skip = integer("n", n), integer("skip", skip)
    if not 1 <= n <= MOST:
        raise ValueError(f"n must be from 1 to {MOST:.0e}, got {n}")
    if not 0 <= skip <= MOST:
        raise ValueError(f"skip must be from 0 to {MOST:.0e}, got {skip}")
    if len(maps) not in {1, len(starts)}:
        raise ValueError(f"maps must be one, or one for each of {len(starts)}, got {len(maps)}")
    with ProgressBar(progress, "orbits") as bar:
        found = _zivi.orbits_of_impacts(
            [each.system._core for each in maps],
            starts,
            skip=skip,
            n=n,
            threads=check_threads(threads),
            progress=bar.report,
        )
    found = found.reshape(*shape, n, 2)
    return found[..., 0], found[..., 1]


MOST = 10**9
"""Impacts of one orbit."""


def _starts(phase: ArrayLike, u: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Return rows of phase and speed, and the shape of both."""
    phases, speeds = real_array("phase", phase), real_array("u", u)
    if not np.all(np.isfinite(phases)):
        raise ValueError("phase must be finite")
    if not np.all((speeds > 0) & np.isfinite(speeds)):
        raise ValueError("u must be finite speeds > 0 after impacts")
    try:
        phases, speeds = np.broadcast_arrays(phases, speeds)
    except ValueError as error:
        raise ValueError(f"phase and u must fit together: {error}") from None
    return np.stack([phases.ravel(), speeds.ravel()], axis=1), phases.shape


def impact_map(system: ImpactSystem) -> ImpactMap:
    r"""Return the map of a system from one impact to the next.

    .. math::

        (\varphi, u) \mapsto (\varphi', u'), \qquad \varphi = \omega t \bmod 2\pi

    It is exact to rounding (see :doc:`methods`), and so is its Jacobian, with
    :math:`\det J = e^2 (u/u')\, \mathrm{e}^{-c T}` where `T` is the time between both impacts and
    `c` the damping.

    Parameters
    ----------
    system : ImpactSystem
        With a `LinearForce` of ``omega`` not 0, above a wall at rest or a `HarmonicWall` of the
        same frequency.

    Returns
    -------
    ImpactMap
        Called with phases and speeds, it gives phases, speeds and Jacobians of the next impacts;
        its methods give orbits and derivatives by parameters.

    Raises
    ------
    ValueError
        If the system has no such map.

    See Also
    --------
    periodic_orbit : fixed points of the map, with stability.
    simulate : the motion between impacts.

    Notes
    -----
    One evaluation integrates a single flight; derivatives follow from the implicit function theorem
    at the next impact.

    References
    ----------
    J. M. Luck and A. Mehta, Bouncing ball with a finite restitution: chattering, locking, and
    chaos, Phys. Rev. E 48, 1993.

    S. W. Shaw and P. J. Holmes, A periodically forced piecewise linear oscillator, J. Sound Vib.
    90, 1983.

    Examples
    --------
    A periodic motion with one impact in each period of the excitation:

    >>> force = zivi.LinearForce(stiffness=1, damping=0.1, amplitude=1, omega=2.2)
    >>> step = zivi.impact_map(zivi.ImpactSystem(force, e=0.7))
    >>> phase, u, jacobian = step(5.577050690, 1.176263555)
    >>> round(float(phase), 7), round(float(u), 7)
    (5.5770507, 1.1762636)
    >>> bool(abs(np.linalg.eigvals(jacobian)).max() < 1)  # it is stable
    True
    """
    return ImpactMap(system)
