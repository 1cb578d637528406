"""Files that are written whole or not at all, and that know whether they are what was written.

A *sealed* file ends in the SHA-256 of all that stands before it. What it holds stays readable for
other programs where the format allows bytes at its end, as ZIP archives (.npz) and shared libraries
do.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
from pathlib import Path

_MARK = b"\nhusky sha256 "
_END = b"\n"
SEAL_LENGTH = len(_MARK) + 64 + len(_END)
"""Bytes that a seal adds."""


class DamagedFileError(ValueError):
    """A file is not what was written; the message names it and says why."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that whoever looks sees the old one or the new one, whole.

    Raises:
        OSError: it cannot be written; what was there stays.
    """
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")
    try:
        with open(scratch, "xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        scratch.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            scratch.unlink(missing_ok=True)
        raise


def seal(content: bytes) -> bytes:
    """Return the content with its seal."""
    return b"".join((content, _MARK, hashlib.sha256(content).hexdigest().encode(), _END))


def write_sealed(path: Path, content: bytes) -> None:
    """Write a sealed file, as `write_atomically` does."""
    write_atomically(path, seal(content))


def read_sealed(path: Path) -> bytes:
    """Return the content of a sealed file.

    Raises:
        OSError: it cannot be read.
        DamagedFileError: it has no seal, or another one than its content calls for.
    """
    return unseal(path.read_bytes(), path)


def unseal(data: bytes, path: Path) -> bytes:
    """Return the content of sealed bytes; `path` is for the message.

    Raises:
        DamagedFileError: as `read_sealed`.
    """
    content, found = data[:-SEAL_LENGTH], data[-SEAL_LENGTH:]
    if len(found) < SEAL_LENGTH or not (found.startswith(_MARK) and found.endswith(_END)):
        raise DamagedFileError(f"{path} does not end in a checksum: cut short, or never had one")
    if seal(content) != data:
        raise DamagedFileError(f"{path} does not match its checksum: it is damaged")
    return content
