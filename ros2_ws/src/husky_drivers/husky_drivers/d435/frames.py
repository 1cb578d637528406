"""Depth frames of the RealSense D435, as librealsense hands them out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DepthImage = NDArray[np.uint16]
"""Depth along the optical axis in units of the frame's `depth_unit`, 0 where there is none;
shape (height, width), row 0 at the top, column 0 on the left as the camera sees it."""


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
