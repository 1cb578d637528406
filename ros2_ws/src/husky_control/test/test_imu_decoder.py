"""The IMU decoder against ROS's own serialisation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from husky_control.nodes.imu_decoder import decode_imu

NUMBER = st.floats(-100.0, 100.0)
ROTATION = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(
    lambda q: max(map(abs, q)) > 0.1
)
GOOD = [0.0, 0.0, 0.0, 1.0, *6 * [0.1]]


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


@given(st.text("abc_", max_size=20), ROTATION, st.lists(NUMBER, min_size=6, max_size=6))
def test_reads_what_ros_has_written(frame, rotation, rest):
    numbers = [*(np.array(rotation) / np.linalg.norm(rotation)).tolist(), *rest]
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


@pytest.mark.parametrize("index", range(10))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, 2e3])
def test_numbers_that_no_imu_measures_are_refused(index, bad):
    numbers = list(GOOD)
    numbers[index] = bad
    with pytest.raises(ValueError):
        decode_imu(serialize_message(message("imu_link", numbers)))


@pytest.mark.parametrize("rotation", [(0, 0, 0, 0), (0, 0, 0, 2), (0.5, 0.5, 0.5, 0.1)])
def test_an_orientation_that_is_no_rotation_is_refused(rotation):
    with pytest.raises(ValueError, match="no rotation"):
        decode_imu(serialize_message(message("imu_link", [*map(float, rotation), *GOOD[4:]])))


def test_a_stamp_that_is_no_time_is_refused():
    for sec, nanosec in ((-1, 0), (0, 1_000_000_000)):
        imu = message("imu_link", GOOD)
        imu.header.stamp.sec, imu.header.stamp.nanosec = sec, nanosec
        with pytest.raises(ValueError, match="no time"):
            decode_imu(serialize_message(imu))


def test_big_endian_and_lengths_beyond_the_message_are_refused():
    data = serialize_message(message("imu_link", GOOD))
    for broken in (b"\x00\x00" + data[2:], data[:12] + b"\xff\xff\xff\xff" + data[16:], data[:-8]):
        with pytest.raises(ValueError):
            decode_imu(broken)
