"""The node that looks at the graph, and what it sees there."""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import rclpy
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.validate_full_topic_name import validate_full_topic_name

NamesAndTypes = list[tuple[str, list[str]]]

POLL = 0.05  # s
SETTLING = 0.2  # s


class NodeName(NamedTuple):
    """A node of the graph: base name, namespace, and both joined."""

    name: str
    namespace: str
    full_name: str


@contextmanager
def graph_node(
    args: argparse.Namespace, name: str | None = None, handle_signals: bool = True
) -> Iterator[Node]:
    """A node of this command's own, gone on exit; it has yet to discover the graph.

    Unless handle_signals, an interrupt is Python's alone and leaves the node usable.
    """
    handlers = SignalHandlerOptions.ALL if handle_signals else SignalHandlerOptions.NO
    rclpy.init(args=[], signal_handler_options=handlers)
    node = rclpy.create_node(
        name or f"_ros2cli_{os.getpid()}",
        start_parameter_services=False,
        parameter_overrides=[
            Parameter("use_sim_time", value=getattr(args, "use_sim_time", False)),
            Parameter("start_type_description_service", value=False),
        ],
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        yield node
    except RuntimeError:
        if rclpy.ok():
            raise
        raise ExternalShutdownException from None  # a signal came between two waits
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def discover(node: Node, spin_time: float, found: Callable[[], bool] | None = None) -> None:
    """Give the node spin_time seconds to see the graph, less when `found` comes true before."""
    deadline = time.monotonic() + spin_time
    while (left := deadline - time.monotonic()) > 0.0:
        rclpy.spin_once(node, timeout_sec=min(left, POLL))
        if found is not None and found():
            # What belongs to the same node is announced together, but not at the same instant.
            found = None
            deadline = min(deadline, time.monotonic() + SETTLING)


def wait_until(predicate: Callable[[], bool], timeout: float, period: float = POLL) -> bool:
    """Whether the predicate came true within a timeout in seconds (negative: wait for ever)."""
    deadline = time.monotonic() + (timeout if timeout >= 0.0 else float("inf"))
    while not predicate():
        if time.monotonic() > deadline:
            return predicate()
        time.sleep(period)
    return True


def absolute(node_name: str) -> str:
    """A node's name with its leading slash."""
    return node_name if node_name.startswith("/") else f"/{node_name}"


def split_node_name(full_name: str) -> tuple[str, str]:
    """Base name and namespace of a node's full name."""
    namespace, _, name = absolute(full_name).rpartition("/")
    return name, namespace or "/"


def node_names(node: Node, hidden: bool) -> list[NodeName]:
    """Every node of the graph, in the order of discovery, duplicates included."""
    return [
        NodeName(name, namespace, f"{namespace.rstrip('/')}/{name}")
        for name, namespace in node.get_node_names_and_namespaces()
        if hidden or (name and not name.startswith("_"))
    ]


def node_exists(node: Node, full_name: str, hidden: bool, timeout: float) -> bool:
    """Whether a node of this name is, or comes, into the graph within the timeout in seconds."""
    return wait_until(
        lambda: full_name in {other.full_name for other in node_names(node, hidden)}, timeout
    )


def topics(node: Node, hidden: bool) -> NamesAndTypes:
    """Topics of the graph with their types."""
    return visible(node.get_topic_names_and_types(), hidden)


def services(node: Node, hidden: bool) -> NamesAndTypes:
    """Services of the graph with their types."""
    return visible(node.get_service_names_and_types(), hidden)


def visible(names_and_types: NamesAndTypes, hidden: bool) -> NamesAndTypes:
    """Without those that ROS takes for hidden, unless asked for."""
    return [
        (name, types)
        for name, types in names_and_types
        if hidden or not topic_or_service_is_hidden(name)
    ]


def print_names(names_and_types: NamesAndTypes, args: argparse.Namespace, count_only: bool) -> None:
    """The list that the verbs called `list` print."""
    if count_only:
        print(len(names_and_types))
        return
    for name, types in names_and_types:
        print(f"{name} [{', '.join(types)}]" if args.show_types else name)


def print_found(names_and_types: NamesAndTypes, wanted: str, count_only: bool) -> None:
    """What the verbs called `find` print: names, or the number, of those of the type wanted."""
    found = [name for name, types in names_and_types if wanted in types]
    for line in [len(found)] if count_only else found:
        print(line)


def print_types(args: argparse.Namespace, name: str, look: Callable[[Node], NamesAndTypes]) -> int:
    """What the verbs called `type` do: print the types of a name; code 1 when it is not there."""

    def types() -> list[str]:
        return dict(look(node)).get(name, [])

    with graph_node(args) as node:
        discover(node, args.spin_time, lambda: bool(types()))
        found = types()
    for each in found:
        print(each)
    return 0 if found else 1


def expanded_name(node: Node, name: str) -> str:
    """The full name of a topic or an action; RuntimeError when it is not valid."""
    try:
        full = expand_topic_name(name, node.get_name(), node.get_namespace())
        validate_full_topic_name(full)
    except (ValueError, InvalidTopicNameException) as error:
        raise RuntimeError(error) from None
    return full


def call(node: Node, client: Any, request: Any) -> Any:
    """The response of a service that is ready, or RuntimeError."""
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    return outcome(future, "calling service")


def outcome(future: Future, doing: str) -> Any:
    """The result of a call that is over; RuntimeError when it failed."""
    if future.result() is None:
        raise RuntimeError(f"Exception while {doing}: {future.exception()!r}")
    return future.result()
