"""Messages that pymavlink's dialect lacks: checksum seeds by the guide, bytes by hand."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega, common

from husky_pu.mavlink import frames as mavlink_frames
from husky_pu.mavlink.dialect import (
    ComponentMetadata,
    EscInfo,
    EscStatus,
    ProtocolVersion,
    SetAttitudeTarget,
)

FIELDS = (1234, 1, 1, 39, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.25)


def crc_extra(message):
    """CRC_EXTRA as MAVLink's guide to serialisation defines it."""
    crc = 0xFFFF

    def add(data):
        nonlocal crc
        for byte in data:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1

    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    add(f"{message.msgname} ".encode())
    for name, length in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        add(f"{types[name]} {name} ".encode())
        if length:
            add(bytes([length]))
    return (crc & 0xFF) ^ (crc >> 8)


@pytest.mark.parametrize("message", [EscInfo, EscStatus, ProtocolVersion, ComponentMetadata])
def test_seeds_of_the_checksums(message):
    assert crc_extra(message) == message.crc_extra


def read(data):
    reader = mavlink_frames.FrameReader(common.MAVLink(None))
    (message,) = reader.feed(data)
    return message


def test_thrust_body_goes_behind_the_payload():
    message = SetAttitudeTarget(*FIELDS, thrust_body=(0.5, -0.25, -0.125))
    data = message.pack(common.MAVLink(None))
    assert data[1] == 39 + 12
    assert struct.unpack("<3f", data[10 + 39 : 10 + 51]) == (0.5, -0.25, -0.125)
    heard = read(data)
    assert heard.thrust_body == [0.5, -0.25, -0.125]
    assert heard.to_dict()["thrust_body"] == [0.5, -0.25, -0.125]
    assert (heard.time_boot_ms, heard.type_mask, heard.thrust) == (1234, 39, 0.25)
    # Who does not know the extension reads the rest.
    assert ardupilotmega.MAVLink(None).decode(bytearray(data)).thrust == 0.25


def test_without_the_extension_it_is_zero():
    for codec in (ardupilotmega.MAVLink(None), common.MAVLink(None)):
        data = codec.set_attitude_target_encode(*FIELDS).pack(codec)
        assert read(data).thrust_body == [0.0, 0.0, 0.0]


def test_escs_there_and_back():
    codec = common.MAVLink(None)
    status = EscStatus(0, 2**40, [1, -2, 30000, 42000], [22.0] * 4, [1.5, -3.0, 0.0, 60.0])
    heard = read(status.pack(codec))
    assert heard.get_type() == "ESC_STATUS" and heard.time_usec == 2**40
    assert heard.rpm == [1, -2, 30000, 42000] and heard.current == [1.5, -3.0, 0.0, 60.0]
    info = EscInfo(0, 5, 0, 4, 0, 15, [0, 64, 0, 0], [0] * 4, [32767] * 4)
    heard = read(info.pack(codec))
    assert (heard.info, heard.count, heard.failure_flags) == (15, 4, [0, 64, 0, 0])
    assert heard.temperature == [32767] * 4


def test_what_a_ground_station_asks_at_first_there_and_back():
    codec = common.MAVLink(None)
    heard = read(ProtocolVersion(200, 100, 200, list(range(8)), [255] * 8).pack(codec))
    assert (heard.version, heard.min_version, heard.max_version) == (200, 100, 200)
    assert (heard.spec_version_hash, heard.library_version_hash) == (list(range(8)), [255] * 8)
    address = b"mftp:///general.json"
    heard = read(ComponentMetadata(7, 2**31, address).pack(codec))
    assert (heard.time_boot_ms, heard.file_crc) == (7, 2**31)
    assert heard.uri == address.decode()
