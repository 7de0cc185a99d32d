"""Initial states of mechanical systems: checks, states on equality rows, gap coordinates."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, real_array
from zivi.system.gap import Channel, HarmonicWall, LinearGap, MovingWall, Slip
from zivi.system.mechanism import MechanicalSystem, Model, check_mass
from zivi.system.model_parts import Evaluation, check_equalities, violations

# Checks before a run: state, mass, and every derivative by finite differences.


AGREEMENT = 1e-5
"""Relative difference between a derivative and its differences that is taken for one."""
CLEAR = 1e-4
"""Differences over two steps that differ by less, relative to their size, agree."""
STEPS = (*(1e-3 * 100.0**-k for k in range(8)), 1e-1)
"""Steps of the differences, tried until they agree with the derivative: no unit is known."""
LATER = 0.382
"""Part of the span after which gaps that are equal at the start are compared again."""
TIMES = 9
"""So many times in the span show whether a gap without a rate moves."""


def check_start(
    system: MechanicalSystem, model: Model, span: tuple[float, float], q: Array, qdot: Array
) -> None:
    """Raise a ValueError that names what is wrong with a system at its start.

    Derivatives are compared with finite differences once per system: its functions do not change
    between runs, and the differences dominate the cost of a short run.

    Parameters
    ----------
    system : MechanicalSystem
        Its names and gaps.
    model : Model
        What is integrated.
    span : (float, float)
        Start and end.
    q, qdot : ndarray
        The state at the start, finite.
    """
    n, m = model.layout.n, model.layout.m
    row = model.evaluate(span[0], q, qdot)
    mass = row[: n * n].tobytes()
    span_before, mass_before = system._checked_start
    known = span_before == span or (system.derived and span_before is not None)
    known = known and not model.layout.k
    if known and mass == mass_before and not system._channels and _zivi.is_sound(row, n, m):
        return
    look, row = _Look(model), np.array(row)
    here = model.layout.read(row)
    if not np.isfinite(row).all():
        _check_finite(system, here)
    if mass != mass_before:
        check_mass(here.mass)
    if model.layout.k:
        _check_rows_at_start(system, look, span, q, qdot)
    if (here.gaps < 0.0).any():
        _check_open(system, here, span[0], q)
    if not here.gradients.any(axis=1).all():
        _check_gradients_are_not_zero(system, here)
    if system._channels:
        _check_channels(system, look, span, q, qdot)
    if span_before is None:
        _check_distinct(system, look, span, q, here)
    if not system.derived and span_before is None:
        _check_gradients(system, look, span[0], q, here)
        _check_curvatures(system, look, span, q)
    if not system.derived and span_before != span:
        _check_rates(system, look, span, q, here)
    system._checked_start = span, mass


def check_functions(system: MechanicalSystem, model: Model, q: Array) -> None:
    """Raise a ValueError where the derivatives of gaps, whatever their sign, are none.

    Parameters
    ----------
    system : MechanicalSystem
        Its names and gaps.
    model : Model
        The evaluated model.
    q : ndarray
        Coordinates.
    """
    if system.derived:
        return
    look = _Look(model)
    here = look(0.0, q, np.zeros_like(q))
    _check_finite(system, here)
    _check_gradients(system, look, 0.0, q, here)
    _check_curvatures(system, look, (0.0, 1.0), q)


def _check_open(system: MechanicalSystem, here: Evaluation, t: float, q: Array) -> None:
    # rounding of the coordinates, of cancelling terms of a gap, and of the time in its motion
    terms = np.maximum(1.0, np.abs(here.gradients).sum(axis=1))
    rounding = RESOLUTION * ((1.0 + float(np.max(np.abs(q)))) * terms + np.abs(t * here.rates))
    compliant = {system.gap_names[it[0]] for it in system._compliant()}
    for name, gap, least in zip(system.gap_names, here.gaps, -rounding, strict=True):
        if gap < least and name not in compliant:
            raise ValueError(f"gap {name!r} must be >= 0 at the start, got {gap:.6g}")


def _check_gradients_are_not_zero(system: MechanicalSystem, here: Evaluation) -> None:
    for name, gradient in zip(system.gap_names, here.gradients, strict=True):
        if not gradient.any():
            raise ValueError(f"gradient of gap {name!r} must not be zero at the start")


def _check_finite(system: MechanicalSystem, here: Evaluation) -> None:
    """Raise an error that names the values that are not finite."""
    for name in ("mass", "force"):
        if not np.all(np.isfinite(values := getattr(here, name))):
            raise ValueError(f"{name} must be finite at the start, got {values.tolist()}")
    for part, name in OF_GAPS.items():
        for gap, values in zip(system.gap_names, getattr(here, name), strict=True):
            if not np.all(np.isfinite(values)):
                told = f"{part} of gap {gap!r}" if part else f"gap {gap!r}"
                raise ValueError(f"{told} must be finite at the start, got {values.tolist()}")
    for part, name in OF_CHANNELS.items():
        for channel, values in zip(system._channels, getattr(here, name), strict=True):
            if not np.all(np.isfinite(values)):
                told = _part_of(channel, part)
                raise ValueError(f"{told} must be finite at the start, got {values.tolist()}")


def _part_of(channel: Channel, part: str) -> str:
    """Return the user's name of a part of a friction channel."""
    if channel.gap is None:
        return f"{part} of friction {channel.name!r}"
    return f"{AT_GAP.get(part, f'tangent_{part}')} of gap {channel.name!r}"


