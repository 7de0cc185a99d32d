"""Variational inequalities on a box, or mixed complementarity problems."""

from zivi.base.check import MAX_DENSE
from zivi.base.former import of_zivi
from zivi.vi.complementarity import Equilibrium, bimatrix, solve_lcp, solve_ncp
from zivi.vi.derivatives import VIDerivative, solution_derivative
from zivi.vi.jacobian import JacobianError, check_jacobian
from zivi.vi.solve import natural_residual, solve_avi, solve_vi
from zivi.vi.types import VIOptions, VIProgress, VIResult, VIStatus

__all__ = [
    "MAX_DENSE",
    "Equilibrium",
    "JacobianError",
    "VIDerivative",
    "VIOptions",
    "VIProgress",
    "VIResult",
    "VIStatus",
    "bimatrix",
    "check_jacobian",
    "natural_residual",
    "solution_derivative",
    "solve_avi",
    "solve_lcp",
    "solve_ncp",
    "solve_vi",
]

of_zivi(globals())
