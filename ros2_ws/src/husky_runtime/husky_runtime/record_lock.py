"""Record locks of Linux on whole files: another process sees them without touching them (fcntl(2)).

Their files lie in directories below /tmp in which each user may make files and nobody removes those
of others, as in /tmp itself: a robot of one user keeps another user's out of its ROS domain.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pwd
import struct
from pathlib import Path

_RECORD = "hhqqi"
"""`struct flock`: type, whence, start, length, process."""


_FOR_ALL, _STICKY = 0o666, 0o1777
"""Modes of the files and of their directories."""


def make_directory(path: Path) -> None:
    """Make the directory of lock files, if it is not there.

    Raises:
        OSError: it cannot be made.
    """
    with contextlib.suppress(FileExistsError):
        path.mkdir(parents=True)
        path.chmod(_STICKY)  # whatever the umask is


def open_file(path: Path) -> int:
    """Open the file of a lock, of whichever user it is; make it and its directory if need be.

    Raises:
        PermissionError: another user does not let us; says who, and what helps.
        OSError: it cannot be made.
    """
    make_directory(path.parent)
    try:
        try:
            return os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:  # O_CREAT is refused on others' files (proc_sys_fs(5))
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, _FOR_ALL)
            with contextlib.suppress(PermissionError):  # made by somebody else meanwhile
                os.fchmod(descriptor, _FOR_ALL)
            return descriptor
    except PermissionError as error:
        raise left_by_another(path) from error


def left_by_another(path: Path) -> PermissionError:
    """Return the error that names the other user whose file or directory is in our way."""
    found = path if os.path.lexists(path) else path.parent
    user: int | str = found.lstat().st_uid
    with contextlib.suppress(KeyError):
        user = pwd.getpwuid(found.lstat().st_uid).pw_name
    return PermissionError(
        f"{found} belongs to user {user}: choose another domain with ROS_DOMAIN_ID, or, if that "
        f"user's robot has ended, sudo rm -r {path.parent}"
    )


def take(descriptor: int) -> None:
    """Take the lock of a file for as long as this descriptor is open.

    It belongs to the open file, not to the process: a second descriptor of the same process is
    refused as well.

    Raises:
        BlockingIOError: it is taken.
    """
    fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _whole_file())


def try_take(descriptor: int) -> bool:
    """Take the lock as `take` does, unless it is taken; return whether this descriptor has it."""
    try:
        take(descriptor)
    except BlockingIOError:
        return False
    return True


def owner(descriptor: int) -> int | None:
    """Return the process that has the lock, 0 for one that cannot be told, or None."""
    answer = fcntl.fcntl(descriptor, fcntl.F_GETLK, _whole_file())
    kind, _, _, _, process = struct.unpack(_RECORD, answer)
    return None if kind == fcntl.F_UNLCK else max(0, process)


def _whole_file() -> bytes:
    return struct.pack(_RECORD, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
