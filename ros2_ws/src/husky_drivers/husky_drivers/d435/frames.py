"""Depth frames of the RealSense D435, as librealsense hands them out, and their pinhole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array

DepthImage = NDArray[np.uint16]
"""Depth along the optical axis in units of the frame's `depth_unit`, 0 where there is none;
shape (height, width), row 0 at the top, column 0 on the left as the camera sees it."""


OPTICAL_ROTATION = (-0.5, 0.5, -0.5, 0.5)
"""Optical axes (x right, y down, z along the view) to ROS axes (x forward, y left, z up),
quaternion (x, y, z, w): roll -pi/2, then yaw -pi/2 (REP-103)."""


class Intrinsics(NamedTuple):
    """Pinhole without distortion, as depth streams are rectified (librealsense's `rs2_intrinsics`).

    Pixel (u, v) sees along ((u - cx) / fx, (v - cy) / fy, 1) in optical axes: x to the right,
    y down, z along the view (REP-103). Pixel (0, 0) has its centre at u = v = 0.

    Attributes:
        width, height: of the image [pixels].
        fx, fy: focal lengths [pixels].
        cx, cy: principal point [pixels].
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of_field(cls, width: int, height: int, field: tuple[float, float]) -> Intrinsics:
        """Return those of a field of view, horizontal and vertical [rad], axis in the middle."""
        fx = width / 2.0 / math.tan(field[0] / 2.0)
        fy = height / 2.0 / math.tan(field[1] / 2.0)
        return cls(width, height, fx, fy, (width - 1) / 2.0, (height - 1) / 2.0)

    @property
    def slopes(self) -> tuple[Array, Array]:
        """Slopes of the rays to the right, of each column, and downwards, of each row."""
        right: Array = (np.arange(float(self.width)) - self.cx) / self.fx
        below: Array = (np.arange(float(self.height)) - self.cy) / self.fy
        return right, below

    @property
    def camera_matrix(self) -> list[float]:
        """Matrix `k` of `sensor_msgs/CameraInfo`, 3 x 3, row by row (9): optical axes to pixels."""
        return [self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0]

    @property
    def projection_matrix(self) -> list[float]:
        """Matrix `p`, 3 x 4, row by row (12): `k` beside zeros, as of a single camera."""
        return [self.fx, 0.0, self.cx, 0.0, 0.0, self.fy, self.cy, 0.0, 0.0, 0.0, 1.0, 0.0]


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """One frame of the depth stream.

    Attributes:
        number: counts the frames of the stream.
        time_ms: the camera's time in the middle of the exposure [ms].
        intrinsics: of the image.
        depth_unit: metres per unit of `depth`.
        depth: see `DepthImage`.
    """

    number: int
    time_ms: float
    intrinsics: Intrinsics
    depth_unit: float
    depth: DepthImage

    @property
    def time_ns(self) -> int:
        """The camera's time of the image [ns]."""
        return round(self.time_ms * 1e6)

    def millimetres(self) -> DepthImage:
        """Return the depth in millimetres, the unit of `16UC1` (REP-118); 0 where there is none.

        Depth that does not fit into 16 bits is none.
        """
        if math.isclose(self.depth_unit, 1e-3, rel_tol=1e-6):  # A float32 on any wire.
            return self.depth
        scaled = np.rint(self.depth * (1e3 * self.depth_unit))
        return np.where(scaled <= 65535.0, scaled, 0.0).astype(np.uint16)


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
        right, below = i.slopes
        rays[:, :, 0] = right
        rays[:, :, 1] = below[:, None]
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
