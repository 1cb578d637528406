"""The simulated D435, at the far end of a Unix stream socket."""

from __future__ import annotations

import contextlib
import errno
import select
import socket
from collections.abc import Mapping, Sequence

from husky_drivers.d435.frames import DepthFrame
from husky_drivers.d435.wire import START, FrameParser, taken

_READ_SIZE = 1 << 20
"""Bytes of one read: some images of 160 x 120, half of the largest."""


class SimBackend:
    """The device by its socket."""

    retry_period = 0.05

    def __init__(self, path: str):
        """Prepare; the socket at the path is connected to later."""
        self.path = path
        self.parser = FrameParser()
        self._socket: socket.socket | None = None
        self._poller = select.poll()

    def open(self) -> None:
        """Connect and ask for frames; raises OSError."""
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            line.setblocking(False)  # A device that accepts nobody must not hold the driver up.
            line.connect(self.path)
            line.send(START)
        except OSError:
            line.close()
            raise
        self.parser.reset()
        self._poller = select.poll()
        self._poller.register(line, select.POLLIN)
        self._socket = line

    def poll(self, timeout: float) -> Sequence[DepthFrame]:
        """Wait for bytes; return the frames that they complete; raises OSError."""
        if self._socket is None or not self._poller.poll(round(1e3 * timeout)):
            return ()
        data = self._socket.recv(_READ_SIZE)
        if not data:
            raise OSError(errno.ECONNRESET, "the simulated camera has hung up")
        return self.parser.feed(data)

    def taken(self, frame: DepthFrame) -> None:
        """Tell the device that a frame has been passed on or dropped; raises OSError."""
        if self._socket is not None:
            with contextlib.suppress(BlockingIOError):  # A device that does not listen.
                self._socket.send(taken(frame.number))

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def counters(self) -> Mapping[str, int]:
        """Return what the parser has counted."""
        counters = self.parser.counters
        return {"crc_errors": counters.crc_errors, "garbage_bytes": counters.garbage_bytes}
