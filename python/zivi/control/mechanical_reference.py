"""References of mechanical systems: at samples, by forces that decouple gaps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, finite, not_negative, real, real_array
from zivi.control.loop_arguments import SLOWEST, sampled_run
from zivi.control.model_based import believed
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap_coordinates import GapKinetics, check_independent, kinetic_cosines
from zivi.system.mechanism import MechanicalSystem, Model
from zivi.system.model_parts import Partials, places

__all__ = [
    "MechanicalReference",
    "ReferenceSample",
    "check_coupling",
    "reference_of",
    "reference_run",
]

# References of mechanical systems at the samples of a controller.

MOST_IMPACTS = 100_000
"""Impacts of an accumulation of a reference that are counted."""


class ReferenceSample(NamedTuple):
    """Where a reference is at one sample.

    Attributes
    ----------
    q, qdot : ndarray
        Coordinates and velocities, shape (n,).
    sides : ndarray
        1 or -1 for each gap, the other after each impact, shape (m,).
    contacts : ndarray of bool
        Which gaps are closed and stay so, shape (m,).
    gaps, gap_rates : ndarray or None
        Gaps and their rates, shape (m,); without them the controller's own model says.
    accelerations : ndarray or None
        Of the gaps, without the force of their own contact, shape (m,): in contact they are
        negative. Without them the difference of the rates.
    qddot : ndarray or None
        Accelerations of the coordinates without contact forces, shape (n,); 0 without them.
    tasks : ndarray or None
        The functions of the controller's `tasks`, their first and second derivatives, shape (3, k);
        without them they do not follow.
    """

    q: Array
    qdot: Array
    sides: Array
    contacts: NDArray[np.bool_]
    gaps: Array | None = None
    gap_rates: Array | None = None
    accelerations: Array | None = None
    qddot: Array | None = None
    tasks: Array | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class MechanicalReference:
    """A reference at the samples, one array a quantity.

    Parameters
    ----------
    q, qdot, qddot : ndarray
        Shape (k, n).
    gaps, gap_rates, accelerations, sides : ndarray
        Shape (k, m).
    contacts : ndarray of bool
        Shape (k, m).
    apart : bool
        Whether gaps and coordinates were given apart: their coupling must be small then.
    goals : ndarray or None
        Functions of the coordinates that follow, first and second derivatives, shape (k, 3, p).
    """

    q: Array
    qdot: Array
    qddot: Array
    gaps: Array
    gap_rates: Array
    accelerations: Array
    sides: Array
    contacts: NDArray[np.bool_]
    apart: bool = False
    goals: Array | None = None

    def sample(self, k: int) -> ReferenceSample:
        """Give sample `k`, the last one beyond the end."""
        k = min(k, len(self.q) - 1)
        return ReferenceSample(
            self.q[k],
            self.qdot[k],
            self.sides[k],
            self.contacts[k],
            self.gaps[k],
            self.gap_rates[k],
            self.accelerations[k],
            self.qddot[k],
            None if self.goals is None else self.goals[k],
        )


def reference_of(
    reference: Any, times: Array, names: tuple[str, ...], q0: Array, tasks: tuple[str, ...] = ()
) -> MechanicalReference | None:
    """Translate what a loop is given, for a controller with these tasks; None for none."""
    if reference is None or isinstance(reference, MechanicalReference):
        return reference
    if isinstance(reference, MechanicalTrajectory):
        return of_run(reference, times, names, q0)
    if isinstance(reference, str):
        reference = {}.fromkeys(names, reference)
    if not isinstance(reference, Mapping):
        raise TypeError(
            "reference must be a run of zivi.simulate or zivi.reference_run, 'rest', or a dict of "
            f"one for each gap and the posture, got {type(reference).__name__}"
        )
    return of_parts(dict(reference), times, names, q0, tasks)


def of_run(
    run: MechanicalTrajectory, times: Array, names: tuple[str, ...], q0: Array
) -> MechanicalReference:
    """Give a run of the system at the samples."""
    if run.gap_names != names:
        raise ValueError(f"reference must have the gaps {names}, it has {run.gap_names}")
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(
            f"reference must be known over t_span = ({times[0]}, {times[-1]}), "
            f"it is a run over ({start}, {end})"
        )
    model = run._model
    if model is None:
        raise ValueError("reference has lost its system, as runs do that were loaded or sent")
    q, qdot, gaps, rates, contacts = run._known().at(np.ascontiguousarray(times))
    if q.shape[1] != len(q0):
        raise ValueError(f"reference must have {len(q0)} coordinates, it has {q.shape[1]}")
    gaps, rates = np.where(contacts, 0.0, gaps), np.where(contacts, 0.0, rates)
    qddot, accelerations = _without_contacts(model, times, (q, qdot), contacts)
    sides = _sides(run, times, len(names))
    return MechanicalReference(q, qdot, qddot, gaps, rates, accelerations, sides, contacts)


def _without_contacts(
    model: Model, times: Array, states: tuple[Array, Array], contacts: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Give the accelerations of coordinates and of gaps, each gap's without its own force."""
    layout, (q, qdot) = model.layout, (np.ascontiguousarray(it) for it in states)
    rows = np.empty((len(times), layout.size))
    for k, t in enumerate(times.tolist()):
        rows[k] = model.evaluate(t, q[k], qdot[k])
    count = len(times)
    part = {name: rows[:, at].reshape(count, *shape) for name, at, shape in places(layout)}
    mass, normals = part["mass"], part["gradients"]
    qddot: Any = np.linalg.solve(mass, part["force"][:, :, None])[:, :, 0]
    accelerations: Array = (normals @ qddot[:, :, None])[:, :, 0] + part["curvatures"]
    mobility: Any = np.linalg.solve(mass, normals.transpose(0, 2, 1))
    D: Array = normals @ mobility
    D = 0.5 * (D + D.transpose(0, 2, 1))
    check_independent(D)
    if layout.m > 1:  # one gap has no others
        for k in np.flatnonzero(contacts.any(axis=1)).tolist():
            accelerations[k] += _pushed(D[k], accelerations[k], contacts[k])
    return qddot, accelerations


