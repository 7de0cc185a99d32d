"""Controllers of mechanical systems: gap trackers and strikers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, finite, not_negative, positive, real, switch
from zivi.control.component import TickStatus, delay_of, limit_pairs, limits_of
from zivi.control.mechanical_reference import MechanicalReference, ReferenceSample
from zivi.control.model_based import ModelBased, believed
from zivi.control.twisting import TwistingTracker
from zivi.simulation.run import pair
from zivi.system.gap import Gap
from zivi.system.mechanism import MechanicalSystem, Model
from zivi.system.start import check_functions
from zivi.system.symbolic_system import SymbolicSystem, system as symbolic_system

# Task functions of the coordinates that a controller tracks in addition to the gaps.


def check_tasks(system: MechanicalSystem, tasks: Mapping[str, Any]) -> dict[str, Any]:
    """Read functions by name: all a `Gap`, or formulas for a symbolic system."""
    read = {str(name): it for name, it in tasks.items()}
    taken = {"posture", *system.gap_names}
    if strange := sorted(set(read) & taken):
        raise ValueError(f"tasks must have names other than {sorted(taken)}, got {strange[0]!r}")
    formulas = [name for name, it in read.items() if not isinstance(it, Gap)]
    if formulas and (len(formulas) < len(read) or not isinstance(system, SymbolicSystem)):
        raise TypeError(
            f"tasks[{formulas[0]!r}] must be a zivi.Gap with value and derivatives, or all are "
            "formulas in coordinates and parameters of a symbolic system"
        )
    return read


def functions_of(system: MechanicalSystem, tasks: Mapping[str, Any], n: int) -> MechanicalSystem:
    """Return a system whose gaps are the functions; its masses and forces do not matter."""
    if any(isinstance(it, Gap) for it in tasks.values()):
        gaps = list(tasks.values())
        return MechanicalSystem(mass=np.eye(n), force=np.zeros(n), gaps=gaps, e=0.0)
    assert isinstance(system, SymbolicSystem)
    names = system.coordinate_names(n)
    own = symbolic_system(
        list(names),
        T=" + ".join(f"{name}dot**2" for name in names),
        gaps={name: _in_symbols(it) for name, it in tasks.items()},
        parameters=dict(system.parameters),
        compiler=system._compiler,
    )
    own._parameters = system.parameters  # those change with the system's
    return own


def _in_symbols(formula: Any) -> Any:
    """Replace functions of time by symbols of their names."""
    functions = formula.atoms(_undefined()) if hasattr(formula, "atoms") else ()
    return formula.subs({it: it.func.__name__ for it in functions}) if functions else formula


def _undefined() -> Any:
    import sympy.core.function

    return sympy.core.function.AppliedUndef


# A controller of mechanical systems: one tracker a gap, the rest at right angles to impacts.


class GapTracker(ModelBased):
    r"""Lets the gaps of a mechanism follow bouncing references through impacts, rest and lift-off.

    With :math:`W = N M^{-1} N^T` and :math:`Z` as in `zivi.mechanics.gap_coordinates`:

    .. math::

        \ddot g = a + W \lambda, \qquad
        Z \ddot q = Z (\ddot q_r - k_p (q - q_r) - k_d (\dot q - \dot q_r))

    where :math:`a_i` is the control of a `TwistingTracker` on gap i, for all of which impacts,
    accumulations and coming to rest are as for one mass; an impact leaves the second line alone.
    Contacts that rest with their reference are held with the specified contact forces, :math:`a_A =
    -W_{AA} \lambda_d`. Functions :math:`y = f(q)` with a reference follow it with priority, the
    posture in their null space:

    .. math::

        J T b = \ddot y_r - \dot J \dot q + J M^{-1} N^T W^{-1} \dot N \dot q
        - k_p (y - y_r) - k_d (J T w - \dot y_r)

    The effect of impacts on y is not compensated; in contact, y follows :math:`y_r`.

    Parameters
    ----------
    system : MechanicalSystem
        The controller's model of the plant, for example ``arm.replace(m2=0.9)``.
    h : float
        Sampling period, > 0 (s).
    gains : dict
        For each gap the gains ``(mu1, mu2)`` of its tracker.
    posture : (float, float)
        :math:`k_p` (1/s^2) and :math:`k_d` (1/s).
    force : dict, optional
        The contact forces :math:`\lambda_d` > 0 (N) by gap, numbers or functions of time. They must
        exceed :math:`M_i/W_{ii}`, with the bound :math:`M_i` of the unknown acceleration of the
        gap; without a value the contact-establishing law presses the gap.
    u_limits : sequence of (float, float), optional
        Range of each control.
    horizon : float
        As for `TwistingTracker`.
    shift : bool
        As for `TwistingTracker`.
    latch : (float, float), optional
        Gap (m) and rate (m/s) below which a contact that rests with its reference is held; by
        default 20 standard deviations of their noise, which `simulate_closed_loop` passes, or 1e-9
        without noise.
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64: the state is
        predicted as far ahead.
    tasks : dict, optional
        Functions of the coordinates that may follow a reference in addition to the gaps, by their
        names in the ``reference`` of a loop: each a `Gap`, for its value and derivatives; or
        formulas in the coordinates and parameters of a `zivi.symbolic.system`, such as ``{"x":
        "l1*cos(a) + l2*cos(a + b)"}``.
    learn_offset : bool
        Whether gaps measured in held contacts are interpreted as errors of the wall positions, up
        to 5 mm. Contacts are then held by their rates.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range or a gap without gains; at the first update, if the controls do
        not reach all gaps: the rank of :math:`N M^{-1} B` is less than m.

    See Also
    --------
    reference_run : motions to follow.
    Striker : aim at the next impact.
    zivi.interop.native.gap_tracker_source : the controller in C.

    Notes
    -----
    The accelerations of the gaps are decoupled by the Delassus matrix; each gap is then controlled
    as one mass. An update evaluates the model at the sample and, for a reference without gaps,
    at both ends of its period; with `delay` it integrates the model ahead. It factorises matrices
    of the size of the coordinates and solves one twisting step for each gap. The page "Control of
    mechanical systems" (control_mechanics.md) derives the decoupling; the law of a gap is equation
    (7) of Huber and Oza.

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> ctl = zivi.GapTracker(box, h=1e-3, gains={"floor": (30, 17)}, force={"floor": 5.0})
    >>> run = zivi.simulate_closed_loop(box, ctl, (0, 1), ([0, 0.3], [0, 0]), reference="rest")
    >>> run.contacts[-1], run.reactions[-1].round(9)
    (array([ True]), array([5.]))
    """

    _law: _zivi.GapTracker

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        h: float,
        gains: Mapping[str, Sequence[float]],
        posture: Sequence[float] = (400.0, 40.0),
        force: Mapping[str, float | Callable[[float], float]] | None = None,
        u_limits: Sequence[Sequence[float]] | None = None,
        horizon: float = 1.0,
        shift: bool = False,
        latch: Sequence[float] | None = None,
        delay: int = 0,
        tasks: Mapping[str, Any] | None = None,
        learn_offset: bool = False,
    ) -> None:
        settings: dict[str, Any] = {
            "h": real("h", h),
            "gains": {
                name: pair(f"gains[{name!r}]", it, "(mu1, mu2)")
                for name, it in by_name("gains", gains).items()
            },
            "posture": pair("posture", posture, "(kp, kd)"),
            "force": _force_levels({} if force is None else by_name("force", force)),
            "u_limits": u_limits,
            "horizon": real("horizon", horizon),
            "shift": switch("shift", shift),
            "latch": None if latch is None else pair("latch", latch, "(of the gap, of its rate)"),
            "delay": delay_of(delay),
            "tasks": check_tasks(
                believed(system), {} if tasks is None else by_name("tasks", tasks)
            ),
            "learn_offset": switch("learn_offset", learn_offset),
        }
        for name, both in (("posture", posture), ("latch", latch or (0.0, 0.0))):
            if not all(math.isfinite(it) and it >= 0.0 for it in both):
                raise ValueError(f"{name} must be two finite numbers >= 0, got {both}")
        names = believed(system).gap_names
        _same_names("gains", settings["gains"], names, every=True)
        _same_names("force", settings["force"], names)
        self._trackers = [
            TwistingTracker(
                *settings["gains"][name],
                h=settings["h"],
                e=float(e),
                horizon=settings["horizon"],
                shift=settings["shift"],
            )
            for name, e in zip(names, system.e, strict=True)
        ]
        self._law = _zivi.GapTracker(
            self._trackers,
            h=settings["h"],
            posture=settings["posture"],
            limits=limit_pairs(limits_of(u_limits)),
            latch=settings["latch"],
            delay=settings["delay"],
            learn_offsets=settings["learn_offset"],
            pressing=[_pressing(name, settings["force"].get(name)) for name in names],
        )
        super().__init__(system, settings)

    @property
    def status(self) -> TickStatus:
        """Status of the last update: treatment of sample and control."""
        return TickStatus(self._law.state[7])

    @property
    def latched(self) -> NDArray[np.bool_]:
        """Which contacts are held, shape (m,)."""
        return np.array(self._law.state[1], dtype=bool)

    @property
    def accelerations(self) -> Array:
        """Commanded gap accelerations of the last update, without contact forces, shape (m,)."""
        return np.array(self._law.state[3], dtype=np.float64)

    @property
    def least_singular_value(self) -> float:
        r"""The least singular value so far of :math:`W^{-1/2} N M^{-1} B`, in parts of limits."""
        return float(self._law.state[8][0])

    @property
    def zero_dynamics(self) -> int:
        """How many directions have no actuator of their own: nothing is promised of them."""
        return int(self._law.state[8][1])

    @property
    def tasks(self) -> tuple[str, ...]:
        """Names of the task functions."""
        return tuple(self._settings["tasks"])

    @property
    def offsets(self) -> Array:
        """How much nearer the walls are than the model thinks, as far as that is learnt (m)."""
        return np.array(self._law.state[9][0], dtype=np.float64)

    @property
    def state(self) -> tuple[Any, ...]:
        """Internal state, which changes at each update; assigning it restores it exactly."""
        own = self._law.state
        trackers, held, beyond, a, queue, *last, status, rank, offsets = own
        rows = (None if it is None else tuple(it) for it in last)
        sent = tuple(tuple(it) for it in queue)
        known = status, rank, tuple(tuple(it) for it in offsets)
        return (tuple(trackers), tuple(held), tuple(beyond), tuple(a), sent, *rows, *known)

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        try:
            for tracker, own in zip(self._trackers, state[0], strict=True):
                tracker.state = own  # checked
            self._law.state = state
        except (TypeError, ValueError, IndexError, OverflowError) as error:
            text = f"state must be what a GapTracker of these gaps gave: {error}"
            raise ValueError(text) from None

    def __getstate__(self) -> dict[str, Any]:
        own = {"settings": self._settings, "system": self.system}
        return {**own, "state": self.state, "noise": np.array(self._law.noise)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        GapTracker.__init__(self, state["system"], **state["settings"])
        self.sensed(*state["noise"].tolist())
        self.state = state["state"]

    def sensed(self, noise: Sequence[float], steps: Sequence[float]) -> None:
        """Set standard deviations and resolutions of the sensor: coordinates and velocities."""
        self._law.noise = (list(noise), list(steps))

    def step(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Return the controls for the period that starts now; all gaps come to rest.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).

        Returns
        -------
        ndarray
            The controls, shape (r,). Where a measurement is not finite they are the last ones, and
            the status is ``REFUSED``.
        """
        return self._ticked(t, q, qdot, None)

    def step_to(
        self,
        t: float,
        q: ArrayLike,
        qdot: ArrayLike,
        now: ReferenceSample,
        next: ReferenceSample,
    ) -> Array:
        """Return the controls for a reference that is given at this sample and at the next one.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).
        now, next : ReferenceSample
            The reference, as many periods ahead as `delay` says.

        Returns
        -------
        ndarray
            As `step`.
        """
        return self._ticked(t, q, qdot, (_sample_spec(now), _sample_spec(next)))

    def in_loop(self, n: int, reference: MechanicalReference | None) -> _zivi.GapLoop:
        """Return the native loop for `n` coordinates, along a reference or into rest."""
        given = None
        if reference is not None:
            it = reference
            given = _zivi.Reference(
                it.q,
                it.qdot,
                it.qddot,
                it.gaps,
                it.gap_rates,
                it.accelerations,
                it.sides,
                it.contacts,
                np.zeros((0, 0)) if it.goals is None else it.goals.reshape(len(it.q), -1),
            )
        return _zivi.GapLoop(self._law, self._model(np.zeros(n))[1].core, given)

    def functions(self, q: Array) -> Model | None:
        """Return the model whose gaps are the tasks, checked at coordinates; None without any."""
        return self._model(q)[1].tasks

    def _functions(self, q: Array) -> MechanicalSystem | None:
        tasks = self._settings["tasks"]
        if not tasks:
            return None
        functions = functions_of(self.system, tasks, len(q))
        check_functions(functions, functions.model(len(q)), q)
        return functions

    def _ticked(self, t: float, q: ArrayLike, qdot: ArrayLike, ends: Any) -> Array:
        core, at, speed = self._measured(q, qdot)
        return self._law.step(core, finite("t", t), at, speed, ends)


