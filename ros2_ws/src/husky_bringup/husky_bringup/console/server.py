"""The web server of the page: viser's, on this machine alone, behind whatever gate there is."""

from __future__ import annotations

import contextlib
import io

from viser import ViserServer


class PageServer(ViserServer):
    """A server on a port that is free, which says nothing and shares nothing."""

    def __init__(self) -> None:
        """Listen."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__("127.0.0.1", 0, verbose=False)

    def request_share_url(self, verbose: bool = True) -> None:
        """Open no tunnel to viser's public host, whatever a client asks for: it has no gate."""

    def stop(self) -> None:
        """End."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()
