"""`ros2 topic hz`, `delay` and `bw`: how often messages come, how old, and how many bytes."""

import argparse
import statistics
import sys
from collections import deque
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time

from standin.arguments import OWN_NODE, TOPIC_NAME, argument, flag, takes, window
from standin.graph import graph_node
from standin.topic_class import published_class

SECOND = 1_000_000_000  # ns
TOPIC = argument("topic", help="name of the topic (e.g. '/chatter')")


class Spans:
    """Spans of time that end as messages come, over a sliding window; times in nanoseconds."""

    def __init__(self, window: int) -> None:
        self.spans: deque[int] = deque(maxlen=window)
        self.last: int | None = None
        self.reported: int | None = None

    def add(self, now: int, begin: int | None = None) -> None:
        """Count a message that came now, its span from `begin`, or from the message before, on.

        A clock that starts anew starts the statistics anew.
        """
        if now == 0:  # simulated time that has not begun
            if self.spans:
                print("time has reset, resetting counters")
                self.spans.clear()
            return
        if self.last is None or now < self.last:
            self.spans.clear()
        else:
            self.spans.append(now - (self.last if begin is None else begin))
        self.last = now


# ------------------------------------------------------------------ hz
class Rate(Spans):
    """Statistics of the intervals between messages."""

    def report(self) -> str | None:
        """What to print now: once a second of message time, else None."""
        if not self.spans or self.last is None:
            return None
        if self.reported is None or self.last < self.reported:
            self.reported = self.last
            return None
        if self.last < self.reported + SECOND:
            return None
        self.reported = self.last
        mean = statistics.fmean(self.spans) / SECOND
        deviation = statistics.pstdev(self.spans) / SECOND
        return (
            f"average rate: {1.0 / mean if mean > 0.0 else 0.0:.3f}\n"
            f"\tmin: {min(self.spans) / SECOND:.3f}s max: {max(self.spans) / SECOND:.3f}s "
            f"std dev: {deviation:.5f}s window: {len(self.spans)}"
        )


@takes(
    TOPIC_NAME,
    window(10000, dest="window_size", metavar="WINDOW"),
    argument(
        "--filter",
        dest="filter_expr",
        metavar="EXPR",
        help="count only where this Python expression of m, the message, is true",
    ),
    flag("--wall-time", dest="use_wtime", help="measure by the wall clock, not by ROS time"),
    *OWN_NODE,
)
def hz_main(args: argparse.Namespace) -> None:
    """Print the rate of a topic once a second until interrupted."""
    keep = eval(f"lambda m: ({args.filter_expr})") if args.filter_expr else None
    rate = Rate(args.window_size)
    with graph_node(args) as node:
        message_class = published_class(node, args.topic_name, args.spin_time, wait=True)
        clock = Clock(clock_type=ClockType.SYSTEM_TIME) if args.use_wtime else node.get_clock()

        def on_message(message: Any) -> None:
            if keep is None or keep(message):
                rate.add(clock.now().nanoseconds)

        # Without a filter nobody looks into the messages: they stay serialised, so that the
        # messages of a fast topic are all counted.
        node.create_subscription(
            message_class, args.topic_name, on_message, qos_profile_sensor_data, raw=keep is None
        )
        while rclpy.ok():
            rclpy.spin_once(node)
            if text := rate.report():
                print(text)


# ------------------------------------------------------------------ delay
class Delay(Spans):
    """Statistics of the ages of messages, by the stamps in their headers."""

    def report(self) -> str | None:
        """What to print now, None before the second message."""
        if not self.spans:
            return None
        if self.last == self.reported:
            return "no new messages"
        self.reported = self.last
        return (
            f"average delay: {statistics.fmean(self.spans) * 1e-9:.3f}\n"
            f"\tmin: {min(self.spans) * 1e-9:.3f}s max: {max(self.spans) * 1e-9:.3f}s "
            f"std dev: {statistics.pstdev(self.spans) * 1e-9:.5f}s window: {len(self.spans)}"
        )


@takes(TOPIC, window(10000), *OWN_NODE)
def delay_main(args: argparse.Namespace) -> None:
    """Print the delay of a topic once a second until interrupted."""
    delay = Delay(args.window)
    with graph_node(args) as node:
        message_class = published_class(node, args.topic, args.spin_time, wait=True)
        clock = node.get_clock()

        def on_message(message: Any) -> None:
            if not hasattr(message, "header"):
                raise RuntimeError("msg does not have header")
            delay.add(clock.now().nanoseconds, Time.from_msg(message.header.stamp).nanoseconds)

        def report() -> None:
            if text := delay.report():
                print(text)

        node.create_subscription(message_class, args.topic, on_message, qos_profile_sensor_data)
        node.create_timer(1.0, report)
        while rclpy.ok():
            rclpy.spin_once(node)


# ------------------------------------------------------------------ bw
class Bandwidth:
    """Sizes of messages in bytes over a sliding window; times in nanoseconds."""

    def __init__(self, window: int) -> None:
        self.arrivals: deque[tuple[int, int]] = deque(maxlen=window)

    def add(self, now: int, size: int) -> None:
        """Count a message that came now."""
        self.arrivals.append((now, size))

    def report(self, now: int) -> str | None:
        """What to print now, None where too little came."""
        if len(self.arrivals) < 2:
            return None
        duration = (now - self.arrivals[0][0]) * 1e-9
        if duration <= 0.0:
            print("WARNING: time is reset!", file=sys.stderr)
            self.arrivals.clear()
            return None
        sizes = [size for _, size in self.arrivals]
        rate = sum(sizes) / duration
        mean, least, most = (
            in_unit_of(rate, size) for size in (sum(sizes) / len(sizes), min(sizes), max(sizes))
        )
        return (
            f"{in_unit_of(rate, rate)}/s from {len(sizes)} messages\n"
            f"\tMessage size mean: {mean} min: {least} max: {most}"
        )


def in_unit_of(rate: float, size: float) -> str:
    """A number of bytes in the unit that suits the rate in bytes a second."""
    if rate < 1e3:
        return f"{size:.0f} B"
    return f"{size / 1e3:.2f} KB" if rate < 1e6 else f"{size / 1e6:.2f} MB"


@takes(TOPIC, window(100, metavar="WINDOW"), *OWN_NODE)
def bw_main(args: argparse.Namespace) -> None:
    """Print the bandwidth of a topic once a second until interrupted."""
    bandwidth = Bandwidth(args.window)
    with graph_node(args) as node:
        message_class = published_class(node, args.topic, args.spin_time, wait=True)
        clock = node.get_clock()

        def on_message(serialised: bytes) -> None:
            bandwidth.add(clock.now().nanoseconds, len(serialised))

        def report() -> None:
            if text := bandwidth.report(clock.now().nanoseconds):
                print(text)

        node.create_subscription(
            message_class, args.topic, on_message, qos_profile_sensor_data, raw=True
        )
        print(f"Subscribed to [{args.topic}]")
        node.create_timer(1.0, report)
        while rclpy.ok():
            rclpy.spin_once(node)
