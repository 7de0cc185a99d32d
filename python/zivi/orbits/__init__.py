"""Periodic orbits of systems with impacts: their stability, their branches, what they attract."""

from zivi.orbits.branch import Branch, BranchEvent, continue_orbit
from zivi.orbits.orbit import PeriodicOrbit, periodic_orbit

__all__ = ["Branch", "BranchEvent", "PeriodicOrbit", "continue_orbit", "periodic_orbit"]
