"""An answer to everything: each message of pymavlink's common dialect, by the standard's own text.

What the standard says is read from the XML files that pymavlink ships: every message that speaks of
an answer, or is addressed to somebody, stands in one of the tables here, so that a new one is seen.
"""

import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from asking_bench import ME, YOU, AskingBench, message_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.dialects.v20 import common

import husky_pu

SIZES = (8, 16, 32, 64)

DEMANDED = {
    "PING": ({"target_system": 0, "target_component": 0}, {"PING"}),
    "CHANGE_OPERATOR_CONTROL": ({}, {"CHANGE_OPERATOR_CONTROL_ACK"}),
    "SET_MODE": ({}, {"COMMAND_ACK", "STATUSTEXT"}),
    "PARAM_REQUEST_READ": ({"param_id": b"MAV_TYPE", "param_index": -1}, {"PARAM_VALUE"}),
    "PARAM_REQUEST_LIST": ({}, {"PARAM_VALUE"}),
    "PARAM_SET": ({"param_id": b"MC_ROLL_P", "param_type": 9}, {"PARAM_VALUE"}),
    "PARAM_EXT_REQUEST_READ": ({"param_id": b"MAV_TYPE"}, {"PARAM_EXT_VALUE"}),
    "PARAM_EXT_REQUEST_LIST": ({}, {"PARAM_EXT_VALUE"}),
    "PARAM_EXT_SET": ({"param_id": b"MC_ROLL_P", "param_type": 9}, {"PARAM_EXT_ACK"}),
    "MISSION_REQUEST_PARTIAL_LIST": ({}, {"MISSION_ACK"}),
    "MISSION_WRITE_PARTIAL_LIST": ({}, {"MISSION_ACK"}),
    "MISSION_ITEM": ({}, {"MISSION_ACK"}),
    "MISSION_ITEM_INT": ({}, {"MISSION_ACK"}),
    "MISSION_REQUEST": ({}, {"MISSION_ACK"}),
    "MISSION_REQUEST_INT": ({}, {"MISSION_ACK"}),
    "MISSION_SET_CURRENT": ({}, {"MISSION_CURRENT", "STATUSTEXT"}),
    "MISSION_REQUEST_LIST": ({}, {"MISSION_COUNT"}),
    "MISSION_COUNT": ({"count": 3}, {"MISSION_ACK"}),
    "MISSION_CLEAR_ALL": ({}, {"MISSION_ACK"}),
    "SET_GPS_GLOBAL_ORIGIN": ({}, {"GPS_GLOBAL_ORIGIN", "STATUSTEXT"}),
    "COMMAND_INT": ({}, {"COMMAND_ACK"}),
    "COMMAND_LONG": ({}, {"COMMAND_ACK"}),
    "FILE_TRANSFER_PROTOCOL": ({}, {"FILE_TRANSFER_PROTOCOL"}),
    "TIMESYNC": ({"ts1": 77}, {"TIMESYNC"}),
    "LOG_REQUEST_LIST": ({}, {"LOG_ENTRY"}),
    "LOG_REQUEST_DATA": ({}, {"LOG_DATA"}),
    "SERIAL_CONTROL": ({"flags": 2}, {"SERIAL_CONTROL", "STATUSTEXT"}),
    "TERRAIN_CHECK": ({}, {"TERRAIN_REPORT"}),
}
"""Fields of a request that are not zero, and the kinds that answer it."""

REFUSED_IN_WORDS = {
    "PARAM_MAP_RC", "SAFETY_SET_ALLOWED_AREA", "SET_ATTITUDE_TARGET",
    "SET_ACTUATOR_CONTROL_TARGET", "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT", "GPS_INJECT_DATA", "SET_HOME_POSITION", "V2_EXTENSION",
    "SETUP_SIGNING", "PLAY_TUNE", "GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_DEVICE_SET_ATTITUDE",
    "GIMBAL_MANAGER_SET_PITCHYAW", "GIMBAL_MANAGER_SET_MANUAL_CONTROL", "TUNNEL", "CAN_FRAME",
    "CANFD_FRAME", "CAN_FILTER_MODIFY", "LOGGING_DATA", "OPEN_DRONE_ID_BASIC_ID",
    "OPEN_DRONE_ID_LOCATION", "OPEN_DRONE_ID_AUTHENTICATION", "OPEN_DRONE_ID_SELF_ID",
    "OPEN_DRONE_ID_SYSTEM", "OPEN_DRONE_ID_OPERATOR_ID", "OPEN_DRONE_ID_MESSAGE_PACK",
    "OPEN_DRONE_ID_SYSTEM_UPDATE",
    # An acknowledgment would say that it was kept; only who asked for a log gets one.
    "LOGGING_DATA_ACKED",
}  # fmt: skip
"""Addressed to us, without an answer of their own: a status text says that there is no such thing
(or, of a setpoint of zeros, what is wrong with it)."""