def _check_rows_at_start(
    system: MechanicalSystem, look: _Look, span: tuple[float, float], q: Array, qdot: Array
) -> None:
    """Reject equality rows with wrong derivatives, and a start that does not obey them."""
    here, names = look(span[0], q, qdot), system.equality_names
    for part, field in OF_EQUALITIES.items():
        for name, values in zip(names, getattr(here, field), strict=True):
            if not np.all(np.isfinite(values)):
                told = f"{part} of equality {name!r}" if part else f"equality {name!r}"
                raise ValueError(f"{told} must be finite at the start, got {values.tolist()}")
    if not system.derived and system._checked_start[0] != span:
        _check_derivatives_of_equalities(system, look, span, q)
    check_equalities(names, here, q, qdot)


def _check_derivatives_of_equalities(
    system: MechanicalSystem, look: _Look, span: tuple[float, float], q: Array
) -> None:
    names, (t, end), rest = system.equality_names, span, np.zeros_like(q)
    here, known = look(t, q, rest), np.zeros(len(names), dtype=bool)
    terms = np.abs(here.equalities) + np.abs(here.equality_gradients) @ np.abs(q)
    for j in range(len(q)):
        unit = np.eye(len(q))[j]
        _compare(
            [f"gradient (entry {j}) of equality {name!r}" for name in names],
            "value",
            lambda s, unit=unit: look(t, q + s * unit, rest).equalities,  # type: ignore[misc]
            (here.equality_gradients[:, j], known, terms),
            (float(q[j]), 1.0 + abs(float(q[j]))),
        )
    for i, row in enumerate(system.equalities):
        values = [look(at, q, rest).equalities[i] for at in np.linspace(t, end, TIMES)]
        if row.rate is None and np.ptp(values) > 1e-12 * np.max(np.abs(values)):
            raise ValueError(
                f"equality {names[i]!r} depends on time: give its rate, the derivative with "
                "respect to t"
            )
    parts = (here.equality_rates, known, terms)
    rates = [f"rate of equality {name!r}" for name in names]
    _compare(rates, "value", lambda s: look(t + s, q, rest).equalities, parts, (t, end - t))
    ours = np.array([row.curvature is None and row._is_flat() for row in system.equalities])
    _check_accelerations(
        ([f"curvature of equality {name!r}" for name in names], ours, "rate"),
        look,
        (span, q),
        lambda at: (at.equality_gradients, at.equality_rates, at.equality_curvatures),
    )


OF_EQUALITIES = {
    "": "equalities",
    "gradient": "equality_gradients",
    "curvature": "equality_curvatures",
    "rate": "equality_rates",
}
"""Parts of an equality row, and what an evaluation calls those of all."""

