"""The web server of the page: viser's, on this machine alone, behind whatever gate there is."""

from __future__ import annotations

import contextlib
import io
import threading

from viser import SceneNodeHandle, ViserServer
from viser._messages import GuiUpdateMessage, SetOrientationMessage, SetPositionMessage
from viser.infra import ClientId

PORT = 8080
"""At which people find the page, unless they say another."""


class PageServer(ViserServer):
    """A server on a port that is free, which says nothing and shares nothing.

    Attributes:
        inputs: held while a browser gives an input a value; who reads one and then writes it holds
            it meanwhile, for what comes between would be lost.
    """

    def __init__(self) -> None:
        """Listen."""
        self.inputs = threading.Lock()
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__("127.0.0.1", 0, verbose=False)
        inputs = self.gui._websock_interface
        inputs.unregister_handler(GuiUpdateMessage, self.gui._handle_gui_updates)
        inputs.register_handler(GuiUpdateMessage, self._take_value)

    async def _take_value(self, client_id: ClientId, message: GuiUpdateMessage) -> None:
        """Let a browser give an input a value, of its type, and nothing else.

        viser would set any attribute of the input: then the page's next word to it fails.
        """
        with contextlib.suppress(ValueError, TypeError, OverflowError, AssertionError):
            if set(message.updates) == {"value"}:
                with self.inputs:
                    await self.gui._handle_gui_updates(client_id, message)  # awaits nothing

    def request_share_url(self, verbose: bool = True) -> None:
        """Open no tunnel to viser's public host, whatever a client asks for: it has no gate."""

    def stop(self) -> None:
        """End."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def move(
    handle: SceneNodeHandle,
    position: tuple[float, float, float],
    wxyz: tuple[float, float, float, float] | None = None,
) -> None:
    """Move an object of the scene; as its setters, which spend most of a drawing on comparing.

    Args:
        handle: of the object.
        position: in the object above it [m].
        wxyz: quaternion likewise; None to turn nothing.
    """
    state = handle._impl
    state.position[:] = position
    state.api._queue_scene_message(SetPositionMessage(state.name, position))
    if wxyz is not None:
        state.wxyz[:] = wxyz
        state.api._queue_scene_message(SetOrientationMessage(state.name, wxyz))
