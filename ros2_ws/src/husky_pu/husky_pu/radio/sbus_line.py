"""The transmitting end of an SBUS line: a serial port that may vanish and come back."""

from __future__ import annotations

import contextlib
import os
import termios

import serial

from husky_pu.radio.sbus import BAUD
from husky_runtime.ports.port_lock import check_served
from husky_runtime.ports.serial_line import SerialPort

_RETRY_PERIOD = 0.1
"""Wall time between two attempts to open the port [s]."""


def open_sbus(path: str) -> SerialPort:
    """Open a serial port at 100000 baud 8E2, for us alone; inverting levels is the adapter's job.

    A pseudo-terminal carries bytes, no parity: to ask one for it again, with all else as it is,
    is an error.

    Raises:
        OSError: no such port, no permission, taken by another process, its server is dead.
        ValueError: the port cannot do it.
    """
    check_served(path)
    is_pty = os.path.realpath(path).startswith("/dev/pts/")
    port: SerialPort = serial.Serial(
        path,
        BAUD,
        bytesize=serial.EIGHTBITS,
        parity=serial.PARITY_NONE if is_pty else serial.PARITY_EVEN,
        stopbits=serial.STOPBITS_TWO,
        timeout=0.0,
        exclusive=True,
    )
    return port


class SbusLine:
    """Writes frames without ever waiting or raising; opens the port again when it is gone.

    Attributes:
        path: the serial port.
        sent: frames that went out whole.
        dropped: frames that did not: no port, or nobody took the bytes.
        connections: how often the port has been opened.
        error: why it is not open, "" when it is.
    """

    def __init__(self, path: str):
        """Prepare; the port is opened by the first `write`."""
        self.path = path
        self.sent = 0
        self.dropped = 0
        self.connections = 0
        self.error = "not opened yet"
        self._port: SerialPort | None = None
        self._retry_at = float("-inf")

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def write(self, frame: bytes, now: float) -> bool:
        """Send a frame of 25 bytes at a monotonic wall time [s]; return whether it went out."""
        if self._port is None and now >= self._retry_at:
            self._retry_at = now + _RETRY_PERIOD
            self._open()
        written = 0
        if self._port is not None:
            try:
                with contextlib.suppress(BlockingIOError):
                    written = os.write(self._port.fileno(), frame)
            except (OSError, termios.error) as error:
                self.error = str(error)
                self.close()
        if written == len(frame):
            self.sent += 1
            return True
        self.dropped += 1
        return False

    def _open(self) -> None:
        try:
            self._port = open_sbus(self.path)
            os.set_blocking(self._port.fileno(), False)
        except (OSError, termios.error, ValueError) as error:
            self.error = str(error)
            self.close()
            return
        self.connections += 1
        self.error = ""

    def close(self) -> None:
        """Give the port back."""
        if self._port is not None:
            with contextlib.suppress(OSError, termios.error):
                self._port.close()
            self._port = None
