"""Variational inequalities on a box, or mixed complementarity problems."""

from zivi.vi.jacobian import JacobianError, check_jacobian
from zivi.vi.solve import MAX_DENSE, natural_residual, solve_avi, solve_vi
from zivi.vi.types import VIOptions, VIProgress, VIResult, VIStatus

__all__ = [
    "MAX_DENSE",
    "JacobianError",
    "VIOptions",
    "VIProgress",
    "VIResult",
    "VIStatus",
    "check_jacobian",
    "natural_residual",
    "solve_avi",
    "solve_vi",
]
