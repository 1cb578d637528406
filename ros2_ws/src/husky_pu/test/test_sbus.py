"""SBUS against a decoder of bit strings, and its parser against any bytes."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_pu.radio.sbus import (
    FRAME_SIZE,
    Frame,
    SbusChannel,
    SbusParser,
    decode,
    encode,
    frame_of_pulses,
    to_pulse,
    to_raw,
)

FRAMES = st.builds(
    Frame,
    st.lists(st.integers(0, 2047), min_size=16, max_size=16).map(tuple),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


def decode_bits(data):
    """The same by strings of bits in the order in which a UART sends them."""
    line = "".join(f"{byte:08b}"[::-1] for byte in data)
    assert len(line) == 200
    assert line[:8] == "11110000"
    assert line[-8:] == "00000000"
    channels = [int(line[8 + 11 * i : 19 + 11 * i][::-1], 2) for i in range(16)]
    return Frame(tuple(channels), *(bit == "1" for bit in line[184:188]))


@given(FRAMES)
def test_frames_agree_with_an_independent_decoder(frame):
    data = encode(frame)
    assert len(data) == FRAME_SIZE
    assert decode_bits(data) == frame
    assert decode(data) == frame


def test_a_frame_written_out_by_hand():
    # SbusChannel 1 all ones fills byte 1 and three bits of byte 2; channel 16 is the last 11 bits.
    frame = Frame((2047, *[0] * 14, 1), failsafe=True)
    assert encode(frame).hex() == "0fff07" + "00" * 18 + "2000" + "0800"


@pytest.mark.parametrize(
    ("pulse", "raw"), [(1000, 192), (1500, 992), (2000, 1792), (0, 0), (9e3, 2047)]
)
def test_scale(pulse, raw):
    assert to_raw(pulse) == raw


@given(st.floats(1000.0, 2000.0))
def test_pulses_survive_to_half_a_step(pulse):
    assert to_pulse(to_raw(pulse)) == pytest.approx(pulse, abs=0.5 * 1000 / 1600 + 1e-9)


@given(st.lists(FRAMES, max_size=5), st.data())
def test_a_clean_stream_in_any_pieces(frames, data):
    stream = b"".join(map(encode, frames))
    parser, found = SbusParser(), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        found += parser.feed(stream[:size])
        stream = stream[size:]
    assert found == frames
    assert (parser.garbage_bytes, parser.pending) == (0, 0)


@given(st.lists(st.binary(max_size=80), max_size=8))
def test_any_bytes_are_taken_and_accounted_for(pieces):
    parser = SbusParser()
    found = [frame for piece in pieces for frame in parser.feed(piece)]
    total = sum(map(len, pieces))
    assert total == FRAME_SIZE * len(found) + parser.garbage_bytes + parser.pending
    assert len(found) == parser.frames
    assert parser.pending < FRAME_SIZE


@given(st.binary(max_size=200), FRAMES)
def test_it_resynchronises_after_garbage(garbage, frame):
    """After any garbage three rests of a line of equal frames are enough."""
    parser = SbusParser()
    parser.feed(garbage)
    quiet = Frame(tuple(100 for _ in range(16)))  # holds no byte 0x0F: no false header inside
    assert encode(quiet).count(0x0F) == 1
    parser.feed(encode(quiet) * 3)
    assert parser.feed(encode(quiet) + encode(frame))[-1] == frame


@pytest.mark.parametrize("throttle", range(1000, 2001, 50))
def test_a_truncated_frame_and_the_next_make_no_false_one(throttle):
    """No switch moves, no failsafe is seen; the frames behind it get through."""
    for mode, arm, kill in itertools.product((1000, 1500, 2000), (1000, 2000), (1000, 2000)):
        frame = frame_of_pulses([1480, 1500, throttle, 1500, mode, arm, kill])
        data = encode(frame)
        for size in range(1, FRAME_SIZE):
            parser = SbusParser()
            pieces = (data, data[:size], data, data, data)
            assert [f for piece in pieces for f in parser.feed(piece)] == [frame] * 4


def test_a_frame_with_a_byte_missing_costs_no_other():
    good = [frame_of_pulses([1000 + 7 * k, 1500, 1100]) for k in range(4)]
    broken = encode(good[1])[:10] + encode(good[1])[11:]
    parser = SbusParser()
    found = parser.feed(encode(good[0]) + broken + encode(good[2]) + encode(good[3]))
    assert found == [good[0], good[2], good[3]]
    assert parser.garbage_bytes == FRAME_SIZE - 1


@pytest.mark.parametrize(
    "data", [b"", b"\x0f" * 24, b"\x0e" + bytes(24), b"\x0f" + bytes(23) + b"\x04"]
)
def test_what_is_no_frame_is_refused(data):
    with pytest.raises(ValueError, match="no SBUS frame"):
        decode(data)


@pytest.mark.parametrize("channels", [(0,) * 15, (0,) * 15 + (2048,), (-1,) + (0,) * 15])
def test_bad_channels_are_refused(channels):
    with pytest.raises(ValueError, match="channel"):
        encode(Frame(channels))
    with pytest.raises(ValueError, match="17 channels"):
        frame_of_pulses([1500] * 17)


def test_missing_channels_are_centred():
    frame = frame_of_pulses([2000])
    assert frame.pulses == (2000, *[1500] * 15)
    assert encode(frame)[23] == 0
    assert encode(frame_of_pulses([], frame_lost=True))[23] == 4


def test_channels_are_in_the_order_that_the_document_says():
    names = ["ROLL", "PITCH", "THROTTLE", "YAW", "MODE", "ARM", "KILL"]
    assert [(channel.name, int(channel)) for channel in SbusChannel] == list(
        zip(names, range(7), strict=True)
    )
