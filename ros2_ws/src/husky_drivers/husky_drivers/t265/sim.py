"""The simulated T265, at the far end of a serial line."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
from collections.abc import Mapping, Sequence

from husky_drivers.t265.frames import PoseFrame
from husky_drivers.t265.wire import BAUD, START, FrameParser
from husky_runtime.ports.serial_line import SerialPort, hung_up, open_serial, read_bytes


class SimBackend:
    """The device by its line."""

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