OF_CHANNELS = {
    "direction": "tangents",
    "curvature": "slip_curvatures",
    "velocity": "slip_rates",
    "limit": "limits",
    "static": "static_limits",
}
"""Parts of a channel of friction, and what an evaluation calls those of all."""
AT_GAP = {"direction": "tangent", "limit": "mu", "static": "mu_static"}
"""What those of a gap are called, if not ``tangent_`` and the part."""


OF_GAPS = {"": "gaps", "gradient": "gradients", "curvature": "curvatures", "rate": "rates"}
"""Parts of a gap, and what an evaluation calls those of all."""

RESOLUTION = 1e-14
"""What a gap may be below zero by rounding, relative to the coordinates."""


class _Look:
    """A model by its parts, copied."""

    def __init__(self, model: Model) -> None:
        self.model = model

    def __call__(self, t: float, q: Array, qdot: Array) -> Evaluation:
        return self.model.layout.read(self.model.evaluate(t, q, qdot))


def _probe(n: int) -> Array:
    """Return a velocity without symmetry."""
    probe: Array = np.cos(1.0 + 2.0 * np.arange(n))
    return probe


def _difference(
    function: Callable[[float], Array], step: float, terms: Array, place: float
) -> tuple[Array, Array]:
    """Difference at zero, of fourth order, and an estimate of its error.

    Parameters
    ----------
    function : callable
        What is differenced.
    step : float
        The longer one of two steps.
    terms : ndarray
        Size of the terms of the sum in the function, to which its rounding errors are relative.
    place : float
        Where zero is, relative to which steps are rounded.
    """

    def central(s: float) -> Array:
        change: Array = function(s) - function(-s)
        return change / (2 * s)

    wide: Array = central(step)
    narrow: Array = central(step / 2)
    best: Array = (4 * narrow - wide) / 3
    doubt: Array = 2 * np.abs(narrow - wide)
    return best, doubt + 8 * EPSILON * (terms + np.abs(best) * abs(place)) / step


EPSILON = float(np.finfo(float).eps)


def _compare(
    named: Sequence[str],
    whose: str,
    function: Callable[[float], Array],
    values: tuple[Array, NDArray[np.bool_], Array],
    at: tuple[float, float] = (0.0, 1.0),
) -> None:
    """Reject the first derivative that is not what the differences of a function say.

    Nothing is known of the lengths and times over which the function varies. A derivative is
    wrong if differences over two steps agree with each other and not with it, and no others do.

    Parameters
    ----------
    named : sequence of str
        The derivatives.
    whose : str
        What they are derivatives of.
    function : callable
        This as a function of a step.
    values : tuple of ndarray
        The derivatives; which of them are known to be right; the size of the terms of the function.
    at : (float, float)
        Where the function is differenced, and the unit of the steps.
    """
    (given, known, terms), (place, unit) = values, at
    right, wrong, seen = known.copy(), np.zeros(len(given), dtype=bool), given.copy()
    for number, step in enumerate(STEPS):
        if right.all():
            return
        found, doubt = _difference(function, step * unit, terms, place)
        size = np.maximum(np.abs(given), np.abs(found))
        clear = doubt <= CLEAR * size
        near = np.abs(given - found) <= AGREEMENT * size + doubt
        right |= (clear & near) | ((size <= doubt) & (number == 0))
        first = clear & ~near & ~wrong
        seen[first] = found[first]
        wrong |= first
    wrong &= ~right
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"{named[i]} is not the derivative of the {whose} at the start: "
            f"{given[i]:.9g} given, {seen[i]:.9g} by differences"
        )


def _of_gaps(system: MechanicalSystem, what: str) -> tuple[list[str], NDArray[np.bool_]]:
    """Return labels of the derivatives of gaps, and which gaps need no check."""
    # those of a table would be differenced across a knot
    ours = [
        isinstance(gap, LinearGap) and not isinstance(gap.motion, MovingWall) for gap in system.gaps
    ]
    named = [f"{what} of gap {name!r}" for name in system.gap_names]
    if what == "curvature":
        # its step fits lengths and times of order one
        for i, gap in enumerate(system.gaps):
            named[i] += " (differenced: give it)" if gap.curvature is None else ""
    return named, np.array(ours, dtype=bool)


