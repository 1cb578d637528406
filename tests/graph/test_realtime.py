"""Faults that lockstep hides by design: nodes that are late by the wall clock."""

import signal

import pytest

from husky_description import graph
from husky_description.nodes import stamps
from husky_msgs.msg import JointCommand
from husky_msgs.srv import SetMode

pytestmark = pytest.mark.graph

ATTEMPTS = 10
"""On a busy machine a controller may well be late by itself before it is stopped."""


@pytest.fixture(scope="module")
def realtime(new_graph):
    """The graph beside the wall clock."""
    with new_graph("realtime") as robot:
        yield robot


def test_controller_stalls_for_50_ms(realtime, record_property):
    """Five ticks without a command, and torque goes; the controller finds the drives off."""
    robot, s = realtime, realtime.session
    commands = robot.tap(JointCommand, graph.JOINT_COMMAND)
    for _ in range(ATTEMPTS):
        robot.enable()
        robot.watch()
        response = s.call(graph.SET_MODE, SetMode.Request(mode="stand_up"))
        s.advance(0.1)
        s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGSTOP)
        s.advance(0.06)
        last = stamps.to_ns(commands.drain()[-1].stamp) / 1e9
        s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGCONT)
        assert s.time - last > 0.05, "the controller has not stalled"
        s.advance(0.3)
        times, currents = robot.torques()
        if response.success and currents[(times > last - 0.01) & (times <= last)].all():
            break  # there was torque until the stall
    else:
        pytest.skip(f"this machine is too busy for realtime: {robot.seen}")
    record_property("reaction_s", robot.torque_ends(last))
    assert s.drives.reason == "no joint command", robot.seen
    robot.until(lambda: robot.mode == "damping", "damping", within=1.0)
    robot.enable()


def test_loss_is_reported(realtime):
    """Nobody waits for a lost node in realtime either, but it is reported."""
    s = realtime.session
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    realtime.reported(graph.DRIVE_BRIDGE, "low_level_controller is lost")
    s.kill(graph.DRIVE_BRIDGE)
    realtime.reported(graph.PLANT, "drive_bridge is lost")
    assert not realtime.torques()[1][-20:].any()
