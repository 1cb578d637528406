"""`ros2 topic`: which topics there are, who publishes and subscribes; echo, hz, pub are apart."""

import argparse

from standin.graph import add_node_arguments, discover, graph_node, print_names, topics
from standin.topic_echo import add_echo_arguments, echo_main
from standin.topic_hz import add_hz_arguments, hz_main
from standin.topic_pub import add_pub_arguments, pub_main

__all__ = [
    "add_echo_arguments",
    "add_hz_arguments",
    "add_pub_arguments",
    "echo_main",
    "hz_main",
    "pub_main",
]


def add_shared_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments between `topic` and the verb."""
    parser.add_argument(
        "--include-hidden-topics", action="store_true", help="consider hidden topics as well"
    )


def add_list_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `topic list`."""
    add_node_arguments(parser)
    parser.add_argument("-t", "--show-types", action="store_true", help="show the types as well")
    parser.add_argument(
        "-c", "--count-topics", action="store_true", help="show only how many there are"
    )
    parser.add_argument(
        "--include-hidden-topics",
        action="store_true",
        default=argparse.SUPPRESS,
        help="consider hidden topics as well",
    )
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="show types and number of publishers and subscribers",
    )


def list_main(args: argparse.Namespace) -> None:
    """Print the topics of the graph."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        found = topics(node, args.include_hidden_topics)
        if not args.verbose or args.count_topics:
            print_names(found, args, args.count_topics)
            return
        publishers = [(name, types, node.count_publishers(name)) for name, types in found]
        subscribers = [(name, types, node.count_subscribers(name)) for name, types in found]
    for title, noun, counted in (
        ("Published", "publisher", publishers),
        ("Subscribed", "subscriber", subscribers),
    ):
        print(f"{title} topics:")
        for name, types, count in counted:
            if count:
                print(f" * {name} [{', '.join(types)}] {count} {noun}{'s' if count > 1 else ''}")
        print()


def add_info_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `topic info`."""
    add_node_arguments(parser)
    parser.add_argument("topic_name", help="name of the topic (e.g. '/chatter')")
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="show every endpoint with its node, type, GUID and QoS",
    )


def info_main(args: argparse.Namespace) -> str | None:
    """Print type, publishers and subscriptions of a topic."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        types = dict(topics(node, hidden=True)).get(args.topic_name)
        if types is None:
            return f"Unknown topic '{args.topic_name}'"
        end = "\n\n" if args.verbose else "\n"
        print(f"Type: {types[0] if len(types) == 1 else types}", end=end)
        for noun, count, endpoints in (
            ("Publisher", node.count_publishers, node.get_publishers_info_by_topic),
            ("Subscription", node.count_subscribers, node.get_subscriptions_info_by_topic),
        ):
            print(f"{noun} count: {count(args.topic_name)}", end=end)
            if args.verbose:
                for endpoint in endpoints(args.topic_name):
                    print(endpoint, end=end)
    return None


def add_type_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `topic type`."""
    add_node_arguments(parser)
    parser.add_argument("topic_name", help="name of the topic (e.g. '/chatter')")


def type_main(args: argparse.Namespace) -> int:
    """Print the types of a topic; code 1 when there is no such topic."""
    with graph_node(args) as node:
        discover(node, args.spin_time, lambda: args.topic_name in dict(topics(node, hidden=True)))
        types = dict(topics(node, hidden=True)).get(args.topic_name, [])
    for name in types:
        print(name)
    return 0 if types else 1
