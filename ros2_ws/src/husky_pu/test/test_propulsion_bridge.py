"""From thrust commands to setpoints: refusals, slew limit, axes, and the autopilot's clock."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from husky_pu.companion.bridge import BootClock, Kind, Limits, ThrustCommand, ThrustSetpoints
from husky_pu.companion.client import ClientConfig, MavlinkClient

LIMITS = Limits(collective=80.0, moment=(5.0, 4.0, 2.0), thrust_rate=100.0)
PERIOD = 10_000_000


def wrench(stamp, thrust=0.0, moment=(0.0, 0.0, 0.0), **changes):
    return replace(
        ThrustCommand(stamp, Kind.WRENCH, force=(0.0, 0.0, thrust), moment=moment), **changes
    )


def running():
    """Enabled, and with a command behind it."""
    setpoints = ThrustSetpoints(LIMITS, enabled=True)
    setpoints.convert(wrench(0))
    return setpoints


def on_the_wire(setpoint, boot_us=123_456_000):
    """Return the message as pymavlink's own parser reads it."""
    client = MavlinkClient(ClientConfig(4, target_system=1))
    setpoint.send(client, boot_us)
    (message,) = mavlink.MAVLink(None).parse_buffer(client.take_output())
    return message


def test_a_wrench_on_the_wire_is_in_frd_and_normalised():
    setpoints = running()
    setpoints.convert(wrench(PERIOD, 1.0))
    for k in range(2, 60):
        setpoint = setpoints.convert(wrench(k * PERIOD, 40.0, (2.5, 1.0, -2.0)))
    message = on_the_wire(setpoint)
    assert message.get_type() == "SET_ACTUATOR_CONTROL_TARGET"
    assert (message.time_usec, message.group_mlx) == (123_456_000, 0)
    assert (message.target_system, message.target_component) == (1, 1)
    # Roll keeps its sign, pitch and yaw change it: x forward, y left -> right, z up -> down.
    assert message.controls == pytest.approx([0.5, -0.25, 1.0, 0.5, 0, 0, 0, 0])


def test_an_attitude_on_the_wire_is_frd_to_ned_scalar_first():
    setpoints = running()
    rotation = Rotation.from_euler("xyz", [0.2, -0.1, 2.5])
    command = ThrustCommand(PERIOD, Kind.ATTITUDE, rotation.as_quat(), (0, 0, 0.5))
    message = on_the_wire(setpoints.convert(command))
    assert message.get_type() == "SET_ATTITUDE_TARGET"
    assert (message.time_boot_ms, message.type_mask) == (123_456, 7)
    swap, flip = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    np.testing.assert_allclose(
        Rotation.from_quat(message.q, scalar_first=True).as_matrix(),
        swap @ rotation.as_matrix() @ flip,
        atol=1e-6,
    )
    assert message.thrust == pytest.approx(0.5 / 80.0)


def test_nothing_is_told_by_the_message_of_before():
    setpoints = ThrustSetpoints(LIMITS, enabled=True)
    message = on_the_wire(setpoints.convert(ThrustCommand(0, Kind.NONE)))
    assert message.get_type() == "SET_ATTITUDE_TARGET"
    assert (message.type_mask, message.thrust) == (128, 0.0)
    setpoints.convert(wrench(PERIOD, 0.5))
    message = on_the_wire(setpoints.convert(ThrustCommand(2 * PERIOD, Kind.NONE)))
    assert message.get_type() == "SET_ACTUATOR_CONTROL_TARGET"
    assert message.controls == [0.0] * 8


def test_while_not_armed_the_stream_goes_on_without_thrust():
    setpoints = ThrustSetpoints(LIMITS)
    message = on_the_wire(setpoints.convert(wrench(0, 40.0, (5.0, 0.0, 0.0))))
    assert message.get_type() == "SET_ACTUATOR_CONTROL_TARGET"
    assert message.controls == [0.0] * 8
    half = math.sqrt(0.5)
    command = ThrustCommand(PERIOD, Kind.ATTITUDE, (0, 0, 0, 1), (0, 0, 40.0))
    message = on_the_wire(setpoints.convert(command))
    assert (message.type_mask, message.thrust) == (7, 0.0)
    assert message.q == pytest.approx([half, 0, 0, half])


