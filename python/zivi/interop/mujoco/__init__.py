"""Models of MuJoCo (MJCF, URDF) as systems; needs the extra ``mujoco``.

`tree` gives bodies and joints to a `zivi.Tree`, which needs MuJoCo no more; `system` has MuJoCo
compute what a tree has not.
"""

from zivi.interop.mujoco.read import read_mjcf, read_urdf, tree
from zivi.interop.mujoco.system import MujocoSystem, scalar_joints, system

__all__ = ["MujocoSystem", "read_mjcf", "read_urdf", "scalar_joints", "system", "tree"]
