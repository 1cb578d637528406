"""`ros2 topic pub`: publish a message from the command line."""

import argparse
import time
from typing import Any

import rclpy
from rclpy.node import Node

from standin.arguments import (
    OWN_NODE,
    TOPIC_NAME,
    argument,
    flag,
    given_values,
    non_negative_int,
    one_of,
    positive_float,
    takes,
    values,
)
from standin.graph import discover, graph_node
from standin.messages import fill, interface_class, load_values
from standin.qos import chosen_profile, qos_arguments

POLL = 0.1  # s


@takes(
    TOPIC_NAME,
    argument("message_type", help="type of the message (e.g. 'std_msgs/String')"),
    values("the message's fields as YAML (e.g. 'data: Hello World')"),
    argument(
        "-r",
        "--rate",
        metavar="N",
        type=positive_float,
        default=1.0,
        help="messages a second (default: 1)",
    ),
    argument(
        "-p",
        "--print",
        metavar="N",
        type=int,
        default=1,
        help="print every N-th message only (default: 1)",
    ),
    one_of(
        flag("-1", "--once", help="publish one message and exit"),
        argument(
            "-t",
            "--times",
            type=non_negative_int,
            default=0,
            help="publish this number of messages and exit",
        ),
    ),
    argument(
        "-w",
        "--wait-matching-subscriptions",
        type=non_negative_int,
        help="wait for this number of subscriptions (default: 1 with --once or --times, else 0)",
    ),
    argument(
        "--max-wait-time-secs",
        type=positive_float,
        help="give up waiting for them after this number of seconds",
    ),
    argument(
        "--keep-alive",
        metavar="N",
        type=positive_float,
        default=0.1,
        help="seconds to stay after the last message (default: 0.1)",
    ),
    argument("-n", "--node-name", help="name of the publishing node"),
    *qos_arguments("default"),
    *OWN_NODE,
)
def pub_main(args: argparse.Namespace) -> str | None:
    """Publish the number of messages asked for, or for ever; a string is what went wrong."""
    times = 1 if args.once else args.times
    awaited = args.wait_matching_subscriptions
    if awaited is None:
        awaited = int(times != 0)
    values_text = given_values(args)
    with graph_node(args, args.node_name) as node:
        try:
            message = interface_class(args.message_type, "msg")()
        except ValueError:
            raise RuntimeError("The passed message type is invalid") from None
        fields = load_values(values_text)
        if not isinstance(fields, dict):
            return "The passed value needs to be a dictionary in YAML format"
        publisher = node.create_publisher(type(message), args.topic_name, chosen_profile(args))
        if awaited == 0 and args.max_wait_time_secs is not None:
            return (
                "--max-wait-time-secs option is only effective "
                "with --wait-matching-subscriptions, --once or --times"
            )
        discover(
            node, args.spin_time, lambda: publisher.get_subscription_count() >= max(awaited, 1)
        )
        if not wait_for_subscriptions(publisher, awaited, args.max_wait_time_secs):
            return (
                f"Timed out waiting for subscribers: Expected {awaited} subcribers "
                f"but only got {publisher.get_subscription_count()} subscribers"
            )
        try:
            now_setters = fill(message, fields, expand_now=True)
        except Exception as error:  # whatever the message's own setters raise is the user's answer
            return f"Failed to populate field: {error}"
        print("publisher: beginning loop")
        publish(node, publisher, message, now_setters, args, times)
        time.sleep(args.keep_alive)
    return None


def wait_for_subscriptions(publisher: Any, count: int, timeout: float | None) -> bool:
    """Wait until so many subscriptions match, saying so once a second.

    False when the timeout in seconds passed first.
    """
    polls = 0
    while publisher.get_subscription_count() < count:
        if polls % 10 == 0:
            print(f"Waiting for at least {count} matching subscription(s)...")
        if timeout is not None and polls * POLL >= timeout:
            return False
        polls += 1
        time.sleep(POLL)
    return True


def publish(
    node: Node,
    publisher: Any,
    message: Any,
    now_setters: list[Any],
    args: argparse.Namespace,
    times: int,
) -> None:
    """Publish at the rate that args say, so many times (0: for ever)."""
    sent = 0

    def send() -> None:
        nonlocal sent
        stamp = node.get_clock().now().to_msg()
        for set_now in now_setters:
            set_now(stamp)
        sent += 1
        if args.print and sent % args.print == 0:
            print(f"publishing #{sent}: {message!r}\n")
        publisher.publish(message)

    send()
    if times == 1:
        return
    timer = node.create_timer(1.0 / args.rate, send)
    while times == 0 or sent < times:
        rclpy.spin_once(node)
    node.destroy_timer(timer)
