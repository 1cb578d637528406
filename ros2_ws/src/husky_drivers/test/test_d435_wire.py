"""Frames of the simulated D435 as bytes: what is written is read, whatever lies between."""

import struct
import zlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_drivers.d435.frames import DepthFrame, Intrinsics
from husky_drivers.d435.wire import FrameParser, encode, taken, taken_numbers

HEAD = 4 + 8 + 2 * 2 + 5 * 4
"""Bytes of number, time, width, height, four intrinsics and depth unit."""
AROUND = 2 + 8 + 4
"""Bytes of mark, size, its complement and CRC."""

single = st.floats(width=32, allow_nan=False)
any_size = st.tuples(st.integers(1, 6), st.integers(1, 4))


@st.composite
def frames(draw, sizes=any_size):
    width, height = draw(sizes)
    pixels = draw(st.binary(min_size=2 * width * height, max_size=2 * width * height))
    return DepthFrame(
        draw(st.integers(0, 2**32 - 1)),
        draw(st.floats(allow_nan=False)),
        Intrinsics(width, height, *(draw(single) for _ in range(4))),
        draw(single),
        np.frombuffer(pixels, "<u2").reshape(height, width),
    )


EXAMPLE = DepthFrame(
    7,
    35.5,
    Intrinsics(3, 2, 100.0, 200.0, 1.0, 0.5),
    0.25,
    np.array([[1, 2, 3], [0xA5, 0xD4A5, 65535]], np.uint16),
)
SIZE = AROUND + HEAD + 12


def content(frames):
    """Return frames as what can be compared."""
    return [
        (f.number, f.time_ms, f.intrinsics, f.depth_unit, f.depth.tolist(), f.depth.dtype)
        for f in frames
    ]


def check(parser, received):
    """Each byte is accounted for."""
    counters = parser.counters
    whole = sum(AROUND + HEAD + 2 * frame.depth.size for frame in received)
    assert counters.frames == len(received)
    assert counters.bytes == whole + counters.garbage_bytes + parser.pending


def test_bytes_stand_where_the_description_says():
    data = encode(EXAMPLE)
    assert len(data) == SIZE
    assert data[:2] == bytes.fromhex("a5 d4")
    size, complement = struct.unpack_from("<2I", data, 2)
    assert size == HEAD + 12 and size + complement == 0xFFFFFFFF
    assert struct.unpack_from("<Id2H", data, 10) == (7, 35.5, 3, 2)
    assert struct.unpack_from("<5f", data, 26) == (100.0, 200.0, 1.0, 0.5, 0.25)
    assert struct.unpack_from("<6H", data, 46) == (1, 2, 3, 0xA5, 0xD4A5, 65535)
    assert struct.unpack_from("<I", data, 58) == (zlib.crc32(data[10:58]),)


def test_an_image_of_the_robot_has_the_size_of_the_document():
    frame = DepthFrame(
        0, 0.0, Intrinsics(160, 120, 1, 1, 0, 0), 1e-3, np.zeros((120, 160), np.uint16)
    )
    assert len(encode(frame)) == 38_450


@settings(max_examples=50)
@given(st.lists(frames(), max_size=4), st.lists(st.integers(0, 450), max_size=10))
def test_whatever_the_cuts(sent, cuts):
    stream = b"".join(map(encode, sent))
    parser = FrameParser()
    received, start = [], 0
    for stop in [*sorted(min(cut, len(stream)) for cut in cuts), len(stream)]:
        received += parser.feed(stream[start:stop])
        check(parser, received)
        start = stop
    assert content(received) == content(sent)
    assert (parser.counters.crc_errors, parser.counters.garbage_bytes, parser.pending) == (0, 0, 0)


alike = frames(st.just((3, 2)))
noise = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([b"\xa5", b"\xa5\xd4", b"\xa5\xa5\xd4", encode(EXAMPLE)[2:]]),
    st.integers(0, SIZE - 1).map(lambda size: encode(EXAMPLE)[:size]),
)


@settings(max_examples=50)
@given(st.lists(st.tuples(noise, alike), min_size=1, max_size=6))
def test_garbage_and_truncation_cost_no_whole_frame(pieces):
    """Each whole frame comes out with its last byte."""
    parser = FrameParser()
    received = []
    for junk, frame in pieces:
        early = parser.feed(junk)
        data = encode(frame)
        early += parser.feed(data[:-1])
        assert not early
        (last,) = parser.feed(data[-1:])
        assert content([last]) == content([frame])
        received.append(last)
        check(parser, received)


@given(st.integers(0, SIZE - 1), st.integers(1, 255))
def test_damage_anywhere_costs_its_frame_alone(place, change):
    data = bytearray(encode(EXAMPLE))
    data[place] ^= change
    parser = FrameParser()
    assert parser.feed(bytes(data)) == []
    received = parser.feed(encode(EXAMPLE))
    assert content(received) == content([EXAMPLE])
    assert parser.counters.crc_errors == (place >= 10), "before that there is no header"
    check(parser, received)


@given(st.integers(0, 65535), st.integers(0, 65535))
def test_a_frame_that_contradicts_itself_is_none(width, height):
    """Its CRC is right, but its pixels are not as many as its size says."""
    body = bytearray(encode(EXAMPLE)[10:-4])
    struct.pack_into("<2H", body, 12, width, height)
    sizes = struct.pack("<2I", len(body), len(body) ^ 0xFFFFFFFF)
    data = b"\xa5\xd4" + sizes + body + struct.pack("<I", zlib.crc32(body))
    received = FrameParser().feed(data)
    assert len(received) == (width * height == 6)


def test_a_size_beyond_the_cameras_images_is_not_waited_for():
    parser = FrameParser()
    for size in (0, HEAD, HEAD + 2 * 1280 * 720 + 1, 2**32 - 1):
        assert not parser.feed(b"\xa5\xd4" + struct.pack("<2I", size, size ^ 0xFFFFFFFF))
        assert parser.pending < 2
    assert content(parser.feed(encode(EXAMPLE))) == content([EXAMPLE])


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_no_bytes_raise(chunks):
    parser = FrameParser()
    received = []
    for chunk in chunks:
        received += parser.feed(chunk)
        check(parser, received)
    parser.reset()
    assert parser.pending == 0
    check(parser, received)


@given(st.lists(st.integers(0, 2**33), max_size=5))
def test_what_the_host_has_taken(numbers):
    said = b"D435+" + b"".join(map(taken, numbers))
    assert taken_numbers(said) == [number % 2**32 for number in numbers]
    assert len(said) == 5 + 9 * len(numbers)
