"""The host's end of a serial line: how a port is opened and read."""

from __future__ import annotations

import contextlib
import errno
import os
from typing import Protocol

import serial

from husky_runtime.ports.port_lock import check_served

_READ_SIZE = 4096


class SerialPort(Protocol):
    """What is needed of a serial port; `serial.Serial` has it."""

    baudrate: int

    def fileno(self) -> int:
        """Return the file descriptor, to wait on, to read and to write."""

    def close(self) -> None:
        """Give the port back."""


def open_serial(path: str, baud: int) -> SerialPort:
    """Open a serial port, raw, 8N1, for us alone, without the USB adapter's waiting time.

    Reading and writing its descriptor never waits.

    Raises:
        OSError: no such port, no permission, taken by another process, its server is dead.
        ValueError: the port cannot do that rate.
    """
    check_served(path)
    try:
        port = serial.Serial(path, baud, timeout=0.0, exclusive=True)
    except serial.SerialException as error:
        if error.errno == errno.ENOENT:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path) from error
        raise
    with contextlib.suppress(ValueError, OSError, NotImplementedError):
        port.set_low_latency_mode(True)
    os.set_blocking(port.fileno(), False)
    opened: SerialPort = port
    return opened


def read_bytes(descriptor: int) -> bytes:
    """Return what has come on a line, b"" for nothing; raises OSError if the port is gone."""
    try:
        data = os.read(descriptor, _READ_SIZE)
    except BlockingIOError:
        return b""
    if not data:
        raise hung_up()
    return data


def hung_up() -> OSError:
    """Return the error of a line whose far end is gone."""
    return OSError(errno.EIO, "the serial line has been hung up")
