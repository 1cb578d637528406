"""A network interface for EtherCAT: may frames be sent on it, and is there no other master?"""

from __future__ import annotations

import errno
import fcntl
import socket
import struct
import time

ETHERTYPE = 0x88A4
_LISTEN = 0.02
"""Time in which the frames of another master would be heard [s]: 10 cycles of 2 ms."""
_ETH_P_ALL = 0x0003
_SIOCGIFFLAGS, _IFF_UP = 0x8913, 0x1


def check_interface(name: str) -> None:
    """Raise OSError, which says what to do, when no frame can be sent on a network interface.

    PermissionError is one of them: raw sockets need the capability CAP_NET_RAW.
    """
    try:
        probe = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
    except PermissionError:
        raise PermissionError(
            f"EtherCAT frames on {name} need the capability CAP_NET_RAW: run as root or in "
            "scripts/wire.sh, or give it to Python: "
            "sudo setcap cap_net_raw+ep $(readlink -f .venv/bin/python)"
        ) from None
    with probe:
        try:
            request = struct.pack("16sH14x", name.encode()[:15], 0)
            answer = fcntl.ioctl(probe, _SIOCGIFFLAGS, request)
        except OSError:
            known = ", ".join(other for _, other in socket.if_nameindex())
            raise OSError(f"there is no network interface {name!r}; there are {known}") from None
        if not struct.unpack_from("16xH", answer)[0] & _IFF_UP:
            raise OSError(f"network interface {name} is down: sudo ip link set {name} up")


def claim_interface(name: str) -> socket.socket:
    """Become the only master on a network interface, until the socket that it returns is closed.

    Two masters would set each other's drives back, and mix up their answers. A master of this
    package is told by a lock, any other by its frames.

    Raises:
        OSError: there is another master.
    """
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f"\0husky/ethercat/{name}")  # gone with the process; one for each network
        with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETH_P_ALL)) as ears:
            ears.bind((name, _ETH_P_ALL))
            end = time.monotonic() + _LISTEN
            while (left := end - time.monotonic()) > 0.0:
                ears.settimeout(left)
                try:
                    _, source = ears.recvfrom(1)
                except TimeoutError:
                    break
                if source[1] == ETHERTYPE:
                    raise OSError(f"another EtherCAT master sends on {name}; end it first")
    except OSError as error:
        lock.close()
        if error.errno == errno.EADDRINUSE:
            raise OSError(f"another drive_bridge has {name}; end it first") from None
        raise
    return lock
