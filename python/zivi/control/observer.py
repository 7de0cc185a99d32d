"""Observers of position, velocity and an unknown force through impacts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array, switch
from zivi.base.habits import hinted
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.control.component import Component


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Observed(Tabulated):
    """Estimates at recorded measurements.

    Attributes
    ----------
    t : ndarray
        Times of the measurements (s).
    x, xdot : ndarray
        Position (m) and velocity (m/s).
    d : ndarray
        Unknown force (m/s^2).
    std : ndarray, shape (n, 3)
        Standard deviations of `x`, `xdot` and `d`, as the observer estimates them.
    refused : ndarray of bool
        Measurements that were too far off to be taken.
    missing : ndarray of bool
        Times without a measurement (NaN).
    e, std_e : ndarray
        Coefficient of restitution and its standard deviation; the assumed ones if it is not
        estimated.
    """

    t: Array
    x: Array
    xdot: Array
    d: Array
    std: Array
    refused: NDArray[np.bool_]
    e: Array
    std_e: Array
    missing: NDArray[np.bool_]

    def _table(self) -> ResultTable:
        """Describe the dataset: estimates over ``time``."""
        coords: dict[str, Field] = {"time": ("time", "s", "time"), "of": ("of", "", "estimate")}
        values = {"time": self.t, "of": ["x", "xdot", "d"]}
        return ResultTable("Estimates of an observer", FIELDS, coords, values)

    def __repr__(self) -> str:
        refused, missing = np.count_nonzero(self.refused), np.count_nonzero(self.missing)
        return f"<Observed {len(self.t)} measurements, {refused} refused, {missing} missing>"


FIELDS: dict[str, Field] = {
    "x": ("time", "m", "distance from the wall"),
    "xdot": ("time", "m/s", "velocity"),
    "d": ("time", "m/s^2", "unknown force"),
    "std": (("time", "of"), "", "standard deviations"),
    "refused": ("time", "", "whether the measurement was refused"),
    "e": ("time", "1", "coefficient of restitution"),
    "std_e": ("time", "1", "its standard deviation"),
    "missing": ("time", "", "whether the measurement was missing"),
}
"""Dimensions, unit and meaning of what is in the dataset."""
VERSION = 2
"""Of a state, first number of what it has more than the first version."""
_SEEN = 6


def _is_later(later: Any) -> bool:
    """Whether a state has the fields of the second version."""
    version, waiting, e, _, _, _, ee, count, *seen = later
    return (
        version == VERSION
        and all(map(math.isfinite, later))
        and waiting in (0.0, 1.0)
        and 0.0 <= e <= 1.0
        and ee >= 0.0
        and count in range(_SEEN + 1)
        and len(seen) == 2 * _SEEN
        and min(seen[1::2]) >= 0.0
    )


def _is_state(state: Any) -> bool:
    try:
        started, x, xdot, d, covariance, in_a_row, refused, *later = state
        variances = (covariance[0], covariance[3], covariance[5])
        return (
            isinstance(started, bool)
            and all(map(math.isfinite, (x, xdot, d, *covariance)))
            and x >= 0.0
            and len(covariance) == 6
            and min(variances) >= 0.0
            and in_a_row in range(14)
            and refused in range(2**32)
            and len(later) <= 1
            and all(map(_is_later, later))
        )
    except (TypeError, ValueError, IndexError):
        return False


_of_x, _of_xdot, *_DEFAULTS = (it.default for it in _zivi.CONTROL_SETTINGS["ImpactObserver"])
NOISE: tuple[float, float] = (_of_x, _of_xdot)
Q_D, SE, DMAX, Q_E = _DEFAULTS


class ImpactObserver(_zivi.Observer, Component):
    r"""Observer of position, velocity and an unknown force :math:`d` through impacts.

    .. math:: \ddot x = F + u + d, \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    An extended Kalman filter on the exact sampled map: the covariance of :math:`(x, \dot x, d)`,
    with ``learn_e`` of :math:`e` too, follows each flight of a period and, through the saltation
    matrix

    .. math::

        \Xi = \begin{pmatrix} -e & 0 & 0 \\ (1 + e) a/\dot x^- & -e & 0 \\ 0 & 0 & 1 \end{pmatrix},
        \qquad a = F + u + d

    each impact; at a Zeno point and at rest only the variance of :math:`d` stays, which the wall's
    reaction hides. A measurement is rejected if it differs from the prediction by more than 5
    standard deviations. With velocities the fifth rejection in a row restarts the filter; from
    positions alone it restarts if four of the last six (all but two of fewer) lie on one flight, so
    that outliers do not restart it. Defaults with units of length and time
    scale with these units. It is a tick like a controller's, and bounded in the same way.

    Parameters
    ----------
    e : float
        Coefficient of restitution, in [0, 1].
    h : float
        Sampling period, > 0 (s).
    noise : float or (float, float)
        Standard deviations of the measured position (m) and velocity (m/s), > 0; with
        `position_only` one number will do.
    q_d : float
        Variance of the change of :math:`d` in a period (m^2/s^4), about 5 to 10 times
        :math:`(h \max|\dot d|)^2`.
    se : float
        Standard deviation of the assumed `e`: 0 if it is known exactly, otherwise about 0.03.
    dmax : float
        Bound of :math:`|d|` (m/s^2).
    position_only : bool
        Whether the velocity is not measured: what `step` is given for it is ignored.
    learn_e : bool
        Whether the restitution is also estimated, from impacts faster than ten times the position
        noise per period: `e_est`, `e_std`. `se` is then its initial standard deviation, 0.1 if it
        is 0.
    q_e : float
        Variance that each impact adds to an `e` that is learnt, for walls that change (1e-6, say).

    Raises
    ------
    ValueError
        If a setting is out of range.

    See Also
    --------
    JointObserver : observer of mechanical systems.
    simulate_closed_loop : the argument ``observer``.

    Notes
    -----
    An extended Kalman filter on the exact sampled map between impacts; its state has at most four
    variables. The page "The observer" (observer.md) has the equations of flight, impact and rest.

    References
    ----------
    D. Simon, Optimal State Estimation, Wiley, 2006.

    Examples
    --------
    A mass falls from 1 m under 2 m/s^2 more than is known; positions alone:

    >>> observer = zivi.ImpactObserver(0.5, 1e-2, position_only=True)
    >>> for t in np.arange(0, 0.3, 1e-2):
    ...     x, xdot, d = observer.step(1 - 11.81 * t**2 / 2, None, -9.81, 0.0)
    >>> round(xdot, 2), round(d, 1)
    (-3.42, -2.0)
    """

    _is_state = staticmethod(_is_state)
    _kind = "an observer's"

    @hinted("observer")
    def __new__(  # noqa: D102 the class says it
        cls,
        e: float,
        h: float,
        *,
        noise: float | Sequence[float] = NOISE,
        q_d: float = Q_D,
        se: float = SE,
        dmax: float = DMAX,
        position_only: bool = False,
        learn_e: bool = False,
        q_e: float = Q_E,
    ) -> Self:
        settings: dict[str, Any] = {
            "e": real("e", e),
            "h": real("h", h),
            "noise": _deviations(noise, switch("position_only", position_only)),
            "q_d": real("q_d", q_d),
            "se": real("se", se),
            "dmax": real("dmax", dmax),
            "position_only": bool(position_only),
            "learn_e": switch("learn_e", learn_e),
            "q_e": real("q_e", q_e),
        }
        self = super().__new__(cls, **settings)
        self._settings = settings
        return self

    @property
    def e(self) -> float:
        """Coefficient of restitution."""
        return float(self._settings["e"])

    @property
    def position_only(self) -> bool:
        """Whether the velocity is not measured."""
        return bool(self._settings["position_only"])

    @property
    def estimate(self) -> tuple[float, float, float]:
        """The last estimate: position (m), velocity (m/s), unknown force (m/s^2)."""
        _, x, xdot, d, *_ = self.state
        return x, xdot, d

    @property
    def learn_e(self) -> bool:
        """Whether the restitution is learnt."""
        return bool(self._settings["learn_e"])

    @property
    def e_est(self) -> float:
        """Current estimate of the restitution."""
        return float(self._restitution[0])

    @property
    def e_std(self) -> float:
        """Its standard deviation; 0 if it is not estimated."""
        return math.sqrt(self._restitution[1])

    @property
    def covariance(self) -> Array:
        """Covariance of the estimate (a copy): shape (3, 3), or (4, 4) with ``learn_e``."""
        n = 4 if self.learn_e else 3
        return np.array(self._covariance)[:n, :n]

    @property
    def n_refused(self) -> int:
        """Measurements that were not taken so far."""
        return int(self.state[6])

    def observe(
        self,
        t: ArrayLike,
        x_measured: ArrayLike,
        xdot_measured: ArrayLike | None = None,
        *,
        force: ArrayLike = 0.0,
        u: ArrayLike = 0.0,
    ) -> Observed:
        r"""Estimate what was measured at given times, from a fresh start.

        The observer itself does not change.

        Parameters
        ----------
        t : array_like, shape (n,)
            Increasing times (s), of any distance; `q_d` is per `h`.
        x_measured : array_like, shape (n,)
            Measured positions (m), NaN where a measurement is missing.
        xdot_measured : array_like, shape (n,), optional
            Measured velocities (m/s), NaN if missing.
        force, u : float or array_like, shape (n,)
            Known force on the mass and control (m/s^2), each held from its time until the next.
            Unknown forces are estimated by `d`, up to `dmax`.

        Returns
        -------
        Observed
            The estimates, NaN before the first measurement.

        Examples
        --------
        >>> sol = zivi.simulate(
        ...     zivi.ImpactSystem(-9.81, e=0.6), (0, 2), (1, 0), t_eval=np.arange(0, 2, 1e-3)
        ... )
        >>> observer = zivi.ImpactObserver(0.6, 1e-3, noise=1e-4, position_only=True)
        >>> seen = observer.observe(sol.t, sol.x, force=-9.81)
        >>> bool(abs(seen.xdot - sol.xdot)[100:].max() < 0.05)
        True
        """
        times, x = real_array("t", t), real_array("x_measured", x_measured)
        if times.ndim != 1 or len(times) == 0:
            raise ValueError(f"t must have shape (n,), n >= 1, got {times.shape}")
        if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
            raise ValueError("t must be finite and increasing")
        if x.shape != times.shape:
            raise ValueError(f"x_measured must have the shape of t, {times.shape}, got {x.shape}")
        xdot = np.empty(0)
        if xdot_measured is not None:
            xdot = real_array("xdot_measured", xdot_measured)
            if xdot.shape != times.shape:
                raise ValueError(
                    f"xdot_measured must have the shape of t, {times.shape}, got {xdot.shape}"
                )
        controls = _sampled_force("force", force, len(times)) + _sampled_force("u", u, len(times))
        estimates, deviations, refused = self._observe(times, x, xdot, controls)
        missing = np.isnan(x)
        x, xdot, d, e = estimates
        *others, of_e = deviations
        return Observed(times, x, xdot, d, np.column_stack(others), refused, e, of_e, missing)


def _deviations(noise: Any, position_only: bool) -> tuple[float, float]:
    """Return both; of a velocity that is not measured the default."""
    if position_only and np.ndim(noise) == 0:
        return real("noise", noise), NOISE[1]
    try:
        of_x, of_xdot = noise
    except (TypeError, ValueError):
        raise TypeError(f"noise must be two numbers (of x, of xdot), got {noise!r}") from None
    return real("noise", of_x), real("noise", of_xdot)


def _sampled_force(name: str, value: ArrayLike, n: int) -> Array:
    array = real_array(name, value)
    if array.shape not in ((), (n,)):
        raise ValueError(f"{name} must be a number or have shape ({n},), got {array.shape}")
    return np.ascontiguousarray(np.broadcast_to(array, (n,)))
