"""The directory of an experiment's results, in which what somebody else has put there stays.

A run writes into a subdirectory. When it is over its files move up, in place of those that the
earlier run had written; a run that has not begun well leaves everything as it was. A list of the
run's files tells the next run what it may replace: files as they were written. A file that was
changed since, or lies where a new one goes, is kept under another name.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from husky_runtime.stored_file import write_atomically

MANIFEST, WORK = "files.txt", ".running"
"""The list of the files of a run, and the subdirectory that it writes into."""
_LEFT = re.compile(r"left_[0-9]+")
"""Subdirectories with what runs that were killed, or of versions without a list, have left."""
_RESULT = "result.json"
"""Every run that has ended has written it, also before there was a list."""
_HEAD = (
    "# Files of this run (time of change [ns], size, name): the next run replaces them, no others."
)


class _Written(NamedTuple):
    """A file as a run has written it."""

    changed: int
    """Time of its last change [ns]."""
    size: int
    name: str
    """Relative to the directory."""


class OutputDirectory:
    """Where a run writes, and what it replaces in the end.

    Attributes:
        path: the directory of the results.
        work: its subdirectory to write into.
        as_it_was: whether the run has ended without touching earlier results.
        notice: what became of a run that was killed, "" where none was.
    """

    def __init__(self, path: Path):
        """Make both directories. Earlier results are not touched.

        Raises:
            FileExistsError: it holds something else than an earlier run.
            BlockingIOError: another run writes into it.
            OSError: it cannot be made.
        """
        self.path, self.work = path, path / WORK
        self.as_it_was, self.notice = False, ""
        self._begun = self._over = False
        path.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            _take(self._lock, path)
            self._listed = self._has_list()
            self._earlier = list(self._others())
            if self._earlier and not (self._listed or self._is_of_a_version_without_list()):
                raise FileExistsError(f"{path} holds something else than an earlier run")
            if os.path.lexists(self.work):
                aside = self._new_left()
                self.work.rename(aside)
                self.notice = f"what a run before has left that was killed is in {aside}/"
            self.work.mkdir()
        except OSError:
            os.close(self._lock)
            raise

    def begun(self) -> None:
        """The run is under way: its files are to replace the earlier ones."""
        self._begun = True

    def leave(self) -> None:
        """Put the files of the run in place; or, where it has not begun, leave what was there.

        Does nothing the second time.

        Raises:
            OSError: a file could not be replaced; what is left of the run is in `work`.
        """
        if self._over:
            return
        self._over = True
        try:
            self.as_it_was = bool(self._earlier) and not self._begun
            if not self.as_it_was:
                self._replace()
            shutil.rmtree(self.work)
        finally:
            os.close(self._lock)

    # What is there ----------------------------------------------------------------------------
    def _others(self) -> Iterator[Path]:
        """Yield what lies in the directory, without what runs have left that were killed."""
        for each in sorted(self.path.iterdir()):
            if each.name != WORK and not _LEFT.fullmatch(each.name):
                yield each

    def _has_list(self) -> bool:
        """Return whether there is a list that a run has written."""
        with contextlib.suppress(OSError), (self.path / MANIFEST).open("rb") as file:
            return file.readline().rstrip() == _HEAD.encode()
        return False

    def _is_of_a_version_without_list(self) -> bool:
        with contextlib.suppress(OSError, ValueError):
            result = json.loads((self.path / _RESULT).read_text("utf-8"))
            return isinstance(result, dict) and {"experiment", "criteria"} <= result.keys()
        return False

    def _list(self) -> set[_Written]:
        """Return what the list says, as far as it can be read."""
        if not self._listed:
            return set()
        found = set()
        for line in (
            (self.path / MANIFEST).read_bytes().decode("utf-8", "surrogateescape").split("\n")
        ):
            changed, _, rest = line.partition(" ")
            size, _, name = rest.partition(" ")
            inside = not (name.startswith("/") or ".." in Path(name).parts)
            if changed.isdecimal() and size.isdecimal() and inside:
                found.add(_Written(int(changed), int(size), name))
        return found

    def _write_list(self, files: set[_Written]) -> None:
        lines = [_HEAD, *(f"{f.changed} {f.size} {f.name}" for f in sorted(files))]
        content = "".join(f"{line}\n" for line in lines)
        write_atomically(self.path / MANIFEST, content.encode("utf-8", "surrogateescape"))

    def _is_as_written(self, file: _Written) -> bool:
        """Return whether a file of the list is still there, below no link, and unchanged."""
        place = self.path / file.name
        with contextlib.suppress(OSError):
            found = place.lstat()
            same = (found.st_mtime_ns, found.st_size) == (file.changed, file.size)
            parents = [p for p in place.parents if self.path in p.parents]
            return same and place.is_file() and not any(p.is_symlink() for p in (place, *parents))
        return False

    # What is done -----------------------------------------------------------------------------
    def _replace(self) -> None:
        """Remove what the earlier run has written, and put what this one has written there."""
        new = set(_files(self.work))
        old = self._list()
        if self._earlier and not self._listed:
            aside = self._new_left()
            aside.mkdir()
            for each in sorted(self._earlier, key=lambda each: each.name == _RESULT):
                each.rename(aside / each.name)  # last the one by which the next run knows them
        self._write_list(old | new)  # if this is broken off, the next run knows all of them
        for file in old:
            if self._is_as_written(file):
                (self.path / file.name).unlink()
        for directory in sorted({p for file in old for p in Path(file.name).parents}, reverse=True):
            if directory.parts and not (self.path / directory).is_symlink():
                with contextlib.suppress(OSError):  # somebody else's files are in it
                    (self.path / directory).rmdir()
        for file in sorted(new):
            self._put(file.name)
        self._write_list(new)

    def _put(self, name: str) -> None:
        """Move a file of this run to its place; what is in its way gets another name."""
        place = self.path / name
        for parent in reversed([p for p in place.parents if self.path in p.parents]):
            if parent.is_symlink() or not parent.is_dir():
                _keep(parent)
            parent.mkdir(exist_ok=True)
        _keep(place)
        (self.work / name).rename(place)

    def _new_left(self) -> Path:
        """Return the first name that is free for what a run has left."""
        names = (self.path / f"left_{number}" for number in itertools.count(1))
        return next(name for name in names if not os.path.lexists(name))


def _take(descriptor: int, path: Path) -> None:
    """Lock a directory; some file systems have no locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise BlockingIOError(errno.EAGAIN, f"another run writes into {path}") from error
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
            raise


def _files(directory: Path) -> Iterator[_Written]:
    """Yield the files below a directory."""
    for each in directory.rglob("*"):
        if each.is_symlink() or not each.is_dir():
            found = each.lstat()
            name = each.relative_to(directory).as_posix()
            yield _Written(found.st_mtime_ns, found.st_size, name)


def _keep(place: Path) -> None:
    """Give what is at a place, if anything, another name."""
    if os.path.lexists(place):
        names = (f"{place.name}.kept{n}" for n in ("", *map(str, range(2, 1000))))
        place.rename(
            next(place.with_name(n) for n in names if not os.path.lexists(place.with_name(n)))
        )