SILENT = {
    # Answers themselves.
    "PARAM_VALUE", "PARAM_EXT_VALUE", "PARAM_EXT_ACK", "PARAM_ERROR", "MISSION_CURRENT",
    "MISSION_ACK", "COMMAND_ACK", "GPS_GLOBAL_ORIGIN", "LOG_ENTRY", "LOG_DATA", "LOGGING_ACK",
    "TERRAIN_REPORT", "AUTOPILOT_VERSION", "MESSAGE_INTERVAL", "HOME_POSITION",
    "CAMERA_INFORMATION", "CAMERA_SETTINGS", "STORAGE_INFORMATION", "CAMERA_CAPTURE_STATUS",
    "CAMERA_IMAGE_CAPTURED", "FLIGHT_INFORMATION", "VIDEO_STREAM_INFORMATION",
    "VIDEO_STREAM_STATUS", "CAMERA_FOV_STATUS", "CAMERA_THERMAL_RANGE",
    "GIMBAL_MANAGER_INFORMATION", "GIMBAL_DEVICE_INFORMATION", "UAVCAN_NODE_INFO", "RELAY_STATUS",
    "TERRAIN_DATA", "RAW_IMU",
    # Told to whoever wants to know.
    "HEARTBEAT", "GIMBAL_DEVICE_ATTITUDE_STATUS", "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE",
    "GLOBAL_POSITION_SENSOR", "MAG_CAL_REPORT",
    # Carried out: what comes of it is seen in RC_CHANNELS; there is nothing to erase or to end.
    "RC_CHANNELS_OVERRIDE", "LOG_ERASE", "LOG_REQUEST_END",
    # Superseded by SET_MESSAGE_INTERVAL, said again and again by MAVProxy.
    "REQUEST_DATA_STREAM",
    # Asked by an autopilot of a ground station, or of another kind of component.
    "TERRAIN_REQUEST", "RESOURCE_REQUEST", "WIFI_CONFIG_AP",
}  # fmt: skip
"""They speak of answers, or are addressed, and call for none from a flight controller."""

ANSWERING = re.compile(r"\b(respon\w+|re?pl(y|ies)|ack\w*|request\w*|answer\w*|re-emitted)\b|emit ")


def standard():
    """Every message of the standard: its description, and whether it is addressed."""
    directory = Path(common.__file__).parent
    found = {}
    for file in ("minimal.xml", "standard.xml", "common.xml"):
        for message in ElementTree.parse(directory / file).getroot().iter("message"):
            addressed = message.find("field[@name='target_system']") is not None
            text = " ".join((message.findtext("description") or "").split())
            found[message.get("name")] = (text, addressed)
    return found


# Everything -------------------------------------------------------------------------------------
def test_every_message_of_the_standard_that_speaks_of_an_answer_is_in_a_table():
    tables = (set(DEMANDED), REFUSED_IN_WORDS, SILENT)
    speaking = {
        name
        for name, (text, addressed) in standard().items()
        if addressed or ANSWERING.search(text)
    }
    assert len(speaking) > 90
    in_one = set.union(*tables)
    assert speaking - in_one == set()
    assert sum(map(len, tables)) == len(in_one)


@pytest.mark.parametrize("name", sorted(DEMANDED))
def test_an_answer_that_the_standard_demands(name):
    fields, kinds = DEMANDED[name]
    answers = AskingBench().ask(message_of(name, **fields))
    assert {m.get_type() for m in answers} == kinds
    for answer in answers:
        assert (answer.get_srcSystem(), answer.get_srcComponent()) == YOU
        if hasattr(answer, "target_system"):
            assert answer.target_system == ME[0]
            assert getattr(answer, "target_component", ME[1]) == ME[1]


