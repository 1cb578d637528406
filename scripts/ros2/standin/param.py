"""`ros2 param`: read and write the parameters of running nodes, dump them and load a file."""

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
import yaml
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import (
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)
from rclpy.parameter_client import AsyncParameterClient

from standin.arguments import (
    NODE,
    NODE_NAME,
    TIMEOUT,
    argument,
    flag,
    include_hidden,
    takes,
)
from standin.graph import NodeName, absolute, discover, graph_node, node_exists, node_names

SERVICE_TIMEOUT = 5.0  # s
OF_ONE_NODE = (*NODE, include_hidden("nodes"), TIMEOUT, NODE_NAME)
"""Arguments of the verbs that are about one node."""
PARAMETER_NAME = argument("parameter_name", help="name of the parameter")
TYPES = {  # code: name of the type, what precedes a value of it
    ParameterType.PARAMETER_NOT_SET: ("not set", "Parameter not set."),
    ParameterType.PARAMETER_BOOL: ("boolean", "Boolean value is:"),
    ParameterType.PARAMETER_INTEGER: ("integer", "Integer value is:"),
    ParameterType.PARAMETER_DOUBLE: ("double", "Double value is:"),
    ParameterType.PARAMETER_STRING: ("string", "String value is:"),
    ParameterType.PARAMETER_BYTE_ARRAY: ("byte array", "Byte values are:"),
    ParameterType.PARAMETER_BOOL_ARRAY: ("boolean array", "Boolean values are:"),
    ParameterType.PARAMETER_INTEGER_ARRAY: ("integer array", "Integer values are:"),
    ParameterType.PARAMETER_DOUBLE_ARRAY: ("double array", "Double values are:"),
    ParameterType.PARAMETER_STRING_ARRAY: ("string array", "String values are:"),
}


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


@contextmanager
def named_node(args: argparse.Namespace) -> Iterator[Node]:
    """As `graph_node`, when the node that the command is about is there; else RuntimeError."""
    patience = args.spin_time + args.timeout
    with graph_node(args) as node:
        if not node_exists(node, absolute(args.node_name), args.include_hidden_nodes, patience):
            raise RuntimeError("Node not found")
        yield node


def print_result(result: SetParametersResult, success: str, failure: str) -> None:
    """Print success, or failure to stderr, with the reason if the node gave one."""
    text = success if result.successful else failure
    reason = f": {result.reason}" if result.reason else ""
    print(f"{text}{reason}", file=sys.stdout if result.successful else sys.stderr)


def node_named(node: Node, args: argparse.Namespace) -> bool:
    """Whether the node that the command names, if it does, is there now."""
    names = {other.full_name for other in node_names(node, args.include_hidden_nodes)}
    return bool(args.node_name) and absolute(args.node_name) in names


# ------------------------------------------------------------------ get, set, delete
@takes(*OF_ONE_NODE, PARAMETER_NAME, flag("--hide-type", help="print the value alone"))
def get_main(args: argparse.Namespace) -> str | None:
    """Print a parameter with its type."""
    with named_node(args) as node:
        response = ask(
            node, args.node_name, lambda client: client.get_parameters([args.parameter_name])
        )
    if not response.values:
        return "Parameter not set"
    value: ParameterValue = response.values[0]
    shown = parameter_value_to_python(value)
    _, label = TYPES[value.type]
    if args.hide_type:
        print(shown)
    elif value.type == ParameterType.PARAMETER_NOT_SET:
        print(label)
    else:
        print(label, shown)
    return None


@takes(*OF_ONE_NODE, PARAMETER_NAME, argument("value", help="the new value, as YAML"))
def set_main(args: argparse.Namespace) -> None:
    """Set a parameter and say what the node answered."""
    value = get_parameter_value(args.value)
    set_one(args, value, "Set parameter successful", "Setting parameter failed")


def set_one(args: argparse.Namespace, value: ParameterValue, success: str, failure: str) -> None:
    """Send one parameter and say what the node answered."""
    parameter = ParameterMessage(name=args.parameter_name, value=value)
    with named_node(args) as node:
        (result,) = ask(
            node, args.node_name, lambda client: client.set_parameters([parameter])
        ).results
    print_result(result, success, failure)


