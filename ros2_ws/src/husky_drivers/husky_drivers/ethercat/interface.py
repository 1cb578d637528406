"""A network interface for EtherCAT: may frames be sent on it, and is there no other master?"""

from __future__ import annotations

import errno
import fcntl
import socket
import struct
import time

ETHERTYPE = 0x88A4
ETH_P_ALL = 0x0003
"""Protocol of a packet socket that hears all frames, those that are sent as well."""
_LISTEN = 0.02
"""Time in which the frames of another master would be heard [s]: 10 cycles of 2 ms."""
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 0x1


def check_interface(name: str, *, promiscuous: bool = False) -> None:
    """Raise OSError, which says what to do, when no frame can be sent on a network interface.

    Args:
        name: of the interface.
        promiscuous: whether it is going to be made promiscuous, as SOEM does.

    Raises:
        PermissionError: one of the OSErrors: a capability is missing.
    """
    needed = "CAP_NET_RAW and CAP_NET_ADMIN" if promiscuous else "CAP_NET_RAW"
    try:
        flags = flags_of(name)
        if promiscuous:
            set_flags(name, flags)
    except PermissionError:
        raise PermissionError(
            f"EtherCAT frames on {name} need {needed}: run as root or in scripts/wire.sh, or give "
            f"the capabilities to Python: sudo setcap {needed.lower().replace(' and ', ',')}+ep "
            "$(readlink -f .venv/bin/python)"
        ) from None
    if not flags & _IFF_UP:
        raise OSError(f"network interface {name} is down: sudo ip link set {name} up")


def flags_of(name: str) -> int:
    """Return the flags of a network interface; raises OSError, without CAP_NET_RAW as well."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE)) as probe:
        try:
            answer = fcntl.ioctl(probe, _SIOCGIFFLAGS, struct.pack("16sH14x", _short(name), 0))
        except OSError:
            known = ", ".join(other for _, other in socket.if_nameindex())
            raise OSError(f"there is no network interface {name!r}; there are {known}") from None
    return int(struct.unpack_from("16xH", answer)[0])


def set_flags(name: str, flags: int) -> None:
    """Set the flags of a network interface; raises OSError, without CAP_NET_ADMIN as well."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sH14x", _short(name), flags))


def _short(name: str) -> bytes:
    """Return a name as the kernel takes it."""
    return name.encode()[:15]


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
        with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL)) as ears:
            ears.bind((name, ETH_P_ALL))
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
