"""`ros2 param`: read and write the parameters of running nodes."""

import argparse
import re
import sys
from collections.abc import Callable
from typing import Any

import rclpy
import yaml
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from standin.graph import (
    NodeName,
    absolute,
    add_hidden_nodes_argument,
    add_node_arguments,
    add_timeout_argument,
    discover,
    graph_node,
    node_exists,
    node_names,
)
from standin.param_text import description, type_label, value_label

SERVICE_TIMEOUT = 5.0  # s


def add_shared_arguments(parser: argparse.ArgumentParser) -> None:
    """`param` itself takes no arguments."""


def add_common(parser: argparse.ArgumentParser, timeout: bool = True) -> None:
    """Arguments of every verb."""
    add_node_arguments(parser)
    add_hidden_nodes_argument(parser)
    if timeout:
        add_timeout_argument(parser)


class ServiceTimeout(RuntimeError):
    """A node's parameter services did not appear."""


def ask(node: Node, node_name: str, question: Callable[[AsyncParameterClient], Any]) -> Any:
    """The response of a node's parameter service; RuntimeError when there is none."""
    client = AsyncParameterClient(node, node_name)
    if not client.wait_for_services(timeout_sec=SERVICE_TIMEOUT):
        raise ServiceTimeout(
            f"Wait for service timed out waiting for parameter services for node {node_name}"
        )
    future = question(client)
    rclpy.spin_until_future_complete(node, future)
    if future.result() is None:
        raise RuntimeError(
            f"Exception while calling service of node {node_name}: {future.exception()}"
        )
    return future.result()


def known(node: Node, args: argparse.Namespace) -> bool:
    """Whether the node that the command is about is there."""
    patience = args.spin_time + args.timeout
    return node_exists(node, absolute(args.node_name), args.include_hidden_nodes, patience)


def node_named(node: Node, args: argparse.Namespace) -> bool:
    """Whether the node that the command names, if it does, is there now."""
    names = {other.full_name for other in node_names(node, args.include_hidden_nodes)}
    return bool(args.node_name) and absolute(args.node_name) in names


# ------------------------------------------------------------------ get, set
def add_get_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `param get`."""
    add_common(parser)
    parser.add_argument("node_name", help="name of the node")
    parser.add_argument("parameter_name", help="name of the parameter")
    parser.add_argument("--hide-type", action="store_true", help="print the value alone")


def get_main(args: argparse.Namespace) -> str | None:
    """Print a parameter with its type."""
    with graph_node(args) as node:
        if not known(node, args):
            return "Node not found"
        response = ask(
            node, args.node_name, lambda client: client.get_parameters([args.parameter_name])
        )
    if not response.values:
        return "Parameter not set"
    value: ParameterValue = response.values[0]
    shown = parameter_value_to_python(value)
    if args.hide_type:
        print(shown)
    elif value.type == ParameterType.PARAMETER_NOT_SET:
        print(value_label(value.type))
    else:
        print(value_label(value.type), shown)
    return None


def add_set_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `param set`."""
    add_common(parser)
    parser.add_argument("node_name", help="name of the node")
    parser.add_argument("parameter_name", help="name of the parameter")
    parser.add_argument("value", help="the new value, as YAML")


def set_main(args: argparse.Namespace) -> str | None:
    """Set a parameter and say what the node answered."""
    parameter = ParameterMessage(name=args.parameter_name, value=get_parameter_value(args.value))
    with graph_node(args) as node:
        if not known(node, args):
            return "Node not found"
        (result,) = ask(
            node, args.node_name, lambda client: client.set_parameters([parameter])
        ).results
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"Set parameter successful{reason}")
    else:
        print(f"Setting parameter failed{reason}", file=sys.stderr)
    return None


# ------------------------------------------------------------------ list, describe, dump
def add_list_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `param list`."""
    add_common(parser, timeout=False)
    parser.add_argument("node_name", nargs="?", help="name of the node (default: all nodes)")
    parser.add_argument(
        "--filter", nargs=1, help="only parameters that this regular expression matches"
    )
    parser.add_argument(
        "--param-prefixes", nargs="+", default=[], help="only parameters with these prefixes"
    )
    parser.add_argument("--param-type", action="store_true", help="show the types as well")


def list_main(args: argparse.Namespace) -> str | None:
    """Print the parameters of one node or of all."""
    with graph_node(args) as node:
        discover(node, args.spin_time, lambda: node_named(node, args))
        nodes = sorted(node_names(node, args.include_hidden_nodes))
        if args.node_name:
            nodes = [other for other in nodes if other.full_name == absolute(args.node_name)]
            if not nodes:
                return "Node not found"
        for other in nodes:
            list_one(node, other, args)
    return None


def list_one(node: Node, other: NodeName, args: argparse.Namespace) -> None:
    """Print the parameters of one node."""
    try:
        response = ask(
            node,
            other.full_name,
            lambda client: client.list_parameters(prefixes=args.param_prefixes),
        )
    except ServiceTimeout as error:
        print(error)
        return
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return
    pattern = re.compile(args.filter[0]) if args.filter else None
    names = sorted(name for name in response.result.names if pattern is None or pattern.match(name))
    if names and not args.node_name:
        print(f"{other.full_name}:")
    types = {}
    if args.param_type and names:
        described = ask(node, other.full_name, lambda client: client.describe_parameters(names))
        types = {each.name: f" (type: {type_label(each.type)})" for each in described.descriptors}
    for name in names:
        print(f"  {name}{types.get(name, '')}")


def add_describe_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `param describe`."""
    add_common(parser)
    parser.add_argument("node_name", help="name of the node")
    parser.add_argument("parameter_names", nargs="+", help="names of the parameters")


def describe_main(args: argparse.Namespace) -> str | None:
    """Print type, description and range of parameters."""
    with graph_node(args) as node:
        if not known(node, args):
            return "Node not found"
        response = ask(
            node, args.node_name, lambda client: client.describe_parameters(args.parameter_names)
        )
    for descriptor in response.descriptors:
        print(description(descriptor))
    return None


def all_values(node: Node, node_name: str, names: list[str]) -> dict[str, ParameterValue]:
    """Values by name, without the unset ones (a single one makes rclpy withhold all)."""

    def values(some: list[str]) -> list[ParameterValue]:
        return list(ask(node, node_name, lambda client: client.get_parameters(some)).values)

    together = values(names)
    if len(together) == len(names):
        return dict(zip(names, together, strict=True))
    return {name: value for name in names for value in values([name])}


def add_dump_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `param dump`."""
    add_common(parser)
    parser.add_argument("node_name", help="name of the node")


def dump_main(args: argparse.Namespace) -> str | None:
    """Print all parameters of a node as a parameter file."""
    name = absolute(args.node_name)
    with graph_node(args) as node:
        if not known(node, args):
            return "Node not found"
        try:
            names = sorted(ask(node, name, lambda client: client.list_parameters()).result.names)
            values = all_values(node, name, names)
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return None
    parameters: dict[str, Any] = {}
    for dotted, value in values.items():
        *groups, leaf = dotted.split(".")
        table = parameters
        for group in groups:
            table = table.setdefault(group, {})
        table[leaf] = parameter_value_to_python(value)
    print(yaml.dump({name: {"ros__parameters": parameters}}, default_flow_style=False))
    return None
