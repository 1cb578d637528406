"""A connection to a server of websockets, read by a thread of its own: what its clients share."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect


class WebsocketClient:
    """A connection; who inherits takes what comes over it.

    Attributes:
        closed: whether it has ended.
        code: that it has ended with, None before.
        reason: likewise.
    """

    def __init__(self, address: str, **options: Any):
        """Connect; options are those of `websockets.sync.client.connect`.

        Raises:
            websockets.exceptions.InvalidHandshake: it is refused.
        """
        options.setdefault("max_size", None)
        self._end = contextlib.ExitStack()
        address = address.replace("http", "ws", 1)
        self._socket = self._end.enter_context(connect(address, **options))
        self.closed = False
        self.code: int | None = None
        self.reason: str | None = None
        self._reading = threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Say goodbye."""
        self._end.close()
        self._thread.join()

    def break_off(self) -> None:
        """Go without a word, as a machine that is unplugged."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()

    def join(self) -> None:
        """Wait until the server has ended the connection."""
        self._thread.join(60.0)
        assert self.closed

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Read nothing meanwhile, as a page that its browser has put to sleep."""
        with self._reading:
            yield

    def send_raw(self, data: str | bytes) -> None:
        """Send anything."""
        self._socket.send(data)

    def _read(self) -> None:
        try:
            while True:
                data = self._socket.recv()
                with self._reading:
                    self._take(data)
        except ConnectionClosed:
            pass
        finally:
            self.code, self.reason = self._socket.close_code, self._socket.close_reason
            self.closed = True

    def _take(self, data: str | bytes) -> None:
        """Take what has come."""
        raise NotImplementedError
