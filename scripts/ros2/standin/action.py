"""`ros2 action`: which actions there are, who serves and uses them, and sending a goal.

An interrupt cancels the goal.
"""

import argparse
import signal
from collections.abc import Callable
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action import graph as action_graph
from rclpy.node import Node

from standin.arguments import (
    NODE,
    SHOW_TYPES,
    argument,
    count_only,
    flag,
    given_values,
    takes,
    values,
)
from standin.graph import (
    POLL,
    NamesAndTypes,
    discover,
    expanded_name,
    graph_node,
    node_names,
    outcome,
    print_names,
    print_types,
)
from standin.messages import Shortening, fill, interface_class, load_values, to_yaml

ACTION_NAME = argument("action_name", help="name of the action (e.g. '/fibonacci')")
# Of a goal that is still pursued the status may be unknown: it can be told before the acceptance.
ENDED = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)
STATUS = {
    getattr(GoalStatus, f"STATUS_{name}"): name
    for name in ("ACCEPTED", "EXECUTING", "CANCELING", "SUCCEEDED", "CANCELED", "ABORTED")
}


@takes(*NODE, SHOW_TYPES, count_only("actions"))
def list_main(args: argparse.Namespace) -> None:
    """Print the actions of the graph."""
    with graph_node(args) as node:
        discover(node, args.spin_time)
        found = action_graph.get_action_names_and_types(node)
    print_names(found, args, args.count_actions)


@takes(*NODE, ACTION_NAME)
def type_main(args: argparse.Namespace) -> int:
    """Print the types of an action; code 1 when there is no such action."""
    return print_types(args, args.action_name, action_graph.get_action_names_and_types)


@takes(
    *NODE,
    ACTION_NAME,
    SHOW_TYPES,
    flag("-c", "--count", help="show only how many clients and servers there are"),
)
def info_main(args: argparse.Namespace) -> None:
    """Print which nodes call an action and which serve it."""
    with graph_node(args) as node:
        name = expanded_name(node, args.action_name)
        discover(node, args.spin_time)
        clients, servers = nodes_of_action(node, name)
    print(f"Action: {args.action_name}")
    for noun, nodes in (("clients", clients), ("servers", servers)):
        print(f"Action {noun}: {len(nodes)}")
        for full_name, types in [] if args.count else nodes:
            print(
                f"    {full_name} [{', '.join(types)}]" if args.show_types else f"    {full_name}"
            )


def nodes_of_action(node: Node, action: str) -> tuple[NamesAndTypes, NamesAndTypes]:
    """Full names of the clients and of the servers of an action, with the types they have."""
    clients: NamesAndTypes = []
    servers: NamesAndTypes = []
    for other in node_names(node, hidden=True):
        for nodes, ask in (
            (clients, action_graph.get_action_client_names_and_types_by_node),
            (servers, action_graph.get_action_server_names_and_types_by_node),
        ):
            try:
                offered = dict(ask(node, other.name, other.namespace))
            except RuntimeError:  # it has gone since it was listed
                continue
            if action in offered:
                nodes.append((other.full_name, offered[action]))
    return clients, servers


# ------------------------------------------------------------------ send_goal
@takes(
    ACTION_NAME,
    argument("action_type", help="type of the action (e.g. 'example_interfaces/action/Fibonacci')"),
    values("the goal's fields as YAML (e.g. '{order: 10}')", metavar="goal"),
    flag("-f", "--feedback", help="print feedback while the goal is pursued"),
)
def send_goal_main(args: argparse.Namespace) -> str | None:
    """Send a goal and print what becomes of it; a string is what went wrong."""
    try:
        action_class = interface_class(args.action_type, "action")
    except ValueError:
        raise RuntimeError("The passed action type is invalid") from None
    goal = action_class.Goal()
    fields = load_values(given_values(args))
    try:
        fill(goal, fields)
    except Exception as error:  # whatever the goal's own setters raise is the user's answer
        return f"Failed to populate message fields: {error!r}"
    name = f"_ros2cli_send_goal_{args.action_type.replace('/', '_')}"
    # At an interrupt the handlers of ROS would end the context before the goal is cancelled, and an
    # exception out of a handler of Python's own may get lost in the middle of rclpy.
    interrupts: list[int] = []
    with graph_node(args, name, handle_signals=False) as node:
        signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
        client = ActionClient(node, action_class, args.action_name)
        print("Waiting for an action server to become available...")
        spin_until(node, client.server_is_ready, interrupts)
        print(f"Sending goal:\n     {yaml_of(goal)}")
        accepted = client.send_goal_async(goal, print_feedback if args.feedback else None)
        spin_until(node, accepted.done, interrupts)
        handle = outcome(accepted, "sending goal")
        if not handle.accepted:
            print("Goal was rejected.")
            return None
        print(f"Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n")
        finished = handle.get_result_async()
        try:
            spin_until(node, finished.done, interrupts)
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second one ends this at once
            cancel(node, handle)
            raise
        result = outcome(finished, "getting result")
    print(f"Result:\n    {yaml_of(result.result)}")
    print(f"Goal finished with status: {STATUS.get(result.status, 'UNKNOWN')}")
    return None


def yaml_of(message: Any) -> str:
    """A message as YAML in full."""
    return to_yaml(message, Shortening())


def print_feedback(message: Any) -> None:
    """Print what the server says of its progress."""
    print(f"Feedback:\n    {yaml_of(message.feedback)}")


def spin_until(node: Node, is_done: Callable[[], bool], interrupts: list[int]) -> None:
    """Let the node work until something is done; KeyboardInterrupt where interrupts came first."""
    while not is_done():
        if interrupts:
            raise KeyboardInterrupt
        rclpy.spin_once(node, timeout_sec=POLL)


def cancel(node: Node, handle: Any) -> None:
    """Take a goal back that is still pursued; RuntimeError when the server will not have it."""
    if handle.status in ENDED:
        return
    print("Canceling goal...")
    answer = handle.cancel_goal_async()
    rclpy.spin_until_future_complete(node, answer)
    cancelled = outcome(answer, "canceling goal").goals_canceling
    if not cancelled:
        raise RuntimeError("Failed to cancel goal")
    if [each.goal_id for each in cancelled] != [handle.goal_id]:
        raise RuntimeError("Canceled goal with incorrect goal ID")
    print("Goal canceled.")
