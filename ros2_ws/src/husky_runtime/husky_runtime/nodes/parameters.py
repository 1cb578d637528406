"""Parameters declared once, with description, range and read-only flag."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from husky_description.robot import ROBOTS, Robot, load_robot
from husky_description.sections import MOUNTINGS


def declare(
    node: Node,
    name: str,
    default: Any,
    description: str,
    lower: float | None = None,
    upper: float | None = None,
    *,
    read_only: bool = True,
    allowed: tuple[str, ...] = (),
    constraints: str = "",
) -> Any:
    """Declare a parameter and return its value.

    Args:
        node: the node that gets the parameter.
        name: parameter name.
        default: value when the user gives none; its type is the parameter's type, of an empty list
            that of texts.
        description: what it is, with its unit.
        lower: least allowed number, or None for no range.
        upper: greatest allowed number; needed together with `lower`.
        read_only: False for one that may change while the node runs.
        allowed: the words that a string parameter may be, empty for any.
        constraints: the same in words, where the caller looks at the value.

    An integer that the command line gives is taken for a number.

    Raises:
        InvalidParameterValueException: value outside the range, raised by rclpy with the range.
        ValueError: a word that is not allowed, or a list that should be one of texts.
    """
    constraints = f"one of {', '.join(allowed)}" if allowed else constraints
    descriptor = ParameterDescriptor(
        description=description, read_only=read_only, additional_constraints=constraints
    )
    if lower is not None and upper is not None:
        if isinstance(default, int) and not isinstance(default, bool):
            descriptor.integer_range = [
                IntegerRange(from_value=int(lower), to_value=int(upper), step=0)
            ]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(lower), to_value=float(upper), step=0.0)
            ]
    descriptor.dynamic_typing = default == []  # which rclpy would take for one of bytes
    given = node._parameter_overrides.get(name)
    if isinstance(default, float) and given is not None and type(given.value) is int:
        # rclpy would refuse 300 for 300.0.
        node._parameter_overrides[name] = Parameter(name, value=float(given.value))
    value = node.declare_parameter(name, default, descriptor).value
    if default == [] and not (isinstance(value, list) and all(isinstance(v, str) for v in value)):
        raise ValueError(f"parameter {name} is {value!r}, it must be a list of texts")
    if allowed and value not in allowed:
        raise ValueError(f"parameter {name} is {value!r}, it must be one of {', '.join(allowed)}")
    return value


def declare_robot(node: Node, actuation: str = "", **changes: float | str) -> Robot:
    """Declare which robot it is, the parameter `robot`; return its numbers.

    Args:
        node: the node that gets the parameter.
        actuation: the only kind that the node can deal with, "" for any.
        changes: what this robot has otherwise than its file says, for `load_robot`.

    Raises:
        ValueError: no such robot, or of another kind, or it has not what is changed.
    """
    fitting = [
        name for name in ROBOTS if not actuation or load_robot(name).actuation == actuation
    ]
    allowed = f"{', '.join(fitting)}, or the path of a robot's file"
    name = declare(node, "robot", fitting[0], "which robot it is", constraints=allowed)
    robot = load_robot(name, **changes)
    if actuation not in ("", robot.actuation):
        raise ValueError(
            f"parameter robot is {name!r} with actuation {robot.actuation!r}, it must be one of "
            f"{allowed}, with {actuation!r}"
        )
    return robot


def declare_mounting(node: Node) -> dict[str, str]:
    """Declare how the fans are mounted; return it as an override for `declare_robot`.

    Raises:
        ValueError: no such mounting.
    """
    default = load_robot().fans.mounting
    mounting = declare(
        node,
        "mounting",
        default,
        "of the fans: along base z, or on a gimbal at the centre of mass as the thesis assumes",
        allowed=MOUNTINGS,
    )
    return {"fans__mounting": mounting} if mounting != default else {}


def declare_sensing(node: Node, sensors: str) -> str:
    """Declare whether emulated sensors err, the parameter `sensing`; return "noisy" or "ideal".

    Raises:
        ValueError: another word.
    """
    what = f"{sensors} with the errors that such sensors have, or without any"
    return str(declare(node, "sensing", "noisy", what, allowed=("noisy", "ideal")))