def _check_gradients(
    system: MechanicalSystem, look: _Look, t: float, q: Array, here: Evaluation
) -> None:
    rest, terms = np.zeros_like(q), np.abs(here.gaps) + np.abs(here.gradients) @ np.abs(q)
    for j in range(len(q)):
        unit = np.eye(len(q))[j]
        named, ours = _of_gaps(system, f"gradient (entry {j})")
        _compare(
            named,
            "gap",
            lambda s, unit=unit: look(t, q + s * unit, rest).gaps,  # type: ignore[misc]
            (here.gradients[:, j], ours, terms),
            (float(q[j]), 1.0 + abs(float(q[j]))),
        )


def _check_rates(
    system: MechanicalSystem,
    look: _Look,
    span: tuple[float, float],
    q: Array,
    here: Evaluation,
) -> None:
    rest = np.zeros_like(q)
    for i, gap in enumerate(system.gaps):
        if gap.rate is not None:
            continue
        values = [look(t, q, rest).gaps[i] for t in np.linspace(*span, TIMES)]
        if np.ptp(values) > 1e-12 * np.max(np.abs(values)):
            raise ValueError(
                f"gap {system.gap_names[i]!r} depends on time: give its rate, the derivative "
                "with respect to t"
            )
    named, ours = _of_gaps(system, "rate")
    terms = np.abs(here.gaps) + np.abs(here.gradients) @ np.abs(q)
    at = (span[0], span[1] - span[0])
    parts = (here.rates, ours, terms)
    _compare(named, "gap", lambda s: look(span[0] + s, q, rest).gaps, parts, at)


def _check_curvatures(
    system: MechanicalSystem, look: _Look, span: tuple[float, float], q: Array
) -> None:
    _check_accelerations(
        (*_of_gaps(system, "curvature"), "gap"),
        look,
        (span, q),
        lambda at: (at.gradients, at.rates, at.curvatures),
    )


def _check_accelerations(
    of: tuple[Sequence[str], NDArray[np.bool_], str],
    look: _Look,
    place: tuple[tuple[float, float], Array],
    parts_of: Callable[[Evaluation], tuple[Array, Array, Array]],
) -> None:
    """Reject curvatures that are not what ``rows @ qdot + rates`` changes by without accelerations.

    At a velocity that makes both terms as large, and without one.
    """
    (named, ours, whose), ((t, end), q) = of, place
    if ours.all():
        return
    probe = _probe(len(q))
    rows, rates, _ = parts_of(look(t, q, probe))
    by_rates, by_rows = np.max(np.abs(rates)), np.max(np.abs(rows) @ np.abs(probe))
    velocities = [probe]
    if by_rates > 0.0:
        velocities = [probe * (by_rates / by_rows), np.zeros_like(q)]
    for velocity in velocities:
        fastest = float(np.max(np.abs(velocity)))

        def speed(s: float, velocity: Array = velocity) -> Array:
            rows, rates, _ = parts_of(look(t + s, q + s * velocity, velocity))
            speeds: Array = rows @ velocity + rates
            return speeds

        given = parts_of(look(t, q, velocity))[2]
        terms = np.abs(rows) @ np.abs(velocity) + np.abs(rates)
        far = float(np.max(np.abs(q), initial=0.0)) / fastest if fastest > 0.0 else 0.0
        longest = (1.0 + far * fastest) / fastest if fastest > 0.0 else np.inf
        at = (abs(t) + far, min(end - t, longest))
        _compare(named, whose, speed, (given, ours, terms), at)


