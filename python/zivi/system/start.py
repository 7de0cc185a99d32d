"""What is checked once, before a run: state, mass, and every derivative by differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.system.friction import Channel
from zivi.system.layout import Evaluation
from zivi.system.mechanism import MechanicalSystem, Model, check_mass
from zivi.system.table import Table

__all__ = ["check_functions", "check_start"]

AGREEMENT = 1e-5
"""Relative difference between a derivative and its differences that is taken for one."""
TIMES = 9
"""So many times in the span show whether a gap without a rate moves."""

CHECKED: WeakKeyDictionary[MechanicalSystem, tuple[tuple[float, float], bytes]] = (
    WeakKeyDictionary()
)
"""Systems whose derivatives were compared with differences, span and mass of their last start.

Once a system: what its functions compute does not change from run to run, and the differences are
most of what a short run costs.
"""


def check_start(
    system: MechanicalSystem, model: Model, span: tuple[float, float], q: Array, qdot: Array
) -> None:
    """Raise a ValueError that names what is wrong with a system at its start.

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
    span_before, mass_before = CHECKED.get(system, (None, b""))
    known = span_before == span or (system.derived and span_before is not None)
    if known and mass == mass_before and not system._channels and _zivi.is_sound(row, n, m):
        return
    look, row = _Look(model), np.array(row)
    here = model.layout.read(row)
    if not np.isfinite(row).all():
        _check_finite(system, here)
    if mass != mass_before:
        check_mass(here.mass)
    if (here.gaps < 0.0).any():
        _check_open(system, here, q)
    if not here.gradients.any(axis=1).all():
        _check_gradients_are_not_zero(system, here)
    if system._channels:
        _check_friction(system, look, span[0], q, qdot)
    if span_before is None:
        _check_distinct(system, look, span[0], q, here)
    if not system.derived and span_before is None:
        _check_gradients(system, look, span[0], q, here)
        _check_curvatures(system, look, span[0], q)
    if not system.derived and span_before != span:
        _check_rates(system, look, span, q, here)
    CHECKED[system] = span, mass


def check_functions(system: MechanicalSystem, model: Model, q: Array) -> None:
    """Raise a ValueError where the derivatives of gaps, whatever their sign, are none.

    Parameters
    ----------
    system : MechanicalSystem
        Its names and gaps.
    model : Model
        The same as it is evaluated.
    q : ndarray
        Coordinates.
    """
    if system.derived:
        return
    look = _Look(model)
    here = look(0.0, q, np.zeros_like(q))
    _check_finite(system, here)
    _check_gradients(system, look, 0.0, q, here)
    _check_curvatures(system, look, 0.0, q)


def _check_open(system: MechanicalSystem, here: Evaluation, q: Array) -> None:
    rounding = RESOLUTION * (1.0 + float(np.max(np.abs(q))))
    for name, gap in zip(system.gap_names, here.gaps, strict=True):
        if gap < -rounding:
            raise ValueError(f"gap {name!r} must be >= 0 at the start, got {gap:.6g}")


def _check_gradients_are_not_zero(system: MechanicalSystem, here: Evaluation) -> None:
    for name, gradient in zip(system.gap_names, here.gradients, strict=True):
        if not gradient.any():
            raise ValueError(f"gradient of gap {name!r} must not be zero at the start")


def _check_finite(system: MechanicalSystem, here: Evaluation) -> None:
    """Name what is not finite."""
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
    """Name a part of a channel of friction as its user called it."""
    if channel.gap is None:
        return f"{part} of friction {channel.name!r}"
    return f"{AT_GAP.get(part, f'tangent_{part}')} of gap {channel.name!r}"


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
    """Give a velocity without symmetry."""
    probe: Array = np.cos(1.0 + 2.0 * np.arange(n))
    return probe


def _difference(function: Callable[[float], Array], step: float) -> tuple[Array, Array]:
    """Difference at zero, of fourth order, and an estimate of its error."""

    def central(s: float) -> Array:
        change: Array = function(s) - function(-s)
        return change / (2 * s)

    wide: Array = central(step)
    narrow: Array = central(step / 2)
    best: Array = (4 * narrow - wide) / 3
    doubt: Array = np.abs(narrow - wide)
    return best, doubt


def _compare(
    system: MechanicalSystem, what: str, given: Array, found: Array, doubt: Array, scale: Array
) -> None:
    """Refuse the first gap whose derivative is not what the differences say."""
    # those of a table are of the same polynomials, and a difference may go across a knot
    given = given.copy()
    for i, gap in enumerate(system.gaps):
        if isinstance(getattr(gap, "motion", None), Table):
            given[i] = found[i]
    named = [f"{what} of gap {name!r}" for name in system.gap_names]
    _compare_named(named, "gap", (given, found, doubt, scale))


