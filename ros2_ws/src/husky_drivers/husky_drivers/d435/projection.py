"""The pinhole of a depth image: matrices of `sensor_msgs/CameraInfo`, and points in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from husky_drivers.d435.frames import DepthFrame, Intrinsics

OPTICAL_ROTATION = (-0.5, 0.5, -0.5, 0.5)
"""Optical axes (x right, y down, z along the view) to ROS axes (x forward, y left, z up),
quaternion (x, y, z, w): roll -pi/2, then yaw -pi/2 (REP-103)."""


def camera_matrix(intrinsics: Intrinsics) -> list[float]:
    """Return the 3 x 3 matrix `k`, row by row (9): it takes optical axes to pixels."""
    i = intrinsics
    return [i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0]


def projection_matrix(intrinsics: Intrinsics) -> list[float]:
    """Return the 3 x 4 matrix `p`, row by row (12): `k` beside zeros, as of a single camera."""
    i = intrinsics
    return [i.fx, 0.0, i.cx, 0.0, 0.0, i.fy, i.cy, 0.0, 0.0, 0.0, 1.0, 0.0]


class Deprojection:
    """Takes depth images of one pinhole to points.

    Attributes:
        intrinsics: of the images.
    """

    def __init__(self, intrinsics: Intrinsics):
        """Prepare the direction of each pixel."""
        self.intrinsics = intrinsics
        i = intrinsics
        rays = np.ones((i.height, i.width, 3), np.float32)
        rays[:, :, 0] = (np.arange(i.width) - i.cx) / i.fx
        rays[:, :, 1] = ((np.arange(i.height) - i.cy) / i.fy)[:, None]
        self._rays = rays.reshape(-1, 3)

    def points(self, frame: DepthFrame) -> NDArray[np.float32]:
        """Return the points of the pixels that have depth, in optical axes [m] (n, 3).

        They come row by row.
        """
        pixels = frame.depth.ravel()
        valid = np.flatnonzero(pixels)
        depth = pixels.take(valid).astype(np.float32) * np.float32(frame.depth_unit)
        # `take` needs a quarter of the time of an index or a mask.
        points: NDArray[np.float32] = self._rays.take(valid, axis=0)
        points *= depth[:, None]
        return points
