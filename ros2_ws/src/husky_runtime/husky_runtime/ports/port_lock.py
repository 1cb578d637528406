"""Whose a simulated port is: its server locks a file beside it for as long as it lives.

A killed server leaves its link behind, and the kernel soon gives the pseudo-terminal's number to
somebody else: a driver that opened it again would talk to a stranger's terminal.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

from husky_runtime import record_lock


def path_of_lock(port: str | Path) -> Path:
    """Return the file that is locked."""
    return Path(f"{port}.lock")


def lock(port: Path) -> int:
    """Return the descriptor of a port's lock file, which is locked as long as it is open.

    Raises:
        FileExistsError: another process holds it.
        PermissionError: another user does not let us.
    """
    path = path_of_lock(port)
    while True:
        descriptor = record_lock.open_file(path)
        try:
            record_lock.take(descriptor)
        except OSError as error:
            os.close(descriptor)
            raise FileExistsError(f"{path} is held: another process serves this port") from error
        try:
            if os.stat(path).st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        except FileNotFoundError:
            pass  # Its owner has just removed it: make another.
        os.close(descriptor)


def check_served(port: str) -> None:
    """Look whether a port still has its server; one without a lock file, as a real one, has.

    Raises:
        FileNotFoundError: its server is dead.
    """
    try:
        descriptor = os.open(path_of_lock(port), os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return
    try:
        served = record_lock.owner(descriptor) is not None
    finally:
        os.close(descriptor)
    if not served:
        raise FileNotFoundError(errno.ENOENT, "left behind by a process that has died", port)
