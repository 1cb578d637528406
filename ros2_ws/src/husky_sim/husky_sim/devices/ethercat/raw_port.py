"""A network interface at the slaves' end of the cable: EtherCAT frames by a raw socket of Linux."""

from __future__ import annotations

import errno
import socket
import struct
import threading
from collections.abc import Callable, Sequence

from husky_drivers.ethercat.interface import ETHERTYPE, check_interface

SHORTEST = 60
"""Bytes of the shortest Ethernet frame, without its checksum."""
_LONGEST = 2048
_LOOK_PERIOD = struct.pack("ll", 0, 100_000)
"""Wall time after which the thread looks whether it shall end, as a timeval: 0.1 s."""


class RawPort:
    """Hands every frame that comes in to a callback, in a thread of its own."""

    def __init__(self, interface: str, on_frame: Callable[[bytearray], Sequence[bytearray]]):
        """Open an interface.

        Args:
            interface: its name.
            on_frame: gets each frame, from the Ethernet header on, and may change it in place;
                returns the frames that go back now.

        Raises:
            OSError: it cannot be opened; the text says which and why. PermissionError is one.
        """
        check_interface(interface)
        self._on_frame = on_frame
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
        self._socket.bind((interface, ETHERTYPE))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _LOOK_PERIOD)
        self._closed = False
        self._thread = threading.Thread(
            target=self._receive, name=f"EtherCAT on {interface}", daemon=True
        )
        self._thread.start()

    def send(self, frame: bytes | bytearray) -> None:
        """Send a frame, padded to the least length; one that cannot be sent is lost."""
        try:
            self._socket.send(frame if len(frame) >= SHORTEST else frame.ljust(SHORTEST, b"\0"))
        except OSError as error:
            if error.errno not in (errno.ENETDOWN, errno.ENOBUFS, errno.ENXIO):
                raise

    def close(self) -> None:
        """Stop the thread and close the socket."""
        self._closed = True
        self._thread.join()
        self._socket.close()

    def _receive(self) -> None:
        buffer = bytearray(_LONGEST)
        while not self._closed:
            try:
                length = self._socket.recv_into(buffer)
            except BlockingIOError:  # nothing has come for a while
                continue
            except OSError as error:
                if error.errno == errno.ENETDOWN:  # told once; the interface may come back
                    continue
                raise
            for answer in self._on_frame(buffer[:length]):
                self.send(answer)
