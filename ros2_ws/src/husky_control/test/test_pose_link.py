"""Which pose of the camera a tick knows."""

import math

import pytest
from fake_node import FakeNode
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry

from husky_control.nodes import tick_input
from husky_control.nodes.pose_link import PoseLink
from husky_control.tick_data import Measurements
from husky_runtime import graph
from husky_runtime.nodes import stamps

MS = 1_000_000


def make(lockstep=True):
    """A link, and what publishes to it: a pose whose x tells its stamp [ms]."""
    node = FakeNode()
    link = PoseLink(node, 1.0, lockstep=lockstep)

    def publish(milliseconds, variance=0.01):
        message = Odometry()
        stamps.fill(message.header.stamp, milliseconds * MS)
        message.pose.pose.position.x = float(milliseconds)
        message.pose.covariance[0] = variance
        node.say(message)

    return link, publish


def taken(link, milliseconds):
    """The pose that a tick takes."""
    measurements = Measurements()
    link.await_tick(milliseconds * MS)
    link.fill(milliseconds * MS, measurements)
    return measurements.pose


def test_nothing_is_known_and_nobody_awaited_before_the_first_pose():
    link, _ = make()
    assert link.ready(1000 * MS)
    assert taken(link, 1000).stamp == -math.inf
    assert not taken(link, 1000).usable(1.0)


@given(st.lists(st.integers(0, 3), min_size=1, max_size=80))
def test_in_lockstep_it_does_not_matter_when_poses_come(arrivals):
    link, publish = make()
    publish(0)
    sent = 0
    for index, extra in enumerate(arrivals):
        now = 20 + 2 * index
        for _ in range(extra):  # poses of the future are here early, by up to 100 ms
            if sent + 5 < now + 100:
                sent += 5
                publish(sent)
        while not link.ready(now * MS):
            sent += 5
            publish(sent)
        assert taken(link, now).position[0] == (now - 10) // 5 * 5
        assert taken(link, now).stamp == pytest.approx((now - 10) // 5 * 5e-3)


def test_in_lockstep_the_first_tick_waits_for_a_camera_that_runs(monkeypatch):
    monkeypatch.setattr(tick_input, "runs", lambda node, name: name == graph.T265_DRIVER)
    link, publish = make()
    for start in range(2):
        if start:
            link.restart(0)
        link.await_tick(0)
        assert not link.ready(0)
        publish(0)
        assert link.ready(0) and link.ready(10 * MS) and not link.ready(12 * MS)


def test_in_realtime_the_newest_counts():
    link, publish = make(lockstep=False)
    for stamp in (0, 5, 10, 15):
        publish(stamp)
    assert taken(link, 16).position[0] == 15.0


def test_all_of_a_pose_is_taken():
    link, publish = make(lockstep=False)
    publish(5, variance=10.0)
    message = Odometry()
    stamps.fill(message.header.stamp, 10 * MS)
    at, twist = message.pose.pose, message.twist.twist
    at.position.y, at.orientation.x, at.orientation.w = 2.0, 0.6, 0.8
    twist.linear.z, twist.angular.y = 3.0, 4.0
    link._on_pose(message)
    pose = taken(link, 12)
    assert pose.position.tolist() == [0.0, 2.0, 0.0]
    assert pose.orientation.tolist() == [0.6, 0.0, 0.0, 0.8]
    assert pose.velocity.tolist() == [0.0, 0.0, 3.0]
    assert pose.angular_velocity.tolist() == [0.0, 4.0, 0.0]
    assert pose.variance == 0.0


def test_a_tick_after_a_gap_waits_for_no_pose_that_has_come():
    link, publish = make()
    publish(0)
    taken(link, 10)
    publish(300)  # no joint states, and so no ticks, in between
    link.await_tick(310 * MS)
    assert link.ready(310 * MS) and not link.ready(311 * MS)
    assert taken(link, 310).position[0] == 300.0


def test_poses_of_before_a_reset_do_not_count():
    link, publish = make()
    publish(5000)
    taken(link, 5010)
    link.restart(0)
    publish(0)
    taken(link, 10)
    publish(5005)  # late, of the old time
    assert taken(link, 20).position[0] == 0.0
    publish(10)
    assert link.ready(20 * MS) and not link.ready(24 * MS)
