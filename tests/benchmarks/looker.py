"""A browser of the console in a process of its own, for `console.py`: page and operator.

It keeps what comes and reads it when the measurement is over: drawing it is the work of the
operator's machine, not the robot's. On its standard input `begin` starts to count, `end` tells.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from operator_client import OperatorClient
from page_client import PageClient

from husky_bringup.console.operator_server import VIEW

_BODY = "/scene/torso"
"""Part of the robot that has another position in each drawing while it walks."""


class _Page(PageClient):
    """Keeps the windows of messages as they come."""

    def __init__(self, address: str):
        self.windows: list[bytes] = []
        self._shows_body = False
        super().__init__(address)

    def _take(self, data: str | bytes) -> None:
        assert isinstance(data, bytes)
        self.windows.append(data)

    def _take_message(self, message: dict[str, Any]) -> None:
        if message["type"] == "SetPositionMessage" and message["name"] == _BODY:
            self._shows_body = True

    def is_drawing(self, window: bytes) -> bool:
        """Return whether a window moves the robot."""
        self._shows_body = False
        super()._take(window)
        return self._shows_body


def main(address: str) -> None:
    """Look until standard input ends."""
    page, operator = _Page(address + VIEW), OperatorClient(address)
    print("looks", flush=True)
    begin, first = time.monotonic(), 0
    for word in map(str.strip, sys.stdin):
        if word == "begin":
            begin, first = time.monotonic(), len(page.windows)
        elif word == "end":
            seconds = time.monotonic() - begin
            windows = page.windows[first:]
            told = {
                "rate_hz": sum(map(page.is_drawing, windows)) / seconds,
                "bandwidth_kB_per_s": sum(map(len, windows)) / 1e3 / seconds,
            }
            print(json.dumps(told), flush=True)
    page.close()
    operator.close()


if __name__ == "__main__":
    main(sys.argv[1])
