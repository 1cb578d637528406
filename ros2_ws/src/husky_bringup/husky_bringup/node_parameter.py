"""A parameter of a node, as its descriptor tells it to any tool."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rclpy.parameter import parameter_value_to_python

_EVERY_NODES = ("use_sim_time", "start_type_description_service")
_EVERY_NODES_GROUP = "qos_overrides."
_ONE_OF = "one of "
_UNIT = re.compile(r" ?\[([^\[\]]+)\]")


@dataclass(frozen=True)
class NodeParameter:
    """A parameter of a node: its value now, and what its descriptor says.

    Attributes:
        name: of the parameter, without its node.
        value: bool, int, float, str or a list of them, or bytes; None where it has none.
        description: what it is, with its unit in brackets.
        lower: least allowed number, None where there is no range.
        upper: greatest allowed number.
        read_only: whether it is fixed at the start.
        allowed: what the value may be, in words.
        choices: all that a text may be, empty for any.
    """

    name: str
    value: Any
    description: str
    lower: float | None
    upper: float | None
    read_only: bool
    allowed: str
    choices: tuple[str, ...] = ()


def is_of_every_node(name: str) -> bool:
    """Whether a parameter is one that rclpy gives to every node."""
    return name in _EVERY_NODES or name.startswith(_EVERY_NODES_GROUP)


def make_node_parameter(descriptor: ParameterDescriptor, value: Any) -> NodeParameter:
    """Return a parameter with a value, a plain one of Python."""
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    constraints = descriptor.additional_constraints
    allowed = constraints.removeprefix(_ONE_OF)
    return NodeParameter(
        name=descriptor.name,
        value=list(value) if hasattr(value, "tolist") else value,
        description=descriptor.description,
        lower=ranges[0].from_value if ranges else None,
        upper=ranges[0].to_value if ranges else None,
        read_only=descriptor.read_only,
        allowed=allowed,
        choices=tuple(allowed.split(", ")) if allowed != constraints else (),
    )


def to_python(value: ParameterValue) -> Any:
    """Return a value as bool, int, float, str or a list of them, or as bytes; None for none.

    Raises:
        RuntimeError: it is of a type that there is not.
    """
    found = parameter_value_to_python(value)
    if value.type == ParameterType.PARAMETER_BYTE_ARRAY:
        return b"".join(found)
    return found.tolist() if hasattr(found, "tolist") else found


def check_text(text: str) -> None:
    """Refuse halves of characters, which JSON knows, and neither ROS nor a browser can be sent.

    Raises:
        ValueError: there is one.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{text[:20]!r} has half a character") from error


def unit(parameter: NodeParameter) -> str:
    """Return the unit that a description gives in brackets, "" where it gives none."""
    match = _UNIT.search(parameter.description)
    return match[1] if match else ""


def meaning(parameter: NodeParameter) -> str:
    """Return a description without the unit."""
    return _UNIT.sub("", parameter.description, count=1)
