"""Impact laws: the speed after an impact from the speed before it."""

from zivi.system.impact_law.laws import (
    ImpactLaw,
    NewtonImpact,
    SpeedDependentImpact,
    law_parameters,
)
from zivi.system.impact_law.restitution import Restitution, RestitutionTable
from zivi.system.impact_law.restitutions import (
    LAWS,
    GivenRestitutions,
    Restitutions,
    core_of,
    law_of,
    laws_of,
    restitutions,
    written,
)

__all__ = [
    "LAWS",
    "GivenRestitutions",
    "ImpactLaw",
    "NewtonImpact",
    "Restitution",
    "RestitutionTable",
    "Restitutions",
    "SpeedDependentImpact",
    "core_of",
    "law_of",
    "law_parameters",
    "laws_of",
    "restitutions",
    "written",
]
