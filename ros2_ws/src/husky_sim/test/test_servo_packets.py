"""Packets of the servo bus against the maker's examples, and whatever else comes on a line."""

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.dynamixel.control_table import TABLE, TABLE_SIZE, Instruction
from husky_sim.devices.bus_servos.packets import (
    HEADER,
    PacketReader,
    checksum,
    make_packet,
    status_packet,
)

EXAMPLES = {
    "ping": (1, Instruction.PING, "", "FFFFFD00 01 0300 01 194E"),
    "ping of all": (254, Instruction.PING, "", "FFFFFD00 FE 0300 01 3142"),
    "read": (1, Instruction.READ, "84000400", "FFFFFD00 01 0700 02 84000400 1D15"),
    "write": (1, Instruction.WRITE, "740000020000", "FFFFFD00 01 0900 03 740000020000 CA89"),
    "answer to ping": (1, Instruction.STATUS, "00060426", "FFFFFD00 01 0700 55 00060426 655D"),
    "answer to read": (1, Instruction.STATUS, "00A6000000", "FFFFFD00 01 0800 55 00A6000000 8CC0"),
}
"""ROBOTIS e-manual, DYNAMIXEL protocol 2.0: id, instruction, parameters, bytes."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_makers_examples(name):
    servo, instruction, parameters, packet = EXAMPLES[name]
    expected = bytes.fromhex(packet)
    assert make_packet(servo, instruction, bytes.fromhex(parameters)) == expected
    (read,) = PacketReader().feed(expected)
    assert read == (servo, instruction, bytes.fromhex(parameters), True)


def test_a_status_packet_is_an_answer():
    assert status_packet(1, 0, bytes.fromhex("060426")) == bytes.fromhex(
        "FFFFFD000107005500060426655D"
    )


@given(st.binary(max_size=300))
def test_checksum_is_that_of_the_makers_sdk(data):
    assert checksum(data) == Protocol2PacketHandler().updateCRC(0, list(data), len(data))


@given(st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]), max_size=40).map(bytes))
def test_what_looks_like_a_header_is_stuffed(parameters):
    packet = make_packet(3, Instruction.WRITE, parameters)
    stuffed = packet[:-2]  # the checksum is not: it may end what looks like a header
    assert stuffed.count(HEADER) == 1 + stuffed[7:].count(HEADER)
    assert HEADER + b"\x00" not in packet[3:-2]
    (read,) = PacketReader().feed(packet)
    assert read == (3, Instruction.WRITE, parameters, True)
    if b"\xfd\xfd" in (parameters + packet[-2:]).partition(HEADER)[2]:
        return  # after the first one the SDK looks for the next in what it has moved already
    unstuffed = Protocol2PacketHandler().removeStuffing(list(packet))
    length = unstuffed[5] | unstuffed[6] << 8
    assert bytes(unstuffed[8 : 5 + length]) == parameters


@given(st.binary(max_size=60), st.binary(max_size=20), st.data())
def test_a_packet_is_found_in_whatever_comes_before_and_in_any_pieces(noise, parameters, data):
    packet = make_packet(7, Instruction.READ, parameters)
    stream = noise.replace(HEADER, b"") + packet
    cut = data.draw(st.integers(0, len(stream)))
    reader = PacketReader()
    read = reader.feed(stream[:cut]) + reader.feed(stream[cut:])
    found = [each for each in read if each.sound]
    # Noise that ends in part of a header may swallow the packet's own: the next one is found.
    found += [each for each in reader.feed(packet) if each.sound]
    assert (7, Instruction.READ, parameters, True) in found


@given(st.binary(max_size=400))
def test_no_bytes_end_the_reader(data):
    reader = PacketReader()
    for packet in reader.feed(data + bytes(1100)):
        assert packet.sound or packet.parameters == b""
    packet = make_packet(2, Instruction.PING, b"")
    assert [each for each in reader.feed(packet * 40) if each.sound]


def test_a_damaged_packet_is_told_and_does_not_hide_the_next():
    packet = make_packet(1, Instruction.PING, b"")
    damaged = packet[:-1] + bytes([packet[-1] ^ 1])
    read = PacketReader().feed(damaged + packet)
    assert [each.sound for each in read] == [False, True]


def test_registers_do_not_overlap():
    taken = [address for register in TABLE for address in range(register.address, register.end)]
    assert len(taken) == len(set(taken)) and max(taken) < TABLE_SIZE
