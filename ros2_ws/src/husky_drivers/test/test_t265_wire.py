"""Frames of the simulated T265 as bytes: what is written is read, whatever lies between."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.t265.frames import PoseFrame
from husky_drivers.t265.wire import FRAME_SIZE, FrameParser, encode
from husky_drivers.vn200.protocol import crc16

single = st.floats(width=32, allow_nan=False)
vector = st.tuples(single, single, single)
frames = st.builds(
    PoseFrame,
    st.integers(0, 2**32 - 1),
    st.floats(allow_nan=False),
    vector,
    vector,
    vector,
    st.tuples(single, single, single, single),
    vector,
    vector,
    st.integers(0, 3),
    st.integers(0, 3),
)
EXAMPLE = PoseFrame(
    7, 35.0, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0), (0.0, 0.6, 0.0, 0.8),
    (-1.0, -2.0, -3.0), (-4.0, -5.0, -6.0), 3, 2,
)  # fmt: skip


def check(parser):
    """Each byte is accounted for."""
    counters = parser.counters
    assert counters.bytes == (
        counters.frames * FRAME_SIZE + counters.garbage_bytes + parser.pending
    )


def test_bytes_stand_where_the_description_says():
    """Read with offsets counted by hand in librealsense's `struct rs2_pose`."""
    data = encode(EXAMPLE)
    assert len(data) == FRAME_SIZE == 102
    assert data[:4] == bytes.fromhex("a5 65 60 00")
    assert struct.unpack_from("<Id", data, 4) == (7, 35.0)
    pose = data[16:100]
    assert struct.unpack_from("<3f", pose, 0) == EXAMPLE.translation
    assert struct.unpack_from("<3f", pose, 12) == EXAMPLE.velocity
    assert struct.unpack_from("<3f", pose, 24) == EXAMPLE.acceleration
    assert struct.unpack_from("<4f", pose, 36) == pytest.approx(EXAMPLE.rotation)
    assert struct.unpack_from("<3f", pose, 52) == EXAMPLE.angular_velocity
    assert struct.unpack_from("<3f", pose, 64) == EXAMPLE.angular_acceleration
    assert struct.unpack_from("<2I", pose, 76) == (3, 2)
    assert crc16(data[2:]) == 0


@given(st.lists(frames, max_size=5), st.lists(st.integers(0, 600), max_size=12))
def test_whatever_the_cuts(sent, cuts):
    stream = b"".join(map(encode, sent))
    parser = FrameParser()
    received, start = [], 0
    for stop in [*sorted(min(cut, len(stream)) for cut in cuts), len(stream)]:
        received += parser.feed(stream[start:stop])
        check(parser)
        start = stop
    assert received == sent
    assert (parser.counters.crc_errors, parser.counters.garbage_bytes, parser.pending) == (0, 0, 0)


noise = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([b"\xa5", b"\xa5\x65", b"\xa5\x65\x60", b"\xa5\x65\x60\x00", b"\xa5\xa5\x65"]),
    st.integers(0, FRAME_SIZE - 1).map(lambda size: encode(EXAMPLE)[:size]),
)


@given(st.lists(st.tuples(noise, frames), min_size=1, max_size=6))
def test_garbage_and_truncation_cost_no_whole_frame(pieces):
    """Each whole frame comes out with its last byte."""
    parser = FrameParser()
    for junk, frame in pieces:
        early = parser.feed(junk)
        data = encode(frame)
        early += parser.feed(data[:-1])
        assert not early
        assert parser.feed(data[-1:]) == [frame]
        check(parser)


@given(st.integers(0, 8 * FRAME_SIZE - 1))
def test_a_flipped_bit_costs_its_frame_alone(bit):
    data = bytearray(encode(EXAMPLE))
    data[bit // 8] ^= 1 << bit % 8
    parser = FrameParser()
    assert parser.feed(bytes(data)) == []
    assert parser.feed(encode(EXAMPLE)) == [EXAMPLE._replace(rotation=parser_rotation())]
    assert parser.counters.frames == 1
    check(parser)


def parser_rotation():
    return struct.unpack("<4f", struct.pack("<4f", *EXAMPLE.rotation))


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_no_bytes_raise(chunks):
    parser = FrameParser()
    for chunk in chunks:
        parser.feed(chunk)
        check(parser)
        assert parser.pending < FRAME_SIZE
    parser.reset()
    assert parser.pending == 0
    check(parser)
