"""The motion between the steps of a method of first order."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.simulation.friction_result import FrictionSamples

__all__ = ["LinearMotion"]


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMotion:
    """State and gaps linear between steps; what is held, of the step that contains the time.

    Parameters
    ----------
    t : ndarray
        Times of the steps, shape (k,).
    q, qdot, gaps, gap_rates, reactions : ndarray
        Their values there, shapes (k, n) and (k, m).
    contacts : ndarray of bool
        Which gaps are pressed in the step that ends there, shape (k, m).
    friction : FrictionSamples or None
        What friction does there.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    gap_rates: Array
    reactions: Array
    contacts: NDArray[np.bool_]
    friction: FrictionSamples | None = None

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last step."""
        return float(self.t[0]), float(self.t[-1])

    def at(self, times: Array) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """Give ``(q, qdot, gaps, gap_rates, contacts)`` at `times`."""
        sampled = (self.q, self.qdot, self.gaps, self.gap_rates)
        q, qdot, gaps, rates = (self._between(times, values) for values in sampled)
        return q, qdot, gaps, rates, self.contacts[self._step(times)]

    def reactions_at(self, times: Array) -> Array:
        """Give the reactions of the steps that contain `times`."""
        return self.reactions[self._step(times)]

    def friction_at(self, times: Array) -> FrictionSamples | None:
        """Give what friction does: what is integrated between the steps, the rest of the step."""
        if self.friction is None:
            return None
        step, given = self._step(times), self.friction
        return dataclasses.replace(
            given,
            slips=self._between(times, given.slips),
            slip_distances=self._between(times, given.slip_distances),
            dissipated=np.interp(times, self.t, given.dissipated),
            friction_forces=given.friction_forces[step],
            modes=given.modes[step],
        )

    def _between(self, times: Array, values: Array) -> Array:
        columns = [np.interp(times, self.t, column) for column in values.T]
        return np.array(columns).T.reshape(len(times), values.shape[1])

    def _step(self, times: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.t, times), 0, len(self.t) - 1)
