"""The estimated motion of the base for everybody: `/odom`, `/odometry` and `/tf`."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import serialize_message

from husky_control.controller import Controller
from husky_control.estimation.odometry_covariance import OdometryCovariance
from husky_control.estimation.sensed_body import SensedBody
from husky_control.modes.table import Mode
from husky_control.rotation import yaw_of
from husky_description.arrays import Array
from husky_description.rotation import about_z, conjugate, multiply
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.transforms import TransformTeller, declare_transforms

_EDGES = ((graph.FRAME_ODOM, graph.FRAME_BASE), (graph.FRAME_BASE, graph.FRAME_FOOTPRINT))


class OdometryReport:
    """Tells where the base is, how it moves, and how well that is known."""

    def __init__(self, node: Node, foot_radius: float):
        """Make the publishers of the controller's node; the radius of a foot is in m."""
        self._foot_radius = foot_radius
        self._covariance = OdometryCovariance()
        self._told_ns = -1
        self._message = Odometry()
        self._message.header.frame_id = graph.FRAME_ODOM
        self._message.child_frame_id = graph.FRAME_BASE
        self._publishers = [
            node.create_publisher(Odometry, name, qos.STATUS)
            for name in (graph.ODOM, graph.ODOMETRY)
        ]
        told = declare_transforms(node, f"{graph.FRAME_BASE} and {graph.FRAME_FOOTPRINT}")
        self._teller = TransformTeller(node, _EDGES) if told else None

    def restart(self) -> None:
        """The world starts again: nothing has been walked."""
        self._told_ns = -1
        self._covariance.restart()

    def tell(
        self,
        time_ns: int,
        controller: Controller,
        angular_velocity: Array,
        attitude_variance: Array,
        rate_variance: Array,
    ) -> None:
        """Publish.

        Args:
            time_ns: of the estimate [ns].
            controller: that has made it.
            angular_velocity: of the base in base [rad/s] (3,).
            attitude_variance: about the axes of the odometry frame [rad^2] (3,).
            rate_variance: of the angular velocity on each axis [rad^2/s^2] (3,).
        """
        if time_ns < 0:
            return  # nothing has been measured
        body, message = controller.body, self._message
        rotation, turn = body.rotation, body.measurements.orientation_base_in_world
        place, velocity = body.estimator.position, body.estimator.velocity
        self._follow(time_ns, controller, velocity, float(attitude_variance[2]))
        covariance = self._covariance
        covariance.update(
            rotation,
            body.estimator.horizontal,
            body.estimator.vertical,
            attitude_variance,
            rate_variance,
            place_counts=controller.present.place_counts,
            velocity_counts=controller.present.velocity_counts,
        )
        stamps.fill(message.header.stamp, time_ns)
        pose, twist = message.pose, message.twist
        point, q = pose.pose.position, pose.pose.orientation
        point.x, point.y, point.z = place.tolist()
        q.x, q.y, q.z, q.w = turn.tolist()
        linear, angular = twist.twist.linear, twist.twist.angular
        linear.x, linear.y, linear.z = (velocity @ rotation).tolist()
        angular.x, angular.y, angular.z = angular_velocity.tolist()
        pose.covariance = covariance.pose.ravel()
        twist.covariance = covariance.twist.ravel()
        data = serialize_message(message)
        for publisher in self._publishers:
            publisher.publish(data)
        if self._teller is not None:
            base = (*place.tolist(), *turn.tolist())
            self._teller.tell(time_ns, (base, _footprint(body, self._foot_radius)))

    def _follow(
        self, time_ns: int, controller: Controller, velocity: Array, heading_variance: float
    ) -> None:
        """Add up what has been walked since the last message."""
        dt = max(0, time_ns - self._told_ns) / 1e9 if self._told_ns >= 0 else 0.0
        self._told_ns = time_ns
        if controller.present.velocity_counts:
            rising = controller.mode in (Mode.STAND_UP, Mode.SIT)
            self._covariance.walk(velocity, heading_variance, dt, rising=rising)


def _footprint(body: SensedBody, foot_radius: float) -> tuple[float, ...]:
    """Return the footprint in base (REP-120): amid the feet, level with the lowest sole."""
    rotation = body.rotation
    feet = body.foot_in_base @ rotation.T  # from base's origin, in the odometry frame's axes
    x, y, _ = feet.mean(axis=0).tolist()
    z = float(feet[:, 2].min()) - foot_radius
    place = (np.array((x, y, z)) @ rotation).tolist()
    qx, qy, qz, qw = body.measurements.orientation_base_in_world.tolist()
    return (*place, *multiply(conjugate((qx, qy, qz, qw)), about_z(yaw_of(rotation))))
