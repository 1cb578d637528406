"""The truth of the simulated world, for who judges the robot; the robot is never told it."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node

from husky_description.arrays import Array
from husky_description.rotation import conjugate, multiply, rotate, to_rotation_vector
from husky_msgs.msg import EstimateError, FootContacts
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.transforms import SeenFrom, declare_transforms
from husky_sim.world import World

_KEPT = 64
"""Ticks for which the truth is kept to compare estimates with."""
_EXACT = 1e-12 * np.eye(6).ravel()
"""Covariance of the truth; all zeros would mean that it is not known."""


class GroundTruth:
    """Publishes where the base is and what the feet feel, and how wrong an estimate is.

    Attributes:
        subscription: of the estimates; to be served before the world moves on.
    """

    def __init__(self, node: Node, world: World):
        """Make the publishers."""
        self._world = world
        self._truths: dict[int, tuple[Array, Array, Array]] = {}
        self._publisher = node.create_publisher(Odometry, graph.GROUND_TRUTH, qos.STATUS)
        self._frame: SeenFrom | None = None
        if declare_transforms(node, f"{graph.FRAME_WORLD}, the ground truth"):
            self._frame = SeenFrom(node, graph.FRAME_BASE, graph.FRAME_WORLD)
        self._contacts = node.create_publisher(FootContacts, graph.FOOT_CONTACTS, qos.STATUS)
        self._errors = node.create_publisher(EstimateError, graph.ESTIMATE_ERROR, qos.STATUS)
        self.subscription = node.create_subscription(
            Odometry, graph.ODOMETRY, self._on_estimate, qos.STATUS
        )

    def restart(self) -> None:
        """Time starts again."""
        self._truths.clear()

    def publish(self) -> None:
        """Publish what is true now."""
        world = self._world
        truth = Odometry()
        truth.header.frame_id = graph.FRAME_WORLD
        truth.child_frame_id = graph.FRAME_BASE
        stamps.fill(truth.header.stamp, world.time_ns)
        pose, twist = truth.pose.pose, truth.twist.twist
        pose.position.x, pose.position.y, pose.position.z = map(float, world.base_position)
        orientation = world.base_orientation
        q = pose.orientation
        q.x, q.y, q.z, q.w = map(float, orientation)
        velocity = world.base_velocity_in_base()
        twist.linear.x, twist.linear.y, twist.linear.z = velocity.tolist()
        rate = world.base_angular_velocity
        twist.angular.x, twist.angular.y, twist.angular.z = map(float, rate)
        truth.pose.covariance = truth.twist.covariance = _EXACT
        self._publisher.publish(truth)
        if self._frame is not None:
            place = world.base_position.tolist()
            self._frame.tell(world.time_ns, (*place, *orientation.tolist()))
        if world.has_legs:
            self._publish_contacts()

    def _publish_contacts(self) -> None:
        world = self._world
        contacts = FootContacts()
        stamps.fill(contacts.stamp, world.time_ns)
        forces, normals = world.foot_contacts()
        contacts.contact = np.any(forces, axis=1).tolist()
        contacts.slid = world.slid
        for values, vectors in (
            (forces, contacts.force),
            (normals, contacts.normal),
            (world.foot_positions(), contacts.position),
        ):
            for value, vector in zip(values.tolist(), vectors, strict=True):
                vector.x, vector.y, vector.z = value
        point = contacts.center_of_mass
        point.x, point.y, point.z = world.center_of_mass().tolist()
        self._contacts.publish(contacts)

    def remember(self) -> None:
        """Keep the truth of the last ticks: estimates come a little later."""
        qpos, qvel = self._world.data.qpos, self._world.data.qvel
        self._truths[self._world.time_ns] = (qpos[0:3].copy(), qpos[3:7].copy(), qvel[0:3].copy())
        self._truths.pop(self._world.time_ns - _KEPT * graph.TICK_PERIOD_NS, None)

    def _on_estimate(self, estimate: Odometry) -> None:
        """Compare the controller's estimate with the truth of its stamp, if that is recent."""
        truth = self._truths.get(stamps.to_ns(estimate.header.stamp))
        if truth is None:
            return
        true_position, true_orientation, true_velocity = truth
        position, q = estimate.pose.pose.position, estimate.pose.pose.orientation
        linear = estimate.twist.twist.linear
        estimated = (q.x, q.y, q.z, q.w)
        w, x, y, z = true_orientation.tolist()
        error = EstimateError()
        error.stamp = estimate.header.stamp
        error.position = np.array((position.x, position.y, position.z)) - true_position
        error.velocity = rotate(estimated, (linear.x, linear.y, linear.z)) - true_velocity
        error.attitude = to_rotation_vector(multiply(conjugate((x, y, z, w)), estimated))
        self._errors.publish(error)
