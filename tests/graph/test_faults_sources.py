"""More than one node that commands the joints."""

import math
from pathlib import Path

import pytest
from rclpy.node import Node
from seen_robot import STOP_TIME, Tap
from sensor_msgs.msg import JointState

from husky_bringup.processes import Processes
from husky_msgs.msg import DriveStatusArray, JointCommand
from husky_runtime import domain_locks as occupancy
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

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
    elsewhere = {occupancy.VARIABLE: str(tmp_path)}  # as on another machine: here it is refused
    with Processes(logs=tmp_path, environment=elsewhere) as second:
        second.start(next(spec for spec in s.specs if spec.name == graph.LOW_LEVEL_CONTROLLER))
        s.wait_for(lambda: _sources(trotting) == 2, "the second controller")
        trotting.watch()
        trotting.until(lambda: s.drives.emergency_stop, "emergency stop", within=5.0)
        assert "two sources" in s.drives.reason, trotting.seen
        s.advance(0.9)
        # From the second answer on that the bridge has seen; on a busy machine one may get lost.
        stopped = next(status for status in statuses.drain() if status.emergency_stop)
        since = stamps.to_ns(stopped.stamp) / 1e9
        record_property("reaction_s", trotting.put_down(since))
        trotting.trigger(graph.DRIVES_RESET_FAULTS)
        s.advance(0.1)
        assert "2 nodes publish" in trotting.trigger(graph.DRIVES_ENABLE)
        assert second.end() == {graph.LOW_LEVEL_CONTROLLER: 0}
    s.wait_for(lambda: _sources(trotting) == 1, "the second controller's end")
    trotting.recover()


@pytest.mark.parametrize(
    "value",
    [
        # A good command of a second source: test_two_controllers; of nobody who listens: `nan`.
        pytest.param(0.0, id="position", marks=pytest.mark.slow),
        pytest.param(math.nan, id="nan"),
    ],
)
def test_stranger(trotting, stranger, record_property, value):
    """What `ros2 topic pub` sends answers no joint states."""
    s = trotting.session
    since = trotting.watch()
    for _ in range(4):  # best effort: one may be lost
        stranger.publish(JointCommand(mode_of_operation=8, position=[value] * 12))
        s.advance(0.02)
    s.advance(0.8)
    record_property("reaction_s", trotting.put_down(since, within=STOP_TIME + 0.05))
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


def _ahead(state: JointState) -> JointState:
    state.header.stamp.sec += 1000
    return state


def _a_little_ahead(state: JointState) -> JointState:
    stamps.fill(state.header.stamp, stamps.to_ns(state.header.stamp) + 5 * graph.TICK_PERIOD_NS)
    return state


def _negative(state: JointState) -> JointState:
    state.header.stamp.sec = -1
    return state


def _at_zero(state: JointState) -> JointState:
    stamps.fill(state.header.stamp, 0)
    return state


@pytest.mark.parametrize(
    "change",
    [_ahead, _a_little_ahead, _negative, _at_zero, lambda state: JointState(), lambda state: state],
    ids=["ahead", "5 ticks ahead", "negative", "at zero", "empty", "as it was"],
)
@pytest.mark.parametrize("times", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_joint_states_out_of_turn(trotting, change, times):
    """One, or a flood of them while the world stands: no gap, no new time, the robot walks on."""
    s = trotting.session
    node = Node("stranger", context=s.context)
    publisher = node.create_publisher(JointState, graph.JOINT_STATES, qos.CONTROL)
    tap = trotting.tap(JointState, graph.JOINT_STATES)
    s.wait_for(lambda: publisher.get_subscription_count() >= 2, "controller and tap")
    s.advance(0.02)
    missed, wrong = s.state.missed_ticks, change(tap.drain()[-1])
    for _ in range(times):
        publisher.publish(wrong)
    s.advance(0.3)
    node.destroy_node()
    assert trotting.mode == "walk" and trotting.height > 0.5, trotting.seen
    assert s.drives.operational and s.state.missed_ticks == missed, trotting.seen


def test_copies_of_joint_commands(trotting, stranger):
    """A command of this tick that comes twice, bit for bit, is no second source."""
    s = trotting.session
    tap = trotting.tap(JointCommand, graph.JOINT_COMMAND)
    for _ in range(5):
        s.advance(0.02)
        s.wait_for(lambda: _answered_ns(tap) == round(s.time * 1e9), "the command of this tick")
        for _ in range(3):
            stranger.publish(tap.messages[-1])
    s.advance(0.2)
    assert trotting.mode == "walk" and s.drives.operational, trotting.seen
    assert trotting.told(graph.DRIVE_BRIDGE, "refused_messages") > 0


def _answered_ns(tap: Tap) -> int:
    """Stamp of the newest command: it comes by a way of its own, after the tick has ended."""
    commands = tap.drain()
    return stamps.to_ns(commands[-1].stamp) if commands else -1
