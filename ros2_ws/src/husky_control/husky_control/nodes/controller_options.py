"""Parameters of `low_level_controller`: how it runs, and the controller's gains."""

from __future__ import annotations

from typing import NamedTuple

from rclpy.node import Node

from husky_control.parameters import Parameters, table_of
from husky_description.robot import Robot
from husky_runtime.nodes.parameters import declare, declare_mounting, declare_robot

WAKE = "walk_on_command"
"""The only option that may change while the node runs."""


class ControllerOptions(NamedTuple):
    """How the node runs.

    Attributes:
        lockstep: a tick waits for what belongs to it.
        grace: wall time a silent peer is waited for [s].
        fans: the robot carries the propulsion unit.
        planner: plans are asked for on inclines.
        wakes: a velocity command sets a standing robot in motion.
        robot: its numbers.
    """

    lockstep: bool
    grace: float
    fans: bool
    planner: bool
    wakes: bool
    robot: Robot


def declare_options(node: Node) -> ControllerOptions:
    """Declare the node's own parameters and return their values."""
    time = declare(
        node,
        "time",
        "lockstep",
        "lockstep: wait for the IMU sample that belongs to a tick; realtime: do not",
        allowed=("lockstep", "realtime"),
    )
    grace = declare(
        node, "grace", 1.0, "wall time a silent IMU is waited for [s]", lower=0.2, upper=60.0
    )
    fans = declare(node, "propulsion", False, "the robot carries the propulsion unit")
    planner = declare(node, "planner", False, "ask the planner for plans on inclines")
    payload = declare(
        node,
        "payload",
        -1.0,
        "payload [kg], negative for what the robot's file says",
        lower=-1.0,
        upper=10.0,
    )
    wakes = declare(
        node,
        WAKE,
        False,
        "a velocity command that is not zero sets a standing robot in motion, "
        "and 0.5 s of zero stops it",
        read_only=False,
    )
    weight = {} if payload < 0.0 else {"payload_mass": payload}
    robot = declare_robot(node, **weight, **declare_mounting(node))
    return ControllerOptions(time == "lockstep", grace, fans, planner, wakes, robot)


def declare_gains(node: Node, robot: Robot) -> Parameters:
    """Declare the controller's gains for a robot and return them."""
    return Parameters.of(
        robot,
        {
            name: declare(
                node,
                name,
                row.default,
                f"{row.description} [{row.unit}]",
                lower=row.lower,
                upper=row.upper,
                read_only=False,
            )
            for name, row in table_of(robot).items()
        },
    )
