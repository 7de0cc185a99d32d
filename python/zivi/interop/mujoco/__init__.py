"""Models of MuJoCo (MJCF, URDF) as systems; needs the extra ``mujoco``.

`tree` gives bodies and joints to a `zivi.Tree`, which needs MuJoCo no more.
"""

from zivi.interop.mujoco.read import read_mjcf, read_urdf, tree

__all__ = ["read_mjcf", "read_urdf", "tree"]
