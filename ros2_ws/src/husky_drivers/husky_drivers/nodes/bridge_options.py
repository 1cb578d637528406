"""Parameters that the bridges of drives and of servos both have."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.node import Node

from husky_description.robot import Robot
from husky_drivers.joint_master.commanded_master import CommandedMaster
from husky_runtime.nodes.parameters import declare, declare_robot


@dataclass(frozen=True)
class BridgeOptions:
    """Parameters of a bridge.

    Attributes:
        robot: whose joints they are.
        pace: "lockstep", "realtime" or "hardware".
        grace: wall time that a silent controller is waited for [s].
        autostart: configure and activate at start.
        command_timeout: time without a joint command until the joints are on their own [s].
        stop_category: of an emergency stop (IEC 60204-1), 1 or 0.
    """

    robot: Robot
    pace: str
    grace: float
    autostart: bool
    command_timeout: float
    stop_category: int

    @property
    def lockstep(self) -> bool:
        """Whether a tick waits for the command of the one before."""
        return self.pace == "lockstep"


def declare_bridge(node: Node, actuation: str, master: type[CommandedMaster]) -> BridgeOptions:
    """Declare the parameters; return them.

    Args:
        node: the bridge.
        actuation: of the robots that it can have.
        master: of what stands at the joints.

    Raises:
        ValueError: a value that is not allowed.
    """
    robot = declare_robot(node, actuation)
    clocks = ("lockstep", "realtime", "hardware")
    waits = "lockstep: wait for the command of each tick; realtime, hardware: do not"
    pace = declare(node, "time", "lockstep", waits, allowed=clocks)
    grace = declare(
        node, "grace", 1.0, "wall time a silent controller is waited for [s]", 0.2, 60.0
    )
    autostart = declare(node, "autostart", True, "configure and activate at start")
    what = f"time without a joint command after which all {master.devices} {master.unheard} [s]"
    timeout = declare(node, "command_timeout", 0.01, what, 0.004, 0.03)
    what = "category of an emergency stop (IEC 60204-1): 1 rests the joints first, 0 does not"
    category = declare(node, "stop_category", 1, what, 0, 1)
    return BridgeOptions(robot, pace, grace, autostart, timeout, category)
