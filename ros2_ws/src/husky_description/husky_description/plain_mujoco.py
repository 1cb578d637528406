"""MuJoCo without OpenGL.

At its import MuJoCo loads the OpenGL that MUJOCO_GL names, and fails where there is none. All
import MuJoCo from here; the one module that draws, `husky_experiments.figures.offscreen`, loads
OpenGL itself.
"""

import os

_wanted = os.environ.get("MUJOCO_GL")
os.environ["MUJOCO_GL"] = "disable"
try:
    import mujoco
finally:
    os.environ.pop("MUJOCO_GL")
    if _wanted is not None:
        os.environ["MUJOCO_GL"] = _wanted

__all__ = ["mujoco"]
