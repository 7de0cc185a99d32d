"""Methods: every one of the core, as a frozen class of its settings.

Those with prose of their own have it here. The class of any other method is generated in this
module and in `zivi` from the core's description.
"""

import zivi._zivi as _zivi
from zivi.base.habits import hinted
from zivi.simulation.method_settings import FixedSteps, Method, Settings, class_of

__all__ = ["METHODS", "FixedSteps", "Method", "Settings", *_zivi.METHODS]

SWITCHED_RK = r"""High order through impacts, Zeno points, rest and lift-off, with error control.

Free flight is integrated in :math:`(x, \dot x)` by DOP853 or Dormand-Prince 5(4); a step that
contains an impact is repeated onto it. The accumulation of impacts is extrapolated with its
known ratios, :math:`t_n = t_\infty - C_1 e^n - C_2 e^{2n} - \dots`, until the Zeno time is
within the tolerance. Rest ends at the first time at which the force points away from the wall.
``e`` may be anything in [0, 1].

Parameters
----------
rtol : float
    Relative tolerance of the local error, from 1e-14 to below 1.
atol : float or (float, float)
    Absolute tolerances, > 0, of `x` (m) and `xdot` (m/s), or one number for both. In the time
    of an accumulation they allow ``min(atol_x / U, atol_xdot / g)``, with the speed `U` of
    its first impact and the acceleration `g` towards the wall: no result depends on the units.
order : {8, 5}
    Order of the Runge-Kutta pair.
max_step : float
    Longest step, > 0 (s). Events shorter than a step, such as a pulse of the force at rest or
    within an accumulation, can be overlooked.
first_step : float, optional
    The first step, > 0 (s). By default from the force at the start.
max_steps : int
    Steps, taken and rejected, after which the run ends with `Status.STEP_BUDGET`.
max_impacts : int
    Impacts of one accumulation, or at ``e = 1`` since the last rest, >= 3, after which the run
    ends with `Status.ZENO_BUDGET`.
flights : {"auto", "rk", "series"}
    How free flight is computed. ``"rk"``: by the Runge-Kutta pair, within the tolerances.
    ``"series"``: by power series, to rounding, for a force that is a number or a `LinearForce`,
    above a wall at rest or a `HarmonicWall`; the tolerances then apply to the end of an
    accumulation only, `max_step` to the samples of events, and no force is evaluated (`nfev` is
    0). ``"auto"``, the default: by power series where that is possible, else by the pair.

Raises
------
ValueError
    If a setting is out of range.

See Also
--------
ThetaGamma, MoreauJean : fixed steps.

Notes
-----
A step of order 8 takes 12 evaluations of the force, one of order 5 takes 6; an impact takes up
to 18 more. The terms of a power series need no evaluations.

The force is evaluated at ``x`` slightly below 0 in the step that contains an impact, and should
continue smoothly there; where it raises or is not finite, it is evaluated at ``x = 0`` instead.
For `e` close to 1 an accumulation is long: hundreds of impacts at ``e = 0.99``.

Root finding, extrapolation of Zeno times and power series have their equations on the page "How
SwitchedRK works" (switched_rk.md).

References
----------
E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
Springer, 1993, chapter II.

Examples
--------
>>> ball = zivi.ImpactSystem(-9.81, kappa=0.41)
>>> sol = zivi.simulate(ball, (0, 4), (1, 6), method=zivi.SwitchedRK(rtol=1e-10))
>>> round(sol.rest_time, 15)
2.465846631559044
"""

