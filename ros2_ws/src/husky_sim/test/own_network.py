"""A network of a test's own, with an EtherCAT wire, as `scripts/wire.sh` makes it for a command."""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
from collections.abc import Iterator

import pytest

_CLONE_NEWNET = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)
_COMMANDS = (
    "ip link set lo up",
    "ip link add ecat0 type veth peer name ecat1",
    "ip link set ecat0 multicast off up",
    "ip link set ecat1 multicast off up",
)


@contextlib.contextmanager
def own_network() -> Iterator[None]:
    """Be in a new network: what is opened and started meanwhile, threads too, stays in it.

    Only the calling thread moves. Where that is not allowed, or where raw sockets are not, the test
    is skipped with the reason.
    """
    before = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    try:
        if _LIBC.unshare(_CLONE_NEWNET) != 0:
            reason = os.strerror(ctypes.get_errno())
            pytest.skip(f"a network namespace cannot be made here (CAP_SYS_ADMIN): {reason}")
        try:
            for command in _COMMANDS:
                done = subprocess.run(command.split(), capture_output=True, text=True)
                if done.returncode != 0:
                    pytest.skip(f"no virtual cable can be made here: {command}: {done.stderr}")
            yield
        finally:
            if _LIBC.setns(before, _CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "the thread cannot go back to its network")
    finally:
        os.close(before)
