"""The genuine tf2 listener beside a running robot, where it is installed."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time

from husky_runtime import graph

tf2_ros = pytest.importorskip("tf2_ros", reason="the Python package tf2_ros is not installed")
pytestmark = pytest.mark.graph


@pytest.fixture
def looked_up(standing, domain):
    """Looks up a frame in another one at a time of the simulation, by a listener of its own."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    simulated = Parameter("use_sim_time", value=True)
    node = Node("listener", context=context, parameter_overrides=[simulated])
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    buffer = tf2_ros.Buffer(node=node)
    listener = tf2_ros.TransformListener(buffer, node)

    def look_up(target, source, when):
        def known():
            for _ in range(20):
                executor.spin_once(timeout_sec=0.005)
            return buffer.can_transform(target, source, when)

        standing.until(known, f"{source} in {target}", within=20.0, step=0.02)
        return buffer.lookup_transform(target, source, when).transform

    yield look_up
    listener.unregister()
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_it_finds_what_the_topics_say(standing, looked_up):
    session = standing.session
    looked_up(graph.FRAME_WORLD, graph.FRAME_BASE, Time())  # what was told before it came is lost
    session.advance(0.1)
    truth = session.truth
    told, when = truth.pose.pose.position, Time.from_msg(truth.header.stamp)
    seen = looked_up(graph.FRAME_WORLD, graph.FRAME_BASE, when).translation
    assert (seen.x, seen.y, seen.z) == pytest.approx((told.x, told.y, told.z), abs=1e-3)
    # A robot that stands: its soles are where the footprint has the ground.
    foot = looked_up(graph.FRAME_FOOTPRINT, "front_left_foot", Time()).translation
    assert 0.0 < foot.z < 0.03 < foot.x
