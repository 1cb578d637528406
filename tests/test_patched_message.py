"""Messages that are patched as bytes say what the same messages say as objects."""

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from husky_description.robot import load_robot
from husky_drivers.nodes.t265_driver import odometry_message
from husky_drivers.nodes.vn200_driver import imu_message
from husky_drivers.t265.frames import covariance
from husky_drivers.vn200.imu import ImuFigures
from husky_runtime.nodes.markers import ORANGE, make_marker
from husky_runtime.nodes.patched_message import PatchedMessage


def a_tree(edges):
    return TFMessage(
        transforms=[
            TransformStamped(header=Header(frame_id=parent), child_frame_id=child)
            for parent, child in edges
        ]
    )


def test_transforms_with_names_of_any_length():
    """Names of 0 to 40 characters move everything behind them about."""
    edges = [("p" * (length // 2), "c" * length) for length in range(41)]
    message = a_tree(edges)
    transforms = message.transforms
    places = [p for t in transforms for p in (t.header.stamp, t.transform.rotation)]
    patched = PatchedMessage(message, places)
    numbers = np.random.default_rng(0).uniform(-1e3, 1e3, (len(edges), 4))
    for index, (x, y, z, w) in enumerate(numbers):
        patched.write(2 * index, index, 7 * index)
        patched.write(2 * index + 1, x, y, z, w)
    expected = a_tree(edges)
    for index, each in enumerate(expected.transforms):
        each.header.stamp.sec, each.header.stamp.nanosec = index, 7 * index
        q = each.transform.rotation
        q.x, q.y, q.z, q.w = numbers[index].tolist()
    assert deserialize_message(patched.encode(), TFMessage) == expected


def test_markers_with_points_and_colours():
    def marker():
        return make_marker(Marker.LINE_STRIP, "odom", "way", 3, ORANGE, 5)

    message = MarkerArray(markers=[marker()])
    (made,) = message.markers
    patched = PatchedMessage(message, [made.color, *made.points])
    patched.write(0, 0.25, 0.5, 0.75, 1.0)
    for number in range(5):
        patched.write(1 + number, number, -number, 0.5)
    expected = marker()
    expected.color.r, expected.color.g, expected.color.b, expected.color.a = 0.25, 0.5, 0.75, 1.0
    for number, point in enumerate(expected.points):
        point.x, point.y, point.z = float(number), float(-number), 0.5
    assert deserialize_message(patched.encode(), MarkerArray).markers == [expected]


STAMPS = (0, 1_250_000, 1_700_000_000_123_456_789)
TURN, RATE, FORCE = (0.1, -0.2, 0.3, 0.9), (1e-3, -2.0, 3.0), (4.0, -5.0, 9.81)


@pytest.mark.parametrize("stamp", STAMPS)
def test_samples_of_the_imu(stamp):
    figures = ImuFigures.of(load_robot().imu)
    data = imu_message(figures).encode_at(stamp, TURN, RATE, FORCE)
    expected = Imu(header=Header(frame_id="imu_link"))
    expected.header.stamp.sec, expected.header.stamp.nanosec = divmod(stamp, 10**9)
    q, w, a = expected.orientation, expected.angular_velocity, expected.linear_acceleration
    (q.x, q.y, q.z, q.w), (w.x, w.y, w.z), (a.x, a.y, a.z) = TURN, RATE, FORCE
    turn, rate = figures.orientation_variance, figures.angular_velocity_variance
    expected.orientation_covariance[::4] = turn
    expected.angular_velocity_covariance[::4] = rate
    expected.linear_acceleration_covariance[::4] = figures.linear_acceleration_variance
    assert deserialize_message(data, Imu) == expected
    assert len(data) == len(serialize_message(expected))


@pytest.mark.parametrize("frame", ["", "o", "odom", "a_frame_with_a_long_name"])
@pytest.mark.parametrize("stamp", STAMPS)
def test_poses_of_the_camera(frame, stamp):
    message = odometry_message(frame, 2, 0.01, 0.02)
    data = message.encode_at(stamp, FORCE, TURN, RATE, FORCE)
    message.encode_at(1, RATE, TURN, FORCE, RATE)  # what was encoded before is a copy
    expected = Odometry(header=Header(frame_id=frame), child_frame_id="t265_link")
    expected.header.stamp.sec, expected.header.stamp.nanosec = divmod(stamp, 10**9)
    p, q = expected.pose.pose.position, expected.pose.pose.orientation
    v, w = expected.twist.twist.linear, expected.twist.twist.angular
    (p.x, p.y, p.z), (q.x, q.y, q.z, q.w) = FORCE, TURN
    (v.x, v.y, v.z), (w.x, w.y, w.z) = RATE, FORCE
    expected.pose.covariance = expected.twist.covariance = covariance(2, 0.01, 0.02)
    assert deserialize_message(data, Odometry) == expected
    assert len(data) == len(serialize_message(expected))


def test_what_has_no_fixed_place_is_refused():
    message = a_tree([("a", "b")])
    with pytest.raises(RuntimeError, match="encodes TFMessage in an unexpected way"):
        PatchedMessage(message, [TransformStamped().transform.rotation])
