"""Attitudes on the MAVLink line: FRD body to NED (w, x, y, z), in ROS FLU to ENU (x, y, z, w)."""

from __future__ import annotations

from collections.abc import Sequence

from husky_description.rotation import Quaternion, swap_world_and_body


def ros_attitude(wxyz: Sequence[float]) -> Quaternion:
    """Return the rotation FLU body to ENU world (x, y, z, w) of one FRD to NED (w, x, y, z)."""
    w, x, y, z = wxyz
    return swap_world_and_body((x, y, z, w))


def mavlink_attitude(xyzw: Sequence[float]) -> Quaternion:
    """Return the rotation FRD to NED (w, x, y, z) of one FLU to ENU (x, y, z, w)."""
    x, y, z, w = xyzw
    x, y, z, w = swap_world_and_body((x, y, z, w))
    return w, x, y, z
