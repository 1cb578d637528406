"""Axes, and what an autopilot tells, against SciPy and pymavlink's own encoder."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from husky_description.rotation import swap_body
from husky_pu.mavlink.axes import mavlink_attitude, ros_attitude

NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD_TO_FLU = np.diag([1, -1, -1])


# Axes -------------------------------------------------------------------------------------------
@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
def test_attitudes_agree_with_rotation_matrices(wxyz):
    wxyz = np.array(wxyz) / math.hypot(*wxyz)
    ned = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    ros = Rotation.from_quat(ros_attitude(wxyz)).as_matrix()
    np.testing.assert_allclose(ros, NED_TO_ENU @ ned @ FRD_TO_FLU, atol=1e-12)
    back = mavlink_attitude(ros_attitude(wxyz))
    np.testing.assert_allclose(back, wxyz, atol=1e-12)


def test_axes_by_hand():
    # Level and facing east: no rotation in ROS, a quarter turn to the right of north in MAVLink.
    half = math.sqrt(0.5)
    assert mavlink_attitude((0, 0, 0, 1)) == pytest.approx((half, 0, 0, half))
    assert swap_body((1, 2, 3)) == (1, -2, -3)


# Telemetry --------------------------------------------------------------------------------------
def test_a_bundle_in_ros_axes(pair):
    q = Rotation.from_euler("xyz", [0.1, -0.2, 2.0]).as_quat(scalar_first=True)
    pair.autopilot.armed, pair.autopilot.mode = True, 6
    pair.autopilot.heartbeat()
    pair.autopilot.battery([3700, 3710, 3690], 2500, 80)
    pair.autopilot.telemetry(40, q=q)
    pair.carry()
    (report,) = pair.client.take_bundles()
    assert (report.boot_us, report.armed, report.mode) == (40_000, True, "OFFBOARD")
    assert report.pwm == (1100, 1200, 1300, 1400)
    assert report.collective_desired == 0.25
    expected = NED_TO_ENU @ Rotation.from_quat(q, scalar_first=True).as_matrix() @ FRD_TO_FLU
    for attitude in (report.attitude, report.attitude_desired):
        np.testing.assert_allclose(Rotation.from_quat(attitude).as_matrix(), expected, atol=1e-6)
    battery = report.battery
    assert battery.voltage == pytest.approx(11.1)
    assert (battery.current, battery.remaining, battery.saturated) == (25.0, 0.8, False)
    assert battery.cells == pytest.approx((3.7, 3.71, 3.69))
    assert pair.client.take_bundles() == []


@pytest.mark.parametrize(
    ("current", "amperes", "saturated"),
    [(0, 0.0, False), (32766, 327.66, False), (32767, 327.67, True), (-1, None, False),
     (-32768, None, False)],
)  # fmt: skip
def test_a_full_current_field_means_at_least(pair, current, amperes, saturated):
    pair.autopilot.battery([22200], current)
    pair.carry()
    battery = pair.client.telemetry.report.battery
    assert battery.saturated is saturated
    assert battery.voltage == pytest.approx(22.2)
    assert battery.cells == ()
    assert math.isnan(battery.current) if amperes is None else battery.current == amperes


def test_the_systems_status_serves_where_there_is_no_battery_status(pair):
    status = mavlink.MAVLink_sys_status_message
    pair.autopilot.send(status(0, 0, 0, 0, 23000, 1000, 70, 0, 0, 0, 0, 0, 0))
    pair.carry()
    assert pair.client.telemetry.report.battery.voltage == 23.0
    pair.autopilot.battery([24000], 1000)
    pair.autopilot.send(status(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0))
    pair.carry()
    assert pair.client.telemetry.report.battery.voltage == 24.0


def test_the_failsafe_is_named_by_its_text(pair):
    pair.autopilot.text("Failsafe: offboard signal lost")
    pair.autopilot.state = mavlink.MAV_STATE_CRITICAL
    pair.autopilot.heartbeat()
    pair.carry()
    report = pair.client.telemetry.report
    assert report.failsafe == report.reason == "Failsafe: offboard signal lost"
    pair.autopilot.state = mavlink.MAV_STATE_ACTIVE
    pair.autopilot.heartbeat()
    pair.carry()
    assert pair.client.telemetry.report.failsafe == ""


def test_texts_in_pieces_are_joined(pair):
    text = "Preflight Fail: " + "x" * 60
    pair.autopilot.text(text[:50], number=3)
    pair.autopilot.text(text[50:], number=3)
    pair.carry()
    assert pair.client.telemetry.report.reason == text


@pytest.mark.parametrize("boot_ms", [4_294_960, 4_294_967, 4_294_968, 4_294_980, 9_000_000])
def test_the_outputs_clock_of_32_bits_is_unwrapped(pair, boot_ms):
    pair.autopilot.telemetry(boot_ms)
    pair.carry()
    assert pair.client.take_bundles()[0].boot_us == 1000 * boot_ms


def test_numbers_that_are_not_finite_are_dropped(pair):
    pair.autopilot.telemetry(20)
    pair.autopilot.telemetry(40, q=(math.nan, 0, 0, 0))
    pair.carry()
    assert pair.client.telemetry.invalid == 2
    assert pair.client.telemetry.report.attitude == pytest.approx(ros_attitude((1, 0, 0, 0)))
