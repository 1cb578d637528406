"""Serialized messages from a queue that wakes nobody: its node looks into it when it likes."""

from __future__ import annotations

from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from husky_bringup.definitions import message_class
from husky_runtime import graph


class RawSubscription:
    """A subscription that is in no wait set.

    Thousands of messages a second cost one wake-up per look instead of one each.

    Attributes:
        depth: messages that its queue holds; the oldest go first.
    """

    def __init__(self, node: Node, topic: graph.Topic, offered: QoSProfile, depth: int):
        """Subscribe.

        Args:
            node: that looks.
            topic: to subscribe to.
            offered: how it is published.
            depth: messages to hold.

        Raises:
            ImportError, AttributeError, ValueError: there is no such type of messages.
        """
        profile = QoSProfile(
            history=offered.history,
            depth=depth,
            reliability=offered.reliability,
            durability=offered.durability,
        )
        self.depth = depth
        self._kind = message_class(topic.type)
        with node.handle:
            self._handle: Any = _rclpy.Subscription(
                node.handle, self._kind, topic.name, profile.get_c_qos_profile()
            )
        self._handle.__enter__()
        self._take = self._handle.take_message

    def take(self) -> bytes | None:
        """Return the oldest message that it holds [CDR], None for none."""
        taken = self._take(self._kind, True)
        return None if taken is None else taken[0]

    def close(self) -> None:
        """Unsubscribe."""
        self._handle.__exit__(None, None, None)
        self._handle.destroy_when_not_in_use()
