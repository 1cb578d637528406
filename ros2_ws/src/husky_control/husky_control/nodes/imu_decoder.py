"""`sensor_msgs/Imu` as the middleware's bytes: read in place, because it comes 800 times a second.

Making a message object of the bytes costs forty microseconds, most of it for covariances, which
the controller looks at fifty times a second.
"""

from __future__ import annotations

import struct
import warnings
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array

# The square of a number that is refused may be infinite: that is why it is refused.
warnings.filterwarnings("ignore", "overflow encountered in dot", RuntimeWarning)

_HEADER = 4
"""Bytes of the encapsulation header; alignment counts from behind it (CDR, DDS-RTPS 10)."""
_STAMP_AND_LENGTH = struct.Struct("<iII")
_NUMBERS = 4 + 9 + 3 + 9 + 3 + 9
"""Orientation, angular velocity and linear acceleration, each with its covariance."""
_HUGE_SQUARED = 1e6
"""No IMU measures so much: 1e3 rad/s or m/s^2, squared."""
_NORM_TOLERANCE = 0.01
"""By which a rotation's squared norm may differ from 1: quaternions on the wire are float32."""


class ImuSample(NamedTuple):
    """What the controller needs of one IMU message."""

    time_ns: int  # stamp [ns]
    orientation: Array  # quaternion (x, y, z, w), IMU in world
    angular_velocity: Array  # [rad/s] (3,)
    specific_force: Array  # [m/s^2] (3,)
    orientation_covariance: Array  # about the axes of the world [rad^2], row by row (9,)
    angular_velocity_covariance: Array  # [rad^2/s^2], row by row (9,)


def decode_imu(data: bytes) -> ImuSample:
    """Read a serialised `sensor_msgs/Imu`.

    Raises:
        ValueError: bytes that are no little-endian CDR of such a message, or no measurement:
            numbers that are not finite or absurd, an orientation that is no rotation, no stamp.
    """
    if len(data) < 16 or data[1] != 1:
        raise ValueError(f"{len(data)} bytes are no little-endian sensor_msgs/Imu")
    seconds, nanoseconds, length = _STAMP_AND_LENGTH.unpack_from(data, _HEADER)
    behind_frame = _STAMP_AND_LENGTH.size + length
    start = _HEADER + (behind_frame + 7) // 8 * 8
    if length > len(data) or len(data) < start + 8 * _NUMBERS:
        raise ValueError(f"{len(data)} bytes are too few for a sensor_msgs/Imu")
    numbers = np.frombuffer(data, "<f8", _NUMBERS, start)
    if not numbers.dot(numbers) <= _HUGE_SQUARED:
        raise ValueError("a number is not finite or absurd")
    orientation = numbers[0:4]
    if abs(orientation.dot(orientation) - 1.0) > _NORM_TOLERANCE:
        raise ValueError(f"orientation {orientation.tolist()} is no rotation, its norm must be 1")
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise ValueError(f"{seconds} s and {nanoseconds} ns are no time at or after 0")
    return ImuSample(
        seconds * 1_000_000_000 + nanoseconds,
        orientation,
        numbers[13:16],
        numbers[25:28],
        numbers[4:13],
        numbers[16:25],
    )
