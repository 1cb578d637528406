"""Frames against published and captured ones, and the stream parser against anything."""

import itertools
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.vn200.binary import GROUPS, IMU_LAYOUT, BinaryOutput, OutputLayout
from husky_drivers.vn200.protocol import (
    AsciiMessage,
    Checksum,
    ErrorCode,
    ProtocolError,
    crc16,
    decode_ascii,
    encode_ascii,
    hexadecimal,
)
from husky_drivers.vn200.stream import BinaryPacket, StreamParser

PUBLISHED_LINES = [
    "$VNRRG,8*4B",
    "$VNRRG,08,-114.314,+000.058,-001.773*5F",
    "$VNRRG,01,VN-200T-CR*31",
    "$VNRRG,05,115200*5D",
    "$VNWRG,5,9600*60",
    "$VNWRG,05,921600*53",
    "$VNRRG,06,0*69",
    "$VNWRG,06,0*6C",
    "$VNRRG,07,40*5C",
    "$VNWRG,07,40*59",
    "$VNWRG,07,200*6F",
    "$VNRRG,30,0,0,0,0,1,0,1*6C",
    "$VNRRG,55,2,0,0,0*71",
    "$VNRRG,75*71",
    "$VNWRG,75,1,4,01,0139*7B",
    "$VNRRG,75,1,4,01,0139*7E",
    "$VNASY,0*4F",
    "$VNASY,1*4E",
    "$VNWNV*57",
    "$VNRFS*5F",
    "$VNRST*4D",
    "$VNTAR*5F",
    "$VNERR,03*72",
    "$VNYPR,+010.071,+000.278,-002.026*60",
    "$VNYPR,+010.071,+000.278,-002.026,S0000*1F",
]
YPR_LAYOUT = OutputLayout([0x0008])
YPR_MANUAL = bytes.fromhex("FA01080093502E42833EF13F48B504BB9288")
YPR_CAPTURED = bytes.fromhex("FA010800AE231DC32DB117C001BABC404848")
IMU_PACKET = bytes.fromhex(
    "FA013101341CDCDF020000000000000000000000F304353FF304353F"
    "0AD7233C0AD7A3BC8FC2F53CCDCCCC3DCDCC4CBEC3F51CC17D90"
)
IMU_VALUES = (
    12_345_678_900,
    0,
    0,
    math.sqrt(0.5),
    math.sqrt(0.5),
    0.01,
    -0.02,
    0.03,
    0.1,
    -0.2,
    -9.81,
)
IMU_YPR_PACKET = bytes.fromhex(
    "FA013901341CDCDF020000000000B44200000000000000000000000000000000"
    "F304353FF304353F0AD7233C0AD7A3BC8FC2F53CCDCCCC3DCDCC4CBEC3F51CC161BD"
)
FIELD_SIZES = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
)


def bitwise_crc16(data: bytes) -> int:
    """CRC-16/XMODEM by its definition, one bit after the other."""
    register = 0
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register


# ASCII ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("line", PUBLISHED_LINES)
def test_published_lines_decode_and_encode_again(line):
    message = decode_ascii(line.encode())
    assert message.command == line[3:6]
    assert message.encode() == line.encode() + b"\r\n"


def test_crc_check_value_and_definition():
    assert crc16(b"123456789") == 0x31C3
    assert crc16(bytes(range(256))) == bitwise_crc16(bytes(range(256)))


def test_wrong_checksum_is_refused_with_the_devices_code():
    with pytest.raises(ProtocolError) as error:
        decode_ascii(b"$VNRRG,8*4C")
    assert error.value.code is ErrorCode.INVALID_CHECKSUM


@pytest.mark.parametrize("line", [b"$VNRRG,1*XX\r\n", b"$VNRRG,1*XXXX\r\n"])
def test_a_host_may_leave_the_checksum_out(line):
    assert decode_ascii(line) == AsciiMessage("RRG", ("1",), Checksum.NONE)


def test_16_bit_checksum():
    line = encode_ascii("VNRRG,1", Checksum.CRC16)
    assert line == b"$VNRRG,1*%04X\r\n" % bitwise_crc16(b"VNRRG,1")
    assert decode_ascii(line) == AsciiMessage("RRG", ("1",), Checksum.CRC16)


@given(
    command=st.text("ABCDEFGHIJKLMNOPQRSTUVWXYZ", min_size=3, max_size=3),
    fields=st.lists(st.text("0123456789ABCDEF+-.", max_size=12), max_size=8),
    checksum=st.sampled_from(Checksum),
)
def test_any_message_survives_the_wire(command, fields, checksum):
    message = AsciiMessage(command, tuple(fields), checksum)
    assert decode_ascii(message.encode()) == message


@given(st.binary(max_size=80))
def test_any_other_bytes_are_refused_by_their_own_exception(data):
    with pytest.raises(ProtocolError):
        decode_ascii(b"\x00" + data)


