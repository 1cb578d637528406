"""The web server of the page: viser's, on this machine alone, behind whatever gate there is."""

from __future__ import annotations

import contextlib
import io

from viser import ViserServer
from viser._messages import GuiUpdateMessage
from viser.infra import ClientId


class PageServer(ViserServer):
    """A server on a port that is free, which says nothing and shares nothing."""

    def __init__(self) -> None:
        """Listen."""
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
                await self.gui._handle_gui_updates(client_id, message)

    def request_share_url(self, verbose: bool = True) -> None:
        """Open no tunnel to viser's public host, whatever a client asks for: it has no gate."""

    def stop(self) -> None:
        """End."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()
