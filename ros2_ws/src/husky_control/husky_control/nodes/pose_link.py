"""The controller's side of the tracking camera: which of its poses a tick knows."""

from __future__ import annotations

import time
from collections import deque

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_control.t265_pose import T265Pose
from husky_description import graph
from husky_description.lockstep import Peer
from husky_description.nodes import qos, stamps

_DELAY_NS = 10_000_000
"""In lockstep a tick knows the pose of this long ago: two periods of the camera [ns]."""
_FOREIGN_NS = 100_000_000
"""A pose so far ahead of the tick is of a time before a reset [ns]."""


class PoseLink:
    """Keeps poses until the tick that may know them.

    Attributes:
        hot: subscription to the poses.
    """

    def __init__(self, node: Node, grace: float, *, lockstep: bool):
        """Open the subscription.

        Args:
            node: the controller's.
            lockstep: a tick takes the pose of a fixed time before it; otherwise the newest.
            grace: wall time a silent camera is waited for in lockstep, once heard [s].
        """
        self._node = node
        self._peer = Peer(graph.T265_DRIVER, grace, start_grace=None)
        self._delay_ns = _DELAY_NS if lockstep else 0
        self._lockstep = lockstep
        self._poses: deque[Odometry] = deque(maxlen=64)
        self._pose = T265Pose()
        self._now_ns = -1
        self.hot: Subscription = node.create_subscription(
            Odometry, graph.T265_ODOMETRY, self._on_pose, qos.CONTROL
        )

    def _on_pose(self, pose: Odometry) -> None:
        stamp = stamps.to_ns(pose.header.stamp)
        if 0 <= self._now_ns < stamp - _FOREIGN_NS:
            return
        self._poses.append(pose)
        self._peer.answer(stamp)

    def ready(self, time_ns: int) -> bool:
        """Return whether a tick of this time has the pose that it is to know."""
        return self._peer.ready(time_ns - _DELAY_NS)

    def watch(self, time_ns: int) -> None:
        """Give a silent camera up."""
        if not self.ready(time_ns) and self._peer.expire(time.monotonic()):
            self._node.get_logger().warning(f"{self._peer.name} is silent: going on without it")

    def take(self, time_ns: int, pose: T265Pose) -> None:
        """Write the newest pose that a tick of this time knows, if there is a newer one."""
        self._now_ns = time_ns
        due, newest = time_ns - self._delay_ns, None
        while self._poses and (
            not self._lockstep or stamps.to_ns(self._poses[0].header.stamp) <= due
        ):
            newest = self._poses.popleft()
        if newest is not None:
            _copy(newest, self._pose)
        pose.take(self._pose)

    def restart(self) -> None:
        """The world starts again: poses of before are of another time."""
        self._peer.restart()
        self._poses.clear()
        self._pose = T265Pose()
        self._now_ns = -1


def _copy(message: Odometry, pose: T265Pose) -> None:
    at, twist = message.pose.pose, message.twist.twist
    pose.stamp = stamps.to_ns(message.header.stamp) / 1e9
    pose.position[:] = at.position.x, at.position.y, at.position.z
    q = at.orientation
    pose.orientation[:] = q.x, q.y, q.z, q.w
    pose.velocity[:] = twist.linear.x, twist.linear.y, twist.linear.z
    pose.angular_velocity[:] = twist.angular.x, twist.angular.y, twist.angular.z
    pose.variance = float(message.pose.covariance[0])
