"""What a T265 is to its driver, and the choice of one: the camera, or the simulated device."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
from collections.abc import Mapping, Sequence
from typing import Protocol

from husky_drivers.t265.frames import PoseFrame
from husky_drivers.t265.wire import BAUD, START, FrameParser
from husky_runtime.ports.serial_line import SerialPort, hung_up, open_serial, read_bytes

BACKENDS = ("sim", "realsense")
"""Names of the backends."""


class BackendError(RuntimeError):
    """A backend cannot work on this machine at all; says which version is missing, and why."""


class T265Backend(Protocol):
    """A source of pose frames. One thread uses it.

    Attributes:
        path: where the device is, for reports.
        retry_period: time to wait before `open` is tried again [s].
    """

    path: str
    retry_period: float

    def open(self) -> None:
        """Start the stream; raises OSError when the device is not there, or taken."""

    def poll(self, timeout: float) -> Sequence[PoseFrame]:
        """Wait for frames at most this long [s]; return those that have come, oldest first.

        Raises:
            OSError: the device is gone.
        """

    def close(self) -> None:
        """Stop the stream and give the device back; does nothing when it is not open."""

    def counters(self) -> Mapping[str, int]:
        """Return what is counted on the way, for reports."""


def make_backend(name: str, port: str, serial_number: str = "") -> T265Backend:
    """Return a backend; nothing is opened yet.

    Args:
        name: one of `BACKENDS`.
        port: of `sim`: its serial port.
        serial_number: of `realsense`: which camera, "" for any.

    Raises:
        BackendError: it cannot work here.
        ValueError: there is no such backend.
    """
    if name == "sim":
        return SimBackend(port)
    if name == "realsense":
        from husky_drivers.t265.realsense import RealsenseBackend, load_librealsense

        return RealsenseBackend(load_librealsense(), serial_number)
    raise ValueError(f"backend is {name!r}, it must be one of {', '.join(BACKENDS)}")


class SimBackend:
    """The simulated device, at the far end of a serial line."""

    retry_period = 0.05

    def __init__(self, path: str):
        """Prepare; the serial port at the path is opened later."""
        self.path = path
        self.parser = FrameParser()
        self._port: SerialPort | None = None
        self._descriptor = -1
        self._poller = select.poll()

    def open(self) -> None:
        """Open the line and ask for frames; raises OSError."""
        try:
            self._port = open_serial(self.path, BAUD)
        except (termios.error, ValueError) as error:
            raise OSError(errno.EIO, str(error)) from error
        self.parser.reset()
        self._descriptor = self._port.fileno()
        self._poller = select.poll()
        self._poller.register(self._descriptor, select.POLLIN)
        os.write(self._descriptor, START)

    def poll(self, timeout: float) -> Sequence[PoseFrame]:
        """Wait for bytes; return the frames that they complete; raises OSError."""
        for _, events in self._poller.poll(round(1e3 * timeout)):
            if events & select.POLLIN:
                return self.parser.feed(read_bytes(self._descriptor))
            raise hung_up()
        return ()

    def close(self) -> None:
        """Close the line."""
        if self._port is not None:
            with contextlib.suppress(OSError, termios.error):
                self._port.close()
            self._port = None

    def counters(self) -> Mapping[str, int]:
        """Return what the parser has counted."""
        counters = self.parser.counters
        return {"crc_errors": counters.crc_errors, "garbage_bytes": counters.garbage_bytes}