def _check_distinct(
    system: MechanicalSystem,
    look: _Look,
    span: tuple[float, float],
    q: Array,
    here: Evaluation,
) -> None:
    """Reject a gap that is another one again: its contact force would not be determined.

    Gaps that are equal at the start differ where their walls move.
    """

    def twins(*places: Evaluation) -> tuple[str, str] | None:
        seen: list[tuple[str, Array]] = []
        for i, name in enumerate(system.gap_names):
            row = np.concatenate([np.append(at.gaps[i], at.gradients[i]) for at in places])
            row /= float(np.linalg.norm(here.gradients[i]))
            for other, known in seen:
                if np.max(np.abs(row - known)) <= 1e-12 * (1.0 + np.max(np.abs(row))):
                    return name, other
            seen.append((name, row))
        return None

    if twins(here) is None:  # a force that ends later is not evaluated there
        return
    t = span[0] + LATER * (span[1] - span[0])
    there = look(t, q + 1e-3 * (1.0 + np.abs(q)) * _probe(len(q)), np.zeros_like(q))
    if pair := twins(here, there):
        raise ValueError(f"gap {pair[0]!r} is redundant: it is gap {pair[1]!r} again")


def _check_channels(
    system: MechanicalSystem, look: _Look, span: tuple[float, float], q: Array, qdot: Array
) -> None:
    """Reject directions, limits and curvatures of dry friction that cannot be."""
    t = span[0]
    here = look(t, q, qdot)
    for c, channel in enumerate(system._channels):
        row = here.tangents[c]
        if not np.any(row):
            raise ValueError(f"{_part_of(channel, 'direction')} must not be zero at the start")
        if channel.gap is not None:
            _check_tangent(channel, here, row)
        limit = float(here.limits[c])
        if limit < 0.0:
            raise ValueError(f"{_part_of(channel, 'limit')} must be >= 0, got {limit:.6g}")
        slip = float(row @ qdot + here.slip_rates[c])
        stuck = look(t, q, qdot - row * slip / float(row @ row))
        limit, static = float(stuck.limits[c]), float(stuck.static_limits[c])
        if static < limit * (1.0 - RESOLUTION):
            raise ValueError(
                f"{_part_of(channel, 'static')} must be at least {_part_of(channel, 'limit')} at "
                f"slip speed 0, got {static:.6g} < {limit:.6g}"
            )
    _check_pairs(system, here)
    if not system.derived and system._channels:
        _check_slip_curvatures(system, look, span, q)


def _check_pairs(system: MechanicalSystem, here: Evaluation) -> None:
    """Reject two tangents of a gap that depend on each other or on its gradient."""
    for c, channel in enumerate(system._channels):
        if channel.row != 0 or channel.gap is None:
            continue
        rows = np.array([here.gradients[channel.gap], *here.tangents[c : c + 2]])
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        if np.linalg.svd(rows, compute_uv=False)[-1] < 1e-9:
            raise ValueError(
                f"tangent of gap {channel.name!r} must be two directions independent of each other "
                f"and of its gradient at the start, got {here.tangents[c : c + 2].tolist()}"
            )


def _check_tangent(channel: Channel, here: Evaluation, row: Array) -> None:
    """Reject a tangent along the normal: no mass would distinguish slip from penetration."""
    normal = here.gradients[channel.gap]
    if len(here.equality_gradients):
        free = _free_directions(here.equality_gradients)
        size = np.linalg.norm(normal), np.linalg.norm(row)
        normal, row = free @ normal, free @ row
        if np.linalg.norm(normal) < 1e-9 * size[0] or np.linalg.norm(row) < 1e-9 * size[1]:
            return  # the equality rows hold it
    if abs(row @ normal) >= (1.0 - 1e-12) * np.linalg.norm(row) * np.linalg.norm(normal):
        raise ValueError(
            f"tangent of gap {channel.name!r} must not be along its gradient at the start, got "
            f"{row.tolist()}; set mu=0 where one coordinate moves the point"
        )


def _free_directions(rows: Array) -> Array:
    """Return an orthonormal basis of the velocities that equality rows allow."""
    sizes = np.linalg.norm(rows, axis=1)
    _, values, right = np.linalg.svd(rows[sizes > 0.0] / sizes[sizes > 0.0, None])
    free: Array = right[int(np.sum(values > 1e-10)) :]
    return free


