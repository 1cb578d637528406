"""Velocity commands with a header, on the same topic as those without one.

DDS knows one type for a topic's name within a participant, so this listens with a participant of
its own, in a ROS context of its own. Nav2 and teleop_twist_keyboard send `TwistStamped` in Jazzy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.utilities import try_shutdown

from husky_runtime import graph
from husky_runtime.nodes import qos
from husky_runtime.nodes.executor import HeldSubscription, WaitSetExecutor
from husky_runtime.nodes.message_guard import Refused

FRAMES = ("", graph.FRAME_BASE, graph.FRAME_FOOTPRINT)
"""What a velocity may be expressed in."""


class StampedTwist:
    """Listens for `TwistStamped`; looks for it when it is asked to.

    The header's stamp is not judged: who sends wall time to a simulated robot may drive it too. A
    sender that has died is silent.
    """

    def __init__(self, node: Node, act: Callable[[Twist], object]):
        """Listen.

        Args:
            node: it belongs to; its remappings and namespace hold.
            act: gets each velocity command.
        """
        self._node, self._act = node, act
        self._context = Context()
        rclpy.init(context=self._context, domain_id=node.context.get_domain_id())
        self._listener = Node(
            f"_{node.get_name()}_stamped",  # hidden: `ros2 node list` shows it with --all
            namespace=node.get_namespace(),
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        topic = node.resolve_topic_name(graph.CMD_VEL)
        self._subscription = self._listener.create_subscription(
            TwistStamped, topic, self._on_message, qos.COMMAND
        )
        self._held: HeldSubscription | None = None

    def look(self) -> None:
        """Act on what has come since the last look; the node has its executor."""
        if self._held is None:
            guard = cast(WaitSetExecutor, self._node.executor).guard
            self._held = HeldSubscription(self._subscription, guard)
        self._held.serve_all()

    def _on_message(self, message: TwistStamped) -> None:
        frame = message.header.frame_id
        if frame not in FRAMES:
            raise Refused(f"frame {frame!r}, a velocity is in {' or '.join(FRAMES[1:])}")
        self._act(message.twist)

    def close(self) -> None:
        """Listen no more."""
        if self._held is not None:
            self._held.close()
        self._listener.destroy_node()
        try_shutdown(context=self._context)