@pytest.mark.parametrize("name", sorted(REFUSED_IN_WORDS))
def test_what_there_is_not_is_said_in_words(name):
    bench = AskingBench()
    fields = {"group_mlx": 1} if name == "SET_ACTUATOR_CONTROL_TARGET" else {}
    (answer,) = bench.ask(message_of(name, **fields))
    assert answer.get_type() == "STATUSTEXT"
    said = name if not name.endswith(("ATTITUDE_TARGET", "CONTROL_TARGET")) else "Setpoint refused"
    assert said in answer.text
    assert bench.ask(message_of(name, **fields)) == []  # said once a second at most


@pytest.mark.parametrize("name", sorted(SILENT))
def test_what_is_no_request_is_not_answered(name):
    known = {m.msgname for m in common.mavlink_map.values()}
    assert name in known
    assert AskingBench().ask(message_of(name)) == []


def test_two_flight_controllers_do_not_talk_for_ever():
    """What one answers the other takes in peace; a list of no missions it acknowledges."""
    first, second = AskingBench(), AskingBench(parameters={"MAV_SYS_ID": 2})
    second.codec.srcSystem = 1
    requests = [message_of(name, **fields) for name, (fields, _) in DEMANDED.items()]
    requests += [message_of(name) for name in REFUSED_IN_WORDS]
    answers = [answer for request in requests for answer in first.ask(request)]
    assert len(answers) > 50
    for answer in answers:
        if hasattr(answer, "target_system"):
            answer.target_system, answer.target_component = 2, 1
        said = {m.get_type() for m in second.ask(answer)}
        assert said == ({"MISSION_ACK"} if answer.get_type() == "MISSION_COUNT" else set())


FIELDS = {
    "char": None,
    "float": st.floats(width=32),
    "double": st.floats(),
    **{f"int{bits}_t": st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in SIZES},
    **{f"uint{bits}_t": st.integers(0, 2**bits - 1) for bits in SIZES},
}


@st.composite
def any_message(draw):
    """A message of any kind with any content, addressed to us more often than not."""
    kind = draw(st.sampled_from(sorted(common.mavlink_map.values(), key=lambda m: m.id)))
    values = []
    for field, of_type in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        length = kind.array_lengths[kind.ordered_fieldnames.index(field)]
        if field.startswith("target_") and draw(st.integers(0, 3)):
            values.append(1)
        elif of_type == "char":
            values.append(draw(st.binary(max_size=length or 1)))
        elif length:
            values.append(draw(st.lists(FIELDS[of_type], min_size=length, max_size=length)))
        else:
            values.append(draw(FIELDS[of_type]))
    return kind(*values)


@settings(
    max_examples=150,  # each takes 8 ms
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.large_base_example],
)
@given(st.lists(any_message(), max_size=5), st.booleans())
def test_any_message_is_survived_and_every_answer_can_be_read(messages, lockstep):
    bench = AskingBench(lockstep=lockstep)
    for message in messages:
        bench.autopilot.receive(message.pack(bench.codec), "a")
        bench.tick(2)
    bench.tick(40)
    bench.take()
    assert bench.reader.counters.damaged == bench.reader.counters.garbage_bytes == 0


# One by one -------------------------------------------------------------------------------------
def test_missions():
    bench = AskingBench()

    def result(name, **fields):
        (ack,) = bench.ask(message_of(name, **fields))
        return ack.type, ack.mission_type

    unsupported, accepted = common.MAV_MISSION_UNSUPPORTED, common.MAV_MISSION_ACCEPTED
    assert result("MISSION_COUNT", count=3, mission_type=1) == (unsupported, 1)
    assert result("MISSION_COUNT", count=0) == (accepted, 0)
    assert result("MISSION_CLEAR_ALL", mission_type=255) == (accepted, 255)
    assert result("MISSION_REQUEST_INT", seq=4) == (common.MAV_MISSION_INVALID_SEQUENCE, 0)
    current = bench.ask(message_of("MISSION_SET_CURRENT", seq=4))
    assert [m.get_type() for m in current] == ["STATUSTEXT", "MISSION_CURRENT"]
    assert current[0].text == "Mission item 4: there is no mission"
    assert current[1].mission_state == common.MISSION_STATE_NO_MISSION


