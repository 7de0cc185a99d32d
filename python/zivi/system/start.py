"""What is checked once, before a run: state, mass, and every derivative by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zivi.base.check import Array
from zivi.system.layout import Evaluation
from zivi.system.mechanism import MechanicalSystem, Model, check_mass
from zivi.system.table import Table

__all__ = ["check_start"]

AGREEMENT = 1e-5
"""Relative difference between a derivative and its differences that is taken for one."""
TIMES = 9
"""So many times in the span show whether a gap without a rate moves."""


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
    look = _Look(model)
    here = look(span[0], q, qdot)
    _check_finite(system, here)
    check_mass(here.mass)
    for name, gap in zip(system.gap_names, here.gaps, strict=True):
        if gap < -RESOLUTION * (1.0 + float(np.max(np.abs(q)))):
            raise ValueError(f"gap {name!r} must be >= 0 at the start, got {gap:.6g}")
    _check_distinct(system, look, span[0], q, here)
    if system.derived:
        return
    _check_gradients(system, look, span[0], q, here)
    _check_rates(system, look, span, q, here)
    _check_curvatures(system, look, span[0], q)


def _check_finite(system: MechanicalSystem, here: Evaluation) -> None:
    for name in ("mass", "force"):
        if not np.all(np.isfinite(values := getattr(here, name))):
            raise ValueError(f"{name} must be finite at the start, got {values.tolist()}")
    for part, name in OF_GAPS.items():
        for gap, values in zip(system.gap_names, getattr(here, name), strict=True):
            if not np.all(np.isfinite(values)):
                told = f"{part} of gap {gap!r}" if part else f"gap {gap!r}"
                raise ValueError(f"{told} must be finite at the start, got {values.tolist()}")


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
    tables = [isinstance(getattr(gap, "motion", None), Table) for gap in system.gaps]
    off = np.where(tables, 0.0, np.abs(given - found))
    wrong = off > AGREEMENT * np.maximum(scale, np.abs(found)) + 2 * doubt
    if np.any(wrong):
        i = int(np.argmax(wrong))
        raise ValueError(
            f"{what} of gap {system.gap_names[i]!r} is not the derivative of the gap at the start: "
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
    probe = _probe(len(q))
    given = look(t, q, probe)

    def speed(s: float) -> Array:
        there = look(t + s, q + s * probe, probe)
        rates: Array = there.gradients @ probe + there.rates
        return rates

    found, doubt = _difference(speed, 1e-3)
    size = np.abs(given.gradients) @ np.abs(probe) + np.abs(given.rates)
    _compare(system, "curvature", given.curvatures, found, doubt, size)


def _check_distinct(
    system: MechanicalSystem, look: _Look, t: float, q: Array, here: Evaluation
) -> None:
    """Refuse a gap that is another one again: its contact force would not be determined."""
    there = look(t, q + 1e-3 * _probe(len(q)), np.zeros_like(q))
    seen: list[tuple[str, Array]] = []
    for i, name in enumerate(system.gap_names):
        size = float(np.linalg.norm(here.gradients[i]))
        if size == 0.0:
            raise ValueError(f"gradient of gap {name!r} must not be zero at the start")
        row = np.concatenate([[here.gaps[i], there.gaps[i]], here.gradients[i], there.gradients[i]])
        row /= size
        for other, known in seen:
            if np.max(np.abs(row - known)) <= 1e-12 * (1.0 + np.max(np.abs(row))):
                raise ValueError(f"gap {name!r} is redundant: it is gap {other!r} again")
        seen.append((name, row))
