"""The controller's side of the tracking camera: which of its poses a tick knows."""

from __future__ import annotations

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_control.nodes.tick_input import TickInput
from husky_control.tick_data import Measurements, T265Pose
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.presence import make_peer

_DELAY_NS = 10_000_000
"""In lockstep a tick knows the pose of this long ago: two periods of the camera [ns]."""


class PoseLink(TickInput[Odometry]):
    """Keeps poses until the tick that may know them.

    Attributes:
        hot: subscription to the poses.
    """

    def __init__(self, node: Node, grace: float, *, lockstep: bool):
        """Open the subscription.

        Args:
            node: the controller's.
            lockstep: a tick takes the pose of a fixed time before it; otherwise the newest.
            grace: wall time a silent camera is waited for in lockstep [s].
        """
        peer = make_peer(node, graph.T265_DRIVER, grace, start_grace=None)
        without = "going on without it"
        super().__init__(
            node, graph.T265_ODOMETRY, peer, _DELAY_NS, 64, without, from_start=lockstep
        )
        self._lockstep = lockstep
        self._pose = T265Pose()
        self._copied: Odometry | None = None
        self.hot: Subscription = node.create_subscription(
            Odometry, graph.T265_ODOMETRY, self._on_pose, qos.CONTROL
        )

    def _on_pose(self, pose: Odometry) -> None:
        self._keep(stamps.to_ns(pose.header.stamp), pose)

    def fill(self, time_ns: int, measurements: Measurements) -> None:
        """Write the newest pose that a tick of this time knows, if there is a newer one."""
        poses = self._messages
        known = poses.known(time_ns - _DELAY_NS) if self._lockstep else poses.newest()
        if known is not None and known[1] is not self._copied:
            self._copied = known[1]
            _copy(self._copied, self._pose)
        measurements.pose.copy_from(self._pose)

    def restart(self, time_ns: int) -> None:
        """The world starts again: poses of before are of another time."""
        super().restart(time_ns)
        self._pose, self._copied = T265Pose(), None


def _copy(message: Odometry, pose: T265Pose) -> None:
    at, twist = message.pose.pose, message.twist.twist
    pose.stamp = stamps.to_ns(message.header.stamp) / 1e9
    pose.position[:] = at.position.x, at.position.y, at.position.z
    q = at.orientation
    pose.orientation[:] = q.x, q.y, q.z, q.w
    pose.velocity[:] = twist.linear.x, twist.linear.y, twist.linear.z
    pose.angular_velocity[:] = twist.angular.x, twist.angular.y, twist.angular.z
    pose.variance = float(message.pose.covariance[0])
