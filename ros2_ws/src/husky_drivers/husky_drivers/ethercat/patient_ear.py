"""Hears when simulated drives have answered a frame, beside the master that has sent it.

SOEM gives a frame up after a time of the wall clock and cannot be asked to wait on. In lockstep
drives answer when they can, so it is asked for an answer only when that has come.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from husky_drivers.ethercat.interface import ETH_P_ALL, ETHERTYPE
from husky_runtime.lockstep import Peer, Presence

_LOOK_PERIOD = struct.pack("ll", 0, 50_000)
"""Wall time between two looks at drives that are silent, as a timeval: 50 ms."""
_INDEX = 17
"""Offset of the index of a frame's first datagram, by which a master knows its answer."""


class PatientEar:
    """Waits for the answer to a frame until the far side counts as lost.

    Attributes:
        far_side: the node that has the drives.
    """

    def __init__(self, interface: str, far_side: Peer):
        """Listen on a network interface; raises OSError."""
        self.far_side = far_side
        self._answered = 0  # frames
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
        self._socket.bind((interface, ETH_P_ALL))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _LOOK_PERIOD)

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()

    def forget(self) -> None:
        """Forget what has come so far; call it before a frame is sent."""
        with contextlib.suppress(OSError):  # nothing more, or the interface is down
            while True:
                self._socket.recv(1, socket.MSG_DONTWAIT)

    def wait(self) -> bool:
        """Wait for the answer to the frame that was sent; return whether it has come.

        Drives that are lost get 50 ms.
        """
        index = -1  # of that frame, which is heard as well
        while True:
            try:
                head, source = self._socket.recvfrom(_INDEX + 1)
            except BlockingIOError:
                self.far_side.expire(time.monotonic())
                if self.far_side.presence is not Presence.EXPECTED:
                    return False
                continue
            except OSError:  # the interface is down
                return False
            if source[1] != ETHERTYPE:
                continue
            if source[2] == socket.PACKET_OUTGOING:
                index = head[_INDEX]
            elif head[_INDEX] == index:
                self._answered += 1
                self.far_side.answer(self._answered)
                return True
