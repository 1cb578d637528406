"""The flight controller's side of MAVLink, against another dialect and against bare bytes."""

import math
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mavlink_bench import KEY, Bench, heartbeat, signed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from husky_pu.autopilot.failsafes import FlightMode
from husky_pu.autopilot.flight_parameters import TABLE

CRC_EXTRA = {  # message id: CRC_EXTRA and length of the whole payload, as published
    0: (50, 9),
    1: (124, 43),
    2: (137, 12),
    22: (220, 25),
    30: (39, 28),
    31: (246, 48),
    36: (222, 37),
    65: (118, 42),
    77: (143, 10),
    83: (22, 37),
    105: (93, 63),
    111: (34, 16),
    147: (154, 54),
    148: (178, 78),
    244: (95, 6),
    245: (130, 2),
    253: (83, 54),
    290: (251, 46),
    291: (10, 57),
    300: (217, 22),
    397: (182, 108),
}


def crc_x25(data):
    """CRC-16/MCRF4XX, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1
    return crc


def test_every_frame_is_right_to_the_last_bit():
    bench = Bench()
    bench.send(heartbeat())
    bench.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.send(dialect.MAVLink_timesync_message(0, 5))
    bench.command(520)
    for number in (290, 291):
        assert bench.command(511, number, 20000).result == 0
    bench.send(dialect.MAVLink_command_long_message(1, 1, 519, 0, 0, 0, 0, 0, 0, 0, 0))
    bench.send(dialect.MAVLink_command_long_message(1, 1, 512, 0, 397, 0, 0, 0, 0, 0, 0))
    bench.autopilot.receive(b"", "a")
    bench.tick(600)
    bench.send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    bench.send(dialect.MAVLink_command_long_message(1, 1, 510, 0, 31, 0, 0, 0, 0, 0, 0))
    bench.tick(600)
    data = bench.autopilot.take_output("a")
    seen, sequence, at = set(), None, 0
    while at < len(data):
        magic, size, incompatible, _, number, system, component = data[at : at + 7]
        message_id = int.from_bytes(data[at + 7 : at + 10], "little")
        assert (magic, incompatible, system, component) == (0xFD, 0, 1, 1)
        extra, length = CRC_EXTRA[message_id]
        assert 1 <= size <= length
        body = data[at + 1 : at + 10 + size]
        crc = int.from_bytes(data[at + 10 + size : at + 12 + size], "little")
        assert crc == crc_x25(body + bytes((extra,))), message_id
        assert sequence is None or number == (sequence + 1) % 256
        sequence = number
        seen.add(message_id)
        at += 12 + size
    assert at == len(data)
    assert seen >= set(CRC_EXTRA) - {111, 148}


def test_rates_and_the_order_of_a_bundle():
    bench = Bench()
    bench.send(heartbeat())
    bench.tick(1)
    bench.take()
    bench.tick(500)
    kinds = [m.get_type() for m in bench.take()]
    expected = {"HEARTBEAT": 1, "ATTITUDE_QUATERNION": 50, "ATTITUDE_TARGET": 50, "ATTITUDE": 20}
    for kind, count in expected.items():
        assert kinds.count(kind) == pytest.approx(count, abs=1), kind
    bundles = "".join(
        {"ATTITUDE_QUATERNION": "q", "ATTITUDE_TARGET": "t", "SERVO_OUTPUT_RAW": "s"}.get(k, "")
        for k in kinds
    )
    assert bundles == "qts" * 50


def test_intervals():
    bench = Bench()
    bench.send(heartbeat())
    assert bench.command(511, 30, 4000).result == 0  # ATTITUDE at 250 Hz
    assert bench.command(511, 31, -1).result == 0
    assert bench.command(511, 9999, 1000).result == 2
    assert bench.command(511, math.nan, 1000).result == 2
    interval = bench.command(510, 30, kind="MESSAGE_INTERVAL")
    assert interval.interval_us == 4000
    bench.tick(500)
    kinds = [m.get_type() for m in bench.take()]
    assert kinds.count("ATTITUDE") == 250
    assert kinds.count("ATTITUDE_QUATERNION") == 0
    assert bench.command(511, 31, 0).result == 0
    bench.tick(500)
    assert [m.get_type() for m in bench.take()].count("ATTITUDE_QUATERNION") == 50


def test_replies_go_to_who_asked_and_streams_to_all():
    bench = Bench()
    bench.send(heartbeat(), "a")
    bench.send(heartbeat(), "b")
    bench.send(dialect.MAVLink_ping_message(7, 1, 0, 0), "a")
    assert [m.get_type() for m in bench.take("a")] == ["PING"]
    assert bench.take("b") == []
    bench.tick(500)
    for link in "ab":
        assert "HEARTBEAT" in [m.get_type() for m in bench.take(link)]
    assert bench.autopilot.take_output("c") == b""


def test_a_silent_link_is_dropped_and_a_permanent_one_not():
    bench = Bench()
    bench.autopilot.server.open_link("station")
    bench.send(heartbeat(), "a")
    bench.tick(5100)
    assert bench.autopilot.server.links.names == ["station"]


def test_not_more_than_so_many_links():
    bench = Bench()
    for number in range(100):
        bench.send(heartbeat(), number)
    assert len(bench.autopilot.server.links.names) == 16


def test_what_is_addressed_elsewhere_is_ignored():
    bench = Bench()
    message = dialect.MAVLink_command_long_message(2, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    bench.send(message)
    message = dialect.MAVLink_command_long_message(1, 154, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    bench.send(message)
    assert bench.take() == []
    assert not bench.logic.armed
    assert bench.autopilot.server.foreign == 2


def test_arming_says_why_not():
    bench = Bench().tick(700)
    bench.send(heartbeat())
    message = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    bench.send(message)
    text, ack = (m for m in bench.take() if m.get_type() in ("STATUSTEXT", "COMMAND_ACK"))
    assert text.text == "Arming denied: no manual control input"
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (400, 1, 255, 190)
    assert bench.command(400, 1, 21196).result == 0
    assert bench.logic.armed
    assert bench.command(400, 0).result == 0
    assert not bench.logic.armed
    assert bench.command(400, 0.5).result == 2


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"battery_voltage": 0.0}, "battery not connected"),
        ({"battery_voltage": 21.0}, "low battery"),
        ({"magnetic_field": (0.0, 0.0, 0.0)}, "compass missing"),
        ({"angular_velocity": (math.nan, 0.0, 0.0)}, "gyro or accelerometer missing"),
        ({"angular_velocity": (0.0, 0.0, 0.5)}, "unit is moving"),
        ({"specific_force": (9.5, 0.0, -2.4)}, "tilted too far"),
    ],
)
def test_pre_arm_checks(change, reason):
    bench = Bench()
    bench.sample = bench.sample._replace(**change)
    bench.tick(3000)
    bench.setpoint()
    bench.tick(10)
    bench.command(400, 1)
    bench.logic.texts.clear()
    assert not bench.logic.armed
    bench.offboard()
    assert bench.logic.arm() == reason


def test_modes():
    bench = Bench().tick(700)
    bench.send(heartbeat())
    bench.send(dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0))
    text, ack = (m for m in bench.take() if m.get_type() in ("STATUSTEXT", "COMMAND_ACK"))
    assert text.text == "OFFBOARD denied: no offboard signal"
    assert ack.result == 1
    bench.setpoint()
    bench.tick(10)
    assert bench.command(176, 1, 6).result == 1  # one is no stream
    for _ in range(4):
        bench.setpoint()
        bench.tick(200)  # 2.5 Hz
    assert bench.command(176, 1, 6).result == 0
    assert bench.logic.mode is FlightMode.OFFBOARD
    assert bench.command(176, 1, 4).result == 2  # AUTO is not ours
    assert bench.command(176, 0, 6).result == 2  # not a custom mode
    assert bench.command(176, 1, math.nan).result == 2
    assert bench.command(176, 1, 7).result == 0
    bench.setpoint()
    bench.send(dialect.MAVLink_set_mode_message(1, 1, 6 << 16))
    assert bench.logic.mode is FlightMode.OFFBOARD
    bench.tick(500)
    beat = next(m for m in bench.take() if m.get_type() == "HEARTBEAT")
    assert beat.custom_mode == 6 << 16 and beat.autopilot == 12 and beat.type == 2


def test_a_slow_stream_is_none():
    bench = Bench()
    for _ in range(6):
        bench.setpoint()
        bench.tick(300)  # 1.67 Hz
    assert bench.command(176, 1, 6).result == 1


def test_command_int_and_unknown_commands():
    bench = Bench()
    message = dialect.MAVLink_command_int_message(1, 1, 0, 520, 0, 0, 1, 0, 0, 0, 0, 0, 0)
    bench.send(message)
    kinds = {m.get_type(): m for m in bench.take()}
    assert kinds["COMMAND_ACK"].result == 0
    assert kinds["AUTOPILOT_VERSION"].capabilities & 8192
    assert bench.command(22).result == 3  # take-off
    assert bench.command(512, 148, kind="AUTOPILOT_VERSION").flight_sw_version >> 24 == 1
    assert bench.command(512, 4242).result == 2


def test_timesync_and_missions():
    bench = Bench().tick(50)
    answer = bench.ask(dialect.MAVLink_timesync_message(0, 1234), "TIMESYNC")
    assert (answer.tc1, answer.ts1) == (bench.time_ns - 2_000_000, 1234)
    count = bench.ask(dialect.MAVLink_mission_request_list_message(1, 1, 0), "MISSION_COUNT")
    assert (count.count, count.target_system) == (0, 255)


# Parameters -------------------------------------------------------------------------------------
def as_int(field):
    return struct.unpack("<i", struct.pack("<f", field))[0]


def test_parameter_list():
    bench = Bench()
    bench.send(heartbeat())
    bench.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.tick(len(TABLE) + 5)
    values = [m for m in bench.take() if m.get_type() == "PARAM_VALUE"]
    assert [m.param_index for m in values] == list(range(len(TABLE)))
    for message in values:
        stored = bench.autopilot.parameters[message.param_id]
        if message.param_type == 6:
            assert as_int(message.param_value) == stored
        else:
            assert message.param_type == 9
            assert message.param_value == stored


def request(name=b"", index=-1):
    return dialect.MAVLink_param_request_read_message(1, 1, name, index)


def test_read_and_set_parameters():
    bench = Bench()
    assert bench.ask(request(b"COM_OF_LOSS_T"), "PARAM_VALUE").param_value == 1.0
    value = bench.ask(request(index=0), "PARAM_VALUE")
    assert (value.param_id, as_int(value.param_value)) == ("MAV_SYS_ID", 1)
    for bad, name, index in ((request(b"NO_SUCH"), "NO_SUCH", -1), (request(index=1000), "", 1000)):
        error = bench.ask(bad, "PARAM_ERROR")
        assert (error.error, error.param_id, error.param_index) == (1, name, index)
        assert (error.target_system, error.target_component) == (255, 190)

    def change(name, field, type_):
        return bench.ask(
            dialect.MAVLink_param_set_message(1, 1, name, field, type_), "PARAM_VALUE"
        ).param_value

    assert change(b"COM_OF_LOSS_T", 0.75, 9) == 0.75
    assert bench.autopilot.parameters["COM_OF_LOSS_T"] == 0.75
    assert change(b"COM_OF_LOSS_T", 61.0, 9) == 0.75
    assert change(b"COM_OF_LOSS_T", math.nan, 9) == 0.75
    assert change(b"COM_OF_LOSS_T", 2.0, 6) == 0.75  # another type
    four = struct.unpack("<f", struct.pack("<i", 5))[0]
    assert as_int(change(b"NAV_RCL_ACT", four, 6)) == 5
    assert as_int(change(b"NAV_RCL_ACT", 4.0, 6)) == 5  # a float's bytes make a huge integer


# Telemetry --------------------------------------------------------------------------------------
def test_the_current_saturates_where_its_field_ends():
    bench = Bench()
    bench.sample = bench.sample._replace(battery_current=401.0)
    bench.tick(10)
    battery = bench.command(512, 147, kind="BATTERY_STATUS")
    assert battery.current_battery == 32767
    assert battery.voltages[:6] == [4167] * 6 and battery.voltages[6] == 65535
    status = bench.command(512, 1, kind="SYS_STATUS")
    assert status.current_battery == 32767
    assert status.voltage_battery == 25000


def test_attitude_in_its_own_order():
    bench = Bench()
    bench.sample = bench.sample._replace(
        specific_force=(0.0, -9.81 * math.sin(0.2), -9.81 * math.cos(0.2)),
        magnetic_field=(0.21, 0.43 * math.sin(0.2), 0.43 * math.cos(0.2)),
    )
    bench.tick(60)
    q = bench.command(512, 31, kind="ATTITUDE_QUATERNION")
    assert (q.q1, q.q2) == pytest.approx((math.cos(0.1), math.sin(0.1)), abs=1e-6)
    euler = bench.command(512, 30, kind="ATTITUDE")
    assert (euler.roll, euler.pitch, euler.yaw) == pytest.approx((0.2, 0.0, 0.0), abs=1e-6)


# Signing ----------------------------------------------------------------------------------------
def test_signing():
    bench = Bench(signing_key=KEY)
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0)
    now = 60 * 10**12
    bench.send(arm)
    bench.send(arm, codec=signed(b"\1" * 32, now))
    assert not bench.logic.armed
    assert bench.autopilot.server.links.refused == 2
    bench.send(arm, codec=signed(KEY, now))
    assert bench.logic.armed
    data = bench.autopilot.take_output("a")
    reader = dialect.MAVLink(None)
    reader.signing.secret_key = KEY
    assert [m.get_signed() for m in reader.parse_buffer(data)] == [True, True]
    other = dialect.MAVLink(None)
    other.robust_parsing = True
    other.signing.secret_key = b"\2" * 32
    assert all(m.get_type() == "BAD_DATA" for m in other.parse_buffer(data))


# Any bytes --------------------------------------------------------------------------------------
def frames():
    """Good frames of any content."""
    field = st.floats(width=32, allow_nan=True, allow_infinity=True)
    small = st.integers(0, 255)
    number = st.sampled_from([22, 176, 185, 400, 510, 511, 512, 520, 0, 65535])
    return st.one_of(
        st.builds(
            lambda c, p: dialect.MAVLink_command_long_message(1, 1, c, 0, *p),
            number,
            st.lists(field, min_size=7, max_size=7),
        ),
        st.builds(
            lambda c, p, x: dialect.MAVLink_command_int_message(1, 1, 0, c, 0, 0, *p, x, x, 0.0),
            number,
            st.lists(field, min_size=4, max_size=4),
            st.integers(-(2**31), 2**31 - 1),
        ),
        st.builds(
            lambda m, q, t: dialect.MAVLink_set_attitude_target_message(
                0, 1, 1, m, q[:4], *q[4:], t
            ),
            small,
            st.lists(field, min_size=7, max_size=7),
            field,
        ),
        st.builds(
            lambda g, c: dialect.MAVLink_set_actuator_control_target_message(0, g, 1, 1, c),
            small,
            st.lists(field, min_size=8, max_size=8),
        ),
        st.builds(
            lambda n, v, t: dialect.MAVLink_param_set_message(1, 1, n, v, t),
            st.one_of(st.sampled_from([name.encode() for name in TABLE]), st.binary(max_size=16)),
            field,
            small,
        ),
        st.builds(
            lambda n, i: dialect.MAVLink_param_request_read_message(1, 1, n, i),
            st.binary(max_size=16),
            st.integers(-(2**15), 2**15 - 1),
        ),
        st.builds(
            lambda c: dialect.MAVLink_rc_channels_override_message(1, 1, *c),
            st.lists(st.integers(0, 65535), min_size=18, max_size=18),
        ),
        st.builds(
            lambda b, c: dialect.MAVLink_set_mode_message(1, b, c),
            small,
            st.integers(0, 2**32 - 1),
        ),
    )


@settings(max_examples=80, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.one_of(frames(), st.binary(max_size=60), st.integers(1, 40)), max_size=30),
    st.booleans(),
)
def test_any_bytes_are_survived_and_every_answer_can_be_read(pieces, lockstep):
    bench = Bench(lockstep=lockstep)
    bench.send(heartbeat())
    thrust = 0.0
    for piece in pieces:
        if isinstance(piece, int):
            for _ in range(piece):
                bench.tick()
                rise = bench.logic.thrust - thrust
                assert rise <= 0.002 * bench.autopilot.parameters["HKY_THR_UP"] + 1e-12
                thrust = bench.logic.thrust
                low = bench.autopilot.parameters["PWM_MAIN_DISARM"]
                assert all(1000 <= p <= 2000 or p == low for p in bench.autopilot.vehicle.pwm)
        elif isinstance(piece, bytes):
            bench.autopilot.receive(piece, "a")
        else:
            data = piece.pack(bench.codec)
            bench.autopilot.receive(data, "a")
    bench.tick(60)
    for message in bench.take():
        assert message.get_type() != "BAD_DATA"


@settings(max_examples=100)
@given(st.data())
def test_a_truncated_frame_costs_no_other(data):
    """After garbage and the head of a frame the next frames get through, in time."""
    bench = Bench()
    whole = heartbeat().pack(bench.codec)
    cut = data.draw(st.integers(1, len(whole) - 1))
    bench.autopilot.receive(data.draw(st.binary(max_size=5)) + whole[:cut], "a")
    bench.tick(30)
    bench.autopilot.receive(dialect.MAVLink_timesync_message(0, 77).pack(bench.codec) * 2, "a")
    bench.tick(30)
    bench.tick(30)
    answers = [m for m in bench.take() if m.get_type() == "TIMESYNC"]
    assert [m.ts1 for m in answers] in ([77, 77], [77])
