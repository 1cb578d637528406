"""The bus's serial line as the SDK's packet handler wants a port to be.

ROBOTIS's own `PortHandler` reads in a busy loop, allows every answer 34 ms whatever the line, and
cannot be told to be patient with a far side whose clock is not this machine's. This one waits in
`select`, and its patience is a setting.
"""

from __future__ import annotations

import math
import os
import select
import time
from collections.abc import Callable

from husky_runtime.patient_clock import PatientClock
from husky_runtime.ports.serial_line import SerialPort, open_serial, read_bytes

_BITS_PER_BYTE = 10


class DynamixelPort:
    """A half-duplex line; implements what `dynamixel_sdk` asks of its `PortHandler`.

    The SDK's names are kept where the SDK calls them.

    Attributes:
        is_using: set by the SDK while an answer is awaited.
        is_open: whether the line is there.
        sent, received: bytes since the start.
    """

    def __init__(
        self,
        path: str,
        baud: int,
        patience: float,
        open_port: Callable[[str, int], SerialPort] = open_serial,
        longest_look: float = math.inf,
    ):
        """Prepare; nothing is opened yet.

        Args:
            path: of the serial port.
            baud: of the bus.
            patience: wall time that an answer may take beyond its bytes' own [s].
            open_port: opens a port at a baud rate, as `open_serial` does, or raises OSError.
            longest_look: most that the time between two looks at the line counts [s].
        """
        self.path, self._baud, self._patience = path, baud, patience
        self._open_port = open_port
        self._clock, self._longest_look = PatientClock(longest_look), longest_look
        self._port: SerialPort | None = None
        self._buffer = bytearray()
        self._deadline = 0.0
        self.is_using = False
        self.sent = self.received = 0

    @property
    def is_open(self) -> bool:
        """Whether the line is there."""
        return self._port is not None

    def open(self) -> None:
        """Open the line; raises OSError or ValueError when it cannot be."""
        self._port = self._open_port(self.path, self._baud)
        self._buffer.clear()
        self.is_using = False

    def close(self) -> None:
        """Give the line back."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def expect_at_once(self) -> None:
        """What is to be read next has come already, or does not come."""
        self._deadline = 0.0

    # What the SDK calls -------------------------------------------------------------------------
    def getBaudRate(self) -> int:
        """Return the rate [baud]."""
        return self._baud

    def clearPort(self) -> None:
        """Drop what has come and was not read: it answers nothing that is asked now."""
        while self._receive():
            pass
        self._buffer.clear()

    def writePort(self, packet: list[int]) -> int:
        """Send a packet; return the bytes that were taken."""
        written = os.write(self._descriptor(), bytes(packet))
        self.sent += written
        return written

    def readPort(self, length: int) -> bytes:
        """Return at most so many bytes, after waiting for them as long as the answer may take."""
        buffer = self._buffer
        while len(buffer) < length:
            if not self._receive() and not self._wait():
                break
        taken = max(0, length)  # the SDK asks for less than nothing behind a packet cut short
        data = bytes(buffer[:taken])
        del buffer[:taken]
        return data

    def setPacketTimeout(self, packet_length: int) -> None:
        """An answer of so many bytes is awaited from now on."""
        line_time = packet_length * _BITS_PER_BYTE / self._baud
        self._deadline = self._now() + line_time + self._patience

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """An answer is awaited for so long [ms]."""
        self._deadline = self._now() + 1e-3 * msec

    def isPacketTimeout(self) -> bool:
        """Return whether the answer does not come any more."""
        return self._now() >= self._deadline

    # Bytes --------------------------------------------------------------------------------------
    def _descriptor(self) -> int:
        if self._port is None:
            raise OSError("the line is not open")
        return self._port.fileno()

    def _receive(self) -> bool:
        """Take what is there; return whether there was anything."""
        if not self._readable(0.0):
            return False
        data = read_bytes(self._descriptor())
        self._buffer += data
        self.received += len(data)
        return bool(data)

    def _wait(self) -> bool:
        """Wait for bytes; return whether some came in time."""
        while (left := self._deadline - self._now()) > 0.0:
            if self._readable(min(left, 0.5 * self._longest_look)):
                return True
        return False

    def _now(self) -> float:
        return self._clock.read(time.monotonic())

    def _readable(self, wait: float) -> bool:
        return bool(select.select([self._descriptor()], [], [], wait)[0])
