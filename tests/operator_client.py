"""An operator's browser without a browser: it says what is held, and hears how things stand."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from typing import Any

from websocket_client import WebsocketClient
from websockets.exceptions import ConnectionClosed

from husky_bringup.console.operator_server import PLACE

_PERIOD = 0.05
_PATIENCE = 150.0
"""Wall time that words may take [s]."""


class OperatorClient(WebsocketClient):
    """A connection to the console's operator server.

    Attributes:
        state: what has been told last; empty before.
    """

    def __init__(self, address: str, **options: Any):
        """Connect; options are those of `websockets.sync.client.connect`."""
        self.state: dict[str, Any] = {}
        super().__init__(address + PLACE, **options)

    @property
    def robot(self) -> dict[str, Any]:
        """What has been told of the robot."""
        return dict(self.state.get("robot", {}))

    def ask(self, what: str, value: str) -> None:
        """Press a button."""
        beat = self.state.get("beat", 0)
        self.send_raw(json.dumps({"type": "ask", "what": what, "value": value, "beat": beat}))

    def hears(self, said: str) -> None:
        """Wait until these words are told, while nothing in this process is spun."""
        end = time.monotonic() + _PATIENCE
        while self.state.get("said") != said:
            assert time.monotonic() < end, f"heard {self.state.get('said')!r}, not {said!r}"
            time.sleep(_PERIOD)

    def hold(self, **held: Any) -> None:
        """Say once what is held."""
        word = {"type": "hold", "beat": self.state.get("beat", 0), **held}
        self.send_raw(json.dumps(word))

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

    def _take(self, data: str | bytes) -> None:
        message = json.loads(data)
        if "beat" in message:
            self.state = message
