"""What the end of a run of a mechanical system is called, with the names of its gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import zivi._zivi as _zivi
from zivi.base.status import Status

__all__ = ["ending"]

TOUCHING = 1e-9
"""Gaps below this, relative to the coordinates, touch where a run ends."""

UNSOLVED = (Status.REDUNDANT_CONTACTS, Status.IMPACT_NOT_SOLVED, Status.CONTACT_NOT_SOLVED)

NOT_FINITE = (
    "The mass, the force, or a part of a gap is NaN or infinite; the trajectory ends at the last "
    "step before. Check them behind the last sample: system.at(t, q, qdot)."
)


def ending(record: _zivi.MechanicalRecord, gaps: Sequence[str]) -> str:
    """Give the message of a record; where contacts are not solved, with the gaps that touch."""
    status = Status(record.status)
    if status is Status.FORCE_NOT_FINITE:
        return NOT_FINITE
    if status not in UNSOLVED or not len(record.t):
        return record.message
    size = TOUCHING * (1.0 + float(np.max(np.abs(record.q[-1]))))
    touching = record.contacts[-1] | (record.gaps[-1] <= size)
    names = ", ".join(repr(name) for name, on in zip(gaps, touching, strict=True) if on)
    return f"{record.message} At t = {record.t[-1]:.9g} these gaps touch: {names}."
