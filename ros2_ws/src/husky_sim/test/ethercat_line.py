"""A line of drives, and a master that makes its frames by hand."""

import struct

import numpy as np

from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.pdo import RX_ASSIGNMENT, TX_ASSIGNMENT
from husky_sim.devices.drives.segment import SimulatedSegment
from husky_sim.devices.ethercat.frames import datagrams
from husky_sim.devices.ethercat.wired_segment import WiredSegment

ETHERNET = bytes(6 * (0xFF,)) + bytes((0x00, 0x01, 0x01, 0x01, 0x01, 0x01)) + b"\x88\xa4"
VOLTS = 22.2
AP_READ, AP_WRITE, FP_READ, FP_WRITE, B_READ, B_WRITE = 1, 2, 4, 5, 7, 8
L_READ, L_WRITE, L_BOTH, AP_MULTIPLE, FP_MULTIPLE = 10, 11, 12, 13, 14
FIRST_STATION = 1001
AL_CONTROL, AL_STATUS, AL_CODE = 0x0120, 0x0130, 0x0134
OUT, IN = 18, 22
"""Bytes of the process data of a drive."""


def sync_manager(start, length, control, active=1):
    """Return the registers of a sync manager."""
    return struct.pack("<HHBBBB", start, length, control, 0, active, 0)


MAILBOXES = sync_manager(0x1800, 140, 0x26) + sync_manager(0x1900, 140, 0x22)
BUFFERS = sync_manager(0x1100, OUT, 0x64) + sync_manager(0x1180, IN, 0x20)


def fmmu(logical, length, physical, kind):
    """Return the registers of an FMMU; kind 1 reads, 2 writes."""
    return struct.pack("<IHBBHBBBxxx", logical, length, 0, 7, physical, 0, kind, 1)


def frame_of(*parts):
    """Return a frame; each part is a command, low and high word of the address, and the data."""
    body = b""
    for i, (command, slave, memory, data) in enumerate(parts):
        length = len(data) | (0x8000 if i < len(parts) - 1 else 0)
        body += struct.pack("<BBHHHH", command, i, slave & 0xFFFF, memory, length, 0)
        body += bytes(data) + b"\0\0"
    return bytearray(ETHERNET + struct.pack("<H", len(body) | 0x1000) + body)


class Line:
    """A segment and a master that sends frames by hand."""

    def __init__(self, drift_ppm=None):
        self.segment = SimulatedSegment()
        self.time_ns = 0
        self.wired = WiredSegment(self.segment, lambda: self.time_ns, drift_ppm)
        self.count = self.segment.slave_count
        self.counters = [0] * self.count  # of the mailboxes

    def send(self, *parts):
        """Send a frame; return data and working counter of each datagram."""
        frame = frame_of(*parts)
        assert self.wired.pass_frame(frame)
        return [
            (bytes(frame[d.data : d.end]), struct.unpack_from("<H", frame, d.end)[0])
            for d in datagrams(frame)
        ]

    def ask(self, command, slave, memory, data):
        return self.send((command, slave, memory, data))[0]

    def read(self, i, address, length):
        """Read memory of a drive by its station address; None when it does not count."""
        data, count = self.ask(FP_READ, FIRST_STATION + i, address, bytes(length))
        return data if count == 1 else None

    def write(self, i, address, data):
        """Write memory of a drive by its station address; return the working counter."""
        return self.ask(FP_WRITE, FIRST_STATION + i, address, data)[1]

    def configure(self, *, overlapping=False):
        """Set addresses, mailboxes, buffers, FMMUs and mappings; the drives stay in INIT.

        Outputs of all come before inputs of all, or those of a drive on the same addresses.
        """
        for i, drive in enumerate(self.segment.drives):
            drive.preset({od.RX_COUNT: RX_ASSIGNMENT, od.TX_COUNT: TX_ASSIGNMENT})
            outputs, inputs = (
                (IN * i, IN * i) if overlapping else (OUT * i, OUT * self.count + IN * i)
            )
            mapped = fmmu(outputs, OUT, 0x1100, 2) + fmmu(inputs, IN, 0x1180, 1)
            self.ask(AP_WRITE, -i, 0x0010, struct.pack("<H", FIRST_STATION + i))
            self.write(i, 0x0800, MAILBOXES + BUFFERS)
            self.write(i, 0x0600, mapped)

    def request(self, state):
        """Ask all drives for a state, acknowledging errors."""
        assert self.ask(B_WRITE, 0, AL_CONTROL, struct.pack("<H", state | 0x10))[1] == self.count

    def states(self):
        return [al.status for al in self.segment.al_states()]

    def bring_to_op(self, **configuration):
        self.configure(**configuration)
        for state in (2, 4, 8):
            self.request(state)
        assert self.states() == [8] * self.count

    def tick(self, counts=0, current=0.0):
        """Let one tick of the motors pass."""
        still = np.full(self.count, counts, np.int32)
        self.segment.set_servo_state(still, still, np.full(self.count, current), VOLTS)

    def mail(self, i, body, kind=3):
        """Put a mailbox message to a drive; return the working counter."""
        self.counters[i] = self.counters[i] % 7 + 1
        head = struct.pack("<HHBB", len(body), 0, 0, kind | self.counters[i] << 4)
        return self.write(i, 0x1800, (head + body).ljust(140, b"\0"))

    def fetch(self, i):
        """Return protocol and body of the message that waits, None when none does."""
        mail = self.read(i, 0x1900, 140)
        if mail is None:
            return None
        return mail[5] & 0x0F, mail[6 : 6 + int.from_bytes(mail[:2], "little")]

    def sdo(self, i, content):
        """Exchange SDO bytes; return CoE service and content."""
        assert self.mail(i, struct.pack("<H", 2 << 12) + content) == 1
        protocol, body = self.fetch(i)
        assert protocol == 3
        return body[1] >> 4, body[2:]
