"""Derivatives of runs: sensitivities, the impact map."""

from zivi.base.former import of_zivi
from zivi.derivatives.impact_map import ImpactMap, ImpactReturn, impact_map
from zivi.derivatives.mechanical_sensitivity import MechanicalSensitivity
from zivi.derivatives.result import OrbitStatus, Sensitivity
from zivi.derivatives.sensitivity import sensitivity

__all__ = [
    "ImpactMap",
    "ImpactReturn",
    "MechanicalSensitivity",
    "OrbitStatus",
    "Sensitivity",
    "impact_map",
    "sensitivity",
]

of_zivi(globals())
