"""`nav_msgs/Odometry` as bytes for the middleware, patched rather than converted for each frame."""

from __future__ import annotations

import struct

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from husky_drivers.t265_frames import Pose, Twist


class OdometryEncoder:
    """Writes stamp, pose and twist into one serialised message.

    All that changes from frame to frame has a fixed place in it, since the frames' names do not
    change their lengths. Converting a message object, with its two covariances, costs several
    times as much.
    """

    def __init__(self, message: Odometry):
        """Serialise the message once; its frames and covariances stay.

        Args:
            message: stamp, pose and twist are overwritten.

        Raises:
            RuntimeError: the middleware's encoding has no fixed places for the numbers.
        """
        # Find the places by numbers that stand nowhere else in the message.
        message.header.stamp.sec, message.header.stamp.nanosec = 0x1234ABCD, 0x2345BCDE
        pose, twist = message.pose.pose, message.twist.twist
        marks = [-1.5e300 - 1e298 * index for index in range(13)]
        pose.position.x, pose.position.y, pose.position.z = marks[:3]
        q = pose.orientation
        q.x, q.y, q.z, q.w = marks[3:7]
        twist.linear.x, twist.linear.y, twist.linear.z = marks[7:10]
        twist.angular.x, twist.angular.y, twist.angular.z = marks[10:]
        self._buffer = bytearray(serialize_message(message))
        self._stamp = struct.Struct("=iI")
        self._pose = struct.Struct("=7d")
        self._twist = struct.Struct("=6d")
        stamp = message.header.stamp
        self._stamp_at = self._place(self._stamp.pack(stamp.sec, stamp.nanosec))
        self._pose_at = self._place(self._pose.pack(*marks[:7]))
        self._twist_at = self._place(self._twist.pack(*marks[7:]))

    def _place(self, pattern: bytes) -> int:
        if self._buffer.count(pattern) != 1:
            raise RuntimeError("the middleware encodes nav_msgs/Odometry in an unexpected way")
        return self._buffer.index(pattern)

    def encode(self, stamp_ns: int, pose: Pose, twist: Twist) -> bytes:
        """Return the serialised message.

        Args:
            stamp_ns: stamp [ns], 0 or more.
            pose: of the child frame in the header's frame [m], (x, y, z, w).
            twist: of the child frame in its own axes [m/s], [rad/s].
        """
        buffer = self._buffer
        self._stamp.pack_into(buffer, self._stamp_at, *divmod(stamp_ns, 1_000_000_000))
        self._pose.pack_into(buffer, self._pose_at, *pose)
        self._twist.pack_into(buffer, self._twist_at, *twist)
        return bytes(buffer)