def test_numbers_are_digits_only():
    assert hexadecimal("01fA") == 0x1FA
    for text in ("0x1F", "1_0", "+1", " 1", "", "G"):
        with pytest.raises(ProtocolError):
            hexadecimal(text)


# Binary -----------------------------------------------------------------------------------------
def test_field_sizes_are_those_of_the_makers_library():
    for (_, fields), sizes in zip(GROUPS, FIELD_SIZES, strict=True):
        assert tuple(struct.calcsize("<" + code) for _, code in fields) == sizes


@pytest.mark.parametrize(
    ("packet", "angles"),
    [(YPR_MANUAL, (43.5787, 1.8847, -0.0020)), (YPR_CAPTURED, (-157.14, -2.37, 5.90))],
)
def test_captured_packets(packet, angles):
    (message,) = StreamParser(YPR_LAYOUT).feed(packet)
    assert YPR_LAYOUT.fields == ("common.yaw_pitch_roll",)
    assert message.values == pytest.approx(angles, abs=5e-3)  # published with 2 to 4 decimals
    assert YPR_LAYOUT.encode(*message.values) == packet


def test_the_drivers_packet():
    assert IMU_LAYOUT.size == len(IMU_PACKET) == 54
    assert IMU_LAYOUT.encode(*IMU_VALUES) == IMU_PACKET
    (message,) = StreamParser(IMU_LAYOUT).feed(IMU_PACKET)
    assert message.values[0] == IMU_VALUES[0]
    assert message.values == pytest.approx(IMU_VALUES, rel=1e-7)  # single precision


def test_a_packet_of_five_fields():
    layout = OutputLayout([0x0139])
    values = (IMU_VALUES[0], 90.0, 0.0, 0.0, *IMU_VALUES[1:])
    assert layout.encode(*values) == IMU_YPR_PACKET


def test_groups_and_masks_of_the_manuals_example_are_hexadecimal():
    message = decode_ascii(encode_ascii("VNWRG,75,1,16,15,0001,000C,0014"))
    output = BinaryOutput.from_fields(message.fields[1:])
    assert output.rate_divisor == 16
    assert output.layout is not None
    assert output.layout.masks == (0x0001, 0, 0x000C, 0, 0x0014, 0, 0)
    assert output.to_fields() == message.fields[1:]


def test_a_mask_of_letters_is_no_decimal_number():
    output = BinaryOutput.from_fields(("1", "1", "01", "000A"))
    assert output.layout is not None
    assert output.layout.fields == ("common.time_gps", "common.yaw_pitch_roll")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        (("1", "1"), ErrorCode.NOT_ENOUGH_PARAMETERS),
        (("1", "1", "03", "0001"), ErrorCode.NOT_ENOUGH_PARAMETERS),
        (("1", "1", "01", "0001", "0001"), ErrorCode.TOO_MANY_PARAMETERS),
        (("4", "1", "01", "0001"), ErrorCode.INVALID_PARAMETER),
        (("1", "0", "01", "0001"), ErrorCode.INVALID_PARAMETER),
        (("1", "1", "80", "0001"), ErrorCode.INVALID_PARAMETER),
        (("1", "1", "01", "8000"), ErrorCode.INVALID_PARAMETER),
        (("1", "1", "01", "0000"), ErrorCode.INVALID_PARAMETER),
        (("1", "1", "01", "xyz"), ErrorCode.INVALID_PARAMETER),
    ],
)
def test_bad_output_registers_are_refused_with_the_devices_code(fields, code):
    with pytest.raises(ProtocolError) as error:
        BinaryOutput.from_fields(fields)
    assert error.value.code is code


@pytest.mark.parametrize(
    ("mask", "baud", "highest"),
    [(0x0139, 115200, 174), (0x0139, 460800, 698), (0x0131, 115200, 213)],
)
def test_load_of_the_line(mask, baud, highest):
    load = BinaryOutput(1, 1, OutputLayout([mask])).bits_per_second
    assert math.floor(baud / (load / 800)) == highest


# Stream -----------------------------------------------------------------------------------------
def accounted(parser: StreamParser) -> int:
    counters = parser.counters
    return counters.packet_bytes + counters.line_bytes + counters.garbage_bytes + parser.pending


def chunks(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(edges)]


GARBAGE = st.one_of(
    st.binary(max_size=150),
    st.lists(
        st.sampled_from(
            [
                b"\xfa",
                b"$",
                b"$VN",
                b"\xfa\x01",
                b"\xfa\x01\x31\x01",
                IMU_PACKET[:20],
                IMU_PACKET[30:],
                YPR_MANUAL,
                b"$VNYPR,+010.07",
                b"*60\r\n",
                b"\r\n",
                b"\xff\x00",
            ]
        ),
        max_size=12,
    ).map(b"".join),
)


