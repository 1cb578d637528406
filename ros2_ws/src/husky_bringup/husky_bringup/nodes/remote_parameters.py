"""Parameters of all nodes, read and set from outside, by full names such as `/plant.terrain`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from husky_bringup.node_parameter import (
    NodeParameter,
    check_text,
    is_of_every_node,
    make_node_parameter,
    to_python,
)
from husky_bringup.nodes.service_calls import CallError, ServiceCalls
from husky_bringup.nodes.topic_search import EVERYTHING, is_wanted

_LIST = "/list_parameters"
_LIST_TYPE = "rcl_interfaces/srv/ListParameters"
_UNSET = ParameterType.PARAMETER_NOT_SET
_NUMBERS = {
    Parameter.Type.INTEGER: int,
    Parameter.Type.INTEGER_ARRAY: int,
    Parameter.Type.DOUBLE: float,
    Parameter.Type.DOUBLE_ARRAY: float,
}


class RemoteParameters:
    """Reads and sets parameters for any thread but the node's, which it waits for."""

    def __init__(self, node: Node, calls: ServiceCalls):
        """Look at the graph through a node, call through its calls."""
        self._node, self._calls = node, calls

    def nodes(self) -> list[str]:
        """Return the full names of the robot's nodes that have parameters, without this one."""
        own, namespace = self._node.get_fully_qualified_name(), self._node.get_namespace()
        found = [
            name.removesuffix(_LIST)
            for name, types in self._node.get_service_names_and_types()
            if name.endswith(_LIST)
            and types == [_LIST_TYPE]
            and is_wanted(name, (EVERYTHING,), namespace)
        ]
        return sorted(name for name in found if name != own)

    def read(self, names: Sequence[str] = ()) -> dict[str, Any]:
        """Return values by full names, of parameters that have one, of nodes that answer.

        Args:
            names: of parameters; all of all nodes when there are none.
        """
        return {name: to_python(value) for name, value in self._messages(names).items()}

    def describe(self, node: str) -> list[NodeParameter]:
        """Return the parameters of a node in the order of their declaration.

        Left out are those that every node has.

        Args:
            node: its full name.

        Raises:
            CallError: it is not there, or does not answer.
        """
        if node not in self.nodes():
            raise CallError(f"{node}: is not there")
        names = [name for name in self._names(node) if not is_of_every_node(name)]
        described = self._ask(node, "describe_parameters", DescribeParameters, names)
        types = self._ask(node, "get_parameter_types", GetParameterTypes, names)
        kinds = dict(zip(names, types.result().types, strict=False))
        # One without a value would take those of all others with it.
        with_value = [name for name, kind in kinds.items() if kind != _UNSET]
        read = self._ask(node, "get_parameters", GetParameters, with_value)
        values = dict(zip(with_value, read.result().values, strict=False))
        descriptors = {each.name: each for each in described.result().descriptors}
        if not set(names) == set(kinds) == set(descriptors) or len(values) < len(with_value):
            raise CallError(f"{node}: its parameters change just now")
        return [
            make_node_parameter(
                descriptors[name], to_python(values[name]) if name in values else None
            )
            for name in names
        ]

    def write(self, values: Mapping[str, Any]) -> list[str]:
        """Set parameters; return why some of them have not been set, a line each.

        Args:
            values: by full names; a whole number will do where a float is wanted, and the other
                way round, as JSON knows no difference.
        """
        current, refused = self._messages(list(values)), []
        calls: dict[str, Future[Any]] = {}
        for name, value in values.items():
            node, _, parameter = name.partition(".")
            if name not in current:
                refused.append(f"there is no parameter {name}")
                continue
            try:
                wanted = to_parameter(parameter, current[name].type, value)
            except ValueError as error:
                refused.append(f"{name}: {error}")
                continue
            request = SetParameters.Request(parameters=[wanted.to_parameter_msg()])
            calls[name] = self._calls.call(f"{node}/set_parameters", SetParameters, request)
        for name, call in calls.items():
            try:
                result = call.result().results[0]
            except (CallError, IndexError) as error:
                refused.append(f"{name}: {error}")
                continue
            if not result.successful:
                refused.append(f"{name}: {result.reason}")
        return refused

    def _names(self, node: str) -> list[str]:
        request = ListParameters.Request()
        listed = self._calls.call(f"{node}{_LIST}", ListParameters, request).result()
        return list(listed.result.names)

    def _ask(self, node: str, service: str, kind: Any, names: Sequence[str]) -> Future[Any]:
        return self._calls.call(f"{node}/{service}", kind, kind.Request(names=names))

    def _messages(self, names: Sequence[str]) -> dict[str, ParameterValue]:
        known = self.nodes()
        asked: dict[str, list[str]] = {} if names else self._lists(known)
        for name in names:
            node, _, parameter = name.partition(".")
            if node in known:
                asked.setdefault(node, []).append(parameter)
        calls = {
            node: self._calls.call(
                f"{node}/get_parameters", GetParameters, GetParameters.Request(names=wanted)
            )
            for node, wanted in asked.items()
            if wanted
        }
        found: dict[str, ParameterValue] = {}
        for node, call in calls.items():
            answer = _answer(call)
            if answer is not None:  # a node leaves out all when one is unknown to it
                pairs = zip(asked[node], answer.values, strict=False)
                found |= {f"{node}.{name}": value for name, value in pairs}
        return {name: value for name, value in found.items() if value.type != _UNSET}

    def _lists(self, nodes: Sequence[str]) -> dict[str, list[str]]:
        """Return the names of the parameters of nodes; those that do not answer have none."""
        calls = {
            node: self._calls.call(f"{node}{_LIST}", ListParameters, ListParameters.Request())
            for node in nodes
        }
        answers = {node: _answer(call) for node, call in calls.items()}
        return {node: list(each.result.names) for node, each in answers.items() if each}


def to_parameter(name: str, kind: int, value: Any) -> Parameter:
    """Return a parameter with a value from outside.

    Args:
        name: of the parameter.
        kind: one of `ParameterType`.
        value: of that kind, or a number that is the same in it.

    Raises:
        ValueError: it is of another kind.
    """
    wanted = Parameter.Type(kind)
    number = _NUMBERS.get(wanted)
    if number is not None:
        many = isinstance(value, list)
        value = [_as(number, each) for each in value] if many else _as(number, value)
    if not wanted.check(value):
        raise ValueError(f"{value!r} is no {wanted.name.lower()}")
    for each in value if isinstance(value, list) else [value]:
        if isinstance(each, str):
            check_text(each)
    return Parameter(name, wanted, value)


def _as(number: type, value: Any) -> Any:
    """Return a number as a float or as a whole one of 64 bits, where it is the same.

    Raises:
        ValueError: it is too large, or true or false.
    """
    if isinstance(value, bool):
        raise ValueError(f"{value} is no number")
    is_whole = isinstance(value, float) and value.is_integer()
    if not (isinstance(value, int) or (number is int and is_whole)):
        return value
    if int(value).bit_length() > 63:
        raise ValueError(f"{str(value)[:20]}... has more than 63 bits")
    return number(value)


def _answer(call: Future[Any]) -> Any:
    """Return an answer, None when there is none."""
    try:
        return call.result()
    except CallError:
        return None