def check_gap_tracker(controller: Any) -> None:
    """Reject any other controller, also one that is derived from it."""
    if type(controller) is not GapTracker:
        raise TypeError(
            f"controller must be a zivi.GapTracker, got {type(controller).__name__}; the C "
            "library, zivi.native.prefix(), and zivi.export_fmu have controllers of one mass"
        )


def _sample_spec(sample: ReferenceSample) -> tuple[Any, ...]:
    """Return a sample for the extension."""
    numbers = [None if it is None else np.asarray(it, dtype=np.float64) for it in sample]
    numbers[3] = np.asarray(sample.contacts, dtype=bool)
    numbers[8] = None if numbers[8] is None else numbers[8].ravel()
    return tuple(numbers)


def _pressing(name: str, force: Any) -> Any:
    """Return a force for the extension."""
    if not callable(force):
        return force
    return lambda t: positive(f"force[{name!r}]({t:.9g})", force(t))


def _force_levels(force: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: it if callable(it) else positive(f"force[{name!r}]", it) for name, it in force.items()
    }


def _same_names(
    name: str, given: Mapping[str, Any], gaps: tuple[str, ...], *, every: bool = False
) -> None:
    strange = sorted(set(given) - set(gaps))
    if strange:
        raise ValueError(f"{name} has unknown gap {strange[0]!r}; the gaps are {gaps}")
    missing = sorted(set(gaps) - set(given))
    if every and missing:
        raise ValueError(
            f"{name} must have an entry for each gap of {gaps}; {missing[0]!r} is missing"
        )


