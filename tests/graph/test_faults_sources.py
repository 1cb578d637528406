"""More than one node that commands the joints."""

import math
from pathlib import Path

import pytest
from rclpy.node import Node

from husky_bringup.processes import Processes
from husky_description import graph
from husky_description.nodes import qos, stamps
from husky_msgs.msg import DriveStatusArray, JointCommand

pytestmark = pytest.mark.graph


@pytest.fixture
def stranger(trotting):
    """A node that may publish on /joint_command."""
    session = trotting.session
    node = Node("stranger", context=session.context)
    publisher = node.create_publisher(JointCommand, graph.JOINT_COMMAND, qos.CONTROL)
    session.wait_for(lambda: publisher.get_subscription_count() >= 1, "the bridge")
    yield publisher
    node.destroy_node()
    session.wait_for(lambda: _sources(trotting) == 1, "the stranger's end")


def _sources(robot):
    return robot.session.count_publishers(graph.JOINT_COMMAND)


def test_two_controllers(trotting, record_property, tmp_path: Path):
    s = trotting.session
    statuses = trotting.tap(DriveStatusArray, graph.DRIVES_STATUS)
    with Processes(logs=tmp_path) as second:
        second.start(next(spec for spec in s.specs if spec.name == graph.LOW_LEVEL_CONTROLLER))
        s.wait_for(lambda: _sources(trotting) == 2, "the second controller")
        trotting.watch()
        trotting.until(lambda: s.drives.emergency_stop, "emergency stop", within=5.0)
        assert "two sources" in s.drives.reason, trotting.seen
        s.advance(0.6)
        # From the second answer on that the bridge has seen; on a busy machine one may get lost.
        stopped = next(status for status in statuses.drain() if status.emergency_stop)
        since = stamps.to_ns(stopped.stamp) / 1e9
        record_property("reaction_s", trotting.torque_ends(since))
        trotting.trigger(graph.DRIVES_RESET_FAULTS)
        s.advance(0.1)
        assert "2 nodes publish" in trotting.trigger(graph.DRIVES_ENABLE)
        assert second.end() == {graph.LOW_LEVEL_CONTROLLER: 0}
    s.wait_for(lambda: _sources(trotting) == 1, "the second controller's end")
    trotting.recover()


@pytest.mark.parametrize("value", [0.0, math.nan], ids=["position", "nan"])
def test_stranger(trotting, stranger, record_property, value):
    """What `ros2 topic pub` sends answers no joint states."""
    s = trotting.session
    since = trotting.watch()
    for _ in range(4):  # best effort: one may be lost
        stranger.publish(JointCommand(mode_of_operation=8, position=[value] * 12))
        s.advance(0.02)
    s.advance(0.24)
    record_property("reaction_s", trotting.torque_ends(since))
    assert s.drives.emergency_stop and "two sources" in s.drives.reason, trotting.seen
    trotting.start_again()


def test_command_from_the_future(trotting, stranger):
    """It is of a time before the world was reset, say: ignored."""
    s = trotting.session
    command = JointCommand(mode_of_operation=9)
    command.stamp.sec = 1000
    for _ in range(5):
        stranger.publish(command)
        s.advance(0.02)
    assert trotting.mode == "walk" and s.drives.operational, trotting.seen
