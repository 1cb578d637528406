"""`ros2 topic echo`: print messages as they come."""

import argparse
from typing import Any

import rclpy
import yaml
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.task import Future

from standin.arguments import (
    CSV,
    NODE,
    SHORTENING,
    TOPIC_NAME,
    argument,
    flag,
    positive_float,
    takes,
)
from standin.graph import graph_node
from standin.messages import Shortening, interface_class, to_csv, to_yaml
from standin.qos import chosen_profile, compatible_profile, is_overridden, qos_arguments
from standin.topic_class import published_class


class Echo:
    """Prints the messages of one subscription; `done` is set after the first one with --once."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args = args
        self.path = [name for name in (args.field or "").split(".") if name]
        if args.field is not None and not self.path:
            raise RuntimeError(f"Invalid field value '{args.field}'")
        self.filter = eval(f"lambda m: ({args.filter_expr})") if args.filter_expr else None
        self.shortening = Shortening.chosen(args)
        self.done = Future()

    def on_message(self, message: Any, info: dict[str, Any]) -> None:
        """Print one message."""
        for name in self.path:
            try:
                message = getattr(message, name)
            except AttributeError as error:
                raise RuntimeError(f"Invalid field '{'.'.join(self.path)}': {error}") from None
        if self.filter is not None and not self.filter(message):
            return
        if self.args.once:
            self.done.set_result(True)
        if not hasattr(message, "__slots__"):
            self.print_value(message, info)
        elif self.args.csv:
            source = (
                [str(value) for value in info.values()] if self.args.include_message_info else []
            )
            print(",".join([*source, to_csv(message, self.shortening)]))
        else:
            if self.args.include_message_info:
                print(yaml.dump(info), end="---\n")
            print(to_yaml(message, self.shortening, self.args.flow_style), end="---\n")

    def print_value(self, value: Any, info: dict[str, Any]) -> None:
        """Print what is no message: a field's value, or the bytes of --raw."""
        if self.args.include_message_info:
            print(f"---Got new message, message info:---\n{info}\n---Message data:---")
        print(value, end="\n---\n")

    def on_lost(self, status: Any) -> None:
        """Report messages that the middleware lost."""
        print(
            f"A message was lost!!!\n\ttotal count change:{status.total_count_change}\n"
            f"\ttotal count: {status.total_count}",
            end="---\n",
        )


@takes(
    *NODE,
    TOPIC_NAME,
    argument("message_type", nargs="?", help="type of the messages (e.g. 'std_msgs/msg/String')"),
    *qos_arguments("sensor_data"),
    CSV,
    argument(
        "--field",
        help="only this field; a dot leads to the fields of a field (e.g. pose.pose.position)",
    ),
    *SHORTENING,
    flag("--no-lost-messages", help="do not report lost messages"),
    flag("--raw", help="the message's bytes as they came"),
    argument(
        "--filter",
        dest="filter_expr",
        help="print only where this Python expression of m, the message, is true",
    ),
    flag("--once", help="exit after the first message"),
    argument(
        "--timeout", metavar="N", type=positive_float, help="exit after this number of seconds"
    ),
    flag("--include-message-info", "-i", help="show when and as which message it came"),
)
def echo_main(args: argparse.Namespace) -> None:
    """Print messages of a topic until --once, --timeout or an interrupt."""
    echo = Echo(args)
    with graph_node(args) as node:
        message_class = given_class(args.message_type) if args.message_type else None
        found = published_class(node, args.topic_name, args.spin_time, quiet=bool(message_class))
        message_class = message_class or found
        if message_class is None:
            raise RuntimeError("Could not determine the type for the passed topic")
        if is_overridden(args):
            profile = chosen_profile(args)
        else:
            profile = compatible_profile(node, args.topic_name, args.qos_profile)
        if args.timeout is not None:
            node.create_timer(args.timeout, lambda: echo.done.set_result(True))
        subscribe(node, message_class, echo, profile)
        rclpy.spin_until_future_complete(node, echo.done)


def subscribe(node: Node, message_class: Any, echo: Echo, profile: Any) -> None:
    """Subscribe to the topic, with reports of lost messages where the middleware makes them."""
    events = (
        None
        if echo.args.no_lost_messages
        else SubscriptionEventCallbacks(message_lost=echo.on_lost)
    )
    for event_callbacks in (events, None):
        try:
            node.create_subscription(
                message_class,
                echo.args.topic_name,
                echo.on_message,
                profile,
                event_callbacks=event_callbacks,
                raw=echo.args.raw,
            )
            return
        except UnsupportedEventTypeError:
            continue


def given_class(message_type: str) -> Any:
    """The class of the type on the command line."""
    try:
        return interface_class(message_type, "msg")
    except ValueError:
        raise RuntimeError("The passed message type is invalid") from None
