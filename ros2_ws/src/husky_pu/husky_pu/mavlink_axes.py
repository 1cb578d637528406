"""Axes of MAVLink and of ROS: rotations FRD to NED (w, x, y, z) and FLU to ENU (x, y, z, w)."""

from __future__ import annotations

import math
from collections.abc import Sequence

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

_HALF_ROOT = math.sqrt(0.5)


def ros_attitude(wxyz: Sequence[float]) -> Quaternion:
    """Return the rotation FLU body to ENU world (x, y, z, w) of one FRD to NED (w, x, y, z).

    NED to ENU is half a turn about (1, 1, 0), FRD to FLU half a turn about (1, 0, 0); the product
    of the three quaternions comes down to sums and differences.
    """
    w, x, y, z = wxyz
    return _HALF_ROOT * (x + y), _HALF_ROOT * (x - y), _HALF_ROOT * (w - z), _HALF_ROOT * (w + z)


def mavlink_attitude(xyzw: Sequence[float]) -> Quaternion:
    """Return the rotation FRD to NED (w, x, y, z) of one FLU to ENU (x, y, z, w)."""
    x, y, z, w = xyzw
    return _HALF_ROOT * (z + w), _HALF_ROOT * (x + y), _HALF_ROOT * (x - y), _HALF_ROOT * (w - z)


def flip_body(vector: Sequence[float]) -> Vector:
    """Turn a vector in FLU body axes into FRD, or back."""
    x, y, z = vector
    return x, -y, -z