def test_logs():
    (entry,) = AskingBench().ask(message_of("LOG_REQUEST_LIST", end=0xFFFF))
    assert (entry.id, entry.num_logs) == (0, 0)
    (data,) = AskingBench().ask(message_of("LOG_REQUEST_DATA", id=3, ofs=90, count=90))
    assert (data.id, data.ofs, data.count) == (3, 90, 0)


def test_a_shell_is_not_there():
    bench = AskingBench()
    line = list(b"help\n".ljust(70, b"\0"))
    for flags in (0, 6):  # MAVSDK does not say that it wants an answer
        typed = message_of("SERIAL_CONTROL", device=10, flags=flags, count=5, data=line)
        (answer,) = bench.ask(typed)
        assert bytes(answer.data[: answer.count]) == b"there is no shell here\n"
    (answer,) = bench.ask(message_of("SERIAL_CONTROL", device=10, flags=2))  # asks for output
    assert (answer.count, answer.flags) == (0, common.SERIAL_CONTROL_FLAG_REPLY)
    assert bench.ask(message_of("SERIAL_CONTROL", device=10, flags=1)) == []
    (text,) = bench.ask(message_of("SERIAL_CONTROL", device=1, flags=0, count=5, data=line))
    assert text.text == "SERIAL_CONTROL: there is no port 1 here"


def test_a_bad_mode_is_refused_with_what_is_allowed():
    bench = AskingBench()
    text, ack = bench.ask(message_of("SET_MODE", base_mode=1, custom_mode=4 << 16))
    assert text.text == "Mode 4 denied; allowed: 6 OFFBOARD, 7 STABILIZED"
    assert (ack.command, ack.result) == (11, common.MAV_RESULT_DENIED)
    text, _ = bench.ask(message_of("SET_MODE", base_mode=0, custom_mode=6 << 16))
    assert "bit 1" in text.text
    (ack,) = bench.ask(message_of("SET_MODE", base_mode=1, custom_mode=7 << 16))
    assert (ack.command, ack.result) == (11, common.MAV_RESULT_ACCEPTED)
    assert bench.command(176, 1, 255)["STATUSTEXT"].text.startswith("Mode 255 denied; allowed: 6")


def test_versions():
    bench = AskingBench()
    answers = bench.command(519)
    version = answers["PROTOCOL_VERSION"]
    assert (version.min_version, version.version, version.max_version) == (100, 200, 200)
    assert answers["COMMAND_ACK"].result == 0
    about = bench.command(512, 148)["AUTOPILOT_VERSION"]
    major, minor, patch = husky_pu.VERSION
    assert about.flight_custom_version == [patch, minor, major, 0, 0, 0, 0, 0]
    manifest = Path(__file__).parents[1] / "package.xml"
    stated = ElementTree.parse(manifest).getroot().findtext("version")
    assert stated == ".".join(map(str, husky_pu.VERSION))
    assert about.capabilities & common.MAV_PROTOCOL_CAPABILITY_FTP


def test_the_system_time_is_that_of_the_host_at_boot_and_goes_on_with_our_clock():
    bench = AskingBench()
    bench.ask(message_of("HEARTBEAT"))
    bench.tick(1000)
    told = [m for m in bench.take() if m.get_type() == "SYSTEM_TIME"]
    assert [m.time_boot_ms for m in told] == [1000, 2000]
    for message in told:
        assert message.time_unix_usec == 1_800_000_000_000_000 + 1000 * message.time_boot_ms


def test_an_interval_is_told_by_either_command():
    bench = AskingBench()
    for command in ((510, 30), (512, 244, 30)):
        interval = bench.command(*command)["MESSAGE_INTERVAL"]
        assert (interval.message_id, interval.interval_us) == (30, 50000)
    assert bench.command(512, 244, math.nan)["COMMAND_ACK"].result == common.MAV_RESULT_DENIED


# pymavlink's dialects ---------------------------------------------------------------------------
def test_nothing_is_streamed_that_pymavlink_does_not_know():
    bench = AskingBench()
    bench.ask(message_of("HEARTBEAT"))
    bench.tick(1000)
    known = set(dialect.mavlink_map) - {290, 291, 300, 397}
    assert {m.get_msgId() for m in bench.take()} <= known