THETA_GAMMA = r"""The theta-gamma scheme with implicit set-valued signs.

.. math::

    v^+ &= v + h\,\lambda_s f / R, \qquad R = 1 - \kappa \lambda_s \lambda_v \\
    s^+ &= s + h R\,(\theta v^+ + (1-\theta) v) \\
    \lambda_s &\in \mathrm{sgn}\,s_\gamma, \quad \lambda_v \in \mathrm{sgn}\,v_\gamma, \quad
    z_\gamma = \gamma z^+ + (1-\gamma) z

The default :math:`\theta = \gamma = 1` is implicit Euler, the only member that reaches rest
exactly. First order away from the accumulation; the time of the Zeno point is approached
like :math:`h \log(1/h)`. The force is taken at :math:`t + \theta h` and, if it depends on the
state, found together with the end of the step: to 1e-12 of its size, in at
most 20 trials along the selected solution and 60 on each sign pattern.

Parameters
----------
h : float
    Step size, > 0 (s). The last step is shortened to end at the end of the span.
theta, gamma : float
    In (0, 1].
solver : {"exact", "newton", "outer"}
    How the signs are found: by the exact case analysis; by the general VI solver on the
    nonlinear inclusion ("inner linearisation"); or by affine VIs one after another, each
    linearised at the solution of the last, without a merit function ("outer linearisation").
    A step in which the solver fails is taken by the exact one and counted in
    ``failed_steps``. Where a step has one solution, always when the force points towards the
    wall, all solvers return it. Under an outward force a step may have several: the exact
    analysis selects one by a rule, the other solvers return the one they reach from the present
    signs, and the trajectories may differ from there on.
linearisations : int
    For ``solver="outer"``: maximal number of affine VIs in a step, >= 1.

Raises
------
ValueError
    If a setting is out of range. `simulate` also raises it for a system with ``e = 0``,
    where :math:`R` may vanish.

See Also
--------
SwitchedRK : high order with error control.
TwistingTracker : the controller whose update is the same step.

Notes
-----
A step costs one evaluation of the force, if it depends on time only, and one case analysis of
two signs; a step through an accumulation costs no more.

The scheme discretises equation (2) of Huber and Oza by the theta-gamma method of their section
IV, with signs as in (9). Misprints of the paper are corrected (paper.md). The case analysis and
the selection rule are on the page "The theta-gamma scheme and time stepping" (scheme.md).

References
----------
O. Huber, H. B. Oza, Implicit numerical integration for the simulation and control of a
non-smooth system with resets, CDC 2016.

Examples
--------
>>> zivi.ThetaGamma(h=1e-3)
ThetaGamma(h=0.001, theta=1.0, gamma=1.0, solver='exact', linearisations=20)
"""

MOREAU_JEAN = r"""Baseline: Moreau-Jean time stepping with Newton's impact law on velocities.

.. math::

    \dot x^+ &= \dot x + h f_\theta + P, \qquad
    x^+ = x + h\,(\theta \dot x^+ + (1-\theta)\,\dot x) \\
    0 &\le P \perp \dot x^+ + e\,\dot x \ge 0 \quad
    \text{where } x + h \dot x / 2 \le 0, \text{ else } P = 0

It passes the accumulation at first order and may penetrate the wall by :math:`O(h)`: `x` is
reported without correction and may be negative. ``e`` is in [0, 1].

Parameters
----------
h : float
    Step size, > 0 (s).
theta : float
    In [0, 1].

Raises
------
ValueError
    If a setting is out of range.

See Also
--------
SwitchedRK : located impacts, without penetration.

Notes
-----
A step costs one evaluation of the force and one linear complementarity problem of the gaps that
are closed at its middle. Impacts within a step share one impulse.

References
----------
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, Springer, 1988.
M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177, 1999.

Examples
--------
>>> zivi.MoreauJean(h=1e-3)
MoreauJean(h=0.001, theta=0.5)
"""

EXPLICIT_EULER = r"""Baseline: explicit Euler on the transformed field with explicit signs.

.. math:: v^+ = v + h\,\mathrm{sgn}(s) f / R, \qquad s^+ = s + h R v, \qquad
          \mathrm{sgn}\,0 = +1

It passes the accumulation of impacts but never rests: it chatters.

Parameters
----------
h : float
    Step size, > 0 (s).

Raises
------
ValueError
    If `h` is out of range. `simulate` also raises it for a system with ``e = 0``.

See Also
--------
ThetaGamma : the same step with implicit signs, which comes to rest.

Notes
-----
A step costs one evaluation of the force and no solver. It discretises equation (2) of Huber and
Oza with the signs at the start of the step.

References
----------
O. Huber, H. B. Oza, Implicit numerical integration for the simulation and control of a
non-smooth system with resets, CDC 2016.

V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, Springer, 2008.

Examples
--------
>>> zivi.ExplicitEuler(h=1e-3)
ExplicitEuler(h=0.001)
"""

PROSE = {
    "SwitchedRK": SWITCHED_RK,
    "ThetaGamma": THETA_GAMMA,
    "MoreauJean": MOREAU_JEAN,
    "ExplicitEuler": EXPLICIT_EULER,
}
"""The documentation of those methods that say more than the core does."""

METHODS: dict[str, type[Settings]] = {
    name: hinted("method")(class_of(entry, PROSE.get(name)))
    for name, entry in _zivi.METHODS.items()
}
"""The class of every method, by its name."""

globals().update(METHODS)
