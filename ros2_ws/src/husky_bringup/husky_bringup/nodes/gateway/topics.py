"""Topics of the graph as channels of a Foxglove server."""

from __future__ import annotations

from dataclasses import dataclass

from foxglove import Channel, Context, Schema
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from husky_bringup.bag import begins_with_stamp
from husky_bringup.definitions import Definitions, message_class
from husky_bringup.log_time import near, read_stamp
from husky_bringup.nodes.raw_subscription import RawSubscription
from husky_runtime import graph

_DEPTH = 100
"""Messages that wait for the next look at a topic that is passed on whole."""
_LOG = "rcl_interfaces/msg/Log"


@dataclass(slots=True)
class _Feed:
    """A topic, its channel, and the subscription while somebody listens.

    Attributes:
        is_stamped: whether its messages begin with a stamp.
        is_retold: whether a newcomer hears what was said before he came.
        depth: messages that wait for a look.
    """

    topic: graph.Topic
    offered: QoSProfile
    channel: Channel
    is_stamped: bool
    is_retold: bool
    depth: int
    listeners: int = 0
    source: RawSubscription | None = None


class TopicFeeds:
    """Passes on what is listened to; for the node's thread.

    A topic whose rate is above the allowed one is thinned out: each look takes its newest message.
    One whose messages come on demand, or from several nodes, is passed on whole.

    Attributes:
        forwarded: messages that have been passed on.
    """

    def __init__(self, node: Node, context: Context, definitions: Definitions, rate: float):
        """Know no topic yet.

        Args:
            node: that subscribes.
            context: of the server.
            definitions: of messages, for the schemas.
            rate: looks in a second of wall time [Hz].
        """
        self._node, self._context, self._definitions = node, context, definitions
        self._rate = rate
        self._feeds: dict[int, _Feed] = {}
        self.forwarded = 0

    def __len__(self) -> int:
        """Return how many topics there are."""
        return len(self._feeds)

    @property
    def listened(self) -> int:
        """How many topics somebody listens to."""
        return sum(feed.source is not None for feed in self._feeds.values())

    def add(self, topic: graph.Topic, offered: QoSProfile) -> None:
        """Offer a topic to clients.

        Args:
            topic: with its full name.
            offered: how it is published.

        Raises:
            UnknownTypeError, ImportError, AttributeError, ValueError: its type is not installed.
        """
        message_class(topic.type)
        text = self._definitions.text(topic.type)
        schema = Schema(name=topic.type, encoding="ros2msg", data=text.encode())
        channel = Channel(topic.name, message_encoding="cdr", schema=schema, context=self._context)
        latched = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self._feeds[channel.id()] = _Feed(
            topic,
            offered,
            channel,
            is_stamped=begins_with_stamp(self._definitions.typestore, topic.type),
            is_retold=latched and topic.type != _LOG,  # whose lines others would get twice
            depth=1 if topic.rate > self._rate else _DEPTH,
        )

    def listen(self, channel: int) -> None:
        """Subscribe for one client more."""
        feed = self._feeds[channel]
        feed.listeners += 1
        if feed.is_retold:
            _close(feed)
        if feed.source is None:
            feed.source = RawSubscription(self._node, feed.topic, feed.offered, feed.depth)

    def leave(self, channel: int) -> None:
        """Unsubscribe for a client."""
        feed = self._feeds[channel]
        feed.listeners -= 1
        if feed.listeners == 0:
            _close(feed)

    def forward(self, now: int) -> None:
        """Pass on what has come, at a time of the robot's clock [ns]."""
        for feed in self._feeds.values():
            if feed.source is None:
                continue
            for _ in range(feed.depth):
                message = feed.source.take()
                if message is None:
                    break
                stamp = read_stamp(message) if feed.is_stamped else -1
                feed.channel.log(message, log_time=near(stamp, now))
                self.forwarded += 1

    def close(self) -> None:
        """Unsubscribe from all."""
        for feed in self._feeds.values():
            _close(feed)


def _close(feed: _Feed) -> None:
    if feed.source is not None:
        feed.source.close()
        feed.source = None
