"""Process data by frames is that of the bus in the process, bit for bit."""

import struct

import numpy as np
import pytest
from ethercat_line import (
    AL_CONTROL,
    AP_WRITE,
    B_READ,
    B_WRITE,
    FIRST_STATION,
    FP_MULTIPLE,
    IN,
    L_BOTH,
    L_READ,
    L_WRITE,
    OUT,
    RX_ASSIGNMENT,
    TX_ASSIGNMENT,
    VOLTS,
    Line,
    frame_of,
    od,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_drivers.cia402 import DriveState
from husky_drivers.ethercat import pdo
from husky_drivers.ethercat.bus import AlState
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.cyclic_frame import CyclicFrame
from husky_sim.devices.ethercat.wired_segment import Frame

TICKS = 300
FAULTS = ("sto", "silent", "fault:7300", "disturbed_timing", "fault:8611")
JOINTS = ("front_left_knee", "hind_right_hip_frontal")


def separate(line, outputs):
    """Return inputs and counter of one datagram, outputs of all before inputs of all."""
    data, count = line.ask(L_BOTH, 0, 0, outputs + bytes(IN * line.count))
    assert data[: len(outputs)] == outputs
    return data[len(outputs) :], count


def overlapping(line, outputs):
    """Return inputs and counter of one datagram, outputs and inputs of a drive in one place."""
    rows = [outputs[OUT * i : OUT * (i + 1)] for i in range(line.count)]
    sent = b"".join(row.ljust(IN, b"\0") for row in rows)
    data, count = line.ask(L_BOTH, 0, 0, sent)
    return data, count


def read_then_write(line, outputs):
    """Return inputs and counter of a frame with two datagrams: read, then write."""
    (data, reads), (_, writes) = line.send(
        (L_READ, OUT * line.count, 0, bytes(IN * line.count)), (L_WRITE, 0, 0, outputs)
    )
    return data, reads + 2 * writes


def physical(line, outputs):
    """Return inputs and counter of a datagram for each buffer."""
    reads = [(4, FIRST_STATION + i, 0x1180, bytes(IN)) for i in range(line.count)]
    writes = [
        (5, FIRST_STATION + i, 0x1100, outputs[OUT * i : OUT * (i + 1)]) for i in range(line.count)
    ]
    answers = line.send(*reads, *writes)
    data = b"".join(data for data, _ in answers[: line.count])
    return data, sum(c for _, c in answers) + sum(c for _, c in answers[line.count :])


def random_outputs(rng, fields):
    """Fill the outputs of drives that are mostly walked up to operation enabled."""
    for name in fields.dtype.names:
        info = np.iinfo(fields[name].dtype)
        fields[name] = rng.integers(info.min, info.max, len(fields), fields[name].dtype)
    usual = rng.choice([0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x02, 0x80, 0x10F], len(fields))
    odd = rng.random(len(fields)) < 0.02
    fields["controlword"] = np.where(odd, fields["controlword"], usual)
    fields["mode_of_operation"] = rng.choice([8, 9, 10, 0], len(fields))


@pytest.mark.parametrize("by_frame", [separate, overlapping, read_then_write, physical])
def test_it_equals_the_bus_in_the_process(by_frame):
    rng = np.random.default_rng(7)
    line, bus = Line(), SimulatedSegment()
    line.bring_to_op(overlapping=by_frame is overlapping)
    bus.open()
    for drive in bus.drives:
        drive.preset({od.RX_COUNT: RX_ASSIGNMENT, od.TX_COUNT: TX_ASSIGNMENT})
    for state in (AlState.SAFEOP, AlState.OP):
        bus.bring_to(state)
    image = pdo.ProcessImage(pdo.RX, line.count)
    compared = [name for name in bus.records.dtype.names if name != "emergency"]
    seen, counts = set(), set()
    for tick in range(TICKS):
        motion = (
            rng.integers(-(2**20), 2**20, line.count, np.int32),
            rng.integers(-(2**16), 2**16, line.count, np.int32),
            rng.normal(0.0, 10.0, line.count),
            22.2 if tick % 50 else 9.0,
        )
        line.segment.set_servo_state(*motion)
        bus.set_servo_state(*motion)
        if tick % 20 == 10:
            joint, fault = JOINTS[tick // 20 % 2], FAULTS[tick // 20 % 5]
            for segment in (line.segment, bus):
                segment.clear()
                segment.inject(joint, fault)
        if tick % 40 == 39:
            state, position = rng.choice([2, 4, 8]), int(rng.integers(line.count))
            line.write(position, 0x0120, struct.pack("<H", state | 0x10))
            bus.request_state(AlState(state), position)
            line.write(position, 0x0120, struct.pack("<H", 0x18))
            bus.request_state(AlState.OP, position)
        random_outputs(rng, image.fields)
        silent = bus.records["silent"].astype(bool)
        inputs, counter = by_frame(line, bytes(image.data))
        expected, expected_counter = bus.exchange(image.data)
        bus.emergencies()
        assert counter == expected_counter
        reads = ~silent & (bus.records["al_status"] & 0x0F >= 4)
        for i in np.flatnonzero(reads):
            assert inputs[IN * i : IN * (i + 1)] == bytes(expected[IN * i : IN * (i + 1)])
        assert line.segment.servo_command().tobytes() == bus.servo_command().tobytes()
        for name in compared:
            assert (line.segment.records[name] == bus.records[name]).all(), name
        seen |= set(line.segment.states())
        counts.add(counter)
    assert {DriveState.OPERATION_ENABLED, DriveState.FAULT} <= seen
    assert 3 * line.count in counts and len(counts) > 2


TIME_FROM = FIRST_STATION + 5
EVENTS = {
    "sto": (),
    "fault:7300": (),
    "silent": (),
    "cut": (),
    "clock set": ((5, TIME_FROM, 0x0920, struct.pack("<qI", -(10**9), 77)),),
    "two of one station": ((AP_WRITE, -7, 0x0010, struct.pack("<H", TIME_FROM)),),
    "one again": ((AP_WRITE, -7, 0x0010, struct.pack("<H", FIRST_STATION + 7)),),
    "no frame for 0.1 s": (),
    "op": ((B_WRITE, 0, AL_CONTROL, b"\x18\0"),),
    "outputs unmapped": ((5, FIRST_STATION + 6, 0x060C, b"\0"),),
    "safeop": ((5, FIRST_STATION + 2, AL_CONTROL, b"\x14\0"),),
}
"""Frames, or a fault, after which the frame of every cycle may lead elsewhere."""


def disturb(line, event):
    """Let an event happen that ends the one before."""
    line.segment.clear()
    if EVENTS[event]:
        line.send(*EVENTS[event])
    elif event == "no frame for 0.1 s":
        for _ in range(50):
            line.tick()
        assert line.states() == [0x14] * line.count
    else:
        line.segment.inject(JOINTS[event == "cut"], event)


@pytest.mark.parametrize("overlapping", [False, True])
def test_the_frame_of_every_cycle_passes_as_any_other(monkeypatch, overlapping):
    """Bytes, drives and clocks are those of a line that takes each frame datagram by datagram."""
    rng = np.random.default_rng(11)
    drifts = rng.normal(0.0, 50.0, 12)
    lines = known, other = Line(drifts), Line(drifts)
    other.wired._learn = lambda frame: None
    passed, whole = [], CyclicFrame.pass_frame

    def pass_frame(self, frame, now):
        passed.append(whole(self, frame, now))
        return passed[-1]

    monkeypatch.setattr(CyclicFrame, "pass_frame", pass_frame)
    for line in lines:
        line.bring_to_op(overlapping=overlapping)
    image = pdo.ProcessImage(pdo.RX, 12)
    size = IN * 12 if overlapping else (OUT + IN) * 12
    for tick in range(20 * len(EVENTS)):
        motion = rng.integers(-(2**20), 2**20, (2, 12), np.int32), rng.normal(0.0, 10.0, 12)
        event = list(EVENTS)[tick // 20] if tick % 20 == 9 else ""
        random_outputs(rng, image.fields)
        width = IN if overlapping else OUT
        rows = [bytes(row).ljust(width, b"\0") for row in image.fields]
        data = b"".join(rows).ljust(size, b"\0")
        time = (FP_MULTIPLE, TIME_FROM, 0x0910, rng.bytes(4 + tick // 20 % 5))
        parts = [(L_BOTH, 0, 0, data), time][: 2 if tick < 180 else 1]
        frames, kinds = [frame_of(*parts) for _ in lines], set()
        for line, frame in zip(lines, frames, strict=True):
            line.time_ns += int(2e6)
            line.segment.set_servo_state(*motion[0], motion[1], VOLTS)
            if event:
                disturb(line, event)
            frame[17] = tick & 0xFF
            kinds.add(line.wired.pass_frame(frame))
        assert kinds == {Frame.CYCLIC} or line.states() == [0x14] * 12
        assert frames[0] == frames[1]
        for ours, theirs in (
            (known.segment.records, other.segment.records),
            (known.wired._clocks.records, other.wired._clocks.records),
        ):
            assert ours.tobytes() == theirs.tobytes()
    assert passed.count(True) > 100 and passed.count(False) >= 3


def test_in_safeop_drives_give_inputs_and_take_nothing():
    line = Line()
    line.configure()
    for state in (2, 4):
        line.request(state)
    line.tick(counts=4711)
    inputs, counter = separate(line, b"\xff" * OUT * line.count)
    assert counter == line.count
    assert struct.unpack_from("<i", inputs)[0] == 4711
    assert not line.segment.records["target_position"].any()
    line.request(2)
    assert separate(line, bytes(OUT * line.count))[1] == 0


def test_cyclic_frames_are_those_that_touch_a_drive_in_op():
    line = Line()
    line.configure()
    frame = frame_of((L_BOTH, 0, 0, bytes((OUT + IN) * line.count)))
    for state in (2, 4):
        line.request(state)
        assert not line.wired.is_cyclic(frame)
    line.request(8)
    assert line.wired.is_cyclic(frame)
    assert not line.wired.is_cyclic(frame_of((L_BOTH, 0x9000, 0, bytes(8))))
    assert not line.wired.is_cyclic(frame_of((4, FIRST_STATION, 0x0130, bytes(2))))
    assert not line.wired.is_cyclic(b"\0" * 60)
    for _ in range(50):
        line.tick()  # the watchdogs end it
    assert not line.wired.is_cyclic(frame)


def test_a_buffer_that_no_longer_fits_carries_no_process_data():
    """A master that shortens it in OP: the drive gets none, and its watchdog ends it."""
    line = Line()
    line.bring_to_op()
    line.write(0, 0x0810, bytes(8))
    line.write(0, 0x0810, struct.pack("<HHBBBB", 0x1100, 4, 0x64, 0, 1, 0))
    outputs = b"\x01" * OUT * line.count
    for _ in range(50):
        line.tick()
        separate(line, outputs)
    assert line.states() == [0x14] + [8] * (line.count - 1)
    assert line.segment.records["target_position"][0] == 0


def test_the_number_of_drifts_is_that_of_the_drives():
    with pytest.raises(ValueError, match="2 drifts for 12 drives"):
        Line([0.0, 1.0])


@pytest.fixture(scope="module")
def hurt():
    """A line that is not whole any more."""
    line = Line()
    line.bring_to_op()
    return line


@settings(max_examples=300)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 255),
            st.integers(0, 2**16 - 1),
            st.integers(0, 2**16 - 1),
            st.binary(max_size=64),
        ),
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
    hurt.ask(B_WRITE, 0, register, data)
    hurt.ask(B_READ, 0, register, bytes(len(data)))
    hurt.ask(L_BOTH, 0, 0, bytes(480))
    hurt.tick()
