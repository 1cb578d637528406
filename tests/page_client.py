"""A browser of the console's page without a browser: it keeps what the server has told it."""

from __future__ import annotations

from typing import Any

import msgspec
import zstandard
from viser import __version__
from websocket_client import WebsocketClient

_CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 0.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class PageClient(WebsocketClient):
    """A connection to viser's server, and the page as it is by what has come over it.

    Attributes:
        nodes: kind of each object of the scene by name, e.g. "GlbMessage".
        positions: of objects [m], by name.
        received: bytes that have come.
    """

    def __init__(self, address: str, **options: Any):
        """Connect, and look; options are those of `websockets.sync.client.connect`.

        Raises:
            websockets.exceptions.InvalidHandshake: it is refused.
        """
        self.nodes: dict[str, str] = {}
        self.positions: dict[str, tuple[float, ...]] = {}
        self._gui: dict[str, dict[str, Any]] = {}
        self.received = 0
        super().__init__(address, subprotocols=[f"viser-v{__version__}"], **options)
        self.say(**_CAMERA)

    @property
    def gui(self) -> dict[str, dict[str, Any]]:
        """Properties of each element of the panel that has come so far, by its number."""
        return dict(self._gui)  # a thread adds to it

    def say(self, **message: Any) -> None:
        """Send a message of viser's."""
        self.send_raw(msgspec.msgpack.encode(message))

    def contents(self) -> list[str]:
        """Return the HTML of the panel, an element each."""
        return [str(props.get("content", "")) for props in self.gui.values()]

    def _take(self, data: str | bytes) -> None:
        assert isinstance(data, bytes)
        self.received += len(data)
        for message in _messages(data):
            self._take_message(message)

    def _take_message(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("name", "")
        if kind == "SetPositionMessage":
            self.positions[name] = tuple(message["position"])
        elif kind == "RemoveSceneNodeMessage":
            self.nodes.pop(name, None)
        elif kind.startswith("Gui") and kind.endswith("UpdateMessage"):
            self._gui.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind.startswith("Gui") and "uuid" in message:
            self._gui[message["uuid"]] = dict(message.get("props", {}))
        elif name and "props" in message:
            self.nodes[name] = kind


def _messages(data: bytes) -> list[dict[str, Any]]:
    """Return the messages of a window; arrays, which stand behind them, are left out."""
    packed = int.from_bytes(data[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed])
    return list(msgspec.msgpack.decode(inner)["messages"])