@takes(*OF_ONE_NODE, PARAMETER_NAME)
def delete_main(args: argparse.Namespace) -> None:
    """Take a parameter away (a node allows that where the parameter's type may change)."""
    unset = ParameterValue(type=ParameterType.PARAMETER_NOT_SET)
    set_one(args, unset, "Deleted parameter successfully", "Deleting parameter failed")


# ------------------------------------------------------------------ list, describe
@takes(
    *NODE,
    include_hidden("nodes"),
    argument("node_name", nargs="?", help="name of the node (default: all nodes)"),
    argument("--filter", nargs=1, help="only parameters that this regular expression matches"),
    argument("--param-prefixes", nargs="+", default=[], help="only parameters with these prefixes"),
    flag("--param-type", help="show the types as well"),
)
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
        types = {each.name: f" (type: {TYPES[each.type][0]})" for each in described.descriptors}
    for name in names:
        print(f"  {name}{types.get(name, '')}")


@takes(*OF_ONE_NODE, argument("parameter_names", nargs="+", help="names of the parameters"))
def describe_main(args: argparse.Namespace) -> None:
    """Print type, description and range of parameters."""
    with named_node(args) as node:
        response = ask(
            node, args.node_name, lambda client: client.describe_parameters(args.parameter_names)
        )
    for descriptor in response.descriptors:
        print(description(descriptor))


def description(descriptor: Any) -> str:
    """A parameter's name, type, description and constraints, over several lines."""
    lines = [f"Parameter name: {descriptor.name}", f"  Type: {TYPES[descriptor.type][0]}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    lines.append("  Constraints:")
    if descriptor.read_only:
        lines.append("    Read only: true")
    for limits in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
        lines += [f"    Min value: {limits.from_value}", f"    Max value: {limits.to_value}"]
        if limits.step:
            lines.append(f"    Step: {limits.step}")
    if descriptor.additional_constraints:
        lines.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return "\n".join(lines)


# ------------------------------------------------------------------ dump, load
def all_values(node: Node, node_name: str, names: list[str]) -> dict[str, ParameterValue]:
    """Values by name, without the unset ones (a single one makes rclpy withhold all)."""

    def values(some: list[str]) -> list[ParameterValue]:
        return list(ask(node, node_name, lambda client: client.get_parameters(some)).values)

    together = values(names)
    if len(together) == len(names):
        return dict(zip(names, together, strict=True))
    return {name: value for name in names for value in values([name])}


@takes(*OF_ONE_NODE)
def dump_main(args: argparse.Namespace) -> None:
    """Print all parameters of a node as a parameter file."""
    name = absolute(args.node_name)
    with named_node(args) as node:
        try:
            names = sorted(ask(node, name, lambda client: client.list_parameters()).result.names)
            values = all_values(node, name, names)
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return
    parameters: dict[str, Any] = {}
    for dotted, value in values.items():
        *groups, leaf = dotted.split(".")
        table = parameters
        for group in groups:
            table = table.setdefault(group, {})
        table[leaf] = parameter_value_to_python(value)
    print(yaml.dump({name: {"ros__parameters": parameters}}, default_flow_style=False))


@takes(
    *OF_ONE_NODE,
    argument("parameter_file", help="parameter file, as `ros2 param dump` prints it"),
    flag("--no-use-wildcard", help="leave out what the file has for all nodes (/**)"),
)
def load_main(args: argparse.Namespace) -> None:
    """Set what a file holds, of whichever node, on the node; say what the node answered to each."""
    with named_node(args) as node:
        parameters = file_parameters(args.parameter_file, not args.no_use_wildcard)
        results = ask(
            node, args.node_name, lambda client: client.set_parameters(parameters)
        ).results
    for parameter, result in zip(parameters, results, strict=True):
        asked = f"Set parameter {parameter.name}"
        print_result(result, f"{asked} successful", f"{asked} failed")


def file_parameters(path: str, wildcard: bool) -> list[ParameterMessage]:
    """The parameters in a file; RuntimeError when there are none to be read."""
    try:
        return list(parameter_dict_from_yaml_file(path, wildcard).values())
    except OSError as error:
        raise RuntimeError(f"{path}: {error.strerror}") from None
    except (AttributeError, TypeError, yaml.YAMLError) as error:
        raise RuntimeError(f"{path}: not a parameter file: {error}") from None
