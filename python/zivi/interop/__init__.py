"""Impact systems, controllers and derivatives of runs in other libraries.

`zivi.interop.python_control` needs the extra ``control``, `zivi.interop.jax_function` the extra
``jax``; nothing here is imported with `zivi`.
"""

from zivi.interop.gradient import RunFunction, RunPoint, run_function
from zivi.interop.jax import jax_function
from zivi.interop.juggler import juggler
from zivi.interop.python_control import (
    controller_block,
    force_block,
    impact_plant,
    state_vector,
)

__all__ = [
    "RunFunction",
    "RunPoint",
    "controller_block",
    "force_block",
    "impact_plant",
    "jax_function",
    "juggler",
    "run_function",
    "state_vector",
]
