"""`ros2 node`: which nodes there are, and what each one publishes, subscribes and serves."""

import argparse
import sys

from rclpy.action import graph as action_graph
from rclpy.node import Node

from standin.arguments import ALL_NODES, NODE, argument, count_only, flag, takes
from standin.graph import NamesAndTypes, discover, graph_node, node_names, split_node_name


@takes(*NODE, ALL_NODES, count_only("nodes"))
def list_main(args: argparse.Namespace) -> None:
    """Print the names of the nodes in order."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        names = sorted(name.full_name for name in node_names(node, args.all))
    if args.count_nodes:
        print(len(names))
        return
    if len(set(names)) < len(names):
        print(
            "WARNING: Be aware that there are nodes in the graph that share an exact name, "
            "which can have unintended side effects.",
            file=sys.stderr,
        )
    for name in names:
        print(name)


@takes(
    *NODE,
    argument("node_name", help="full name of the node (e.g. '/talker')"),
    flag("--include-hidden", help="show hidden topics, services and actions as well"),
)
def info_main(args: argparse.Namespace) -> str | None:
    """Print everything that a node offers and uses."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        count = [name.full_name for name in node_names(node, args.include_hidden)].count(
            args.node_name
        )
        if count == 0:
            return f"Unable to find node '{args.node_name}'"
        if count > 1:
            print(
                f'There are {count} nodes in the graph with the exact name "{args.node_name}". '
                "You are seeing information about only one of them.",
                file=sys.stderr,
            )
        print(args.node_name)
        for title, endpoints in node_endpoints(node, *split_node_name(args.node_name)).items():
            shown = [
                (name, types)
                for name, types in endpoints
                if args.include_hidden or not is_hidden(name)
            ]
            print(f"  {title}:")
            print("\n".join(f"    {name}: {', '.join(types)}" for name, types in shown))
    return None


def node_endpoints(node: Node, name: str, namespace: str) -> dict[str, NamesAndTypes]:
    """Topics, services and actions of a node under the titles that they are printed with."""
    return {
        "Subscribers": node.get_subscriber_names_and_types_by_node(name, namespace),
        "Publishers": node.get_publisher_names_and_types_by_node(name, namespace),
        "Service Servers": node.get_service_names_and_types_by_node(name, namespace),
        "Service Clients": node.get_client_names_and_types_by_node(name, namespace),
        "Action Servers": action_graph.get_action_server_names_and_types_by_node(
            node, name, namespace
        ),
        "Action Clients": action_graph.get_action_client_names_and_types_by_node(
            node, name, namespace
        ),
    }


def is_hidden(name: str) -> bool:
    """Whether any part of a name begins with an underscore."""
    return any(part.startswith("_") for part in name.split("/"))
