"""The world put back to time zero while the robot trots; long steps; strangers at the motors."""

import math
import time

import numpy as np
import pytest
from rclpy.node import Node
from std_srvs.srv import SetBool

from husky_description.robot import load_robot
from husky_msgs.msg import ServoCommand
from husky_msgs.srv import ResetWorld, StepWorld
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

pytestmark = pytest.mark.graph


# In one process: husky_drivers' `test_restart_forgets_the_command_and_takes_torque_...`
@pytest.mark.parametrize("keyframe", [pytest.param("sit", marks=pytest.mark.slow), "stand"])
def test_reset_while_trotting(trotting, keyframe):
    """No torque of before acts in the new world; the controller is passive, the drives are off."""
    s = trotting.session
    trotting.watch()
    s.reset(keyframe)
    s.advance(0.3)
    times, kinds = trotting.kinds()
    assert times[0] == 0.0 and (kinds == ServoCommand.TORQUE_OFF).all()
    assert trotting.torque_ends(0.0, within=0.1) == 0.0
    assert trotting.mode == "passive" and not s.drives.operational, trotting.seen
    assert s.drives.reason == "the world has been reset"


def test_emergency_stop_outlasts_a_reset(trotting):
    s = trotting.session
    trotting.trigger(graph.DRIVES_EMERGENCY_STOP)
    s.advance(0.2)
    s.reset()
    s.advance(0.1)
    assert "latched" in trotting.trigger(graph.DRIVES_ENABLE)
    trotting.enable()


def test_imu_after_a_reset(trotting):
    """Its time starts again too; the controller estimates as if nothing had been."""
    s = trotting.session
    s.reset()
    trotting.stand()
    truth = s.truth.pose.pose.position
    error = np.array(s.state.position) - (truth.x, truth.y, truth.z)
    assert np.abs(error).max() < 0.05, error
    for node in (graph.PLANT, graph.DRIVE_BRIDGE, graph.LOW_LEVEL_CONTROLLER):
        assert "lost" not in trotting.reported(node, "").message


@pytest.mark.parametrize("ticks", [0, 30_001, 2**32 - 1])
def test_step_without_bounds(robot, ticks):
    answer = robot.session.call(graph.PLANT_STEP, StepWorld.Request(ticks=ticks))
    assert not answer.success and "1 to 30000 (60 s)" in answer.message, answer
    assert stamps.to_ns(answer.stamp) == round(robot.session.time * 1e9)


@pytest.mark.parametrize(
    ("service", "request_", "reason"),
    [
        (graph.PLANT_PAUSE, SetBool.Request(data=True), "a pause"),
        (graph.PLANT_RESET, ResetWorld.Request(keyframe="sit", seed=1), "a reset"),
    ],
)
def test_others_are_heard_while_a_step_runs(robot, service, request_, reason):
    """They may end it; it then says how far it came, and the next one goes on from there."""
    s = robot.session
    s.advance(0.1)
    start, before = s.time, s.drives.stamp
    long_step = s.ask(graph.PLANT_STEP, StepWorld.Request(ticks=30_000))
    s.wait_for(lambda: s.drives.stamp != before, "the world to move")
    s.inject(graph.PLANT_INJECT_FAULT, "imu", "")
    second = s.call(graph.PLANT_STEP, StepWorld.Request(ticks=1))
    assert not second.success and "of 30000 ticks are done" in second.message, second
    assert s.call(service, request_).success
    s.wait_for(long_step.done, "the answer to the step")
    answer = long_step.result()
    done = int(answer.message.split(" ticks")[0].split()[-3])
    assert not answer.success and f"ended by {reason} after {done} of 30000" in answer.message
    assert 0 < done < 30_000
    ended = 0.0 if reason == "a reset" else start + done * graph.TICK_PERIOD
    assert stamps.to_ns(answer.stamp) / 1e9 == pytest.approx(ended, abs=1e-9)
    s.advance(0.1)
    assert s.time == pytest.approx(ended + 0.1, abs=1e-9)


@pytest.fixture
def at_the_motors(robot):
    """A stranger that may publish on /plant/servo_command."""
    node = Node("stranger_at_the_motors", context=robot.session.context)
    publisher = node.create_publisher(ServoCommand, graph.SERVO_COMMAND, qos.CONTROL)
    robot.session.wait_for(lambda: publisher.get_subscription_count() >= 2, "the plant")
    yield publisher
    node.destroy_node()


def test_strong_servo_command(robot, at_the_motors):
    """The drives give their peak current, whatever limit the message says."""
    s, peak = robot.session, load_robot().drive.peak_current
    robot.watch()
    for _ in range(10):  # best effort: one may be lost
        command = ServoCommand(kind=[ServoCommand.TORQUE] * 12, torque=[200.0] * 12)
        command.torque_limit[:] = 200.0
        stamps.fill(command.stamp, round(s.time * 1e9))
        at_the_motors.publish(command)
        time.sleep(0.02)
        s.advance(graph.TICK_PERIOD)
    _, currents = robot.torques()
    assert 0.9 * peak < currents.max() <= peak * (1 + 1e-9)


def test_bad_servo_command(robot, at_the_motors):
    """Refused whole and counted; nothing acts and nothing dies of it."""
    s = robot.session
    refused = robot.told(graph.PLANT, "refused_messages")
    robot.watch()
    for changes in ({"position": math.nan}, {"torque_limit": math.inf}, {"kind": 9}):
        command = ServoCommand(kind=[ServoCommand.TORQUE] * 12, torque=[5.0] * 12)
        for field, value in changes.items():
            getattr(command, field)[7] = value
        stamps.fill(command.stamp, round(s.time * 1e9))
        for _ in range(3):
            at_the_motors.publish(command)
            time.sleep(0.02)
        s.advance(graph.TICK_PERIOD)
    _, currents = robot.torques()
    assert not currents.any()
    assert robot.told(graph.PLANT, "refused_messages") >= refused + 3