BAD = [
    (wrench(PERIOD, math.nan), "not finite"),
    (wrench(PERIOD, 1.0, (math.inf, 0, 0)), "not finite"),
    (wrench(PERIOD, attitude=(math.nan, 0, 0, 1)), "not finite"),
    (wrench(PERIOD, -1.0), "collective thrust -1 N, it must be 0 to 80 N"),
    (wrench(PERIOD, 80.1), "collective thrust 80.1 N"),
    (wrench(PERIOD, 1.0, (0, 4.1, 0)), "moment y 4.1 N m, it must be within 4 N m"),
    (wrench(PERIOD, force=(60.0, 0, 60.0)), "force of 84.8528 N, it must be 0 to 80 N"),
    (ThrustCommand(PERIOD, Kind.ATTITUDE, (0, 0, 0, 0.9)), "attitude of length 0.9"),
    (ThrustCommand(PERIOD, Kind.ATTITUDE, (0, 0, 0, 0)), "attitude of length 0"),
    (ThrustCommand(PERIOD, 3), "kind 3 is not known"),
]


@pytest.mark.parametrize(("command", "reason"), BAD)
def test_a_bad_command_is_refused_whole(command, reason):
    setpoints = running()
    before = setpoints.newest
    assert setpoints.convert(command) is None
    assert setpoints.refused == 1
    assert re.search(reason, setpoints.refusal)
    assert (setpoints.newest, setpoints.stamp_ns) == (before, 0)


def test_rounding_is_no_reason_to_refuse():
    setpoints = running()
    for k in range(1, 200):
        setpoint = setpoints.convert(
            wrench(k * PERIOD, 80.0 * (1 + 1e-9), (5.0 * (1 + 1e-9), 0, 0))
        )
    assert setpoint.thrust == 1.0
    assert setpoint.moment == (1.0, 0.0, 0.0)


COMMANDS = st.lists(
    st.tuples(
        st.sampled_from([0, 2_000_000, PERIOD, PERIOD, PERIOD, 300_000_000, 600_000_000]),
        st.sampled_from(list(Kind)),
        st.floats(0.0, 80.0),
        st.sampled_from([True, True, True, False]),
    ),
    max_size=40,
)


@given(COMMANDS)
def test_thrust_never_steps_up(steps):
    setpoints, stamp, thrust = running(), 0, 0.0
    for since, kind, wanted, enabled in steps:
        stamp += since
        setpoints.enable(enabled)
        setpoint = setpoints.convert(
            ThrustCommand(stamp, kind, force=(0, 0, wanted), moment=(0.1, 0, 0))
        )
        now = setpoint.thrust * LIMITS.collective
        if since > 0:
            assert now <= thrust + LIMITS.thrust_rate * 1e-9 * min(since, 100_000_000) + 1e-9
            assert now <= wanted + 1e-9
            if kind is Kind.NONE or not enabled:
                assert (now, setpoint.moment) == (0.0, (0.0, 0.0, 0.0))
            if since > 500_000_000:
                assert now <= LIMITS.thrust_rate * 0.01 + 1e-9
        thrust = now


def test_moments_shrink_with_a_thrust_that_is_held_back():
    setpoint = running().convert(wrench(PERIOD, 40.0, (5.0, 0.0, 0.0)))
    assert setpoint.thrust == pytest.approx(1.0 / 80.0)
    assert setpoint.moment == pytest.approx((1.0 / 40.0, 0.0, 0.0))


def test_the_same_stamp_gets_the_same_answer():
    setpoints = running()
    first = setpoints.convert(wrench(PERIOD, 5.0))
    assert setpoints.convert(wrench(PERIOD, 70.0)) is first
    assert setpoints.accepted == 2


def test_time_that_goes_back_begins_at_zero():
    setpoints = running()
    for k in range(1, 100):
        setpoints.convert(wrench(k * PERIOD, 80.0))
    assert setpoints.convert(wrench(0, 80.0)).thrust == pytest.approx(1.0 / 80.0)


@given(
    st.lists(st.floats(0.0, 0.05), min_size=2, max_size=200),
    st.integers(0, 10**15),
)
def test_the_boot_clock_is_late_by_the_smallest_delay(delays, offset):
    clock = BootClock()
    for k, delay in enumerate(delays):
        boot_us = 20_000 * k
        clock.observe(boot_us, offset + 1000 * boot_us + round(1e9 * delay))
        assert clock.known
    smallest = round(1e9 * min(delays))
    assert clock.host_ns(0) == offset + smallest
    assert clock.boot_us(clock.host_ns(5_000_000)) == 5_000_000


def test_the_boot_clock_follows_a_restart_and_forgets():
    clock = BootClock()
    for k in range(2000):
        clock.observe(20_000 * k, 20_000_000 * k + 7_000_000 - (5_000_000 if k < 10 else 0))
    assert clock.host_ns(0) == 7_000_000
    clock.observe(0, 100_000_000_000)
    assert clock.host_ns(0) == 100_000_000_000
    assert clock.boot_us(0) == 0
