"""Impact systems and controllers in the simulation functions of other libraries.

`zivi.interop.python_control` needs the extra ``control``; nothing here is imported with `zivi`.
"""

from zivi.interop.python_control import (
    controller_block,
    force_block,
    impact_plant,
    state_vector,
)

__all__ = ["controller_block", "force_block", "impact_plant", "state_vector"]
