"""Topics on which clients of a Foxglove server publish into the graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from foxglove.websocket import ClientChannel
from rclpy.node import Node
from rclpy.publisher import Publisher

from husky_bringup.definitions import message_class
from husky_bringup.nodes.incoming import decode
from husky_bringup.nodes.topic_search import is_wanted
from husky_runtime import graph
from husky_runtime.nodes import qos


@dataclass(frozen=True)
class _Way:
    """From a client's channel to a topic."""

    kind: Any
    publisher: Publisher


class ClientTopics:
    """Publishes for clients, on the topics that they may publish on; for the node's thread."""

    def __init__(self, node: Node, patterns: Sequence[str]):
        """Publish nothing yet.

        Args:
            node: that publishes.
            patterns: names of topics that clients may publish on; * stands for any text.
        """
        self._node, self._patterns = node, patterns
        self._ways: dict[tuple[int, int], _Way] = {}
        self._publishers: dict[tuple[str, str], Publisher] = {}

    def advertise(self, client: int, channel: ClientChannel) -> None:
        """Open a way for a client.

        Raises:
            ValueError: it may not publish there, or not that.
        """
        topic, kind = channel.topic, type_of(channel.schema_name)
        if not is_wanted(topic, self._patterns, self._node.get_namespace()):
            allowed = ", ".join(self._patterns) or "nothing"
            raise ValueError(f"clients may publish {allowed}, not {topic} (parameter publish)")
        if channel.encoding != "cdr":
            raise ValueError(f"{topic}: encoding is {channel.encoding!r}, it must be cdr")
        known = self._type_of(topic)
        if known not in ("", kind):
            raise ValueError(f"{topic}: type is {kind}, it must be {known}")
        try:
            found = message_class(kind)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"{topic}: {error}") from error
        if (topic, kind) not in self._publishers:
            publisher = self._node.create_publisher(found, topic, qos.COMMAND)
            self._publishers[topic, kind] = publisher
        self._ways[client, channel.id] = _Way(found, self._publishers[topic, kind])

    def _type_of(self, topic: str) -> str:
        """Return the type of a topic, "" if nobody knows it.

        DDS allows for one within a participant, so of `/cmd_vel`, that has two, the table's.
        """
        types = dict(self._node.get_topic_names_and_types())
        for row in graph.TOPICS:
            types[self._node.resolve_topic_name(row.relative)] = [row.type]
        return types.get(topic, [""])[0]

    def unadvertise(self, client: int, channel: int) -> None:
        """Close a way."""
        self._ways.pop((client, channel), None)

    def publish(self, client: int, channel: int, data: bytes) -> None:
        """Publish a client's message.

        Raises:
            ValueError: it is none.
        """
        way = self._ways.get((client, channel))
        if way is None:
            return  # who has opened it was told no
        try:
            way.publisher.publish(decode(data, way.kind))
        except ValueError as error:
            raise ValueError(f"{way.publisher.topic_name}: {error}") from error


def type_of(schema: str) -> str:
    """Return a type of messages as ROS 2 writes it; clients leave `msg` out now and then."""
    package, _, rest = schema.partition("/")
    return schema if rest.startswith("msg/") else f"{package}/msg/{rest}"
