"""The companion's line to an autopilot, serial or UDP, and the thread that owns it."""

from __future__ import annotations

import contextlib
import os
import socket
import termios
import threading
import time
from collections.abc import Callable, Iterator
from typing import TypeAlias

from husky_pu.companion.client import MavlinkClient
from husky_pu.companion.telemetry import Report
from husky_runtime.ports.port_thread import PortThread
from husky_runtime.ports.serial_line import open_serial, read_bytes

_RETRY_PERIOD = 0.1
"""Time between two attempts to open a port that is not there [s]."""
_POLL_PERIOD = 0.05
"""Longest time between two looks at what is due [s]."""
_PEER_SILENCE = 2.0
"""After so long `udpin` listens to another peer [s]."""


class MavlinkSerial:
    """A tty or pseudo-terminal, raw, 8N1, for us alone; nothing of it blocks."""

    def __init__(self, path: str, baud: int):
        """Open it; raises OSError for no such port, no permission, or one that is taken."""
        self._port = open_serial(path, baud)

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._port.fileno()

    def read(self) -> bytes:
        """Return what is there; raises OSError when the port is gone."""
        return read_bytes(self.fileno())

    def write(self, data: bytes) -> int:
        """Send what finds room; return how many bytes did; raises OSError as well."""
        try:
            return os.write(self.fileno(), data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Give the port back."""
        self._port.close()


class MavlinkUdp:
    """The same of a UDP socket.

    `udpout` speaks first to an address, `udpin` answers who speaks first to it. With `udpin` one
    peer is heard at a time, until it has been silent for 2 s.
    """

    def __init__(self, address: tuple[str, int], bind: bool):
        """Open it; raises OSError when the address cannot be had."""
        self._peer: tuple[str, int] | None = None
        self._heard_at = 0.0
        self._bound = bind
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            if bind:
                self._socket.bind(address)
            else:
                self._peer = address
                self._socket.connect(address)
        except OSError:
            self._socket.close()
            raise

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._socket.fileno()

    def read(self) -> bytes:
        """Return one datagram of the peer."""
        try:
            data, sender = self._socket.recvfrom(65536)
        except (BlockingIOError, ConnectionRefusedError):
            return b""  # Nobody listens there yet.
        now = time.monotonic()
        if self._bound and sender != self._peer:
            if self._peer is not None and now - self._heard_at < _PEER_SILENCE:
                return b""
            self._peer = sender
        self._heard_at = now
        return data

    def write(self, data: bytes) -> int:
        """Send to the peer, if there is one."""
        if self._peer is None:
            return 0
        try:
            return self._socket.sendto(data, self._peer) if self._bound else self._socket.send(data)
        except (BlockingIOError, ConnectionRefusedError):
            return 0

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


MavlinkPort: TypeAlias = MavlinkSerial | MavlinkUdp


def opener(connection: str) -> Callable[[], MavlinkPort]:
    """Return what opens a connection.

    Args:
        connection: `serial:<path>:<baud>`, `udpin:<address>:<port>` or `udpout:<address>:<port>`.

    Raises:
        ValueError: something else.
    """
    kind, _, rest = connection.partition(":")
    place, _, number = rest.rpartition(":")
    if kind not in ("serial", "udpin", "udpout") or not place or not number.isdecimal():
        raise ValueError(
            f"connection is {connection!r}, it must be serial:<path>:<baud>, "
            "udpin:<address>:<port> or udpout:<address>:<port>"
        )
    if kind == "serial":
        return lambda: MavlinkSerial(place, int(number))
    if not 0 < int(number) < 65536:
        raise ValueError(f"connection is {connection!r}, a port is 1 to 65535")
    return lambda: MavlinkUdp((place, int(number)), kind == "udpin")


class CompanionLink(PortThread[MavlinkPort]):
    """Owns the connection: opens it, reads it in a thread, opens it again when it is gone.

    The client is used under the lock alone: by the thread for what comes in, and within `talk` for
    what goes out, which is on the line when `talk` ends.

    Attributes:
        dropped: bytes that found no room on the line.
    """

    def __init__(
        self,
        client: MavlinkClient,
        open_port: Callable[[], MavlinkPort],
        on_report: Callable[[Report], None],
        on_state: Callable[[str, bool], None] = lambda text, heard: None,
    ):
        """Prepare; nothing is opened yet.

        Args:
            client: the dialogue.
            open_port: opens the connection; raises OSError when it cannot.
            on_report: called in the thread, without the lock, with each bundle of telemetry.
            on_state: called likewise when the state changes: what it is, and whether the
                autopilot is heard.
        """
        super().__init__("mavlink", _RETRY_PERIOD)
        self.dropped = 0
        self._client = client
        self._open_port = open_port
        self._on_report = on_report
        self._on_state = on_state
        self._told = ""
        self._port: MavlinkPort | None = None
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def talk(self) -> Iterator[MavlinkClient]:
        """Hold the client; what it has to say goes out at the end."""
        with self._lock:
            yield self._client
            self._flush()

    def _dialogue_state(self) -> str:
        return "connected" if self._client.connected else "no autopilot"

    # Under the lock -----------------------------------------------------------------------------
    def _flush(self) -> None:
        data = self._client.take_output()
        if not data or self._port is None:
            return
        try:
            self.dropped += len(data) - self._port.write(data)
        except (OSError, termios.error):
            self.dropped += len(data)  # The thread finds the port gone, too.

    # In the thread ------------------------------------------------------------------------------
    def _open(self) -> MavlinkPort:
        return self._open_port()

    def _opened(self, port: MavlinkPort) -> None:
        with self._lock:
            super()._opened(port)
            self._port = port

    def _closed(self) -> None:
        with self._lock:
            super()._closed()
            self._port = None
            self._client.closed(self.error or "closed", time.monotonic())

    def _serve(self, port: MavlinkPort) -> bool:
        """Listen until the link is to stop, which returns True; raises OSError without the port."""
        descriptor = port.fileno()
        poller = self._poller(descriptor)
        poll_at = 0.0
        while True:
            for ready, _ in poller.poll(int(1e3 * _POLL_PERIOD)):
                if ready != descriptor:
                    return True
                data = port.read()
                with self._lock:
                    self._client.feed(data, time.monotonic())
                    reports = self._client.take_bundles()
                    self._flush()
                for report in reports:
                    self._on_report(report)
            now = time.monotonic()
            if now >= poll_at:
                poll_at = now + 0.5 * _POLL_PERIOD
                with self._lock:
                    self._client.poll(now)
                    self._flush()
            self._tell()

    def _tell(self) -> None:
        """Report a change of state once."""
        state = self.state
        if state != self._told:
            self._told = state
            text = f"{state}: {self.error}" if self.error else state
            self._on_state(text, state == "connected")