def _pushed(D: Array, free: Array, closed: NDArray[np.bool_]) -> Array:
    """Give what each gap gets from the forces of the other contacts."""
    forces = np.zeros(len(free))
    if closed.any():
        inside = np.ix_(closed, closed)
        forces[closed] = -np.linalg.solve(D[inside], free[closed])
    pushed: Array = D @ forces - np.diag(D) * forces
    return pushed


def _sides(run: MechanicalTrajectory, times: Array, m: int) -> Array:
    """Give the branch of each gap: 1, and the other after each of its impacts."""
    impacts = run.impacts_down_to(SLOWEST, limit=MOST_IMPACTS)
    sides = np.ones((len(times), m))
    for i in range(m):
        own = impacts[(impacts["gap"] == i) & (impacts["speed_before"] < 0.0)]["t"]
        sides[np.searchsorted(own, times, side="right") % 2 == 1, i] = -1.0
    return sides


def of_parts(
    parts: dict[str, Any],
    times: Array,
    names: tuple[str, ...],
    q0: Array,
    tasks: tuple[str, ...],
) -> MechanicalReference:
    """Give a reference that is told gap by gap, and what the rest of it follows."""
    posture = parts.pop("posture", q0)
    goals = goals_of({name: parts.pop(name) for name in tasks if name in parts}, tasks, times)
    strange = sorted(set(parts) - set(names))
    if strange:
        raise ValueError(f"reference has {strange[0]!r}, which is no gap of {names} and no task")
    missing = sorted(set(names) - set(parts))
    if missing:
        raise ValueError(f"reference must say what gap {missing[0]!r} does: 'rest' or a run")
    count, m, n = len(times), len(names), len(q0)
    gaps, rates, pulls = (np.zeros((count, m)) for _ in range(3))
    sides, contacts = np.ones((count, m)), np.ones((count, m), dtype=bool)
    for i, name in enumerate(names):
        one = parts[name]
        if isinstance(one, str):
            if one != "rest":
                raise ValueError(f"reference[{name!r}] must be 'rest' or a run, got {one!r}")
            continue
        rows = _scalar(name, one, times)
        gaps[:, i], rates[:, i], sides[:, i], pulls[:, i] = rows
        contacts[:, i] = (rows[0] == 0.0) & (rows[1] == 0.0)
    q, qdot, qddot = posture_at(posture, times, n)
    moving = not contacts.all()
    of_gaps = gaps, rates, pulls, sides
    return MechanicalReference(q, qdot, qddot, *of_gaps, contacts, apart=moving, goals=goals)


