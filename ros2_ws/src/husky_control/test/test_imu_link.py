"""Which sample of the IMU a tick uses."""

import pytest
from fake_node import FakeNode
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from husky_control.estimation.imu_mount import ImuMount
from husky_control.nodes import tick_input
from husky_control.nodes.imu_link import ImuLink
from husky_control.tick_data import Measurements
from husky_description.robot import load_robot
from husky_runtime import graph
from husky_runtime.nodes import stamps

PERIOD = 1_250_000
TICK = graph.TICK_PERIOD_NS


@given(st.lists(st.integers(0, 4), min_size=1, max_size=40), st.integers(0, 1))
def test_in_lockstep_it_does_not_matter_when_samples_come(arrivals, missed):
    """From the first tick on; nor that discovery was later than the sample of time 0."""
    node, ready = FakeNode(), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tick_input, "runs", lambda node, name: True)
        link = ImuLink(
            node, 1.0, ImuMount(load_robot()), lambda: ready.append(True), lockstep=True
        )
        sent = missed
        for tick, early in enumerate(arrivals):
            now = tick * TICK
            for _ in range(early):  # the world is up to one tick ahead
                if sent * PERIOD < now + TICK:
                    sent += publish(node, sent * PERIOD)
            link.await_tick(now)
            while not link.ready(now):
                sent += publish(node, sent * PERIOD)
            measurements = Measurements()
            link.fill(now, measurements)
            newest = (now - 1) // PERIOD * PERIOD
            used = round(now - 1e9 * measurements.imu_age)
            assert used == newest if now else measurements.imu_age > 1.0
    assert len(ready) == sent - missed


def publish(node, stamp):
    message = Imu()
    stamps.fill(message.header.stamp, stamp)
    message.orientation.w = 1.0
    message.linear_acceleration.z = 9.81
    node.say(serialize_message(message))
    return 1