# Aiming at the next impact: a racket, hammer or pusher that sets a body's speed.

LEARNT = 0.7
"""How much of what an impact showed is taken over."""
LEAST = 0.1
"""The same of late impacts under noise, each of which shows little."""
PUSHES = 50, 500
"""Samples of an unknown acceleration that are averaged, without noise and with it.

Under a delay d that nobody told it is the change of the control over d periods that is learnt,
which the next controls compensate: a loop with the gain 1/50. It is stable for
1/50 < 2 sin(pi/(4 d + 6)), for all d up to 64.
"""
MEAN = 50
"""Samples of a noisy speed in flight that are averaged, what gravity does between them known."""
DEVIATIONS = 10.0
"""So many deviations of the measured speed are no impact."""


class Striker(ModelBased):
    r"""Strikes a body so that it flies as high as requested, or a wall with the requested speed.

    The next contact is known from the flight of the body: its time, at the place :math:`z^*`, and
    the speed :math:`v^-` with which the body comes. To leave with :math:`V = \sqrt{2 G H}` it must
    meet a racket that moves with

    .. math::

        w^* = v^- + (V - v^-)/\gamma, \qquad \gamma = (1 + e)\,(M^{-1} N^T)_{body}/W

    The way there is that of least effort, cubic in time. Which acceleration the gap needs is found
    as by `GapTracker`; the gap alone would not know the height. Errors of the model in masses and
    restitution are lumped in one number, :math:`\gamma`, learnt from each impact; errors in the
    forces on the racket are learnt from its acceleration.

    Parameters
    ----------
    system : MechanicalSystem
        The controller's model of the plant.
    gap : str
        The gap between racket and body, or before a wall. Of the body's coordinate it has the
        gradient 1.
    body : str, optional
        The coordinate of the body that is struck, which no control moves; none for a wall.
    apex : callable or float, optional
        Height H of flight `k` above `place` (m), ``apex(k)``; asked until the impact.
    speed : callable or float, optional
        For a wall, in place of `apex`: the speed of blow `k` (m/s), ``speed(k)``.
    interval : float
        For a wall: time between two blows (s).
    place : float
        Where the racket meets the body (m).
    h : float
        Sampling period, > 0 (s).
    learn : bool
        Whether :math:`\gamma` and the unknown acceleration of the racket are learnt.
    u_limits : sequence of (float, float), optional
        Range of each control.
    posture : float
        Damping of the motion in the null space of the gap (1/s).
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range, a name that is none of the system, not exactly one of `apex` and
        `speed`.

    See Also
    --------
    GapTracker : tracking of gaps.

    Notes
    -----
    The speed of the striking body before the next impact follows from Newton's law and the flight
    that is requested; its factor is learnt from each impact. An update is a closed formula.

    Examples
    --------
    >>> racket = zivi.MechanicalSystem(
    ...     mass=np.diag([0.2, 1.0]), force=[-0.2 * 9.81, -9.81],
    ...     gaps=[zivi.LinearGap([1, -1], name="racket")], e=0.6,
    ...     coordinates=["ball", "paddle"], inputs=[[0.0], [1.0]],
    ... )
    >>> ctl = zivi.Striker(racket, gap="racket", body="ball", apex=0.5)
    >>> run = zivi.simulate_closed_loop(racket, ctl, (0, 6), ([0.4, 0.0], [0, 0]))
    >>> float(run.q[run.t > 4, 0].max().round(4))
    0.5
    """

    _law: _zivi.Striker

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        gap: str,
        body: str | None = None,
        apex: Callable[[int], float] | float | None = None,
        speed: Callable[[int], float] | float | None = None,
        interval: float = 0.5,
        place: float = 0.0,
        h: float = 1e-3,
        learn: bool = True,
        u_limits: Sequence[Sequence[float]] | None = None,
        posture: float = 20.0,
        delay: int = 0,
    ) -> None:
        if gap not in believed(system).gap_names:
            raise ValueError(f"gap must be one of {system.gap_names}, got {gap!r}")
        if (apex is None) == (speed is None) or (body is None) != (apex is None):
            raise ValueError("either body and apex must be given, or speed, for a wall")
        self._gap = system.gap_names.index(gap)
        settings: dict[str, Any] = {
            "gap": gap,
            "body": body,
            "apex": apex,
            "speed": speed,
            "interval": finite("interval", interval),
            "place": finite("place", place),
            "h": finite("h", h),
            "learn": switch("learn", learn),
            "u_limits": u_limits,
            "posture": not_negative("posture", posture),
            "delay": delay_of(delay),
        }
        for name in ("h", "interval"):
            if not settings[name] > 0.0:
                raise ValueError(f"{name} must be > 0, got {settings[name]}")
        name, target = ("apex", apex) if speed is None else ("speed", speed)
        self._law = _zivi.Striker(
            gap=self._gap,
            e=float(system.e[self._gap]),
            of_wall=body is None,
            place=settings["place"],
            interval=settings["interval"],
            h=settings["h"],
            learns=settings["learn"],
            learning=(LEARNT, LEAST, PUSHES, MEAN),
            limits=limit_pairs(limits_of(u_limits)),
            posture=settings["posture"],
            delay=settings["delay"],
            target=_target(name, target),
        )
        super().__init__(system, settings)

    @property
    def strokes(self) -> int:
        """How many impacts were seen."""
        return int(self._law.state[0])

    @property
    def gamma(self) -> float:
        """Change of the body's speed by an impact, as a part of the closing speed; NaN before."""
        return float(self._law.state[1])

    @property
    def push(self) -> float:
        """Acceleration of the racket that the model does not know (m/s^2)."""
        return float(self._law.state[6][2][1])

    @property
    def status(self) -> TickStatus:
        """Status of the last update: treatment of sample and control."""
        return TickStatus(self._law.state[9])

    @property
    def state(self) -> tuple[Any, ...]:
        """Internal state, which changes at each update; assigning it restores it exactly."""
        return self._law.state

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        try:
            self._law.state = state
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"state must be what a Striker gave: {error}") from None

    def __getstate__(self) -> dict[str, Any]:
        own = {"settings": self._settings, "system": self.system}
        return {**own, "state": self.state, "noise": self._law.noise}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Striker.__init__(self, state["system"], **state["settings"])
        self._law.noise, self.state = state["noise"], state["state"]

    def sensed(self, noise: Sequence[float], steps: Sequence[float]) -> None:
        """Set standard deviations and resolutions of the sensor: coordinates and velocities."""
        self._law.noise = DEVIATIONS * float(noise[1]) + 2.0 * float(steps[1])

    def step(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Return the controls for the period that starts now.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).

        Returns
        -------
        ndarray
            The controls, shape (r,). Where a measurement is not finite they are the last ones, and
            the status is ``REFUSED``.
        """
        core, at, speed = self._measured(q, qdot)
        return self._law.step(core, finite("t", t), at, speed)

    def in_loop(self, n: int, reference: MechanicalReference | None) -> _zivi.StrikeLoop:
        """Return the native loop for `n` coordinates, without a reference."""
        return _zivi.StrikeLoop(self._law, self._model(np.zeros(n))[1].core)

    def _look_at(self, q: Array) -> None:
        """Find the body among the coordinates."""
        names, body = self.system.coordinate_names(len(q)), self._settings["body"]
        if body is not None and body not in names:
            raise ValueError(f"body must be one of the coordinates {names}, got {body!r}")
        if body is None:
            return
        place = names.index(body)
        self._law.body = place
        there = self.system.at(0.0, q, 0.0 * q)
        if abs(there.gradients[self._gap, place] - 1.0) > 1e-9:
            raise ValueError(f"gap {self._settings['gap']!r} must grow as {body!r} does")


def _target(name: str, given: Any) -> Any:
    """Return heights or speeds for the extension."""
    if callable(given):
        return lambda k: positive(f"{name}({k})", given(k))
    return positive(name, given)