def goals_of(parts: dict[str, Any], tasks: tuple[str, ...], times: Array) -> Array | None:
    """Give functions of the coordinates with their derivatives at the times; None for none."""
    if not parts:
        return None
    goals = np.zeros((len(times), 3, len(tasks)))
    for j, name in enumerate(tasks):
        if name not in parts:
            raise ValueError(
                f"reference must say what task {name!r} does, as it does of {[*parts]}"
            )
        one = parts[name]
        for k, t in enumerate(times.tolist()):
            given = np.atleast_1d(
                real_array(f"reference[{name!r}]", one(t) if callable(one) else one)
            )
            if given.ndim != 1 or not 1 <= len(given) <= 3 or not np.all(np.isfinite(given)):
                raise ValueError(
                    f"reference[{name!r}] must be one finite number, or with its first and second "
                    f"derivatives, got shape {given.shape}"
                )
            goals[k, : len(given), j] = given
    return goals


def _scalar(name: str, run: Any, times: Array) -> tuple[Array, Array, Array, Array]:
    """Give a gap that is a run of one mass: position, velocity, side, acceleration."""
    if not isinstance(run, Trajectory):
        raise TypeError(
            f"reference[{name!r}] must be 'rest' or a run of one mass, got {type(run).__name__}"
        )
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(f"reference[{name!r}] must be known over ({times[0]}, {times[-1]})")
    x, xdot, side, pull = sampled_run(run, times)
    return x, xdot, np.where(side == 0.0, 1.0, side), np.append(pull, pull[-1:])


def posture_at(posture: Any, times: Array, n: int) -> tuple[Array, Array, Array]:
    """Give ``(q, qdot, qddot)`` of a posture, constant or a function of time, at the times."""
    if callable(posture):
        rows = [posture_of(posture, float(t), n) for t in times]
        q, qdot, qddot = (np.array(it) for it in zip(*rows, strict=True))
        return q, qdot, qddot
    one = posture_of(posture, 0.0, n)
    q, qdot, qddot = (np.tile(it, (len(times), 1)) for it in one)
    return q, qdot, qddot


def posture_of(
    posture: Array | Callable[[float], Any], t: float, n: int
) -> tuple[Array, Array, Array]:
    """Read a posture at one time: ``q``, or ``(q, qdot)``, or with its acceleration."""
    given = real_array("posture", posture(t) if callable(posture) else posture)
    rows = given.reshape(1, -1) if given.ndim < 2 else given
    if rows.ndim != 2 or rows.shape[1] != n or len(rows) > 3 or not np.all(np.isfinite(rows)):
        raise ValueError(
            f"posture must be {n} finite coordinates, or these with velocities and "
            f"accelerations, got shape {given.shape}"
        )
    full = np.zeros((3, n))
    full[: len(rows)] = rows
    return full[0], full[1], full[2]


# Whether references that are given gap by gap can be followed: the guard for coupled gaps.

COUPLED = 0.05
"""Largest kinetic cosine of gaps whose references know nothing of each other."""
PLACES = 21
"""At so many samples of a reference the coupling is looked at."""
STEPS = 40
"""Newton steps to the configuration at a sample."""
LONGEST = 0.3
"""Longest of them."""
REACHED = 1e-6
"""Error of a gap or a function, relative to 1 and to it, of a configuration that is found."""
Names = tuple[str, ...]


def check_coupling(
    given: MechanicalReference,
    model: Model,
    tasks: Model | None,
    start: tuple[Array, Array],
    known: tuple[Array, Names, Names],
) -> None:
    """Refuse references that coupled gaps cannot follow, or that no configuration reaches.

    Parameters
    ----------
    given : MechanicalReference
        The reference.
    model, tasks : Model
        The system, and the functions of its coordinates that follow, if any.
    start : (ndarray, ndarray)
        Coordinates and velocities of the plant.
    known : (ndarray, tuple of str, tuple of str)
        The times of the reference, the names of its gaps and of those functions.
    """
    goals = given.goals if tasks is not None else None
    if not given.apart and goals is None:
        return  # the gaps are those of a motion of the system, or rest
    several = given.apart and given.gaps.shape[1] > 1
    q, found = start[0], [_cosine(model, *start)] if several else [0.0]
    for k in _places(given.gaps, goals):
        more = None if goals is None or tasks is None else (tasks, goals[k, 0])
        near = [q] if more is not None else [given.q[k], q, start[0]]
        q = _reached(model, near, given.gaps[k], more, (float(known[0][k]), *known[1:]))
        if several:
            found.append(_cosine(model, q, 0.0 * q))
    worst = max(found)
    if worst > COUPLED:
        raise ValueError(
            f"reference gives each gap a motion of its own, but the gaps are coupled, c = "
            f"{worst:.3g}: an impact on one kicks the other. Follow a motion of the system, "
            "zivi.reference_run"
        )