def _check_slip_curvatures(
    system: MechanicalSystem, look: _Look, span: tuple[float, float], q: Array
) -> None:
    named = [_part_of(channel, "curvature") for channel in system._channels]
    ours = np.array([_is_ours(slip) for slip in system._slips()], dtype=bool)
    _check_accelerations(
        (named, ours, "slip speed"),
        look,
        (span, q),
        lambda at: (at.tangents, at.slip_rates, at.slip_curvatures),
    )


def _is_ours(slip: Slip) -> bool:
    """Whether a direction is constant, and the other surface at rest or a wall of ours."""
    steady = isinstance(slip.rate, np.ndarray) and isinstance(slip.curvature, np.ndarray)
    return isinstance(slip.direction, np.ndarray) and (
        steady or isinstance(slip.motion, HarmonicWall)
    )


# States moved onto the equality rows of a system.


ITERATIONS = 50
"""Newton steps of a projection at most."""
NOTHING = 1e-12
"""A row whose gradient is below this part of the largest has none but rounding."""
DEPENDENT = 1e-10
"""A row of which the others leave less than this part of `D_aa` follows from them."""


def consistent(
    system: MechanicalSystem, q: ArrayLike, qdot: ArrayLike | None = None, t: float = 0.0
) -> tuple[Array, Array]:
    r"""Project a state onto the equality rows of a system.

    .. math::

        q \leftarrow q - M^{-1} G^T (G M^{-1} G^T)^+ \varphi, \qquad
        \dot q \leftarrow \dot q - M^{-1} G^T (G M^{-1} G^T)^+ (G \dot q + \varphi_t)

    Parameters
    ----------
    system : MechanicalSystem
        The system with its equality rows.
    q : array_like
        Coordinates, of shape (n,), near a configuration that obeys the rows.
    qdot : array_like, optional
        Velocities, of shape (n,). Default 0.
    t : float
        Time (s). Default 0.

    Returns
    -------
    (ndarray, ndarray)
        Coordinates and velocities, of shape (n,), that obey the rows to rounding. The velocities
        are the nearest in the metric of the masses, those after an impulse of the rows.

    Raises
    ------
    ValueError
        If the iteration finds no configuration: start it nearer, or check the rows.

    See Also
    --------
    zivi.Equality : a row.

    Notes
    -----
    Newton's method, at most 50 iterations; the velocities need one. Dependent rows are allowed.

    References
    ----------
    E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, chapter
    VII.

    Examples
    --------
    >>> circle = zivi.Equality(lambda t, q: q @ q - 1.0, lambda t, q: 2.0 * q, name="circle")
    >>> bead = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], equalities=[circle])
    >>> q, qdot = zivi.consistent(bead, [0.6, 0.81], [1.0, 0.0])
    >>> q.round(4), qdot.round(4)
    (array([0.5952, 0.8036]), array([ 0.6457, -0.4783]))
    """
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a mechanical system, got {type(system).__name__}")
    position = np.atleast_1d(real_array("q", q)).astype(float)
    velocity = np.zeros_like(position)
    if qdot is not None:
        velocity = np.atleast_1d(real_array("qdot", qdot)).astype(float)
    time = finite("t", t)
    if not np.isfinite(position).all() or not np.isfinite(velocity).all():
        raise ValueError("q and qdot must be finite")
    here = system.at(time, position, velocity)
    last = np.inf
    for _ in range(ITERATIONS):
        size = float(np.max(np.abs(here.equalities), initial=0.0))
        # as near as rounding lets it come
        if size == 0.0 or (size >= 0.5 * last and _obeys_rows(here, position)):
            break
        last = size
        # off the rows, rows that follow from others on them differ by the square of the distance
        apart = size / (1.0 + float(np.max(np.abs(position))))
        cut = min(max(DEPENDENT, 100.0 * apart**2), 1e-2)
        position = position - _pull(here, here.equalities, cut)
        here = system.at(time, position, velocity)
    else:
        _fail(system, here.equalities)
    if not _obeys_rows(here, position):
        _fail(system, here.equalities)
    for _ in range(2):
        left = here.equality_gradients @ velocity + here.equality_rates
        velocity = velocity - _pull(here, left)
    if not np.all(violations(here, position, velocity)[1] <= 1.0):
        _fail(system, here.equality_gradients @ velocity + here.equality_rates, "rates")
    return position, velocity


