"""The D435's view of the world: rays through its pixels, and the image that it makes of them."""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_description.mujoco_look import VISUAL_GROUP
from husky_description.plain_mujoco import mujoco
from husky_description.sections import D435Section
from husky_drivers.d435.frames import DepthImage, Intrinsics
from husky_sim.devices.d435.errors import StereoErrors
from husky_sim.devices.d435.ray_casting import cast, geoms_of

CARRIER, LENS = "base", "d435"
"""Names of the body that carries the camera, and of the site at camera_link (x along the view)."""


def intrinsics_of(figures: D435Section) -> Intrinsics:
    """Return the pinhole of a camera's figures."""
    across, down = figures.field_of_view.tolist()
    return Intrinsics.of_field(figures.width, figures.height, (across, down))


class WorldSnapshot(NamedTuple):
    """State of a world at an instant, as far as it tells where every geom is.

    Attributes:
        qpos: positions of the joints, as MuJoCo's `qpos`.
        mocap_pos: positions of bodies that are moved by hand [m] (n, 3).
        mocap_quat: their orientations, (w, x, y, z) (n, 4).
    """

    qpos: Array
    mocap_pos: Array
    mocap_quat: Array

    @classmethod
    def of(cls, data: mujoco.MjData) -> WorldSnapshot:
        """Return a copy of a world's state."""
        return cls(data.qpos.copy(), data.mocap_pos.copy(), data.mocap_quat.copy())


class DepthRays:
    """Casts a ray through each pixel at what collides: ground, obstacles, the robot's own legs.

    Rays pass through visual geoms, and through the geoms of the base, which would be in front of
    the lens where the camera is inside of one. Model and data are its own, so that one thread may
    cast while another steps the world.

    Attributes:
        intrinsics: of the image.
    """

    def __init__(self, model: mujoco.MjModel, intrinsics: Intrinsics):
        """Prepare rays.

        Args:
            model: of the world, with the body `CARRIER` and the site `LENS`.
            intrinsics: of the image.

        Raises:
            ValueError: something has a shape that rays cannot meet.
        """
        self.intrinsics = intrinsics
        self._model = copy.copy(model)
        self._data = mujoco.MjData(self._model)
        lens = model.site(LENS).id
        seen = (model.geom_group != VISUAL_GROUP) & (model.geom_bodyid != model.body(CARRIER).id)
        geoms = geoms_of(self._model, self._data, seen)
        axes = self._data.site_xmat[lens].reshape(3, 3)
        self._scene = geoms, intrinsics.slopes, self._data.site_xpos[lens], axes
        # The kernel is compiled, or loaded, before an image waits for it.
        self.cast(WorldSnapshot.of(self._data))

    def cast(self, snapshot: WorldSnapshot) -> Array:
        """Return the true depth along the optical axis [m] (height, width), inf without a hit."""
        data, depth = self._data, np.empty((self.intrinsics.height, self.intrinsics.width))
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = snapshot
        mujoco.mj_kinematics(self._model, data)
        cast(*self._scene, depth)
        return depth


class D435Optics:
    """Makes depth images: image k depends on the seed, the scene and k alone.

    One thread may call `image` while another, which steps the world, calls `snapshot`.
    """

    def __init__(self, model: mujoco.MjModel, figures: D435Section, seed: int = 0):
        """Prepare to look at the world of a model; the seed is of the errors."""
        self._rays = DepthRays(model, intrinsics_of(figures))
        self._errors = StereoErrors(figures, self._rays.intrinsics, seed)

    def restart(self, seed: int) -> None:
        """The world starts again, with another seed."""
        self._errors.seed = seed

    def snapshot(self, data: mujoco.MjData) -> WorldSnapshot:
        """Return a copy of a world's state for `image`; takes some microseconds."""
        return WorldSnapshot.of(data)

    def image(self, number: int, snapshot: WorldSnapshot) -> DepthImage:
        """Return the image of a world's state [mm]; the longest part runs without Python's lock.

        Args:
            number: of the image, counted from the world's time 0.
            snapshot: of the world at the middle of the exposure.
        """
        return self._errors.apply(self._rays.cast(snapshot), number)
