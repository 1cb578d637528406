"""Sealed files: whole, or known to be damaged."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from husky_runtime.stored_file import (
    DamagedFileError,
    read_sealed,
    seal,
    unseal,
    write_atomically,
    write_sealed,
)

FILE = Path("some.file")


@given(st.binary())
def test_what_is_sealed_comes_back(content: bytes) -> None:
    assert unseal(seal(content), FILE) == content
    assert seal(content).startswith(content)
    assert hashlib.sha256(content).hexdigest().encode() in seal(content)[len(content) :]


@given(st.binary(), st.data())
def test_no_other_bytes_are_taken(content: bytes, data: Any) -> None:
    whole = seal(content)
    start = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(start, len(whole)))
    changed = whole[:start] + data.draw(st.binary(max_size=200)) + whole[end:]
    assume(changed != whole)
    # Sealed twice is sealed, too: then the content is another one, and is known as such.
    assume(changed != seal(changed[: -len(seal(b""))]))
    with pytest.raises(DamagedFileError, match=r"some\.file"):
        unseal(changed, FILE)


@given(st.binary(min_size=1))
def test_a_damaged_end_is_not_taken(content: bytes) -> None:
    whole = seal(content)
    for changed in (whole[:-1], whole + b"\n", whole[:-65] + whole[-1:], content, b""):
        with pytest.raises(DamagedFileError, match="checksum"):
            unseal(changed, FILE)


def test_a_disk_that_is_full_leaves_the_old_file(tmp_path: Path, small_files: Any) -> None:
    path = tmp_path / "file"
    write_sealed(path, b"old")
    with small_files(100), pytest.raises(OSError, match="File too large"):
        write_sealed(path, b"new" * 100)
    assert read_sealed(path) == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_replaced_not_changed(tmp_path: Path) -> None:
    """Who has opened it goes on to read the old one; a link to it keeps what it had."""
    path, link = tmp_path / "file", tmp_path / "link"
    write_atomically(path, b"old")
    link.hardlink_to(path)
    with path.open("rb") as file:
        write_atomically(path, b"new")
        assert file.read() == link.read_bytes() == b"old"
    assert path.read_bytes() == b"new"


def test_what_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="missing"):
        read_sealed(tmp_path / "missing")