def _obeys_rows(here: Evaluation, q: Array) -> bool:
    return bool(np.all(violations(here, q, np.zeros_like(q))[0] <= 1.0))


def _pull(here: Evaluation, right: Array, cut: float = DEPENDENT) -> Array:
    """Return what the rows move by their values: rows that follow from others are left out."""
    gradients = here.equality_gradients
    moved = np.zeros(gradients.shape[1])
    if not len(gradients):
        return moved
    mobility = np.linalg.solve(here.mass, gradients.T)
    d = gradients @ mobility
    basis = _independent(d, cut)
    if not basis:
        return moved
    scale = 1.0 / np.sqrt(np.diag(d)[basis])
    scaled = scale[:, None] * d[np.ix_(basis, basis)] * scale
    moved += mobility[:, basis] @ (scale * np.linalg.solve(scaled, scale * right[basis]))
    return moved


def _independent(d: Array, cut: float) -> list[int]:
    """Choose rows from which the others follow, by a Cholesky factor with pivots."""
    diagonal = np.diag(d)
    acts = diagonal > NOTHING**2 * np.max(diagonal)
    left, factor = np.where(acts, 1.0, 0.0), np.zeros((len(d), 0))
    chosen: list[int] = []
    scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros(len(d)), where=acts)
    while len(chosen) < len(d) and np.max(left) >= cut:
        # of rows that are as independent the one with the largest gradient
        near = left >= 0.5 * np.max(left)
        pivot = int(np.argmax(np.where(near, diagonal, -1.0)))
        column = scale * d[:, pivot] * scale[pivot] - factor @ factor[pivot]
        column /= np.sqrt(left[pivot])
        factor, left = np.column_stack([factor, column]), left - column**2
        left[pivot] = 0.0
        chosen.append(pivot)
    return chosen


def _fail(system: MechanicalSystem, left: Array, what: str = "values") -> None:
    told = ", ".join(
        f"{name!r} {value:.6g}" for name, value in zip(system.equality_names, left, strict=True)
    )
    raise ValueError(
        f"q must be near a state that obeys all equality rows, got the {what} {told} after the "
        "projection; start nearer, or remove rows that contradict each other"
    )


# Gap coordinates of a mechanical system, and velocities that impacts do not change.


class GapCoordinates(NamedTuple):
    r"""A state of a mechanical system, split into gaps and velocities that impacts do not change.

    .. math::

        \dot q = M^{-1} N^T W^{-1} (\dot g - g_t) + T w, \qquad W = N M^{-1} N^T, \qquad
        Z = (T^T M T)^{-1} T^T M

    with :math:`N T = 0`, :math:`Z T = 1` and :math:`Z M^{-1} N^T = 0`: an impact on any gaps
    changes :math:`\dot g` but not :math:`w = Z \dot q`.

    Attributes
    ----------
    g, gdot : ndarray
        Gaps and their rates, shape (m,).
    D : ndarray
        The Delassus matrix W, shape (m, m): an impulse P changes the rates by ``D @ P``.
    N : ndarray
        Gradients of the gaps, shape (m, n).
    T : ndarray
        A basis of the velocities that keep all gaps, shape (n, n - m).
    Z : ndarray
        Shape (n - m, n).
    w : ndarray
        The velocities ``Z @ qdot``, shape (n - m,): in general not those of coordinates.
    c : ndarray
        Kinetic cosines of the gaps, ``D[i, j]/sqrt(D[i, i] D[j, j])``, shape (m, m): if nonzero, an
        impact on one gap changes the velocity of the other.
    """

    g: Array
    gdot: Array
    D: Array
    N: Array
    T: Array
    Z: Array
    w: Array
    c: Array


