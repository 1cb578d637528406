"""Commands that are wrong, come twice, or do not come."""

import math
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist
from rclpy.node import Node
from sensor_msgs.msg import JointState

from husky_experiments.session import SessionError
from husky_msgs.msg import JointCommand
from husky_runtime import graph
from husky_runtime.nodes import qos

pytestmark = pytest.mark.graph

_CSP = JointCommand.CYCLIC_SYNCHRONOUS_POSITION


def twist(vx: float = 0.0, vy: float = 0.0, yaw_rate: float = 0.0) -> Twist:
    """A velocity command."""
    message = Twist()
    message.linear.x, message.linear.y, message.angular.z = vx, vy, yaw_rate
    return message


BAD_VELOCITIES = [
    {"vx": math.nan},
    {"vy": math.nan},
    {"yaw_rate": math.nan},
    {"vx": math.inf},
    {"vx": -math.inf},
    {"vx": 9.0},
    {"vy": -9.0},
    {"vx": 0.1, "yaw_rate": 99.0},
]


def test_bad_velocity_commands_among_good_ones(trotting):
    """Each is refused whole and counted; the last good one stays."""
    s = trotting.session
    refused, command = s.state.refused_commands, list(s.state.commanded_velocity)
    for bad in BAD_VELOCITIES:
        s.publish_twist(twist(**bad))
    s.advance(0.4)
    assert s.state.refused_commands == refused + len(BAD_VELOCITIES), trotting.seen
    assert trotting.mode == "walk" and np.isfinite(s.state.position).all(), trotting.seen
    assert list(s.state.commanded_velocity) == pytest.approx(command), trotting.seen


def test_parameters_that_do_not_fit(trotting):
    """One that does not fit what is set is refused with the reason; the robot trots on."""
    s, node = trotting.session, graph.LOW_LEVEL_CONTROLLER
    reason = r"liftoff_force \(8 N\) must not be above contact\.touchdown_force \(6 N\)"
    s.set_parameter(node, "contact.touchdown_force", 6.0)
    try:
        with pytest.raises(SessionError, match=reason):
            s.set_parameter(node, "contact.liftoff_force", 8.0)
    finally:
        s.set_parameter(node, "contact.touchdown_force", 10.0)
    s.set_parameter(node, "contact.liftoff_force", 8.0)  # The first was not taken, this one is.
    s.set_parameter(node, "contact.liftoff_force", 5.0)
    s.advance(0.4)
    assert trotting.mode == "walk", trotting.seen


def test_only_bad_velocity_commands(trotting, record_property):
    """They count as silence: a program gone mad does not keep a robot going."""
    s = trotting.session
    s.release_velocity()
    start = s.time

    def stands() -> bool:
        s.publish_twist(twist(math.nan))
        return trotting.mode == "stand"

    trotting.until(stands, "stand", within=2.0, step=0.05)
    record_property("reaction_s", s.time - start)
    assert s.drives.operational and trotting.height > 0.5, trotting.seen


def test_velocity_command_silent(trotting, record_property):
    s = trotting.session
    s.release_velocity()
    took = trotting.until(lambda: trotting.mode == "stand", "stand", within=2.0)
    record_property("reaction_s", took)
    assert took > 0.3, "0.5 s of silence, 0.2 s of which may have gone by"
    assert trotting.told(graph.LOW_LEVEL_CONTROLLER, "command_timeouts") >= 1
    s.advance(0.5)
    assert s.drives.operational and trotting.height > 0.5, trotting.seen
    x = s.truth.pose.pose.position.x
    s.advance(0.5)
    way = abs(s.truth.pose.pose.position.x - x)
    assert way < 0.03, f"a robot that stands makes no way, not {way:.3f} m in 0.5 s"


class StandIn:
    """Commands the joints in the controller's place: holds them where they are."""

    def __init__(self, robot: Any):
        session = robot.session
        self.good()
        self.node = Node("stand_in", context=session.context)
        self._publisher = self.node.create_publisher(JointCommand, graph.JOINT_COMMAND, qos.CONTROL)
        session.subscribe(JointState, graph.JOINT_STATES, self._on_joints)

    def good(self) -> None:
        """Hold the joints where they are now."""
        self.spoil = lambda command: None
        self._hold: list[float] | None = None

    def _on_joints(self, joints: JointState) -> None:
        if self._hold is None:
            self._hold = list(joints.position)
        command = JointCommand(stamp=joints.header.stamp, mode_of_operation=_CSP)
        command.position = list(self._hold)
        self.spoil(command)
        self._publisher.publish(command)


@pytest.fixture(scope="module")
def stand_in(graph_of_module, graphs):
    """A node that takes the controller's place for the rest of the module, and of the graph."""
    robot = graph_of_module
    robot.start_again()
    robot.session.processes.end(graph.LOW_LEVEL_CONTROLLER)
    stand_in = StandIn(robot)
    with robot.session.unheard(graph.LOW_LEVEL_CONTROLLER):
        yield stand_in
    stand_in.node.destroy_node()
    graphs.end()


def _set(field: str, index: int, value: float) -> Any:
    def spoil(command: JointCommand) -> None:
        getattr(command, field)[index] = value

    return spoil


def _mode(command: JointCommand) -> None:
    command.mode_of_operation = 7


@pytest.mark.parametrize(
    "spoil",
    [
        _set("position", 0, math.nan),
        _set("velocity", 5, math.nan),
        _set("effort", 11, math.nan),
        _set("position", 3, math.inf),
        _set("position", 2, 9.0),
        _set("velocity", 2, -99.0),
        _set("effort", 7, 99.0),
        _mode,
    ],
    ids=["nan", "nan-velocity", "nan-effort", "inf", "range", "velocity", "effort", "mode"],
)
def test_bad_joint_commands(graph_of_module, stand_in, record_property, spoil):
    """One is refused whole and nothing happens; no good one for five ticks, and the drives stop."""
    robot, s = graph_of_module, graph_of_module.session
    stand_in.good()
    s.advance(0.1)
    assert robot.trigger(graph.DRIVES_ENABLE) == ""
    robot.until(lambda: s.drives.operational, "operational drives", within=1.0)
    refused = s.drives.refused_commands
    once = iter([spoil])
    stand_in.spoil = lambda command: next(once, lambda command: None)(command)
    robot.until(lambda: s.drives.refused_commands > refused, "a refusal", within=1.0)
    assert s.drives.operational and s.drives.refused_commands == refused + 1, robot.seen
    since = robot.watch()
    stand_in.spoil = spoil
    s.advance(0.8)
    record_property("reaction_s", robot.torque_ends(since))
    assert s.drives.reason == "no joint command", robot.seen
    assert all(np.isfinite(m.position).all() for m in robot.commands()), "nothing got through"
