"""A thread that owns a port: opens it, serves it, and opens it again when it is gone."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import threading
from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

PORT_ERRORS = (OSError, termios.error, ValueError)
"""What opening and serving a port may raise."""


class Closable(Protocol):
    """What the thread itself needs of a port."""

    def close(self) -> None:
        """Give the port back."""


PortT = TypeVar("PortT", bound=Closable)


class PortThread(ABC, Generic[PortT]):
    """Opens a port, serves it in a thread, and tries again for as long as it is not there.

    Attributes:
        connected: whether the port is open.
        connections: how often it has been opened.
        error: why it is not open, "" when it is.
    """

    def __init__(self, name: str, retry_period: float):
        """Prepare; nothing is opened yet.

        Args:
            name: of the thread.
            retry_period: time between two attempts to open a port that is not there [s].
        """
        self.connected = False
        self.connections = 0
        self.error = ""
        self._name = name
        self._retry_period = retry_period
        self._wake_read, self._wake_write = os.pipe()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close everything; it cannot be started again."""
        if self._thread is None:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        os.close(self._wake_read)
        os.close(self._wake_write)

    @property
    def state(self) -> str:
        """What it is doing: "stopped", "no port", or what is going on at the open port."""
        if self._thread is None or not self._thread.is_alive():
            return "stopped"
        return self._dialogue_state() if self.connected else "no port"

    # For those who make one, all in the thread but `_dialogue_state` ----------------------------
    @abstractmethod
    def _dialogue_state(self) -> str:
        """Return what is going on at an open port; any thread asks."""

    @abstractmethod
    def _open(self) -> PortT:
        """Open the port; raises one of `PORT_ERRORS` when it cannot."""

    @abstractmethod
    def _serve(self, port: PortT) -> bool:
        """Serve an open port until it is to be reopened; return whether the thread is to stop.

        That is when `_wake_read` can be read. Raises one of `PORT_ERRORS` when the port is gone.
        """

    @abstractmethod
    def _tell(self) -> None:
        """Report a change of state, if there is one."""

    def _opened(self, port: PortT) -> None:
        """Note that the port is open."""
        self.connected = True
        self.connections += 1
        self.error = ""

    def _closed(self) -> None:
        """Note that it is not any more; `error` says why."""
        self.connected = False

    def _poller(self, descriptor: int) -> select.poll:
        """Return what waits for bytes of the port, or for the wish to stop."""
        poller = select.poll()
        poller.register(descriptor, select.POLLIN)
        poller.register(self._wake_read, select.POLLIN)
        return poller

    def _run(self) -> None:
        stopped = False
        while not stopped:
            try:
                port = self._open()
            except PORT_ERRORS as error:
                self.error = _in_words(error)
                self._tell()
                stopped = bool(select.select([self._wake_read], [], [], self._retry_period)[0])
                continue
            try:
                self._opened(port)
                stopped = self._serve(port)
            except PORT_ERRORS as error:
                self.error = str(error)
            finally:
                self._closed()
                with contextlib.suppress(OSError, termios.error):
                    port.close()
            if not stopped:
                self._tell()


def _in_words(error: Exception) -> str:
    """Say why a port is not open; one that does not exist yet is waited for, as at every start."""
    if isinstance(error, FileNotFoundError) and error.filename is not None:
        return f"waiting for {error.filename}"
    return str(error)