def gap_coordinates(
    system: MechanicalSystem, q: ArrayLike, qdot: ArrayLike, t: float = 0.0
) -> GapCoordinates:
    """Split a state of a mechanical system into gaps and velocities that impacts do not change.

    Parameters
    ----------
    system : MechanicalSystem
        The system; its gaps must be independent, ``m <= n``.
    q, qdot : array_like
        Coordinates and velocities, shape (n,).
    t : float
        Time.

    Returns
    -------
    GapCoordinates
        A named tuple ``g, gdot, D, N, T, Z, w, c``.

    Raises
    ------
    ValueError
        If the gaps are not independent at this state: `D` is singular.

    See Also
    --------
    zivi.GapTracker : uses these coordinates.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> split = zivi.mechanics.gap_coordinates(box, [0.0, 1.0], [3.0, -2.0])
    >>> split.gdot, abs(split.w)
    (array([-2.]), array([3.]))
    """
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a zivi.MechanicalSystem, got {type(system).__name__}")
    for name, it in (("q", q), ("qdot", qdot)):
        if not np.all(np.isfinite(real_array(name, it))):
            raise ValueError(f"{name} must be finite, got {it!r}")
    here = system.at(t, q, qdot)
    velocity = np.atleast_1d(np.asarray(qdot, dtype=np.float64))
    kinetics = GapKinetics.of(here, velocity)
    normals, m = here.gradients, len(here.gaps)
    basis = np.linalg.qr(normals.T, mode="complete")[0][:, m:]
    momenta = basis.T @ here.mass
    inverse = np.linalg.solve(momenta @ basis, momenta)
    cosines = kinetic_cosines(kinetics.D)
    np.fill_diagonal(cosines, 1.0)
    return GapCoordinates(
        here.gaps, kinetics.gdot, kinetics.D, normals, basis, inverse, inverse @ velocity, cosines
    )


REDUNDANT = 1e-10
"""Least eigenvalue of the matrix of cosines of independent gaps."""


def kinetic_cosines(D: Array) -> Array:
    """Return ``D_ij/sqrt(D_ii D_jj)`` of one Delassus matrix or of many, (..., m, m)."""
    size = np.sqrt(np.diagonal(D, axis1=-2, axis2=-1))
    return np.asarray(D / (size[..., :, None] * size[..., None, :]), dtype=np.float64)


def check_independent(D: Array) -> None:
    """Raise a ValueError if gaps are not independent, of one matrix D or of many, (..., m, m)."""
    single = D.shape[-1] == 1
    least = D if single else np.linalg.eigvalsh(kinetic_cosines(D))[..., 0]
    if not np.all(least > (0.0 if single else REDUNDANT)):
        raise ValueError("the gaps must be independent: N M^-1 N^T is singular here")


@dataclasses.dataclass(frozen=True, eq=False)
class GapKinetics:
    """Kinetics of gaps and controls at a state.

    Parameters
    ----------
    here : Evaluation
        The system.
    gdot : ndarray
        Rates of the gaps, shape (m,).
    mobility : ndarray
        ``M^-1 N^T``, shape (n, m).
    D : ndarray
        The Delassus matrix, shape (m, m).
    """

    here: Evaluation
    gdot: Array
    mobility: Array
    D: Array

    @classmethod
    def of(cls, here: Evaluation, qdot: Array) -> GapKinetics:
        """Compute them; a ValueError if the gaps are not independent."""
        normals = here.gradients
        mobility: Any = np.linalg.solve(here.mass, normals.T)
        D: Array = normals @ mobility
        D = 0.5 * (D + D.T)
        check_independent(D)
        return cls(here, normals @ qdot + here.rates, mobility, D)

    def without_gaps(self, vector: Any, gaps: Any = slice(None)) -> Array:
        """Remove the gap-changing part of a velocity vector by M-orthogonal projection."""
        normals, mobility = self.here.gradients[gaps], self.mobility[:, gaps]
        if not len(normals):
            return np.asarray(vector, dtype=np.float64)
        D = self.D[np.ix_(np.arange(len(self.D))[gaps], np.arange(len(self.D))[gaps])]
        left: Array = vector - mobility @ np.linalg.solve(D, normals @ vector)
        return left
