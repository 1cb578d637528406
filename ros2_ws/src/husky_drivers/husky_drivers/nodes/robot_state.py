"""The robot's shape and posture for everybody: URDF and transforms, as robot_state_publisher."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from std_msgs.msg import String

from husky_description.arrays import Array
from husky_description.link_frames import LinkFrames
from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.transforms import (
    TRANSFORM_PERIOD_NS,
    TransformTeller,
    declare_transforms,
    tell_fixed,
)
from husky_runtime.pace import Pace


class RobotState:
    """Tells the URDF and its fixed joints once, and where the joints have turned the links."""

    def __init__(self, node: Node, urdf: str, joint_names: Sequence[str]):
        """Make the publishers.

        Args:
            node: that measures the joints.
            urdf: of the robot.
            joint_names: in the order of the positions that will be told.
        """
        self._description = node.create_publisher(String, graph.ROBOT_DESCRIPTION, qos.LATCHED)
        self._description.publish(String(data=urdf))
        self._frames = LinkFrames(urdf)
        self._order = [list(joint_names).index(name) for name in self._frames.joint_names]
        self._teller: TransformTeller | None = None
        self._pace = Pace(TRANSFORM_PERIOD_NS, graph.TICK_PERIOD_NS // 2)
        if declare_transforms(node, "the robot's links"):
            tell_fixed(node, self._frames.fixed_edges, self._frames.fixed)
            self._teller = TransformTeller(node, self._frames.moving_edges)

    def tell(self, time_ns: int, position: Array) -> None:
        """Tell where the links are with joints [rad] (12,) at a stamp [ns], if it is time to."""
        if self._teller is not None and self._pace.due(time_ns):
            self._teller.tell(time_ns, self._frames.moving(position[self._order]).tolist())