@given(data=st.lists(GARBAGE, max_size=5).map(b"".join), cuts=st.lists(st.integers(0, 10**4)))
@pytest.mark.parametrize("layout", [YPR_LAYOUT, IMU_LAYOUT])
def test_nothing_raises_and_every_byte_is_accounted_for(layout, data, cuts):
    parser = StreamParser(layout)
    for chunk in chunks(data, cuts):
        parser.feed(chunk)
        assert accounted(parser) == parser.counters.bytes
    assert parser.counters.bytes == len(data)
    assert parser.pending <= 600
    parser.reset()
    assert parser.pending == 0
    assert accounted(parser) == len(data)


@given(data=st.lists(GARBAGE, max_size=4).map(b"".join), cuts=st.lists(st.integers(0, 10**4)))
@pytest.mark.parametrize("layout", [YPR_LAYOUT, IMU_LAYOUT])
def test_messages_do_not_depend_on_how_the_bytes_are_cut(layout, data, cuts):
    whole = StreamParser(layout)
    expected = whole.feed(data + IMU_PACKET)
    parser = StreamParser(layout)
    found = [message for chunk in chunks(data + IMU_PACKET, cuts) for message in parser.feed(chunk)]
    assert found == expected
    assert parser.counters == whole.counters


@given(before=GARBAGE, step=st.integers(1, 60))
def test_a_packet_behind_garbage_is_found_with_its_last_byte(before, step):
    parser = StreamParser(IMU_LAYOUT)
    parser.feed(before)
    found = []
    for start in range(0, len(IMU_PACKET), step):
        assert found == []
        found = parser.feed(IMU_PACKET[start : start + step])
    assert [message.values[0] for message in found] == [IMU_VALUES[0]]


@given(kept=st.integers(1, 53))
def test_a_cut_packet_costs_only_itself(kept):
    parser = StreamParser(IMU_LAYOUT)
    found = parser.feed(IMU_PACKET[:kept] + IMU_PACKET + IMU_PACKET)
    assert len(found) == 2
    assert parser.counters.garbage_bytes == kept
    assert parser.counters.truncated + parser.counters.crc_errors == (1 if kept >= 4 else 0)


@given(bit=st.integers(0, 54 * 8 - 1))
def test_one_inverted_bit_costs_one_packet(bit):
    damaged = bytearray(IMU_PACKET)
    damaged[bit // 8] ^= 1 << bit % 8
    parser = StreamParser(IMU_LAYOUT)
    found = parser.feed(IMU_PACKET + bytes(damaged) + IMU_PACKET)
    assert len(found) == 2
    assert parser.counters.crc_errors == (1 if bit >= 32 else 0)  # else it is no start any more
    assert parser.counters.garbage_bytes == 54


@given(line=st.sampled_from(PUBLISHED_LINES), before=GARBAGE)
def test_a_line_behind_garbage_is_found(line, before):
    parser = StreamParser(IMU_LAYOUT)
    found = parser.feed(before + b"\x00" * 60 + line.encode() + b"\r\n")
    assert decode_ascii(line.encode()) in found


def test_lines_and_packets_come_in_order():
    parser = StreamParser(IMU_LAYOUT)
    found = parser.feed(b"$VNASY,1*4E\r\n" + IMU_PACKET + b"$VNERR,03*72\r\n" + IMU_PACKET)
    kinds = [type(message) for message in found]
    assert kinds == [AsciiMessage, BinaryPacket, AsciiMessage, BinaryPacket]


def test_a_damaged_line_is_counted_and_dropped():
    parser = StreamParser(IMU_LAYOUT)
    assert parser.feed(b"$VNASY,1*4F\r\n") == []
    assert parser.counters.checksum_errors == 1
    assert parser.feed(b"$VNASY,1*4E\r\n") == [AsciiMessage("ASY", ("1",))]


@pytest.mark.parametrize("pattern", [b"\xfa", b"\xfa\x01\x31\x01", b"$VN", b"$VNAAA,", b"\xfa\x05"])
@pytest.mark.parametrize("layout", [YPR_LAYOUT, IMU_LAYOUT])
def test_work_is_linear_in_the_bytes(pattern, layout, monkeypatch):
    """The bytes over which a CRC is computed are at most a packet's length for each byte fed."""
    summed = []
    monkeypatch.setattr(
        "husky_drivers.vn200.stream.crc_hqx", lambda data, start: summed.append(len(data)) or 1
    )
    parser = StreamParser(layout)
    data = pattern * (20_000 // len(pattern))
    for start in range(0, len(data), 1000):
        parser.feed(data[start : start + 1000])
        assert parser.pending <= 600
    assert sum(summed) <= layout.size * (len(data) // 4 + 1)
