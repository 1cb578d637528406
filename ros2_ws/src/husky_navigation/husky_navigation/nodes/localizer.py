"""Node `localizer`: the frame `odom` in `map`, from odometry of the legs and poses of the T265."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from husky_description.link_frames import inverse, transform_of
from husky_description.rotation import Quaternion, Vector, multiply, rotate
from husky_navigation.map_frame import LocalizerState, MapFrame
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos, stamps
from husky_runtime.nodes.message_guard import Refused
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare, declare_robot
from husky_runtime.nodes.run import run
from husky_runtime.nodes.transforms import TransformTeller, declare_transforms

_HIGH, _FAILED = 3, 0
"""Confidence of the T265."""
_RESTART_NS = 1_000_000_000
"""A stamp so far back is that of a world that has started again [ns]."""
_SILENT_NS = 1_000_000_000
"""Time without odometry that is a fault [ns]."""
_POSES = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Four poses of the T265 come for each message of odometry, and are taken with it; the depth covers
a burst."""


class Localizer(OneClock, Node):
    """Publishes `map` to `odom`, and the base in `map`, with each message of odometry."""

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__(graph.LOCALIZER)
        camera = declare_robot(self).t265
        x, y, z, qx, qy, qz, qw = inverse(
            transform_of(camera.position.tolist(), camera.rpy.tolist())
        )
        self._base_position, self._base_rotation = (x, y, z), (qx, qy, qz, qw)
        what = "variance of a position of high confidence on /t265/odom, as its driver has it [m^2]"
        self._variance = declare(self, "t265_variance", 0.01, what, 1e-6, 1.0)
        self._frame = MapFrame(report=lambda event: self.get_logger().info(event))
        self._stamp = -1
        self.hot: Sequence[Subscription] = []
        edge = [(graph.FRAME_MAP, graph.FRAME_ODOM)]
        publishes = declare_transforms(self, graph.FRAME_ODOM)
        self._transform = TransformTeller(self, edge) if publishes else None
        self._poses = self.create_publisher(PoseWithCovarianceStamped, graph.MAP_POSE, qos.STATUS)
        self._tracking = self.create_subscription(
            Odometry, graph.T265_ODOMETRY, self._on_tracking, _POSES
        )
        self.create_subscription(Odometry, graph.ODOMETRY, self._on_odometry, qos.STATUS)
        self._diagnostics = diagnostics.Diagnostics(self, "map frame", self._report)

    @property
    def unawaited(self) -> tuple[Subscription, ...]:
        """Poses of the T265, 200 a second, need not wake the node either."""
        return (*super().unawaited, self._tracking)

    # Measurements -------------------------------------------------------------------------------
    def _on_odometry(self, odometry: Odometry) -> None:
        stamp = stamps.to_ns(odometry.header.stamp)
        if stamp < self._stamp - _RESTART_NS:
            self._frame.clear()
        position, rotation = _pose_of(odometry)
        try:
            taken = self._frame.add_odometry(stamp, position, rotation)
        except ValueError as error:
            raise Refused(str(error)) from error
        if not taken:
            raise Refused(f"stamp {stamp} ns is not after {self._stamp} ns")
        self._stamp = stamp
        self._publish(stamp)

    def _on_tracking(self, tracking: Odometry) -> None:
        position, rotation = _pose_of(tracking)
        # From the pose of the camera to that of the base.
        (x, y, z), (dx, dy, dz) = position, rotate(rotation, self._base_position)
        position, rotation = (x + dx, y + dy, z + dz), multiply(rotation, self._base_rotation)
        confidence = self._confidence(tracking.pose.covariance[0])
        try:
            self._frame.add_tracking(
                stamps.to_ns(tracking.header.stamp), position, rotation, confidence
            )
        except ValueError as error:
            raise Refused(str(error)) from error

    def _confidence(self, variance: float) -> int:
        """Return the confidence of a variance [m^2], which is ten times as great a step below."""
        if not 0.0 < variance < math.inf:
            return _FAILED
        steps = round(math.log10(variance) - math.log10(self._variance))
        return max(_FAILED, min(_HIGH, _HIGH - steps))

    # The map frame ------------------------------------------------------------------------------
    def _publish(self, stamp: int) -> None:
        """Publish `map` to `odom`, and the base in `map`, at a stamp [ns]."""
        odom = self._frame.map_to_odom
        if self._transform is not None:
            self._transform.tell(stamp, [(odom.x, odom.y, odom.z, *odom.rotation)])
        base = self._frame.base_in_map
        if base is None:
            return
        message = PoseWithCovarianceStamped()
        stamps.fill(message.header.stamp, stamp)
        message.header.frame_id = graph.FRAME_MAP
        at, q = message.pose.pose.position, message.pose.pose.orientation
        (at.x, at.y, at.z), (q.x, q.y, q.z, q.w) = base
        covariance = np.zeros((6, 6))
        places = np.ix_([0, 1, 2, 5], [0, 1, 2, 5])  # roll and pitch are gravity's
        covariance[places] = self._frame.covariance
        message.pose.covariance = covariance.ravel()
        self._poses.publish(message)

    def _report(self) -> diagnostics.Report:
        frame = self._frame
        x, y, z, yaw = frame.deviation.tolist()
        values = {
            "deviation": f"{math.hypot(x, y):.3f} m, {z:.3f} m, {math.degrees(yaw):.2f} deg",
            **asdict(frame.counters),
        }
        state = frame.state
        if self._stamp < 0:
            return diagnostics.WARN, "waiting for odometry", values
        silent = self.get_clock().now().nanoseconds - self._stamp
        if silent > _SILENT_NS:
            text = f"no odometry for {silent / 1e9:.1f} s: the pose is old"
            return diagnostics.WARN, text, values
        bad = state in (LocalizerState.FROZEN, LocalizerState.LOST)
        return diagnostics.WARN if bad else diagnostics.OK, state.value, values

    def quiet(self) -> None:
        """Nothing to do: messages wake the node."""

    def close(self) -> None:
        """Nothing to do: the node moves nothing."""


def _pose_of(odometry: Odometry) -> tuple[Vector, Quaternion]:
    """Return position [m] and attitude (x, y, z, w)."""
    at, q = odometry.pose.pose.position, odometry.pose.pose.orientation
    return (at.x, at.y, at.z), (q.x, q.y, q.z, q.w)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run(Localizer)


if __name__ == "__main__":
    sys.exit(main())