def _places(gaps: Array, goals: Array | None) -> list[int]:
    """Give the samples that are looked at: even ones, and those of the extremes."""
    rows = [gaps] if goals is None else [gaps, goals[:, 0]]
    count = len(gaps)
    ends = [it(axis=0).tolist() for row in rows for it in (row.argmax, row.argmin)]
    even = np.linspace(0, count - 1, min(PLACES, count)).astype(int).tolist()
    return sorted({*even, *(k for end in ends for k in end)})


def _cosine(model: Model, q: Array, qdot: Array) -> float:
    here = model.layout.read(model.evaluate(0.0, np.ascontiguousarray(q), qdot))
    cosines = kinetic_cosines(GapKinetics.of(here, qdot).D)
    np.fill_diagonal(cosines, 0.0)
    return float(np.abs(cosines).max())


def _reached(
    model: Model,
    near: list[Array],
    gaps: Array,
    more: tuple[Model, Array] | None,
    known: tuple[float, Names, Names],
) -> Array:
    """Give a configuration with these gaps and functions, near one of others; or tell the lack."""
    lacks = []
    for q in near:
        q, has = _configuration(model, q, gaps, more)
        wanted = gaps if more is None else np.concatenate([gaps, more[1]])
        lack = np.abs(has - wanted) / (1.0 + np.abs(wanted))
        if len(wanted) > len(q):  # more than can be: functions follow as far as there is room
            lack = lack[: len(gaps)]
        if np.all(lack <= REACHED):
            return q
        lacks.append((float(np.nan_to_num(lack, nan=np.inf).max()), has))
    t, *names = known
    _, has = min(lacks, key=lambda it: it[0])
    words = [
        f"{name!r} = {one:.6g} ({abs(one - other):.3g} from the nearest found, {other:.6g})"
        for name, one, other in zip((*names[0], *names[1]), wanted, has, strict=False)
        if not abs(one - other) <= REACHED * (1.0 + abs(one))
    ]
    raise ValueError(
        f"reference asks at t = {t:.6g} for what no configuration was found to have: "
        f"{', '.join(words)}"
    )


def _configuration(
    model: Model, q: Array, gaps: Array, more: tuple[Model, Array] | None = None
) -> tuple[Array, Array]:
    """Give coordinates with these gaps and functions, near others, and what they do have."""
    q, still = np.array(q, dtype=np.float64), np.zeros(len(q))
    for k in range(2 * STEPS):
        here = model.layout.read(model.evaluate(0.0, q, still))
        missing = gaps - here.gaps
        to_gaps = np.linalg.pinv(here.gradients)
        step: Array = to_gaps @ missing
        if more is not None and k < STEPS:
            functions, goal = more
            there = functions.layout.read(functions.evaluate(0.0, q, still))
            beside = there.gradients @ (np.eye(len(q)) - to_gaps @ here.gradients)
            left = goal - there.gaps - there.gradients @ step
            step = step + np.linalg.pinv(beside, rcond=1e-6) @ left
        length = float(np.linalg.norm(step))
        q = q + step * min(1.0, LONGEST / max(length, 1e-300))
        if length < 1e-10:
            break
    has = [model.layout.read(model.evaluate(0.0, q, still)).gaps]
    if more is not None:
        has.append(more[0].layout.read(more[0].evaluate(0.0, q, still)).gaps)
    return q, np.concatenate(has)


# References that are motions of the system itself, made by forces that decouple its gaps.

EXACT = SwitchedRK(rtol=1e-9, atol=1e-12)

Virtual = Mapping[str, float | Callable[[float], float]]


