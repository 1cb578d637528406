"""The localizer's report on `/diagnostics`, without a graph."""

import pytest

pytest.importorskip("rclpy")

import rclpy
from nav_msgs.msg import Odometry

from husky_navigation.nodes.localizer import Localizer
from husky_runtime.nodes import diagnostics, stamps


@pytest.fixture(scope="module")
def localizer(domain):
    """On the robot's clock: host time."""
    rclpy.init(args=["--ros-args", "-p", "use_sim_time:=false"], domain_id=domain)
    node = Localizer()
    yield node
    node.destroy_node()
    rclpy.shutdown()


def odometry(time_ns):
    message = Odometry()
    stamps.fill(message.header.stamp, time_ns)
    message.pose.pose.orientation.w = 1.0
    return message


def test_odometry_that_stops_is_reported(localizer):
    """Stamps stand for time that has gone by: the report compares them with the node's clock."""
    now = localizer.get_clock().now().nanoseconds
    assert localizer._report()[:2] == (diagnostics.WARN, "waiting for odometry")
    localizer._on_odometry(odometry(now - 100_000_000_000))
    level, text, _ = localizer._report()
    assert level == diagnostics.WARN
    assert text.startswith("no odometry for 10") and text.endswith(" s: the pose is old")
    localizer._on_odometry(odometry(now + 3_600_000_000_000))
    level, text, _ = localizer._report()
    assert (level, text) == (diagnostics.OK, "legs only")
