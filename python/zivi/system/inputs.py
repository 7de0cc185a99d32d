"""Forces of mechanical systems that take inputs from a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.functions import check_arguments
from zivi.system.model_parts import Compiled, Part, compiled_part
from zivi.system.table import Table

__all__ = ["DrivenForce", "driven"]

C_FORM = "void (double t, double *q, double *qdot, double *u, double *out)"


class DrivenForce(Compiled):
    """A compiled force that is called with the inputs of a table, too."""

    def __init__(self, address: int, owner: object, inputs: Table) -> None:
        # the same arguments as those of a part with data: addresses, of which one more is given
        super().__init__(address, 0, owner)
        self.inputs = inputs
        self._u = np.empty(inputs.width or 1)

    def fill(self, t: float, q: Array, qdot: Array, out: Array) -> None:
        """Evaluate into ``out``; all arrays are contiguous."""
        self.inputs._core.fill(t, self._u)
        u = self._u.ctypes.data
        self._call(t, q.ctypes.data, qdot.ctypes.data, u, out.ctypes.data)


def driven(force: Any, inputs: Any) -> Part:
    """Give a force ``F(t, q, qdot, u)`` with its inputs as one of (t, q, qdot)."""
    if not isinstance(inputs, Table):
        raise TypeError(f"inputs must be a zivi.Table, got {inputs!r}")
    compiled = compiled_part("force", force)
    if compiled is not None:
        low_level = isinstance(force, tuple)  # of SciPy: its last argument is its own data
        if compiled.data is None or low_level:
            raise TypeError(f"force with inputs, compiled, must have the signature {C_FORM}")
        return DrivenForce(compiled.address, force, inputs)
    if not callable(force):
        raise TypeError(
            f"force must be a function (t, q, qdot, u) of the inputs, or compiled {C_FORM}, "
            f"got {type(force).__name__}"
        )
    check_arguments("force", force, "t, q, qdot, u")
    core, size = inputs._core, inputs.width or 1

    def evaluated(t: float, q: Array, qdot: Array) -> Any:
        u = np.empty(size)
        core.fill(t, u)
        return force(t, q, qdot, u)

    return evaluated
