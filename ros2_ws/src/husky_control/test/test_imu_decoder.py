"""The IMU decoder against ROS's own serialisation."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from husky_control.nodes.imu_decoder import decode_imu

NUMBER = st.floats(allow_nan=False, width=64)


def message(frame: str, numbers: list[float]) -> Imu:
    imu = Imu()
    imu.header.frame_id = frame
    imu.header.stamp.sec, imu.header.stamp.nanosec = 12, 345_000_000
    q, w, a = imu.orientation, imu.angular_velocity, imu.linear_acceleration
    q.x, q.y, q.z, q.w, w.x, w.y, w.z, a.x, a.y, a.z = numbers
    imu.orientation_covariance[:] = 1.0
    imu.angular_velocity_covariance[:] = 2.0
    imu.linear_acceleration_covariance[:] = 3.0
    return imu


@given(st.text("abc_", max_size=20), st.lists(NUMBER, min_size=10, max_size=10))
def test_reads_what_ros_has_written(frame, numbers):
    sample = decode_imu(serialize_message(message(frame, numbers)))
    assert sample.time_ns == 12_345_000_000
    assert [*sample.orientation, *sample.angular_velocity, *sample.specific_force] == numbers


@given(st.binary(max_size=400))
def test_other_bytes_are_refused_or_read_but_never_crash(data):
    try:
        sample = decode_imu(data)
    except ValueError:
        return
    assert len(sample.orientation) == 4


def test_a_cut_message_is_refused():
    data = serialize_message(message("imu_link", [0.0] * 10))
    for end in range(0, len(data) - 8, 7):
        with pytest.raises(ValueError, match="sensor_msgs/Imu"):
            decode_imu(data[:end])
