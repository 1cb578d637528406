"""The patched bytes say what a message object would."""

import pytest

pytest.importorskip("rclpy")

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu

from husky_drivers.nodes.imu_encoder import ImuEncoder


def full_message(frame):
    message = Imu()
    message.header.frame_id = frame
    message.orientation_covariance[:] = range(1, 10)
    message.angular_velocity_covariance[:] = range(11, 20)
    message.linear_acceleration_covariance[:] = range(21, 30)
    return message


@pytest.mark.parametrize("frame", ["", "i", "imu_link", "a_frame_with_a_long_name"])
def test_bytes_are_those_of_the_middleware(frame):
    encoder = ImuEncoder(full_message(frame))
    for stamp in (0, 1_250_000, 1_700_000_000_123_456_789):
        data = encoder.encode(stamp, (0.1, -0.2, 0.3, 0.9), (1e-3, -2.0, 3.0), (4.0, -5.0, 9.81))
        expected = full_message(frame)
        expected.header.stamp.sec, expected.header.stamp.nanosec = divmod(stamp, 10**9)
        q, w, a = expected.orientation, expected.angular_velocity, expected.linear_acceleration
        q.x, q.y, q.z, q.w = 0.1, -0.2, 0.3, 0.9
        w.x, w.y, w.z = 1e-3, -2.0, 3.0
        a.x, a.y, a.z = 4.0, -5.0, 9.81
        assert deserialize_message(data, Imu) == expected
        assert len(data) == len(serialize_message(expected))


def test_each_sample_is_a_copy():
    encoder = ImuEncoder(full_message("imu_link"))
    first = encoder.encode(1, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
    kept = bytes(first)
    encoder.encode(2, (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert first == kept
