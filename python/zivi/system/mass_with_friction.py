"""A mass above a wall with dry friction, as a mechanical system of one coordinate."""

from __future__ import annotations

import ctypes
import numbers
from typing import Any

from zivi.base.functions import of_three
from zivi.system.force import force_spec
from zivi.system.gap import LinearGap
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.table import Table

__all__ = ["mechanism_of"]


def mechanism_of(system: ImpactSystem) -> MechanicalSystem:
    """Give a mass with friction as what a run integrates: x, its wall as a gap, and a joint."""
    assert system.friction is not None
    return MechanicalSystem(
        mass=1.0,
        force=_force(system.force),
        gaps=[LinearGap([1.0], name="wall")],
        e=system.e,
        coordinates=["x"],
        friction=[system.friction],
    )


def _force(force: Any) -> Any:
    """Give a force of a mass as that of a mechanical system."""
    if isinstance(force, numbers.Real):
        return [float(force)]
    if isinstance(getattr(force, "excitation", None), Table):
        raise NotImplementedError(
            "force must not be excited by a table where there is friction: make a "
            "zivi.MechanicalSystem with inputs"
        )
    spec = force_spec(force)
    if (address := spec.address) is None:
        function = of_three("force", force, more_than_y=False)
    elif "void" in str(getattr(force, "signature", "")):
        raise NotImplementedError(
            "force must not have user_data where there is friction: make a zivi.MechanicalSystem"
        )
    else:
        function = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 3)(address)

    def along(t: float, q: Any, qdot: Any) -> float:
        _ = spec  # which holds compiled code
        return function(t, float(q[0]), float(qdot[0]))  # type: ignore[no-any-return]

    return along
