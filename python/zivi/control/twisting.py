"""Twisting controllers for a mass with impacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Self

import zivi._zivi as _zivi
from zivi.base.check import integer, real, switch
from zivi.base.habits import hinted
from zivi.control.component import (
    DEPTH,
    HORIZON,
    Following,
    LandingController,
    Shared,
    TickStatus,
    common_settings,
    core,
    delay_of,
    horizon_of,
    plant_kappa,
    quiet_of,
    reference_kappa,
    with_wall,
)
from zivi.simulation.methods import ThetaGamma

__all__ = ["ExplicitTwisting", "TickStatus", "TwistingRegulator", "TwistingTracker"]

BRANCHES = ("positive", "nearest")
"""How a tracker lifts what it measures."""
LINEARISATIONS: int = ThetaGamma.linearisations


def _solve_by(
    controller: _zivi.Regulator | _zivi.Tracker, solver: str, linearisations: int
) -> dict[str, Any]:
    """Have the steps of a controller solved so, and return the settings."""
    count = integer("linearisations", linearisations)
    controller._solve_by(solver, count)
    return {"solver": solver, "linearisations": count}


class TwistingRegulator(_zivi.Regulator, LandingController):
    r"""The twisting regulator: brings the mass to rest at the wall in finite time.

    .. math::

        \dot s = R v, \qquad
        \dot v = R^{-1} \left( \mathrm{sgn}(s) F - \mu_1\,\mathrm{sgn}\,s
                 - \mu_2\,\mathrm{sgn}\,v \right)

    with the signs taken implicitly, at the end of the sampling period; in physical terms
    :math:`u = -\mu_1 - \mu_2\,\mathrm{sgn}\,\dot x`. With ``landing`` the sign is the fraction of
    the braking acceleration that stops the mass in :math:`N` periods, with a dead zone :math:`q`
    (`quiet`),

    .. math::

        \ddot x = F + u = -\min(\max((\dot x - q) / (N h), D), U), \qquad
        D = \mu_1 - \mu_2 - F, \quad U = \mu_1 + \mu_2 - F

    and a sampled loop ends in exact rest for every :math:`e < 1`; without it the step is solved as
    in the paper, whose plan to end a period on the wall a held control misses. Finite-time stable
    for every force bounded by :math:`M` when

    .. math:: M - \mu_1 \frac{1 - e^2}{1 + e^2} < \mu_2 < \mu_1 - M

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. If both are None, `simulate_closed_loop` sets the plant's
        value; ``step`` then requires it.
    bound : float, optional
        A bound :math:`M` of the force (m/s^2). The gains are then checked against it.
    depth : float
        Measurements down to ``-depth`` (m) are sensor noise and are taken as 0; deeper ones are
        rejected.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2): the control is cut to it.
    landing : bool
        Whether the control ends in exact rest in a sampled loop (the contact-establishing law);
        False is the paper's update.
    ahead : int
        The horizon :math:`N` of the contact-establishing law, >= 1: one more than the periods from
        a measurement to the moment when its control acts.
    quiet : float
        Dead zone of the contact-establishing law, >= 0 (m/s): a bound of the errors of the measured
        velocity, such as 5 standard deviations. A mass at rest then has a constant control, and
        rest is as exact as without errors.
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64, in place of
        `ahead`: the state is predicted as far ahead, exactly where the force is known, through
        impacts and into rest, under the controls that do not act yet.
    solver : {"exact", "newton", "outer"}
        Method for the signs of a step with ``landing=False``: by cases; as the variational
        inequality (23) of the paper by the general solver; or by a sequence of affine ones, without
        a merit function. Both solvers start from the signs of the last update. If the step has one
        solution, all methods return the same control; if a solver fails, the exact signs are used
        and `status` has ``UNSOLVED``.
    linearisations : int
        For ``solver="outer"``: maximal number of affine problems per step, >= 1.

    Raises
    ------
    ValueError
        If a setting is out of range, or the gains do not suffice for `bound`.

    See Also
    --------
    TwistingTracker : tracking of a reference.
    design_regulator : gains and sampling period.

    Notes
    -----
    A step evaluates both set-valued signs at the end of the period in closed form.

    The law is equation (3) of Huber and Oza; the step is their (12)-(13) with the missing terms
    :math:`s_k`, :math:`v_k` and the missing factor `h`, as a variational inequality (23). The
    contact-establishing law and the sharper condition of the gains are derived in the page
    "Exact rest in a sampled loop" (exact_rest.md).

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    A. Levant, Sliding order and sliding accuracy in sliding mode control, Int. J. Control 58, 1993.

    Examples
    --------
    >>> regulator = zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, bound=0.9)
    >>> regulator.step(1.0, -0.5, 0.0)  # falling: -mu1 + mu2
    -1.0
    >>> zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, bound=2.5)
    Traceback (most recent call last):
        ...
    ValueError: mu1 must be greater than mu2 + bound = 4.5 m/s^2 for bound = 2.5, got 3.0
    """

    @hinted("controller")
    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
        landing: bool = True,
        ahead: int = 1,
        quiet: float = 0.0,
        delay: int = 0,
        solver: Literal["exact", "newton", "outer"] = "exact",
        linearisations: int = LINEARISATIONS,
    ) -> Self:
        kappa = plant_kappa(e, kappa)
        settings = common_settings(mu1, mu2, h, kappa, bound, depth, u_limits)
        horizon = horizon_of(landing, ahead)
        more: dict[str, Any] = {
            "quiet": quiet_of(landing, quiet),
            "delay": delay_of(delay, horizon),
        }
        self = super().__new__(cls, **core(settings), ahead=horizon if landing else None, **more)
        self._settings = settings | {"landing": bool(landing), "ahead": horizon} | more
        self._settings |= _solve_by(self, solver, linearisations)
        return with_wall(self)


class TwistingTracker(_zivi.Tracker, Following, LandingController):
    r"""The twisting tracker: makes the mass follow a bouncing reference through its Zeno point.

    .. math::

        u = R\,\mathrm{sgn}(s) \left[ -\mu_1\,\mathrm{sgn}\,e_s - \mu_2\,\mathrm{sgn}\,e_v
            + \mathrm{sgn}(s_r) F_r / R_r \right] - \mathrm{sgn}(s)^2 F,
        \qquad e_s = s - s_r, \quad e_v = v - v_r

    with all six signs taken implicitly, at the end of the sampling period, and solved exactly: the
    control follows without chattering. The reference is a mass of its own above a wall, inside
    the controller, that each update advances by `h`. It starts at rest; see `reset`. A given
    reference is passed sample by sample: see `step_to`.

    With ``landing`` the contact-establishing law replaces it while the reference is at rest:

    .. math::

        \ddot x = F + u = -\min(\max((\dot x - q) / (N h), D), U), \qquad
        D = \frac{2 (\mu_1 - \mu_2)}{1 + e}, \quad U = \frac{2 e (\mu_1 + \mu_2)}{1 + e}

    (:math:`U < D`: :math:`U` if :math:`\dot x - q \ge N h U`, else :math:`D`), which are the law's
    own accelerations while the mass falls and rises, with a dead zone :math:`q` (`quiet`). A
    sampled loop ends in exact rest for every :math:`0 < e < 1`, also under noise and an unknown
    force.

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution of the plant's wall, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. If both are None, `simulate_closed_loop` sets the plant's
        value; ``step`` then requires it.
    e_ref, kappa_ref : float, optional
        At most one of them, for the reference's wall; by default the plant's. Exact
        tracking needs the plant's.
    branch : {"positive", "nearest"}
        How a measurement is lifted to ``(s, v)``: to ``s >= 0``, the reference too, every period
        (the paper); or to the preimage that is nearer to the reference, which itself passes
        through the wall continuously: the one with the smaller
        :math:`\mu_1 |e_s| + e_v^2/2`.
    bound : float, optional
        A bound :math:`M` of the force that is not known (m/s^2). The gains are then checked
        against it: :math:`M_e < \mu_2 < \mu_1 - M_e` with :math:`M_e = M (1+e)/(2e)`.
    depth : float
        Measurements down to ``-depth`` (m) are sensor noise and are taken as 0; deeper ones are
        rejected.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2): the control is cut to it.
    landing : bool
        Whether the control ends in exact rest in a sampled loop; False is the paper's law, whose
        control at rest is :math:`-F`.
    press : float, optional
        Acceleration towards the wall of a mass at rest, :math:`u = -F - press` (m/s^2): at least
        `bound`, or the unknown force lifts it. By default :math:`D`.
    ahead : int
        The horizon :math:`N` of the contact-establishing law, >= 1: one more than the periods from
        a measurement to the moment when its control acts.
    quiet : float
        Dead zone of the contact-establishing law, >= 0 (m/s): a bound of the errors of the measured
        velocity, such as 5 standard deviations. A mass at rest then has a constant control, and
        rest is as exact as without errors.
    horizon : float
        Periods over which the implicit step is planned, >= 1. More, about 3 to 5, are quieter under
        noise and less sharp near an impact.
    shift : bool
        Whether the update shifts the measured velocity by half a period, :math:`\dot x - h F_r/2`,
        in flight: it removes the bias :math:`h^2 |F_r|/2` of the position.
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64, in place of
        `ahead`: the state is predicted as far ahead, exactly where the force is known, through
        impacts and into rest, under the controls that do not act yet. The reference is as far
        ahead: after an update `x_ref` is its position at the end of the period in which the control
        acts.
    solver : {"exact", "newton", "outer"}
        Method for the signs of a step: by cases; as the variational inequality (24) of the paper
        with six signs by the general solver; or by a sequence of affine ones, without a merit
        function. Both solvers start from the signs of the last update. If the step has one
        solution, all methods return the same control; if a solver fails, the exact signs are used
        and `status` has ``UNSOLVED``.
    linearisations : int
        For ``solver="outer"``: maximal number of affine problems per step, >= 1.

    Raises
    ------
    ValueError
        If a setting is out of range, or the gains do not suffice for `bound`.

    See Also
    --------
    TwistingRegulator : control to rest without a reference.
    design_tracker : gains and sampling period.
    simulate_closed_loop : run the loop.

    Notes
    -----
    A step evaluates all set-valued signs at the end of the period, by an exact distinction of
    cases.

    The law is equation (7) of Huber and Oza. The step is their implicit Euler scheme (16)-(19) with
    the inclusions (9)-(11); it returns the control (20). All six signs together are the variational
    inequality (24). Misprints are corrected (paper.md).

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    A. Levant, Sliding order and sliding accuracy in sliding mode control, Int. J. Control 58, 1993.

    Examples
    --------
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5, bound=5.0)
    >>> tracker.reset(3.0, 3.0)
    >>> round(tracker.step(6.0, 5.0, -9.81, -19.81), 9)
    -33.5
    >>> tracker.x_ref  # the reference is one period ahead now
    3.00298019
    """

    @hinted("controller")
    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        e_ref: float | None = None,
        kappa_ref: float | None = None,
        branch: Literal["positive", "nearest"] = "positive",
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
        landing: bool = True,
        press: float | None = None,
        ahead: int = 1,
        quiet: float = 0.0,
        horizon: float = HORIZON,
        shift: bool = False,
        delay: int = 0,
        solver: Literal["exact", "newton", "outer"] = "exact",
        linearisations: int = LINEARISATIONS,
    ) -> Self:
        if not (isinstance(branch, str) and branch in BRANCHES):
            raise ValueError(f"branch must be one of {', '.join(BRANCHES)}, got {branch!r}")
        kappa = plant_kappa(e, kappa)
        settings = common_settings(mu1, mu2, h, kappa, bound, depth, u_limits)
        settings["kappa_ref"] = reference_kappa(e_ref, kappa_ref, kappa)
        periods = horizon_of(landing, ahead)
        more: dict[str, Any] = {
            "quiet": quiet_of(landing, quiet),
            "horizon": real("horizon", horizon),
            "shift": switch("shift", shift),
            "delay": delay_of(delay, periods),
        }
        if press is not None:
            press = real("press", press)
            if not landing:
                raise ValueError(f"press must be None with landing=False, got {press}")
        self = super().__new__(
            cls,
            **core(settings),
            nearest=branch == "nearest",
            ahead=periods if landing else None,
            press=press,
            **more,
        )
        self._settings = settings | {
            "branch": branch,
            "landing": bool(landing),
            "press": press,
            "ahead": periods,
            **more,
        }
        self._settings |= _solve_by(self, solver, linearisations)
        return with_wall(self)

    @property
    def branch(self) -> str:
        """How a measurement is lifted."""
        return str(self._settings["branch"])

    @property
    def press(self) -> float | None:
        """Acceleration towards the wall of a mass at rest (m/s^2); None if ``landing=False``."""
        self._number("kappa")  # known
        accelerations = self._accelerations()
        return None if accelerations is None else accelerations[-1]

    @property
    def horizon(self) -> float:
        """Periods over which the implicit step is planned."""
        return self._number("horizon")

    @property
    def shift(self) -> bool:
        """Whether the measured velocity is taken half a period back in the air."""
        return bool(self._settings["shift"])


class ExplicitTwisting(_zivi.Explicit, Following):
    r"""Baseline: the twisting tracker with the signs of the sampled state. It chatters.

    .. math::

        u = R \left[ -\mu_1\,\mathrm{sgn}\,(s - s_r) - \mu_2\,\mathrm{sgn}\,(v - v_r)
            + F_r / R_r \right] - F \qquad (s, s_r \ge 0)

    The same interface as `TwistingTracker`, and the same reference inside.

    Parameters
    ----------
    mu1, mu2 : float
        Gains, ``0 < mu2 < mu1`` (m/s^2).
    h : float
        Sampling period, > 0 (s).
    e, kappa : float
        At most one of the coefficient of restitution of the plant's wall, in (0, 1], and
        :math:`\kappa = (1-e)/(1+e)`. If both are None, `simulate_closed_loop` sets the plant's
        value; ``step`` then requires it.
    e_ref, kappa_ref : float, optional
        At most one of them, for the reference's wall; by default the plant's.
    bound : float, optional
        A bound of the unknown force (m/s^2), against which the gains are checked as the tracker's.
    depth : float
        Measurements down to ``-depth`` (m) are taken as 0; deeper ones are rejected.
    u_limits : (float, float), optional
        Range of the actuator (m/s^2).

    Raises
    ------
    ValueError
        If a setting is out of range.

    See Also
    --------
    TwistingTracker : the same law with implicit signs.

    Notes
    -----
    Explicit signs switch in each period, with an amplitude that does not depend on `h`. The class
    is for comparison with `TwistingTracker`; an update does not solve equations. The law is
    equation (7) of Huber and Oza with the signs of the sample.

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    A. Levant, Sliding order and sliding accuracy in sliding mode control, Int. J. Control 58, 1993.

    Examples
    --------
    >>> baseline = zivi.ExplicitTwisting(30, 17, h=1e-3, kappa=0.5)
    >>> round(baseline.step(0.1, 0.0, -9.81, -9.81), 9)  # above the reference, which rests
    -20.19
    """

    @hinted("controller")
    def __new__(  # noqa: D102 the class says it
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        e: float | None = None,
        kappa: float | None = None,
        e_ref: float | None = None,
        kappa_ref: float | None = None,
        bound: float | None = None,
        depth: float = DEPTH,
        u_limits: Sequence[float] | None = None,
    ) -> Self:
        kappa = plant_kappa(e, kappa)
        settings = common_settings(mu1, mu2, h, kappa, bound, depth, u_limits)
        settings["kappa_ref"] = reference_kappa(e_ref, kappa_ref, kappa)
        self = super().__new__(cls, **core(settings))
        self._settings = settings
        return with_wall(self)


CONTROLLERS: tuple[type[Shared], ...] = (TwistingRegulator, TwistingTracker, ExplicitTwisting)
"""All of them: closed loops, batches, blocks and files take each; they are names of `zivi`."""
