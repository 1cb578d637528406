"""A bad line and signing: garbage, truncation, twins, forgers."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from husky_pu.companion.client import ClientConfig, MavlinkClient
from husky_pu.mavlink.frames import FrameReader, read_key, signing_time

KEY = bytes(range(32))


# A bad line -------------------------------------------------------------------------------------
def test_lost_messages_are_counted(pair):
    pair.autopilot.telemetry(20)
    pair.carry()
    pair.autopilot.telemetry(40)
    pair.autopilot.take_output()
    pair.autopilot.telemetry(60)
    pair.carry()
    assert pair.client.missing == 3


def test_two_autopilots_of_one_id_are_noticed(pair, make_autopilot):
    twin = make_autopilot()
    twin.codec.seq = 77
    for k in range(8):
        for one in (pair.autopilot, twin):
            one.telemetry(20 * k + (60_000 if one is twin else 0))
            pair.client.feed(one.take_output(), pair.now)
        pair.now += 0.02
    assert pair.client.conflict(pair.now) == "two autopilots speak as system 1"
    assert pair.client.telemetry.boots == 0
    pair.now += 3.0
    assert pair.client.conflict(pair.now) == ""


def test_another_companion_of_our_id_is_noticed(pair, make_autopilot):
    other = make_autopilot(1, 191, autopilot=mavlink.MAV_AUTOPILOT_INVALID)
    other.heartbeat()
    pair.client.feed(other.take_output(), pair.now)
    assert pair.client.conflict(pair.now) == "another companion speaks as 1.191"


def frames(autopilot, count=3):
    """Return some frames of different kinds, each for itself."""
    found = []
    for k in range(count):
        autopilot.heartbeat()
        found.append(autopilot.take_output())
        autopilot.battery([22000 + k], 1000)
        found.append(autopilot.take_output())
    return found


@settings(max_examples=80)
@given(data=st.data())
def test_good_frames_survive_garbage_and_truncation_between_them(make_autopilot, data):
    """Junk holds no byte that could begin a frame; a piece of a frame may hold what it likes."""
    autopilot = make_autopilot()
    good = frames(autopilot)
    junk = st.binary(max_size=40).map(lambda b: b.replace(b"\xfd", b"").replace(b"\xfe", b""))
    stream = b""
    for frame in good:
        stream += data.draw(junk)
        if data.draw(st.booleans()):
            stream += frame[: data.draw(st.integers(0, len(frame) - 1))]
        stream += frame
    reader = FrameReader(mavlink.MAVLink(None))
    found = []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        found += reader.feed(stream[:size])
        stream = stream[size:]
    while reader.pending:
        found += reader.give_up()
    assert [bytes(message.get_msgbuf()) for message in found] == good


@settings(max_examples=200)
@given(st.lists(st.binary(max_size=300), max_size=6))
def test_any_bytes_are_taken(pieces):
    client = MavlinkClient(ClientConfig(4))
    for k, piece in enumerate(pieces):
        client.feed(piece, 0.1 * k)
        client.poll(0.1 * k + 0.09)
    while client.reader.pending:
        client.reader.give_up()
    counters = client.reader.counters
    assert counters.garbage_bytes <= sum(map(len, pieces))
    assert not client.connected


@settings(max_examples=60)
@given(data=st.data())
def test_a_flipped_bit_is_never_believed(make_autopilot, data):
    (frame, *_) = frames(make_autopilot(), 1)
    bit = data.draw(st.integers(8, 8 * len(frame) - 1))
    bad = bytearray(frame)
    bad[bit // 8] ^= 1 << bit % 8
    reader = FrameReader(mavlink.MAVLink(None))
    found = reader.feed(bytes(bad))
    while reader.pending:
        found += reader.give_up()
    assert found == []


def test_unknown_messages_are_passed_over(pair):
    payload = bytes(5)
    # Sent by a newer autopilot.
    unknown = struct.pack("<BBBBBBBHB", 0xFD, 5, 0, 0, 9, 1, 1, 60000, 0) + payload + b"\x12\x34"
    pair.autopilot.heartbeat()
    pair.client.feed(unknown + pair.autopilot.take_output(), pair.now)
    assert pair.client.reader.counters.unknown == 1
    assert pair.client.received["HEARTBEAT"] == 2


# Signing ----------------------------------------------------------------------------------------
def test_signed_both_ways(make_autopilot, make_pair):
    pair = make_pair(make_autopilot(key=KEY), signing_key=KEY)
    pair.autopilot.codec.signing.timestamp = signing_time(1.8e9)
    pair.client.heartbeat(pair.now)
    pair.connect()
    assert pair.client.reader.counters.refused == 0
    assert pair.autopilot.codec.signing.goodsig_count == len(pair.autopilot.heard)
    assert pair.autopilot.codec.signing.badsig_count == 0
    assert len(pair.autopilot.of("COMMAND_LONG")) == 7


@pytest.mark.parametrize("key", [b"", bytes(32), KEY[::-1]])
def test_what_is_not_signed_with_our_key_is_refused(make_autopilot, key, make_pair):
    pair = make_pair(make_autopilot(key=key), signing_key=KEY)
    for _ in range(3):
        pair.autopilot.heartbeat()
        pair.client.feed(pair.autopilot.take_output(), pair.now)
    assert not pair.client.connected
    assert pair.client.reader.counters.refused == 3
    assert pair.client.reader.counters.damaged == 0


@pytest.mark.parametrize("key", [b"", KEY])
def test_an_autopilot_that_signs_is_known_as_such(make_autopilot, key, make_pair):
    pair = make_pair(make_autopilot(key=key))
    pair.autopilot.heartbeat()
    pair.client.feed(pair.autopilot.take_output(), pair.now)
    assert pair.client.connected
    assert pair.client.signed is bool(key)


def test_a_forger_with_a_later_time_does_not_lock_the_true_sender_out(make_autopilot, make_pair):
    pair = make_pair(make_autopilot(key=KEY), signing_key=KEY)
    forger = make_autopilot(key=bytes(32))
    forger.codec.signing.timestamp = 1 << 46
    forger.heartbeat()
    pair.client.feed(forger.take_output(), pair.now)
    pair.autopilot.heartbeat()
    pair.client.feed(pair.autopilot.take_output(), pair.now)
    assert pair.client.connected


def test_a_replayed_frame_is_refused(make_autopilot, make_pair):
    pair = make_pair(make_autopilot(key=KEY), signing_key=KEY)
    pair.autopilot.heartbeat()
    frame = pair.autopilot.take_output()
    pair.client.feed(frame + frame, pair.now)
    assert pair.client.received["HEARTBEAT"] == 1
    assert pair.client.reader.counters.refused == 1


def test_keys_in_hexadecimal():
    assert read_key(KEY.hex() + "\n") == KEY
    for text in ("", "zz" * 32, "00" * 31):
        with pytest.raises(ValueError, match="64 hexadecimal digits"):
            read_key(text)
