"""The parameter protocols against bare messages: what is told, refused, and told to others."""

import math
import struct

import pytest
from asking_bench import AskingBench, message_of
from pymavlink.dialects.v20 import common

from husky_pu.autopilot.flight_parameters import TABLE


def put(name, value, type_=9):
    field = struct.unpack("<f", struct.pack("<i", value))[0] if type_ == 6 else value
    return message_of("PARAM_SET", param_id=name.encode(), param_value=field, param_type=type_)


@pytest.mark.parametrize(
    ("message", "error", "held"),
    [
        (put("NO_SUCH", 1.0), common.MAV_PARAM_ERROR_DOES_NOT_EXIST, None),
        (put("COM_OF_LOSS_T", 61.0), common.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, 1.0),
        (put("COM_OF_LOSS_T", math.nan), common.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, 1.0),
        (put("COM_OF_LOSS_T", 1, 6), common.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, 1.0),
    ],
)
def test_a_parameter_that_cannot_be_set(message, error, held):
    answers = {m.get_type(): m for m in AskingBench().ask(message)}
    told = answers["PARAM_ERROR"]
    assert (told.param_id, told.error) == (message.param_id, error)
    assert message.param_id in answers["STATUSTEXT"].text
    assert ("PARAM_VALUE" in answers) == (held is not None)
    if held is not None:
        assert answers["PARAM_VALUE"].param_value == held


@pytest.mark.parametrize("kind", ["PARAM_SET", "PARAM_EXT_SET"])
def test_everybody_is_told_of_a_parameter_that_was_set(kind):
    bench = AskingBench()
    for link in "bc":
        bench.autopilot.receive(message_of("HEARTBEAT").pack(bench.codec), link)
        bench.autopilot.take_output(link)
    bench.ask(
        put("COM_OF_LOSS_T", 0.75)
        if kind == "PARAM_SET"
        else extended("COM_OF_LOSS_T", 0.75, "<f", 9)
    )
    for link in "bc":
        told = [
            m
            for m in bench.reader.feed(bench.autopilot.take_output(link))
            if m.get_type() == "PARAM_VALUE"
        ]
        assert [(m.param_id, m.param_value) for m in told] == [("COM_OF_LOSS_T", 0.75)]


def bytes_of(field):
    return struct.unpack("<I", struct.pack("<f", field))[0]


def test_the_hash_of_all_parameters_changes_with_each():
    bench = AskingBench()
    ask = message_of("PARAM_REQUEST_READ", param_id=b"_HASH_CHECK", param_index=-1)

    def told():
        (value,) = bench.ask(ask)
        assert (value.param_id, value.param_type) == ("_HASH_CHECK", 5)
        assert (value.param_count, value.param_index) == (len(TABLE), 0xFFFF)
        return bytes_of(value.param_value)

    first = told()
    assert told() == first == expected_hash(bench.autopilot.parameters)
    bench.ask(put("COM_OF_LOSS_T", 0.75))
    assert told() != first
    assert told() == expected_hash(bench.autopilot.parameters)


def expected_hash(parameters):
    """PX4's: CRC-32 from 0 and without inversions, bit by bit, over names and values by name."""
    crc = 0
    for name in sorted(TABLE):
        value = parameters[name]
        for byte in name.encode() + struct.pack("<i" if isinstance(value, int) else "<f", value):
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ 0xEDB88320 if crc & 1 else crc >> 1
    return crc


def test_who_has_all_parameters_is_sent_no_more():
    bench = AskingBench()
    bench.ask(message_of("PARAM_REQUEST_LIST"), ticks=3)
    (value,) = (
        m
        for m in bench.ask(
            message_of("PARAM_REQUEST_READ", param_id=b"_HASH_CHECK", param_index=-1)
        )
        if m.param_id == "_HASH_CHECK"
    )
    known = message_of(
        "PARAM_SET", param_id=b"_HASH_CHECK", param_value=value.param_value, param_type=5
    )
    bench.ask(known)
    bench.tick(100)
    assert not [m for m in bench.take() if m.get_type() == "PARAM_VALUE"]


def extended(name, value, form, type_):
    return message_of(
        "PARAM_EXT_SET",
        param_id=name.encode(),
        param_value=struct.pack(form, value).ljust(128, b"\0"),
        param_type=type_,
    )


def raw(message):
    """The 128 bytes of a value; pymavlink strips zeros at their end."""
    return bytes(message._param_value_raw).ljust(128, b"\0")


def test_the_extended_protocol_reads_and_sets_the_same_parameters():
    bench = AskingBench()
    values = bench.ask(message_of("PARAM_EXT_REQUEST_LIST"), ticks=len(TABLE) + 5)
    assert [m.param_id for m in values] == list(TABLE)
    for message in values:
        form = "<i" if message.param_type == 6 else "<f"
        (held,) = struct.unpack_from(form, raw(message))
        assert held == bench.autopilot.parameters[message.param_id]
    for message, result, held in (
        (extended("COM_OF_LOSS_T", 2.0, "<f", 9), common.PARAM_ACK_ACCEPTED, 2.0),
        (extended("NAV_RCL_ACT", 5, "<i", 6), common.PARAM_ACK_ACCEPTED, None),
        (extended("COM_OF_LOSS_T", 61.0, "<f", 9), common.PARAM_ACK_VALUE_UNSUPPORTED, 2.0),
        (extended("COM_OF_LOSS_T", 1, "<i", 6), common.PARAM_ACK_VALUE_UNSUPPORTED, 2.0),
        (extended("NO_SUCH", 3.0, "<f", 9), common.PARAM_ACK_FAILED, 3.0),
    ):
        ack = next(m for m in bench.ask(message) if m.get_type() == "PARAM_EXT_ACK")
        assert (ack.param_id, ack.param_result) == (message.param_id, result)
        assert held is None or struct.unpack_from("<f", raw(ack))[0] == held
    assert bench.autopilot.parameters["NAV_RCL_ACT"] == 5
    (error,) = bench.ask(message_of("PARAM_EXT_REQUEST_READ", param_id=b"NO_SUCH", param_index=-1))
    assert error.error == common.MAV_PARAM_ERROR_DOES_NOT_EXIST


def test_reset_of_all_parameters():
    bench = AskingBench()
    bench.ask(put("COM_OF_LOSS_T", 0.75))
    bench.autopilot.vehicle.logic.arm(force=True)
    assert bench.command(245, 2)["COMMAND_ACK"].result == common.MAV_RESULT_TEMPORARILY_REJECTED
    bench.autopilot.vehicle.logic.disarm(force=True)
    assert bench.command(245, 2)["COMMAND_ACK"].result == 0
    assert bench.autopilot.parameters["COM_OF_LOSS_T"] == 1.0
    bench.autopilot.parameters.outlasting = True
    assert bench.command(245, 1)["COMMAND_ACK"].result == 0
    bench.autopilot.parameters.outlasting = False
    answers = bench.command(245, 1)  # nobody stores them here
    assert answers["COMMAND_ACK"].result == common.MAV_RESULT_DENIED
    assert "not stored" in answers["STATUSTEXT"].text
