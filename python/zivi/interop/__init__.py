"""Impact systems, controllers, derivatives of runs and of solutions of VIs in other libraries.

`zivi.interop.python_control` needs the extra ``control``, `zivi.interop.jax_function` the extra
``jax``; nothing here is imported with `zivi`.
"""

from zivi.base.habits import hint_calls
from zivi.interop.gradient import (
    ControlledFunction,
    RunFunction,
    RunPoint,
    SolutionFunction,
    SolutionPoint,
    controlled_function,
    run_function,
    solution_function,
)
from zivi.interop.jax import jax_function
from zivi.interop.juggler import juggler
from zivi.interop.python_control import (
    controller_block,
    force_block,
    impact_plant,
    state_vector,
)

__all__ = [
    "ControlledFunction",
    "RunFunction",
    "RunPoint",
    "SolutionFunction",
    "SolutionPoint",
    "controlled_function",
    "controller_block",
    "force_block",
    "impact_plant",
    "jax_function",
    "juggler",
    "run_function",
    "solution_function",
    "state_vector",
]

hint_calls(__name__)
