"""An operator's browser without a browser: it says what is held, and hears how things stand."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Iterator
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from husky_bringup.console.operator_server import PLACE

_PERIOD = 0.05


class OperatorClient:
    """A connection to the console's operator server.

    Attributes:
        state: what has been told last; empty before.
        closed: code and reason of the end of the connection, None before.
    """

    def __init__(self, address: str, **options: Any):
        """Connect; options are those of `websockets.sync.client.connect`."""
        self._end = contextlib.ExitStack()
        self._socket = self._end.enter_context(
            connect(address.replace("http", "ws", 1) + PLACE, **options)
        )
        self.state: dict[str, Any] = {}
        self.closed: tuple[int, str] | None = None
        self._reading = threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Say goodbye."""
        self._end.close()
        self._thread.join()

    def break_off(self) -> None:
        """Be gone without a word."""
        self._socket.socket.close()

    @property
    def robot(self) -> dict[str, Any]:
        """What has been told of the robot."""
        return dict(self.state.get("robot", {}))

    def ask(self, what: str, value: str) -> None:
        """Press a button."""
        beat = self.state.get("beat", 0)
        self.send_raw(json.dumps({"type": "ask", "what": what, "value": value, "beat": beat}))

    def hold(self, **held: Any) -> None:
        """Say once what is held."""
        word = {"type": "hold", "beat": self.state.get("beat", 0), **held}
        self.send_raw(json.dumps(word))

    def send_raw(self, data: str | bytes) -> None:
        """Send anything."""
        self._socket.send(data)

    @contextlib.contextmanager
    def holding(self, **held: Any) -> Iterator[threading.Thread]:
        """Hold something meanwhile, which has been let go before; let it go in the end.

        Yields:
            What says so; it ends when the connection does.
        """
        over = threading.Event()

        def say() -> None:
            with contextlib.suppress(ConnectionClosed, OSError):
                self.hold()
                while not over.wait(_PERIOD):
                    self.hold(**held)
                self.hold()

        saying = threading.Thread(target=say, daemon=True)
        saying.start()
        try:
            yield saying
        finally:
            over.set()
            saying.join()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Read nothing meanwhile, as a page that its browser has put to sleep."""
        with self._reading:
            yield

    def _read(self) -> None:
        try:
            while True:
                data = json.loads(self._socket.recv())
                with self._reading:
                    if "beat" in data:
                        self.state = data
        except (ConnectionClosed, OSError):
            end = self._socket.protocol
            self.closed = end.close_code or 1006, end.close_reason or ""
