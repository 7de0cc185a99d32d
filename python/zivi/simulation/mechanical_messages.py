"""What the end of a run of a mechanical system is called, with the names of its gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.status import Status
from zivi.system.friction import Channel
from zivi.system.mechanism import Model

__all__ = ["ending"]

TOUCHING = 1e-9
"""Gaps below this, relative to the coordinates, touch where a run ends."""

UNSOLVED = (Status.REDUNDANT_CONTACTS, Status.IMPACT_NOT_SOLVED, Status.CONTACT_NOT_SOLVED)

NOT_FINITE = (
    "The mass, the force, or a part of a gap is NaN or infinite; the trajectory ends at the last "
    "step before. Check them behind the last sample: system.at(t, q, qdot)."
)


PARADOXES = (
    Status.INCONSISTENT_CONTACT,
    Status.INDETERMINATE_CONTACT,
    Status.PAINLEVE_SINGULAR,
)


def ending(
    record: _zivi.MechanicalRecord,
    gaps: Sequence[str],
    model: Model,
    channels: Sequence[Channel] = (),
) -> str:
    """Give the message of a record; where contacts are not solved, with those that touch."""
    status = Status(record.status)
    if status is Status.FORCE_NOT_FINITE:
        return NOT_FINITE
    if status not in (*UNSOLVED, *PARADOXES) or not len(record.t):
        return record.message
    size = TOUCHING * (1.0 + float(np.max(np.abs(record.q[-1]))))
    touching = record.contacts[-1] | (record.gaps[-1] <= size)
    if status in PARADOXES:
        told = _paradox(record, model, channels, touching)
        return f"{record.message} At t = {record.t[-1]:.9g}: {told}."
    names = ", ".join(repr(name) for name, on in zip(gaps, touching, strict=True) if on)
    return f"{record.message} At t = {record.t[-1]:.9g} these gaps touch: {names}."


def _paradox(
    record: _zivi.MechanicalRecord,
    model: Model,
    channels: Sequence[Channel],
    touching: NDArray[np.bool_],
) -> str:
    r"""Tell of each sliding contact the numbers that decide, alone at its gap.

    .. math:: \ddot g = K \lambda + b, \qquad K = (N M^{-1} (N - \mu \sigma B)^T)
    """
    here = model.layout.read(model.evaluate(record.t[-1], record.q[-1], record.qdot[-1]))
    free = np.linalg.solve(here.mass, here.force)
    told = []
    for c, channel in enumerate(channels):
        i = channel.gap
        if i is None or not touching[i]:
            continue
        slip = float(here.tangents[c] @ record.qdot[-1] + here.slip_rates[c])
        edge = here.gradients[i] - here.limits[c] * np.sign(slip) * here.tangents[c]
        k = float(here.gradients[i] @ np.linalg.solve(here.mass, edge))
        b = float(here.gradients[i] @ free + here.curvatures[i])
        told.append(f"{channel.name!r} slides with {slip:.6g}, K = {k:.6g}, b = {b:.6g}")
    return "; ".join(told) or "no sliding contact touches"