def _compare_named(
    named: Sequence[str], whose: str, values: tuple[Array, Array, Array, Array]
) -> None:
    given, found, doubt, scale = values
    off = np.abs(given - found)
    wrong = off > AGREEMENT * np.maximum(scale, np.abs(found)) + 2 * doubt
    if np.any(wrong):
        i = int(np.argmax(wrong))
        raise ValueError(
            f"{named[i]} is not the derivative of the {whose} at the start: "
            f"{given[i]:.9g} given, {found[i]:.9g} by differences"
        )


def _check_gradients(
    system: MechanicalSystem, look: _Look, t: float, q: Array, here: Evaluation
) -> None:
    rest, scale = np.zeros_like(q), np.max(np.abs(here.gradients), axis=1, initial=0.0)
    for j in range(len(q)):
        unit = np.eye(len(q))[j]
        found, doubt = _difference(
            lambda s, unit=unit: look(t, q + s * unit, rest).gaps,  # type: ignore[misc]
            1e-3 * (1.0 + abs(q[j])),
        )
        _compare(system, f"gradient (entry {j})", here.gradients[:, j], found, doubt, scale)


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
        if np.ptp(values) > 1e-12 * (1.0 + np.max(np.abs(values))):
            raise ValueError(
                f"gap {system.gap_names[i]!r} depends on time: give its rate, the derivative by t"
            )
    step = 1e-3 * min(1.0, span[1] - span[0])
    found, doubt = _difference(lambda s: look(span[0] + s, q, rest).gaps, step)
    _compare(system, "rate", here.rates, found, doubt, np.abs(here.gaps))


def _check_curvatures(system: MechanicalSystem, look: _Look, t: float, q: Array) -> None:
    given, found = _accelerations(look, t, q, lambda at: (at.gradients, at.rates))
    _compare(system, "curvature", given.curvatures, *found)


def _accelerations(
    look: _Look, t: float, q: Array, rows_of: Callable[[Evaluation], tuple[Array, Array]]
) -> tuple[Evaluation, tuple[Array, Array, Array]]:
    """Give the evaluation at a velocity, and how fast ``rows @ qdot + rates`` changes with it.

    By differences; with their doubt and the size of what is added up.
    """
    probe = _probe(len(q))
    given = look(t, q, probe)

    def speed(s: float) -> Array:
        rows, rates = rows_of(look(t + s, q + s * probe, probe))
        speeds: Array = rows @ probe + rates
        return speeds

    rows, rates = rows_of(given)
    size = np.abs(rows) @ np.abs(probe) + np.abs(rates)
    return given, (*_difference(speed, 1e-3), size)


def _check_distinct(
    system: MechanicalSystem, look: _Look, t: float, q: Array, here: Evaluation
) -> None:
    """Refuse a gap that is another one again: its contact force would not be determined."""
    there = look(t, q + 1e-3 * _probe(len(q)), np.zeros_like(q))
    seen: list[tuple[str, Array]] = []
    for i, name in enumerate(system.gap_names):
        size = float(np.linalg.norm(here.gradients[i]))
        row = np.concatenate([[here.gaps[i], there.gaps[i]], here.gradients[i], there.gradients[i]])
        row /= size
        for other, known in seen:
            if np.max(np.abs(row - known)) <= 1e-12 * (1.0 + np.max(np.abs(row))):
                raise ValueError(f"gap {name!r} is redundant: it is gap {other!r} again")
        seen.append((name, row))


def _check_friction(system: MechanicalSystem, look: _Look, t: float, q: Array, qdot: Array) -> None:
    """Refuse directions, limits and curvatures of dry friction that cannot be."""
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
    if not system.derived and system._channels:
        _check_slip_curvatures(system, look, t, q)


def _check_tangent(channel: Channel, here: Evaluation, row: Array) -> None:
    """Refuse a tangent along the normal: no mass would distinguish slip from penetration."""
    normal = here.gradients[channel.gap]
    if abs(row @ normal) >= (1.0 - 1e-12) * np.linalg.norm(row) * np.linalg.norm(normal):
        raise ValueError(
            f"tangent of gap {channel.name!r} must not be along its gradient at the start, got "
            f"{row.tolist()}"
        )


def _check_slip_curvatures(system: MechanicalSystem, look: _Look, t: float, q: Array) -> None:
    given, found = _accelerations(look, t, q, lambda at: (at.tangents, at.slip_rates))
    named = [_part_of(channel, "curvature") for channel in system._channels]
    _compare_named(named, "slip speed", (given.slip_curvatures, *found))
