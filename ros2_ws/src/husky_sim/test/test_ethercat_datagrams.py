"""Each command of a datagram through slaves of plain memory: addresses, counters (ETG.1000.4)."""

import struct

import pytest
from ethercat_line import frame_of

from husky_sim.devices.ethercat.frames import HEADER, datagrams, pass_frame

COUNT = 3


def no_clocks(command, slave, data):
    raise AssertionError("no datagram hands on a system time here")


class Memory:
    """A slave of 16 bytes that can be read and written, and logs what reaches it."""

    def __init__(self, station, refuses=False):
        self.station, self.refuses = station, refuses
        self.bytes = bytearray((station,)) * 16

    def answers_to(self, station):
        return station == self.station

    def read(self, address, length):
        return None if self.refuses else bytes(self.bytes[address : address + length])

    def write(self, address, data):
        if not self.refuses:
            self.bytes[address : address + len(data)] = data
        return not self.refuses


def line():
    return [Memory(0x10 << i) for i in range(COUNT)]  # 0x10, 0x20, 0x40: an OR tells them apart


def passed(slaves, *parts, logical=lambda *_: 0):
    frame = frame_of(*parts)
    assert pass_frame(frame, slaves, logical, no_clocks)
    return [
        (
            struct.unpack_from("<H", frame, d.header + 2)[0],
            bytes(frame[d.data : d.end]),
            struct.unpack_from("<H", frame, d.end)[0],
        )
        for d in datagrams(frame)
    ]


OLD, NEW = b"\x20\x20", b"\xab\xcd"


@pytest.mark.parametrize(
    ("command", "slave", "leaves", "data", "count", "written"),
    [
        (0, -1, 0xFFFF, NEW, 0, ""),  # NOP
        (1, -1, COUNT - 1, OLD, 1, ""),  # APRD: each slave adds one to the address
        (2, -1, COUNT - 1, NEW, 1, "1"),
        (3, -1, COUNT - 1, OLD, 3, "1"),
        (4, 0x20, 0x20, OLD, 1, ""),  # FPRD
        (5, 0x20, 0x20, NEW, 1, "1"),
        (6, 0x20, 0x20, OLD, 3, "1"),
        (7, 0, COUNT, b"\xfb\xfd", COUNT, ""),  # BRD: all are ORed into the data
        (8, 0, COUNT, NEW, COUNT, "012"),
        (9, 0, COUNT, b"\xfb\xfd", 3 * COUNT, "012"),
        (13, -1, COUNT - 1, OLD, COUNT, "2"),  # ARMW: the addressed reads, the others write
        (14, 0x20, 0x20, OLD, COUNT, "2"),
        (4, 0x77, 0x77, NEW, 0, ""),  # nobody
        (15, 0, 0, NEW, 0, ""),  # no command
    ],
)
def test_commands(command, slave, leaves, data, count, written):
    slaves = line()
    [(address, found, counter)] = passed(slaves, (command, slave, 4, NEW))
    assert (address, found, counter) == (leaves, data, count)
    for i in map(int, written):
        assert slaves[i].bytes[4:6] != bytes((slaves[i].station,)) * 2
    if "0" not in written and command not in (13, 14):
        assert slaves[0].bytes == bytes((0x10,)) * 16


def test_a_multiple_write_reaches_those_behind_with_what_was_read():
    slaves = line()
    passed(slaves, (14, 0x20, 4, NEW))
    assert [bytes(slave.bytes[4:6]) for slave in slaves] == [NEW, OLD, OLD]


def test_refused_access_does_not_count():
    assert passed([Memory(0x20, refuses=True)], (6, 0x20, 4, NEW)) == [(0x20, NEW, 0)]


def test_datagrams_of_a_frame_come_in_order_and_counters_add_up():
    slaves = line()
    frame = frame_of((5, 0x20, 4, NEW), (4, 0x20, 4, b"\0\0"), (7, 0, 8, b"\0"))
    for _ in range(2):
        assert pass_frame(frame, slaves, lambda *_: 0, no_clocks)
    counts = [struct.unpack_from("<H", frame, d.end)[0] for d in datagrams(frame)]
    assert counts == [2, 2, 2 * COUNT]
    assert frame[6] == 0x02  # the source says that it comes back


def test_logical_datagrams_go_to_the_mapping():
    seen = []

    def logical(command, address, data):
        seen.append((command, address, bytes(data)))
        data[0] = 0x55
        return 7

    assert passed(line(), (12, 0x5678, 0x1234, NEW), logical=logical)[0][1:] == (b"\x55\xcd", 7)
    assert seen == [(12, 0x12345678, NEW)]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda frame: frame[:10],
        lambda frame: frame[:12] + b"\x08\x00" + frame[14:],
        lambda frame: frame[:15] + bytes((frame[15] & 0x0F | 0x40,)) + frame[16:],
    ],
    ids=["short", "IPv4", "mailbox gateway"],
)
def test_what_is_not_ethercat_is_left_alone(spoil):
    frame = bytearray(spoil(bytes(frame_of((7, 0, 0, b"\0")))))
    before = bytes(frame)
    assert not pass_frame(frame, line(), lambda *_: 0, no_clocks)
    assert frame == before


def test_a_frame_goes_back_unprocessed_from_the_bad_datagram_on():
    frame = frame_of((7, 0, 0, b"\0\0"), (7, 0, 0, b"\0\0"))
    second = HEADER + 10 + 2 + 2
    struct.pack_into("<H", frame, second + 6, 100)
    before = bytes(frame)
    assert pass_frame(frame, line(), lambda *_: 0, no_clocks)
    assert struct.unpack_from("<H", frame, second - 2)[0] == COUNT
    assert frame[second:] == before[second:]


def test_padding_behind_the_datagrams_is_no_datagram():
    frame = frame_of((7, 0, 0, b"\0\0"))
    frame[HEADER + 7] |= 0x80  # says that more follow
    frame += bytes(40)
    before = bytes(frame)
    assert pass_frame(frame, line(), lambda *_: 0, no_clocks)
    assert frame[HEADER + 14 :] == before[HEADER + 14 :]
