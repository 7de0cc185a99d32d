"""What happened at the control updates of a loop: one count for every kind of loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from zivi.base.warnings import warn
from zivi.control.component import TickStatus

__all__ = ["NONE", "Updated", "Updates", "warn_of_batch", "with_updates"]

SHARE = 0.1
"""Share of the control updates above which rejections or saturations are warned of."""
NAMES = ("n_updates", "n_refused", "n_saturated", "n_unsolved", "n_lost")
"""What datasets call the counts."""
ADVICE = {
    "rejected": "the last control was held; controls must be finite, measurements within depth",
    "saturated": "the controller cannot do what it plans within its limits",
}


@dataclasses.dataclass(frozen=True)
class Updates:
    """Counts of the control updates of a closed loop.

    Parameters
    ----------
    total : int
        Control updates.
    rejected : int
        Those whose sample or control was rejected: the last control was held.
    saturated : int
        Those whose control was cut to its limits.
    unsolved : int
        Those for which the general solver found no signs.
    lost : int
        Those at which a contact opened that the controller held.

    Examples
    --------
    >>> plant = zivi.ImpactSystem(-9.81, e=0.5)
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5, u_limits=(-40, 40))
    >>> run = zivi.simulate_closed_loop(plant, tracker, (0, 2), (0.2, 0), y_ref0=(0.2, 0))
    >>> run.updates.total, run.updates.rejected
    (200, 0)
    """

    total: int = 0
    rejected: int = 0
    saturated: int = 0
    unsolved: int = 0
    lost: int = 0

    @classmethod
    def of_bits(cls, bits: NDArray[np.uint8]) -> Self:
        """Count the bits of `TickStatus` of all updates."""
        counted = (
            TickStatus.REFUSED,
            TickStatus.SATURATED,
            TickStatus.UNSOLVED,
            TickStatus.LATCH_LOST,
        )
        return cls(len(bits), *(int(np.count_nonzero(bits & int(it))) for it in counted))

    def attrs(self) -> dict[str, int]:
        """Return the counts by the names that datasets have."""
        return dict(zip(NAMES, dataclasses.astuple(self), strict=True))

    @classmethod
    def of_attrs(cls, attrs: Mapping[str, Any], bits: NDArray[np.uint8]) -> Self:
        """Return what `attrs` gave; of older datasets what the bits at the samples tell."""
        if NAMES[0] in attrs:
            return cls(*(int(attrs[name]) for name in NAMES))
        return cls.of_bits(bits[:-1])

    def __str__(self) -> str:
        """Say what failed, nothing if nothing did."""
        if not (self.rejected or self.saturated or self.unsolved or self.lost):
            return ""
        text = f"{self.rejected} of {self.total} control updates rejected, "
        text += f"{self.saturated} saturated"
        text += f", {self.unsolved} unsolved" if self.unsolved else ""
        return text + (f", {self.lost} with a lost contact" if self.lost else "")

    def added_to(self, message: str) -> str:
        """Return the message of a run with what failed."""
        return f"{message} {self}." if str(self) else message

    def warn(self, name: str) -> None:
        """Warn of a loop in which much failed."""
        for what, advice in ADVICE.items():
            count = getattr(self, what)
            if count > SHARE * self.total:
                text = f"{count} of {self.total} control updates of {name} were {what}: {advice}"
                warn(text)


NONE = Updates()


class Updated:
    """The counts of a loop by the names that batches have."""

    updates: Updates

    @property
    def n_updates(self) -> int:
        """Number of control updates."""
        return self.updates.total

    @property
    def n_refused(self) -> int:
        """Number of control updates that were rejected; the last control was held."""
        return self.updates.rejected

    @property
    def n_saturated(self) -> int:
        """Number of control updates whose control was cut to its limits."""
        return self.updates.saturated

    def _failed_text(self) -> str:
        """Say what failed behind a comma, nothing if nothing did."""
        return f", {self.updates}" if str(self.updates) else ""


def with_updates(state: dict[str, Any]) -> dict[str, Any]:
    """Give the state of a loop that an older version pickled its counts."""
    if "updates" in state:
        return state
    kept = {name: it for name, it in state.items() if name != "n_refused"}
    return kept | {"updates": Updates.of_bits(state["tick_status"][:-1])}


def batch_text(batch: Any) -> str:
    """Say what failed in the loops of a batch, nothing if nothing did."""
    names = ("n_updates", "n_refused", "n_saturated")
    total, refused, saturated = (int(np.sum(getattr(batch, name))) for name in names)
    return str(Updates(total, refused, saturated))


def warn_of_batch(batch: Any) -> None:
    """Warn of the loops of a batch in which much failed."""
    most = SHARE * batch.n_updates
    failed = int(np.count_nonzero((batch.n_refused > most) | (batch.n_saturated > most)))
    if failed:
        warn(
            f"more than {SHARE:.0%} of the control updates of {failed} of {len(batch)} loops were "
            "rejected or saturated: n_refused and n_saturated tell which"
        )
