"""Joint commands that are wrong.

Last of those that share the robot's graph: its controller gives its place to a node of this test.
"""

import math
from typing import Any

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from husky_msgs.msg import JointCommand
from husky_runtime import graph
from husky_runtime.nodes import qos

pytestmark = pytest.mark.graph

_CSP = JointCommand.CYCLIC_SYNCHRONOUS_POSITION


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


_ALIKE = pytest.mark.slow  # in one process: `test_bad_commands_are_refused_whole`


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(_set("position", 0, math.nan), id="nan"),
        pytest.param(_set("velocity", 5, math.nan), id="nan-velocity", marks=_ALIKE),
        pytest.param(_set("effort", 11, math.nan), id="nan-effort", marks=_ALIKE),
        pytest.param(_set("position", 3, math.inf), id="inf", marks=_ALIKE),
        pytest.param(_set("position", 2, 9.0), id="range", marks=_ALIKE),
        pytest.param(_set("velocity", 2, -99.0), id="velocity", marks=_ALIKE),
        pytest.param(_set("effort", 7, 99.0), id="effort"),
        pytest.param(_mode, id="mode"),
    ],
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
