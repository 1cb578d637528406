"""`ros2 topic hz`: how often messages come."""

import argparse
import statistics
from collections import deque
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.qos import qos_profile_sensor_data

from standin.arguments import positive_int
from standin.graph import add_node_arguments, graph_node
from standin.topic_class import published_class

SECOND = 1_000_000_000  # ns


def add_hz_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `topic hz`."""
    parser.add_argument("topic_name", help="name of the topic (e.g. '/chatter')")
    parser.add_argument(
        "--window",
        "-w",
        dest="window_size",
        metavar="WINDOW",
        type=positive_int,
        default=10000,
        help="number of messages to average over (default: %(default)s)",
    )
    parser.add_argument(
        "--filter",
        dest="filter_expr",
        metavar="EXPR",
        help="count only where this Python expression of m, the message, is true",
    )
    parser.add_argument(
        "--wall-time",
        dest="use_wtime",
        action="store_true",
        help="measure by the wall clock, not by ROS time",
    )
    add_node_arguments(parser, daemon=False)


class Rate:
    """Statistics of the intervals between messages, over a sliding window; times in nanoseconds."""

    def __init__(self, window: int) -> None:
        self.intervals: deque[int] = deque(maxlen=window)
        self.last: int | None = None
        self.reported: int | None = None

    def add(self, now: int) -> None:
        """Count a message that came now; a clock that starts anew starts the statistics anew."""
        if now == 0:  # simulated time that has not begun
            if self.intervals:
                print("time has reset, resetting counters")
                self.intervals.clear()
            return
        if self.last is None or now < self.last:
            self.intervals.clear()
        else:
            self.intervals.append(now - self.last)
        self.last = now

    def report(self) -> str | None:
        """What to print now: once a second of message time, else None."""
        if not self.intervals or self.last is None:
            return None
        if self.reported is None or self.last < self.reported:
            self.reported = self.last
            return None
        if self.last < self.reported + SECOND:
            return None
        self.reported = self.last
        mean = statistics.fmean(self.intervals) / SECOND
        deviation = statistics.pstdev(self.intervals) / SECOND
        return (
            f"average rate: {1.0 / mean if mean > 0.0 else 0.0:.3f}\n"
            f"\tmin: {min(self.intervals) / SECOND:.3f}s max: {max(self.intervals) / SECOND:.3f}s "
            f"std dev: {deviation:.5f}s window: {len(self.intervals)}"
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
