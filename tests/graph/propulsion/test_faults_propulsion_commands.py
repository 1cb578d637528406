"""Thrust commands that are no numbers, while the robot trots with the fans' help."""

import math

import pytest
from rclpy.node import Node

from husky_msgs.msg import PropulsionCommand
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps

COMMAND_PERIOD = 0.01
"""Between two commands [s]."""

pytestmark = pytest.mark.graph


def bad_commands(time):
    """One command for each way to be bad, of 1 ms later: no repetition of the controller's."""
    for force, moment in (
        (math.nan, 0.0),
        (math.inf, 0.0),
        (30.0, math.nan),
        (-1.0, 0.0),
        (1e6, 0.0),
        (30.0, -1e3),
    ):
        message = PropulsionCommand(kind=PropulsionCommand.WRENCH)
        stamps.fill(message.stamp, round(1e9 * (time + 0.001)))
        message.force.z, message.moment.x = force, moment
        yield message
    message = PropulsionCommand(kind=77)
    stamps.fill(message.stamp, round(1e9 * (time + 0.001)))
    yield message


@pytest.fixture
def publish(assisted):
    """Publishes commands beside the controller."""
    node = Node("stranger", context=assisted.session.context)
    publisher = node.create_publisher(PropulsionCommand, graph.PROPULSION_COMMAND, qos.CONTROL)
    assisted.session.wait_for(publisher.get_subscription_count, "the bridge")
    yield publisher.publish
    node.destroy_node()


def test_bad_thrust_commands_among_good_ones(assisted, publish, record_property):
    s, robot = assisted.session, assisted.robot
    before = robot.told(graph.PIXHAWK_BRIDGE, "refused_commands")
    began = assisted.watch()
    for _ in range(10):
        for message in bad_commands(s.time):
            publish(message)
        s.advance(0.1)
    record_property("rise_n", assisted.rise(began))
    record_property("heights_m", assisted.trots_on())
    assert assisted.helps(began), assisted.seen
    assert robot.told(graph.PIXHAWK_BRIDGE, "refused_commands") - before == 70
    assert s.propulsion.armed, assisted.seen


@pytest.mark.slow
def test_only_bad_thrust_commands(assisted, publish, record_property):
    """They count as silence, do not keep the last good one alive, and the world goes on."""
    s, robot = assisted.session, assisted.robot
    losses = robot.told(graph.FLIGHT_CONTROLLER, "peer_losses")
    began = assisted.watch()
    s.kill(graph.LOW_LEVEL_CONTROLLER)
    while not assisted.rests and s.time < began + 2.0:
        for message in bad_commands(s.time):
            publish(message)
        s.advance(COMMAND_PERIOD)
    assert robot.told(graph.FLIGHT_CONTROLLER, "peer_losses") == losses
    record_property("reaction_s", assisted.thrust_ends(began))
    robot.reported(graph.PIXHAWK_BRIDGE, "thrust commands refused", "")
    s.start(graph.LOW_LEVEL_CONTROLLER)
    assisted.recover()
