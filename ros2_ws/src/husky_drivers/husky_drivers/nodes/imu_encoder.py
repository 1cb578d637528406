"""`sensor_msgs/Imu` as bytes for the middleware, patched rather than converted for each sample."""

from __future__ import annotations

import struct

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from husky_drivers.vn200_imu import Quaternion, Vector


class ImuEncoder:
    """Writes stamp and measurement into one serialised message.

    All that changes from sample to sample has a fixed place in it, since the frame's name does not
    change its length. Converting a message object costs three times as much.
    """

    def __init__(self, message: Imu):
        """Serialise the message once; its frame and covariances stay.

        Args:
            message: stamp, orientation, angular velocity and linear acceleration are overwritten.

        Raises:
            RuntimeError: the middleware's encoding has no fixed places for the numbers.
        """
        # Find the places by numbers that stand nowhere else in the message.
        message.header.stamp.sec, message.header.stamp.nanosec = 0x1234ABCD, 0x2345BCDE
        names = ("orientation", "angular_velocity", "linear_acceleration")
        for index, name in enumerate(names):
            part = getattr(message, name)
            for axis, field in enumerate("xyzw" if name == "orientation" else "xyz"):
                setattr(part, field, -1.5e300 - 1e298 * (4 * index + axis))
        self._buffer = bytearray(serialize_message(message))
        self._stamp = struct.Struct("=iI")
        self._four = struct.Struct("=4d")
        self._three = struct.Struct("=3d")
        stamp = message.header.stamp
        q, w, a = message.orientation, message.angular_velocity, message.linear_acceleration
        self._stamp_at = self._place(self._stamp.pack(stamp.sec, stamp.nanosec))
        self._orientation_at = self._place(self._four.pack(q.x, q.y, q.z, q.w))
        self._velocity_at = self._place(self._three.pack(w.x, w.y, w.z))
        self._acceleration_at = self._place(self._three.pack(a.x, a.y, a.z))

    def _place(self, pattern: bytes) -> int:
        if self._buffer.count(pattern) != 1:
            raise RuntimeError("the middleware encodes sensor_msgs/Imu in an unexpected way")
        return self._buffer.index(pattern)

    def encode(
        self,
        stamp_ns: int,
        orientation: Quaternion,
        angular_velocity: Vector,
        linear_acceleration: Vector,
    ) -> bytes:
        """Return the serialised message.

        Args:
            stamp_ns: stamp [ns], 0 or more.
            orientation: quaternion (x, y, z, w), FLU body to ENU.
            angular_velocity: [rad/s] in FLU body axes.
            linear_acceleration: specific force [m/s^2] in FLU body axes.
        """
        buffer = self._buffer
        self._stamp.pack_into(buffer, self._stamp_at, *divmod(stamp_ns, 1_000_000_000))
        self._four.pack_into(buffer, self._orientation_at, *orientation)
        self._three.pack_into(buffer, self._velocity_at, *angular_velocity)
        self._three.pack_into(buffer, self._acceleration_at, *linear_acceleration)
        return bytes(buffer)
