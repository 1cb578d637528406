"""Frames through the simulated drives' slave controllers, written by hand from ETG.1000.4."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_description.robot import load_robot
from husky_drivers.ethercat.bus import AlState
from husky_drivers.ethercat.pdo import RX_ASSIGNMENT, TX_ASSIGNMENT
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.wired_segment import WiredSegment

ROBOT = load_robot()
APRD, APWR, FPRD, FPWR, BRD, BWR, LRD, LWR, LRW, ARMW, FRMW = 1, 2, 4, 5, 7, 8, 10, 11, 12, 13, 14
OUTPUTS, INPUTS = 18, 22
STILL = (np.zeros(12, np.int32), np.zeros(12, np.int32), np.zeros(12))
SENT_BY = bytes.fromhex("010101010101")


def frame_of(*datagrams):
    """Return a frame of datagrams: command, address (two words, or one logical), data."""
    body = b""
    for i, (command, address, data) in enumerate(datagrams):
        more = 0x8000 if i < len(datagrams) - 1 else 0
        where = struct.pack("<HH", *address) if isinstance(address, tuple) else None
        where = where or struct.pack("<I", address)
        body += struct.pack("<BB", command, i) + where
        body += struct.pack("<HH", len(data) | more, 0) + data + bytes(2)
    head = b"\xff" * 6 + SENT_BY + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body))
    return bytearray(head + body)


def answers_of(frame):
    """Return command, first address word, data and working counter of each datagram."""
    found, at, more = [], 16, True
    while more:
        command, _, slave, _, length = struct.unpack_from("<BBHHH", frame, at)
        size, more = length & 0x7FF, bool(length & 0x8000)
        data = bytes(frame[at + 10 : at + 10 + size])
        found.append((command, slave, data, *struct.unpack_from("<H", frame, at + 10 + size)))
        at += 12 + size
    return found


class Line:
    """The drives on a wire, and what a master does to them."""

    def __init__(self):
        self.segment = SimulatedSegment(ROBOT)
        self.now = 0
        self.wired = WiredSegment(self.segment, lambda: self.now)

    def send(self, command, address, data):
        """Send one datagram; return its data and working counter."""
        frame = frame_of((command, address, data))
        assert self.wired.pass_frame(frame)
        ((_, _, data, counter),) = answers_of(frame)
        return data, counter

    def write(self, i, register, data):
        assert self.send(APWR, (-i & 0xFFFF, register), data)[1] == 1

    def al(self, i):
        data, counter = self.send(APRD, (-i & 0xFFFF, 0x0130), bytes(6))
        assert counter == 1
        return struct.unpack("<HxxH", data)

    def bring_to_op(self):
        """As a master does, but for the mailbox: assignments are set from behind."""
        for i in range(12):
            self.write(i, 0x0010, struct.pack("<H", 0x1001 + i))
            for unit, (start, length, control) in enumerate(
                ((0x1800, 140, 0x26), (0x1900, 140, 0x22), (0x1100, 18, 0x64), (0x1180, 22, 0x20))
            ):
                manager = struct.pack("<HHBBH", start, length, control, 0, 1)
                self.write(i, 0x0800 + 8 * unit, manager)
            for unit, (logical, size, physical, kind) in enumerate(
                ((OUTPUTS * i, OUTPUTS, 0x1100, 2), (216 + INPUTS * i, INPUTS, 0x1180, 1))
            ):
                fmmu = struct.pack("<IHBBHBBBxxx", logical, size, 0, 7, physical, 0, kind, 1)
                self.write(i, 0x0600 + 16 * unit, fmmu)
        self.ask(AlState.PREOP)
        assign(self.segment)
        self.ask(AlState.SAFEOP)
        self.ask(AlState.OP)
        assert [self.al(i) for i in range(12)] == [(AlState.OP, 0)] * 12

    def ask(self, state):
        assert self.send(BWR, (0, 0x0120), struct.pack("<H", state))[1] == 12


def assign(segment):
    for i in range(12):
        for index, maps in ((0x1C12, RX_ASSIGNMENT), (0x1C13, TX_ASSIGNMENT)):
            segment.sdo_write(i, index, 0, b"\0")
            for slot, mapping in enumerate(maps, 1):
                segment.sdo_write(i, index, slot, struct.pack("<H", mapping))
            segment.sdo_write(i, index, 0, bytes((len(maps),)))


@pytest.fixture(scope="module")
def operating():
    """Drives in OP, for tests that leave them so."""
    line = Line()
    line.bring_to_op()
    return line


@pytest.fixture
def line():
    return Line()


def test_a_broadcast_is_counted_and_merged_by_every_slave(line):
    line.write(3, 0x0010, b"\x34\x12")
    data, counter = line.send(BRD, (0, 0x0010), bytes(2))
    assert (data, counter) == (b"\x34\x12", 12)


def test_places_are_counted_up_on_the_way(line):
    frame = frame_of((APRD, (0, 0x0130), bytes(2)), (BRD, (7, 0x0130), bytes(2)))
    assert line.wired.pass_frame(frame)
    (_, first, _, one), (_, second, _, all_) = answers_of(frame)
    assert (first, one) == (12, 1) and (second, all_) == (7 + 12, 12)
    assert frame[6] == SENT_BY[0] | 2 and frame[7:12] == SENT_BY[1:], "marked as come back"


def test_a_station_address_finds_its_slave_alone(line):
    line.write(5, 0x0010, b"\x05\x10")
    assert line.send(FPRD, (0x1005, 0x0010), bytes(2)) == (b"\x05\x10", 1)
    assert line.send(FPWR, (0x2000, 0x0010), b"\x06\x10")[1] == 0
    assert line.send(FPRD, (0x1005, 0x0010), bytes(2)) == (b"\x05\x10", 1)


def test_one_reads_and_the_others_write(line):
    """The clock of the first slave goes to all: with ARMW and FRMW."""
    line.now = 5_000_000
    line.write(0, 0x0010, b"\x01\x10")
    for command, address in ((ARMW, (0, 0x0910)), (FRMW, (0x1001, 0x0910))):
        data, counter = line.send(command, address, bytes(8))
        assert counter == 12 and int.from_bytes(data, "little") == 5_000_000


def test_states_are_taken_in_order_and_refusals_have_codes(line):
    line.ask(AlState.SAFEOP)  # from INIT
    assert line.al(0) == (AlState.INIT | 0x10, 0x0011)
    line.ask(AlState.PREOP)  # without acknowledging, and without mailboxes
    assert line.al(0)[0] & 0x0F == AlState.INIT
    line.ask(0x10 | AlState.INIT)
    line.ask(AlState.PREOP)
    assert line.al(0) == (AlState.INIT | 0x10, 0x0016)


def test_a_drive_of_the_wrong_process_data_stays_in_preop(operating):
    line = Line()
    line.bring_to_op()
    line.ask(AlState.PREOP)
    line.write(2, 0x0800 + 16 + 6, b"\0")
    line.write(2, 0x0800 + 16, struct.pack("<HHBBH", 0x1100, 10, 0x64, 0, 1))
    line.ask(AlState.SAFEOP)
    assert line.al(2) == (AlState.PREOP | 0x10, 0x001D)
    assert line.al(1) == (AlState.SAFEOP, 0)


def test_process_data_is_that_of_an_exchange_in_the_process(operating):
    """Outputs in, inputs and power stages out, byte for byte, over some hundred ticks."""
    random = np.random.default_rng(7)
    twin = SimulatedSegment(ROBOT)
    twin.open()
    assign(twin)
    for state in (AlState.SAFEOP, AlState.OP):
        twin.bring_to(state)
    # one that has been on the wire for as long as the twin has been anywhere
    line = Line()
    line.bring_to_op()
    words = (0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x0F, 0x02, 0x00, 0x80)
    for tick in range(300):
        counts = random.integers(-90000, 90000, 12).astype(np.int32)
        for segment in (line.segment, twin):
            segment.set_servo_state(counts, counts // 3, counts * 1e-4, 22.2)
        word = words[tick // 8 % len(words)]
        outputs = b"".join(
            struct.pack(
                "<iihHHbbh",
                *(int(n) for n in random.integers(-50000, 50000, 2)),
                int(random.integers(-900, 900)),
                int(random.integers(0, 900)),
                word,
                int(random.choice((8, 9, 10))),
                0,
                int(random.integers(-900, 900)),
            )
            for _ in range(12)
        )
        data, counter = line.send(LRW, 0, outputs + bytes(264))
        inputs, wanted = twin.exchange(outputs)
        assert counter == wanted == 36, tick
        assert data[:216] == outputs and data[216:] == bytes(inputs), tick
        assert line.segment.servo_command().tobytes() == twin.servo_command().tobytes(), tick


def test_reading_and_writing_alone_count_one_each(operating):
    assert operating.send(LRD, 216, bytes(264))[1] == 12
    assert operating.send(LWR, 0, bytes(216))[1] == 12
    assert operating.send(LRW, 0, bytes(OUTPUTS))[1] == 2
    assert operating.send(LRW, 10_000, bytes(480)) == (bytes(480), 0)


def test_a_part_of_the_outputs_is_not_taken(operating):
    operating.send(LRW, 0, bytes(480))
    before = operating.segment.records["watchdog_left"].copy()
    operating.segment.set_servo_state(*STILL, 22.2)
    operating.send(LWR, 4, bytes(14 + 18))  # the end of the first drive's, all of the second's
    left = operating.segment.records["watchdog_left"]
    assert left[1] == before[1] and (np.delete(left, 1) < before[0]).all()


def test_a_drive_off_the_bus_is_skipped(line):
    line.segment.inject(ROBOT.joint_names[4], "silent")
    assert line.send(BRD, (0, 0), bytes(1))[1] == 11
    line.segment.clear()
    assert line.send(BRD, (0, 0), bytes(1))[1] == 12


@pytest.mark.parametrize("other", [b"\x08\x00", b"\x88\xa5"])
def test_other_frames_are_not_answered(line, other):
    frame = frame_of((BRD, (0, 0), bytes(1)))
    frame[12:14] = other
    before = bytes(frame)
    assert not line.wired.pass_frame(frame)
    assert not line.wired.is_cyclic(frame)
    assert frame == before


def test_a_truncated_frame_comes_back_as_it_was(line):
    whole = frame_of((BRD, (0, 0), bytes(1)), (BRD, (0, 0x0130), bytes(2)))
    for length in range(16, len(whole)):
        frame = whole[:length]
        assert line.wired.pass_frame(frame)
        assert frame[16:] == whole[16:length]


@settings(max_examples=300)
@given(
    st.lists(
        st.tuples(st.integers(0, 255), st.integers(0, 2**32 - 1), st.binary(max_size=64)),
        min_size=1,
        max_size=5,
    ),
    st.integers(0, 2**16 - 1),
    st.integers(0, 400),
)
def test_no_frame_breaks_the_line(hurt, datagrams, header, length):
    """Any datagrams, a length that lies, an end that is cut off."""
    frame = frame_of(*datagrams)
    if header & 1:
        struct.pack_into("<H", frame, 14, 0x1000 | header & 0x7FF)
    frame = frame[: max(16, length)]
    size = len(frame)
    hurt.wired.is_cyclic(frame)
    hurt.wired.pass_frame(frame)
    assert len(frame) == size


@settings(max_examples=300)
@given(st.integers(0, 0x1000), st.binary(min_size=1, max_size=160), st.booleans())
def test_no_register_breaks_the_line(hurt, register, data, mailbox):
    register = 0x1800 if mailbox else register
    hurt.send(BWR, (0, register), data)
    hurt.send(BRD, (0, register), bytes(len(data)))
    hurt.send(LRW, 0, bytes(480))
    hurt.segment.set_servo_state(*STILL, 22.2)


@pytest.fixture(scope="module")
def hurt():
    """A line that is not whole any more."""
    line = Line()
    line.bring_to_op()
    return line
