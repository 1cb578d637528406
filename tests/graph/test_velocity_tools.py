"""`/cmd_vel` as the tools of others send it: to a robot that stands, with and without a header."""

import contextlib

import pytest
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

from husky_runtime import graph

pytestmark = pytest.mark.graph


@contextlib.contextmanager
def publishing(domain, message_type):
    """Yield a publisher with the default settings, in a participant of its own."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("tool", context=context)
    try:
        yield node.create_publisher(message_type, graph.CMD_VEL, 10)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def twist(speed):
    message = Twist()
    message.linear.x = speed
    return message


def stamped(speed):
    message = TwistStamped(twist=twist(speed))
    message.header.frame_id = "base_link"
    return message


@pytest.mark.parametrize("make", [twist, stamped])
def test_a_tool_drives_a_standing_robot(standing, domain, make):
    robot, s, node = standing, standing.session, graph.LOW_LEVEL_CONTROLLER
    s.set_parameter(node, "walk_on_command", True)
    try:
        s.advance(0.6)
        start = s.truth.pose.pose.position.x
        with publishing(domain, type(make(0.0))) as publisher:

            def walks():
                publisher.publish(make(0.3))
                return robot.mode == "walk"

            robot.until(walks, "walk", within=20.0, step=0.1)
            for _ in range(4):
                publisher.publish(make(0.3))
                s.advance(0.2)
            assert s.state.commanded_velocity[0] == pytest.approx(0.3), robot.seen
            assert s.truth.pose.pose.position.x - start > 0.1
        robot.until(lambda: robot.mode == "stand", "stand", within=4.0)
        assert s.state.reason == "feet down", s.state.reason
    finally:
        s.set_parameter(node, "walk_on_command", False)


def test_a_velocity_in_another_frame_is_refused(standing, domain):
    robot, s, node = standing, standing.session, graph.LOW_LEVEL_CONTROLLER
    s.set_parameter(node, "walk_on_command", True)
    try:
        with publishing(domain, TwistStamped) as publisher:
            message = stamped(0.3)
            message.header.frame_id = "map"

            count = robot.told(node, "refused_messages")

            def refused():
                publisher.publish(message)
                s.advance(0.1)
                return robot.told(node, "refused_messages") > count

            robot.until(refused, "a refusal in the diagnostics", within=10.0, step=0.1)
            assert robot.mode == "stand"
    finally:
        s.set_parameter(node, "walk_on_command", False)
