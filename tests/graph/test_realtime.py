"""Faults that lockstep hides by design: nodes that are late by the wall clock."""

import signal

import numpy as np
import pytest
from seen_robot import STOP_TIME
from starvation import in_real_time

from husky_msgs.msg import JointCommand
from husky_msgs.srv import SetMode
from husky_runtime import graph
from husky_runtime.nodes import stamps

pytestmark = [pytest.mark.graph, pytest.mark.realtime]


@pytest.fixture(scope="module")
def realtime(new_graph):
    """The graph beside the wall clock."""
    with new_graph(clock="realtime") as robot:
        yield robot


def test_controller_stalls_for_50_ms(realtime, record_property):
    """Without a command the drives put the robot down; the controller finds them off."""
    robot, s = realtime, realtime.session
    commands = robot.tap(JointCommand, graph.JOINT_COMMAND)

    def stall() -> None:
        robot.enable()
        robot.watch()
        commands.clear()
        response = s.call(graph.SET_MODE, SetMode.Request(mode="stand_up"))
        s.advance(0.1)
        s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGSTOP)
        try:
            s.advance(0.06)
        finally:
            s.processes.kill(graph.LOW_LEVEL_CONTROLLER, signal.SIGCONT)
        s.advance(0.8)
        # When the source fell silent is told by its stamps, however late this process hears them.
        sent = [stamps.to_ns(command.stamp) / 1e9 for command in commands.drain()]
        gaps = np.diff([*sent, s.time])
        last = sent[int(gaps.argmax())]
        assert gaps.max() > 0.03, "the controller has not stalled"
        times, currents = robot.torques()
        assert response.success, response.message
        before = (times > last - 0.01) & (times <= last)
        assert currents[before].all(), "there was torque until the stall"
        record_property("reaction_s", robot.torque_ends(last, within=STOP_TIME + 0.05))
        assert s.drives.reason == "no joint command", robot.seen
        robot.until(lambda: robot.mode == "damping", "damping", within=1.0)
        robot.enable()

    in_real_time(s, stall)


def test_loss_is_reported(realtime):
    """Nobody waits for a lost node in realtime either, but it is reported."""
    s = realtime.session
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    realtime.reported(graph.DRIVE_BRIDGE, "low_level_controller is lost")
    s.kill(graph.DRIVE_BRIDGE)
    realtime.reported(graph.PLANT, "drive_bridge is lost")
    assert not realtime.torques()[1][-20:].any()
