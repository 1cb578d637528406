"""Record locks of Linux on whole files: who looks sees them without touching them (fcntl(2))."""

from __future__ import annotations

import fcntl
import os
import struct

_RECORD = "hhqqi"
"""`struct flock`: type, whence, start, length, process."""


def take(descriptor: int) -> None:
    """Take the lock of a file for as long as this descriptor is open.

    It belongs to the open file, not to the process: a second descriptor of the same process is
    refused as well.

    Raises:
        BlockingIOError: it is taken.
    """
    fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _whole_file())


def owner(descriptor: int) -> int | None:
    """Return the process that has the lock, 0 for one that cannot be told, or None."""
    answer = fcntl.fcntl(descriptor, fcntl.F_GETLK, _whole_file())
    kind, _, _, _, process = struct.unpack(_RECORD, answer)
    return None if kind == fcntl.F_UNLCK else max(0, process)


def _whole_file() -> bytes:
    return struct.pack(_RECORD, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
