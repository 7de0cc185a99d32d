"""A constant force that takes a mass away from its wall for ever is told, not only obeyed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zivi.base.status import Status
from zivi.base.warnings import warn
from zivi.system.force import LinearForce
from zivi.system.gap import LinearGap

if TYPE_CHECKING:
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory
    from zivi.system.mass import ImpactSystem
    from zivi.system.mechanism import MechanicalSystem

__all__ = ["warn_of_flight", "warn_of_flight_from_gap"]


def warn_of_flight(system: ImpactSystem, sol: Trajectory) -> None:
    """Warn of a mass that flies from its wall at the end, and that nothing brings back."""
    pull = _outward(system)
    if pull > 0.0 and sol.status is Status.COMPLETED and sol.xdot[-1] > 0.0:
        warn(
            f"force takes the mass away from its wall for ever, a constant {pull:.6g} m/s^2; write "
            "a negative number, as in zivi.ImpactSystem(-9.81, e=0.5), or a positive gravity of a "
            "zivi.LinearForce, if it shall come back"
        )


def warn_of_flight_from_gap(system: MechanicalSystem, sol: MechanicalTrajectory) -> None:
    """Warn of the same where one gap at rest is all there is, and what moves it is constant."""
    own = vars(system)
    mass, force, gaps = own.get("_mass"), own.get("_force"), own.get("_gaps", ())
    if not (isinstance(mass, np.ndarray) and isinstance(force, np.ndarray) and len(gaps) == 1):
        return
    gap = gaps[0]
    still = isinstance(gap, LinearGap) and gap.motion is None
    if not still or system.channel_names or system._inputs is not None:
        return
    pull = gap.normal @ np.linalg.solve(mass, force)
    if pull > 0.0 and sol.status is Status.COMPLETED and gap.normal @ sol.qdot[-1] > 0.0:
        warn(
            f"force opens the gap {system.gap_names[0]} for ever, with a constant {pull:.6g}; "
            "write the opposite sign if it shall close again"
        )


def _outward(system: ImpactSystem) -> float:
    """Give a constant acceleration; 0 if it is not constant."""
    force = system.force
    if system.wall is not None:
        return 0.0
    if isinstance(force, int | float):
        return float(force)
    if type(force) is LinearForce and force.gravity < 0.0 and force.excitation is None:
        varies = force.stiffness or force.damping or force.amplitude
        return 0.0 if varies else -force.gravity
    return 0.0
