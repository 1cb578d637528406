"""MuJoCo pictures without a window: finds an OpenGL library, draws into memory."""

from __future__ import annotations

import ctypes.util
import importlib
import os
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.plain_mujoco import mujoco

Image = NDArray[np.uint8]
"""Rows of RGB pixels, (height, width, 3)."""

_LIBRARIES = {"egl": (("EGL",), ("OpenGL", "GL")), "osmesa": (("OSMesa",),)}
"""MuJoCo's name of a backend, best first, and the libraries that it loads: one of each group."""
_PACKAGES = "libegl1, libopengl0 and libgl1-mesa-dri, or libosmesa6"
"""Of Debian and Ubuntu: EGL, or OSMesa. tests/bare/test_bare_machine.py tries them."""
_OFF = ("disable", "disabled", "off", "false", "0")
"""MuJoCo's words for no OpenGL."""


class NoRenderingError(RuntimeError):
    """There is no way to draw on this machine; the message says what to install."""


def find_backend() -> str:
    """Return the name of an OpenGL backend that needs no display.

    MUJOCO_GL decides where it is set to one of them, otherwise the libraries found.

    Raises:
        NoRenderingError: there is none, or MUJOCO_GL forbids it.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        raise NoRenderingError(f"MUJOCO_GL is {wanted}")
    names = [wanted] if wanted in _LIBRARIES else list(_LIBRARIES)
    for name in names:
        groups = _LIBRARIES[name]
        if all(any(ctypes.util.find_library(library) for library in group) for group in groups):
            return name
    raise NoRenderingError(
        f"no OpenGL library for {' or '.join(names)}; install the packages {_PACKAGES}"
    )


class Canvas:
    """Draws states of a model from a camera into memory; close it, or use it in a `with`.

    Attributes:
        camera: where it looks from.
        scene: what was put together last.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int):
        """Open an off-screen OpenGL context.

        Args:
            model: to draw; its off-screen size becomes that of the picture.
            width: of the picture [pixels].
            height: of the picture [pixels].

        Raises:
            NoRenderingError: no library, or it cannot be used.
        """
        backend = find_backend()
        self._model = model
        self._context: Any = None
        # The buffer is made in the size that the model asks for.
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        try:
            module = importlib.import_module(f"mujoco.{backend}")
            self._context = module.GLContext(width, height)
            self._context.make_current()
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # PyOpenGL and drivers raise many kinds
            reason = re.split(r"\. |\n", str(error))[0] or type(error).__name__
            raise NoRenderingError(
                f"OpenGL by {backend} fails ({reason}); install the packages {_PACKAGES}"
            ) from error
        self.camera = mujoco.MjvCamera()
        self.scene = mujoco.MjvScene(model, maxgeom=2000)
        self._options = mujoco.MjvOption()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        self._view = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.zeros((height, width, 3), np.uint8)

    def draw(
        self, data: mujoco.MjData, decorate: Callable[[mujoco.MjvScene], None] | None = None
    ) -> Image:
        """Return a picture of a state.

        Args:
            data: the state, after `mj_kinematics` and `mj_camlight` at least.
            decorate: adds to the scene before it is drawn.
        """
        mujoco.mjv_updateScene(
            self._model,
            data,
            self._options,
            None,
            self.camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self.scene,
        )
        if decorate is not None:
            decorate(self.scene)
        mujoco.mjr_render(self._view, self.scene, self._renderer)
        mujoco.mjr_readPixels(self._pixels, None, self._view, self._renderer)
        return np.flipud(self._pixels).copy()

    def close(self) -> None:
        """Give the context back."""
        if self._context is not None:
            self._renderer.free()
            self._context.free()
            self._context = None

    def __enter__(self) -> Canvas:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close."""
        self.close()


def add_arrow(
    scene: mujoco.MjvScene,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    width: float,
    colour: tuple[float, float, float, float],
) -> None:
    """Put an arrow into a scene, if there is room for it.

    Args:
        scene: that is being put together.
        start: in world [m].
        end: in world [m].
        width: of the shaft [m].
        colour: red, green, blue, opacity, 0 to 1.
    """
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_ARROW,
        np.zeros(3),
        np.zeros(3),
        np.eye(3).ravel(),
        np.array(colour, np.float32),
    )
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, width, start, end)
    scene.ngeom += 1
