"""Node `recorder`: every topic of the graph into a rosbag2 bag, as it comes off the wire."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from husky_bringup.bag import BagWriter, Channel, make_typestore, select_topics
from husky_description import graph
from husky_description.nodes import qos
from husky_description.nodes.parameters import declare
from husky_description.nodes.run import run

_INFINITE = QosTime(9_223_372_036, 854_775_807)
"""rmw's infinite duration, as rosbag2 writes it."""


def to_rosbags(profile: QoSProfile) -> Qos:
    """Return a profile as the bag's metadata has it."""
    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        _INFINITE,
        _INFINITE,
        QosLiveliness.AUTOMATIC,
        _INFINITE,
        False,
    )


def _message_class(name: str) -> Any:
    """Return the class of a type such as "sensor_msgs/msg/Imu", with its type support loaded."""
    package, _, message = name.split("/")
    found = getattr(importlib.import_module(f"{package}.msg"), message)
    check_is_valid_msg_type(found)
    return found


@dataclass(slots=True)
class _Source:
    """A subscription and where its messages go."""

    handle: Any
    message_class: Any
    channel: Channel


class Recorder(Node):
    """Takes serialized messages out of deep queues, many at a time, and writes them to a bag.

    The queues are emptied by a timer and are in no wait set: thousands of messages a second cost
    one wake-up per period instead of one each.
    """

    def __init__(self) -> None:
        """Declare parameters, open the bag, subscribe."""
        super().__init__(graph.RECORDER)
        output = declare(
            self, "output", "", "directory of the bag; empty for rosbag2_<date>-<time> here"
        )
        topics = declare(
            self, "topics", [topic.name for topic in graph.TOPICS], "names of the topics to record"
        )
        overwrite = declare(self, "overwrite", False, "replace a bag of that name")
        compress = declare(self, "compress", True, "compress chunks with Zstandard")
        self._depth = declare(
            self, "depth", 2000, "messages that a topic's queue holds", lower=1, upper=100_000
        )
        period = declare(
            self,
            "period",
            0.02,
            "wall time between two looks at the queues [s]",
            lower=0.001,
            upper=0.5,
        )
        share = Path(get_package_share_directory("husky_msgs"))
        self._bag = BagWriter(
            Path(output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")),
            select_topics(topics),
            {name: to_rosbags(profile) for name, profile in qos.PROFILES.items()},
            make_typestore(share / "msg"),
            overwrite=overwrite,
            compress=compress,
        )
        self._sources = [self._subscribe(channel) for channel in self._bag.channels]
        self.hot: Sequence[Subscription] = []
        self.create_timer(period, self._drain)
        self.get_logger().info(f"recording {len(self._sources)} topics to {self._bag.path}")

    def _subscribe(self, channel: Channel) -> _Source:
        """Make a subscription that this node alone looks at."""
        offered = qos.PROFILES[channel.topic.qos]
        profile = QoSProfile(
            history=offered.history,
            depth=self._depth,
            reliability=offered.reliability,
            durability=offered.durability,
        )
        message_class = _message_class(channel.topic.type)
        with self.handle:
            handle = _rclpy.Subscription(
                self.handle, message_class, channel.topic.name, profile.get_c_qos_profile()
            )
        handle.__enter__()
        return _Source(handle, message_class, channel)

    def _drain(self) -> None:
        """Write what the queues hold."""
        write = self._bag.write
        for source in self._sources:
            take, message_class = source.handle.take_message, source.message_class
            channel = source.channel
            for _ in range(self._depth):
                taken = take(message_class, True)
                if taken is None:
                    break
                write(channel, taken[0])

    def quiet(self) -> None:
        """Nothing to do: there are no hot subscriptions."""

    def close(self) -> None:
        """Write the rest, close the bag and say what is in it."""
        self._drain()
        self._bag.close()
        for source in self._sources:
            source.handle.__exit__(None, None, None)
            source.handle.destroy_when_not_in_use()
        self._sources = []
        print(self._bag.report(), flush=True)
        if self._bag.resets:
            print(f"simulated time was reset {self._bag.resets} times", flush=True)


def main() -> int:
    """Run the node."""
    return run(Recorder)


if __name__ == "__main__":
    sys.exit(main())
