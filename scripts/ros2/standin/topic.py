"""`ros2 topic`: which topics there are, who publishes and subscribes; the rest is apart."""

import argparse

from standin.arguments import (
    NODE,
    SHOW_TYPES,
    TOPIC_NAME,
    argument,
    count_only,
    flag,
    include_hidden,
    takes,
)
from standin.graph import discover, graph_node, print_found, print_names, print_types, topics

HIDDEN = include_hidden("topics", default=argparse.SUPPRESS)


@takes(
    *NODE,
    SHOW_TYPES,
    count_only("topics"),
    HIDDEN,
    flag("-v", "--verbose", help="show types and number of publishers and subscribers"),
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


@takes(
    *NODE,
    TOPIC_NAME,
    flag("-v", "--verbose", help="show every endpoint with its node, type, GUID and QoS"),
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


@takes(*NODE, TOPIC_NAME)
def type_main(args: argparse.Namespace) -> int:
    """Print the types of a topic; code 1 when there is no such topic."""
    return print_types(args, args.topic_name, lambda node: topics(node, hidden=True))


@takes(
    *NODE,
    argument("topic_type", help="type of the topics (e.g. 'std_msgs/msg/String')"),
    count_only("topics"),
    HIDDEN,
)
def find_main(args: argparse.Namespace) -> None:
    """Print the topics of a type."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        print_found(topics(node, args.include_hidden_topics), args.topic_type, args.count_topics)
