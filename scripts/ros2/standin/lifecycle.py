"""`ros2 lifecycle`: states of lifecycle nodes and transitions between them."""

import argparse
import sys
from typing import Any

import rclpy
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rclpy.node import Node

from standin.arguments import (
    ALL_NODES,
    NODE,
    NODE_NAME,
    argument,
    count_only,
    flag,
    include_hidden,
    takes,
)
from standin.graph import absolute, call, discover, graph_node, node_names, services


def lifecycle_nodes(node: Node, hidden: bool) -> set[str]:
    """Full names of the nodes that serve a lifecycle."""
    stateful = {
        name for name, types in services(node, hidden) if "lifecycle_msgs/srv/GetState" in types
    }
    return {
        other.full_name
        for other in node_names(node, hidden)
        if f"{other.full_name}/get_state" in stateful
    }


def discovered_nodes(node: Node, args: argparse.Namespace) -> set[str]:
    """The lifecycle nodes that are found in the time for discovery; less when the one wanted is."""

    def found() -> bool:
        names = lifecycle_nodes(node, args.include_hidden_nodes)
        return bool(args.node_name) and absolute(args.node_name) in names

    discover(node, args.spin_time, found)
    return lifecycle_nodes(node, args.include_hidden_nodes)


def ask(node: Node, node_name: str, service_class: Any, service: str, request: Any = None) -> Any:
    """The response of a node's lifecycle service, as soon as that is there.

    Raises RuntimeError when the call fails.
    """
    client = node.create_client(service_class, f"{node_name}/{service}")
    while rclpy.ok() and not client.service_is_ready():
        rclpy.spin_once(node, timeout_sec=0.1)
    try:
        return call(node, client, request or service_class.Request())
    except RuntimeError as error:
        raise RuntimeError(
            f"Exception while calling service of node '{node_name}': {error}"
        ) from None


# ------------------------------------------------------------------ get, nodes
@takes(
    *NODE,
    argument("node_name", nargs="?", help="name of the node (default: all lifecycle nodes)"),
    include_hidden("nodes"),
)
def get_main(args: argparse.Namespace) -> str | None:
    """Print the state of one node or of all."""
    with graph_node(args) as node:
        names = discovered_nodes(node, args)
        if args.node_name:
            if absolute(args.node_name) not in names:
                return "Node not found"
            names = {absolute(args.node_name)}
        for name in sorted(names):
            state = ask(node, name, GetState, "get_state").current_state
            print(f"{'' if args.node_name else f'{name}: '}{state.label} [{state.id}]")
    return None


@takes(*NODE, ALL_NODES, count_only("nodes"))
def nodes_main(args: argparse.Namespace) -> None:
    """Print the names of the lifecycle nodes in order."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        names = lifecycle_nodes(node, args.all)
    print("\n".join([str(len(names))] if args.count_nodes else sorted(names)))


# ------------------------------------------------------------------ list, set
@takes(
    *NODE,
    NODE_NAME,
    include_hidden("nodes"),
    flag("-a", "--all", help="show the transitions of all states"),
)
def list_main(args: argparse.Namespace) -> str | None:
    """Print the transitions from a node's present state, or all."""
    with graph_node(args) as node:
        name = absolute(args.node_name)
        if name not in discovered_nodes(node, args):
            return "Node not found"
        service = "get_transition_graph" if args.all else "get_available_transitions"
        for each in ask(node, name, GetAvailableTransitions, service).available_transitions:
            print(
                f"- {each.transition.label} [{each.transition.id}]\n"
                f"\tStart: {each.start_state.label}\n\tGoal: {each.goal_state.label}"
            )
    return None


@takes(
    *NODE,
    NODE_NAME,
    include_hidden("nodes"),
    argument("transition", help="the transition, by label or number"),
)
def set_main(args: argparse.Namespace) -> str | None:
    """Make a node change its state."""
    with graph_node(args) as node:
        name = absolute(args.node_name)
        if name not in discovered_nodes(node, args):
            return "Node not found"
        available = ask(
            node, name, GetAvailableTransitions, "get_available_transitions"
        ).available_transitions
        transitions = [each.transition for each in available]
        by_name = {str(each.id): each for each in transitions} | {
            each.label: each for each in transitions
        }
        if args.transition not in by_name:
            return "Unknown transition requested, available ones are:" + "".join(
                f"\n- {each.label} [{each.id}]" for each in transitions
            )
        request = ChangeState.Request(transition=by_name[args.transition])
        if ask(node, name, ChangeState, "change_state", request).success:
            print("Transitioning successful")
        else:
            print("Transitioning failed", file=sys.stderr)
    return None
