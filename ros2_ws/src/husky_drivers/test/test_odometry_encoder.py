"""The patched bytes say what a message object would."""

import pytest

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message

from husky_drivers.nodes.odometry_encoder import OdometryEncoder

POSE = (0.1, -0.2, 0.3, 0.0, 0.6, 0.0, 0.8)
TWIST = (1e-3, -2.0, 3.0, 4.0, -5.0, 9.81)


def full_message(frame, child):
    message = Odometry()
    message.header.frame_id, message.child_frame_id = frame, child
    message.pose.covariance = [float(value) for value in range(36)]
    message.twist.covariance = [float(value) for value in range(100, 136)]
    return message


@pytest.mark.parametrize("frame", ["", "o", "odom", "a_frame_with_a_long_name"])
@pytest.mark.parametrize("child", ["", "t265_link", "camera_pose_frame"])
def test_bytes_are_those_of_the_middleware(frame, child):
    encoder = OdometryEncoder(full_message(frame, child))
    for stamp in (0, 5_000_000, 1_700_000_000_123_456_789):
        data = encoder.encode(stamp, POSE, TWIST)
        expected = full_message(frame, child)
        expected.header.stamp.sec, expected.header.stamp.nanosec = divmod(stamp, 10**9)
        p, q = expected.pose.pose.position, expected.pose.pose.orientation
        v, w = expected.twist.twist.linear, expected.twist.twist.angular
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = POSE
        v.x, v.y, v.z, w.x, w.y, w.z = TWIST
        assert deserialize_message(data, Odometry) == expected
        assert len(data) == len(serialize_message(expected))


def test_each_frame_is_a_copy():
    encoder = OdometryEncoder(full_message("odom", "t265_link"))
    first = encoder.encode(1, POSE, TWIST)
    kept = bytes(first)
    encoder.encode(2, (1.0,) * 7, (2.0,) * 6)
    assert first == kept
