"""Node `recorder`: every topic that there is into a rosbag2 bag, as it comes off the wire."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from husky_bringup.bag import BagChannel, BagWriter
from husky_bringup.definitions import Definitions, message_class
from husky_bringup.nodes.raw_subscription import RawSubscription
from husky_bringup.nodes.topic_search import EVERYTHING, TopicSearch
from husky_runtime import graph
from husky_runtime.nodes import diagnostics, qos
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.run import run

_FLUSH_PERIOD = 5.0
"""Wall time after which messages are in the file, however few they are [s]: a recorder that is
killed loses no more."""
_SEARCH_PERIOD = 0.25
"""Wall time between two looks for new topics [s]; one costs a millisecond."""
_FOUND_DEPTH = 100
"""Messages that the queue of a topic beyond the graph's table holds: they may be large."""
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


@dataclass(slots=True)
class _Source:
    """A subscription and where its messages go."""

    subscription: RawSubscription
    channel: BagChannel


class Recorder(OneClock, Node):
    """Takes serialized messages out of deep queues, many at a time, and writes them to a bag.

    The queues are emptied by a timer and are in no wait set: thousands of messages a second cost
    one wake-up per period instead of one each.

    When the disk takes no more, the bag is closed with what it has, and the node ends: nobody else
    needs it.
    """

    def __init__(self) -> None:
        """Declare parameters, open the bag, subscribe."""
        super().__init__(graph.RECORDER)
        output = declare(
            self, "output", "", "directory of the bag; empty for rosbag2_<date>-<time> here"
        )
        topics = declare(
            self, "topics", [EVERYTHING], "topics to record, also later ones; * stands for any text"
        )
        overwrite = declare(self, "overwrite", False, "replace a bag of that name")
        compress = declare(self, "compress", True, "compress chunks with Zstandard")
        self._ending = False
        what = "messages that the queue of a topic of the graph holds"
        self._depth = declare(self, "depth", 2000, what, lower=1, upper=100_000)
        what = "wall time between two looks at the queues [s]"
        period = declare(self, "period", 0.02, what, lower=0.001, upper=0.5)
        self._search = TopicSearch(self, topics)
        definitions = Definitions()
        self._bag = BagWriter(
            Path(output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")),
            self._search.rows(),
            {name: to_rosbags(profile) for name, profile in qos.OFFERED.items()},
            definitions.typestore,
            text_of=definitions.text,
            overwrite=overwrite,
            compress=compress,
        )
        self._sources = [
            self._subscribe(channel, qos.PROFILES[channel.topic.qos], self._depth)
            for channel in self._bag.channels
        ]
        self.hot: Sequence[Subscription] = []
        self.create_timer(period, self._drain)
        self.create_timer(_FLUSH_PERIOD, self._flush)
        self.create_timer(_SEARCH_PERIOD, self._find)
        self._diagnostics = diagnostics.Diagnostics(self, "recorder", self._report)
        self.get_logger().info(f"recording {len(self._sources)} topics to {self._bag.path}")

    def _find(self) -> None:
        """Begin to record what has come into the graph since the last look."""
        for topic, offered in self._search.fresh():

            def record(topic: graph.Topic = topic, offered: QoSProfile = offered) -> None:
                message_class(topic.type)  # first: a channel cannot be taken back
                channel = self._bag.add(topic, to_rosbags(offered))
                self._sources.append(self._subscribe(channel, offered, _FOUND_DEPTH))

            self._search.begin(topic, record)

    def _subscribe(self, channel: BagChannel, offered: QoSProfile, depth: int) -> _Source:
        return _Source(RawSubscription(self, channel.topic, offered, depth), channel)

    def _drain(self) -> None:
        """Write what the queues hold."""
        write = self._bag.write
        for source in self._sources:
            take, channel = source.subscription.take, source.channel
            for _ in range(source.subscription.depth):
                message = take()
                if message is None:
                    break
                write(channel, message)
        self._end_if_full()

    def _flush(self) -> None:
        self._bag.flush()
        self._end_if_full()

    @property
    def problem(self) -> str:
        """Why the recording is not whole; "" while it is."""
        return self._bag.problem

    def _end_if_full(self) -> None:
        """End the node once the bag has been closed."""
        if self.problem and not self._ending:
            self._ending = True
            self._diagnostics.publish()
            signal.raise_signal(signal.SIGTERM)

    def _report(self) -> diagnostics.Report:
        bag = self._bag
        values = {
            "bag": bag.path,
            "messages": sum(channel.count for channel in bag.channels),
            "missing": sum(channel.missing for channel in bag.channels),
            "dropped": bag.dropped,
            "topics": len(bag.channels),
            "skipped": "; ".join(f"{name}: {why}" for name, why in self._search.skipped.items()),
            "problem": bag.problem,
        }
        if bag.problem:
            return diagnostics.ERROR, f"recording has ended: {bag.problem}", values
        return diagnostics.OK, "recording", values

    def quiet(self) -> None:
        """Nothing to do: there are no hot subscriptions."""

    def close(self) -> None:
        """Write the rest, close the bag and say what is in it."""
        self._ending = True
        self._drain()
        self._bag.close()
        for source in self._sources:
            source.subscription.close()
        self._sources = []
        with contextlib.suppress(OSError):  # the log may be on the disk that is full
            print(self._bag.report(), flush=True)
            if self._bag.resets:
                print(f"simulated time was reset {self._bag.resets} times", flush=True)


def main() -> int:
    """Run the node; return the process's exit code, 1 when the recording is not whole."""
    made: list[Recorder] = []

    def make() -> Recorder:
        made.append(Recorder())
        return made[0]

    code = run(make)
    if made and made[0].problem:
        print(f"error: recording has ended: {made[0].problem}", file=sys.stderr)
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
