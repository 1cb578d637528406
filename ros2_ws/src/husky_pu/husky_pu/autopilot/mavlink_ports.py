"""Where the flight controller's MAVLink bytes come from and go to over UDP."""

from __future__ import annotations

import re
import socket
import zlib
from collections.abc import Hashable

_FIRST_PORT = 18570
"""Where PX4's simulated autopilot listens, for the first of several."""
_DOMAINS = 233
"""ROS domains, each of which has its port."""
_DATAGRAM = 2048
_MOST_READS = 64
"""Datagrams taken at one look: a flood does not stop the control loop."""
_BUFFER = 1 << 20
"""Asked of the system for what has come between two looks [bytes]; it may give less."""
_MTU = 1400
"""Largest datagram sent [bytes]."""


def default_port(domain: int, namespace: str = "/") -> int:
    """Return the local UDP port of a robot's autopilot: 18570 + domain.

    For robots in namespaces 233 more a robot: by the number at the end of its namespace (1 to 99),
    and one of the 100 above those if it has none.
    """
    number = re.search(r"(?<!\d)0*([1-9]\d?)$", namespace)
    if namespace == "/":
        robot = 0
    elif number:
        robot = int(number[1])
    else:
        robot = 100 + zlib.crc32(namespace.encode()) % 100
    return _FIRST_PORT + domain + _DOMAINS * robot


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of "host:port"; raises ValueError for something else."""
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
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
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
