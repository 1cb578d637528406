"""Where the flight controller's MAVLink bytes come from and go to: a UDP socket, a serial line."""

from __future__ import annotations

import socket
from collections.abc import Hashable
from pathlib import Path

from husky_description.pty_port import PtyPort

_DATAGRAM = 2048
_MOST_READS = 64
"""Datagrams taken at one look: a flood does not stop the control loop."""
_MTU = 1400
"""Largest datagram sent [bytes]."""


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of "host:port".

    Raises:
        ValueError: something else.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"address {text!r} is not host:port")
    return socket.gethostbyname(host), int(port)


class UdpPort:
    """A socket with a link for each address that speaks.

    Attributes:
        station: link of the ground station that is spoken to first, None for none.
        dropped: datagrams that could not be sent.
        port: local port in use.
    """

    def __init__(self, port: int, station: str = "", host: str = "127.0.0.1"):
        """Bind.

        Args:
            port: local port, 0 for any that is free.
            station: "host:port" of a ground station, "" for none.
            host: address to listen at.

        Raises:
            OSError: the port is taken.
            ValueError: an address that is none.
        """
        self.station = parse_address(station) if station else None
        self.dropped = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise OSError(error.errno, f"UDP port {port}: {error.strerror}") from error
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])

    def read(self) -> list[tuple[Hashable, bytes]]:
        """Return what has come, each with its link."""
        received: list[tuple[Hashable, bytes]] = []
        for _ in range(_MOST_READS):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM)
            except BlockingIOError:
                break
            except OSError:  # a peer that went away answers with ICMP
                continue
            received.append((address, data))
        return received

    def write(self, link: Hashable, data: bytes) -> None:
        """Send to a link; what cannot be sent is counted."""
        for start in range(0, len(data), _MTU):
            try:
                self._socket.sendto(data[start : start + _MTU], link)  # type: ignore[call-overload]
            except OSError:
                self.dropped += 1

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


class SerialLine:
    """The autopilot's end of a serial line: one link, there while somebody has the port open.

    Attributes:
        link: its name.
    """

    link: Hashable = "serial"

    def __init__(self, path: str | Path, baud: int):
        """Make the port.

        Args:
            path: where it appears.
            baud: of both directions.

        Raises:
            FileExistsError: another process serves this path.
        """
        self._port = PtyPort(path)
        self._baud = baud

    def read(self) -> bytes:
        """Return what has come."""
        return self._port.read(self._baud)

    def write(self, data: bytes) -> None:
        """Send; what nobody reads is lost."""
        self._port.write(data, self._baud)

    @property
    def connected(self) -> bool:
        """Whether somebody had the port open at the last look."""
        return self._port.connected

    @property
    def dropped(self) -> int:
        """Bytes that were lost for want of a reader."""
        return self._port.dropped

    def close(self) -> None:
        """Unplug."""
        self._port.close()