def reference_run(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Sequence[ArrayLike],
    *,
    virtual: Virtual,
    posture: ArrayLike | Callable[[float], Any] | None = None,
    gains: Sequence[float] = (400.0, 40.0),
    method: SwitchedRK = EXACT,
    tstops: ArrayLike | None = None,
) -> MechanicalTrajectory:
    r"""Simulate a motion of a system that a `GapTracker` can follow exactly.

    Its gaps fall under accelerations of their own and are coupled in impacts only; what impacts
    leave alone is drawn to a posture:

    .. math::

        \ddot g = a + W \lambda, \qquad
        Z \ddot q = Z (\ddot q_n - k_p (q - q_n) - k_d (\dot q - \dot q_n))

    Where an impact on one gap kicks another a reference must have the same kicks: this one has.

    Parameters
    ----------
    system : MechanicalSystem
        The system, with as many independent gaps as it has.
    t_span : (float, float)
        Start and end (s).
    y0 : (array_like, array_like)
        Coordinates and velocities at the start, shape (n,) each.
    virtual : dict
        For each gap its acceleration a: a number, or a function of time (negative: towards
        contact). Times at which one jumps, such as that of a lift-off, belong into `tstops`.
    posture : array_like or callable, optional
        The coordinates :math:`q_n`, or a function of time that gives them, or these with velocities
        and accelerations, shapes (n,), (2, n) or (3, n). By default where the motion starts.
    gains : (float, float)
        :math:`k_p` (1/s^2) and :math:`k_d` (1/s).
    method : SwitchedRK
        How the motion is integrated.
    tstops : array_like, optional
        Times at which an acceleration jumps (s).

    Returns
    -------
    MechanicalTrajectory

    Raises
    ------
    ValueError
        If a gap has no acceleration, or one that is no gap has.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> run = zivi.reference_run(box, (0, 2), ([0.2, 0.5], [0, 0]), virtual={"floor": -4.0})
    >>> round(float(run.zeno.t[0]), 6), run.contacts[-1]  # 3 sqrt(2 0.5/4)
    (1.5, array([ True]))
    """
    own, virtual = believed(system), by_name("virtual", virtual)
    strange = sorted(set(virtual) - set(system.gap_names))
    missing = sorted(set(system.gap_names) - set(virtual))
    if strange or missing:
        raise ValueError(
            f"virtual must have an acceleration for each gap of {system.gap_names}, "
            f"{'lacks ' + repr(missing[0]) if missing else 'has ' + repr(strange[0])}"
        )
    pulls = {
        name: it if callable(it) else finite(f"virtual[{name!r}]", it)
        for name, it in virtual.items()
    }
    start = state_of(y0, own._n)
    kp, kd = (not_negative("gains", it) for it in pair("gains", gains, "(kp, kd)"))
    driven = Decoupled(own, pulls, start[0] if posture is None else posture, (kp, kd))
    return simulate(driven, t_span, start, method, tstops=tstops, samples="steps")


class Decoupled(MechanicalSystem):
    """A system under forces that decouple its gaps.

    Parameters
    ----------
    system : MechanicalSystem
        The system.
    pulls : dict
        The acceleration of each gap, a number or a function of time.
    posture : array_like or callable
        As for `reference_run`.
    gains : (float, float)
        Of the posture.
    """

    derived = True

    def __init__(
        self,
        system: MechanicalSystem,
        pulls: Mapping[str, Any],
        posture: Any,
        gains: tuple[float, float],
    ) -> None:
        self._own, self._pulls, self._posture, self._gains = system, pulls, posture, gains
        self._gaps, self._gap_names = system.gaps, system.gap_names
        self._e, self._n, self._coordinates = system.e, system._n, system._coordinates

    def _breaks(self, span: tuple[float, float]) -> Array:
        return self._own._breaks(span)

    def model(self, n: int) -> Model:
        """Give what the extension integrates: the system without friction, under these forces."""
        own = self._own.model(n)
        layout = own.layout
        if layout.p:
            raise ValueError("reference_run takes systems without dry friction")
        names, (kp, kd) = self._gap_names, self._gains

        def evaluate(t: float, q: Array, qdot: Array) -> Array:
            row = own.evaluate(t, q, qdot)
            here = layout.read(row)
            at, along, turning = posture_of(self._posture, t, n)
            wanted = turning - kp * (q - at) - kd * (qdot - along)
            pulls = [
                real(f"virtual[{name!r}]", it(t)) if callable(it) else it
                for name, it in ((name, self._pulls[name]) for name in names)
            ]
            row[n * n : n * n + n] = _zivi.decoupling_force(
                here.mass, here.gradients, here.curvatures, np.array(pulls, np.float64), wanted
            )
            return row

        return Model(layout, _zivi.Model.callable(evaluate), evaluate)

    def partials(self, model: Model) -> Partials:
        """Give no derivatives."""
        return Partials()

    def __getstate__(self) -> dict[str, Any]:
        return {
            "system": self._own,
            "pulls": self._pulls,
            "posture": self._posture,
            "gains": self._gains,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        Decoupled.__init__(self, **state)
