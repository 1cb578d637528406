"""The directory of an experiment's results, in which what somebody else has put there stays.

A run begins in an empty directory: what was there waits in a subdirectory. Once the graph runs, the
files that the earlier run had written are removed, and all others come back. A run that does not
get that far leaves everything as it was.
"""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

MANIFEST, BEGUN = "files.txt", ".begun"
"""The list of the files that a run has written, and the mark of one that has not ended."""
_EARLIER, _LEFT = ".earlier", "left"
"""Subdirectories: what waits, and, with a number, what runs without a list of files have left."""
_RESULT = "result.json"
"""What every run that has ended has written, also before there was a list."""
_HEAD = "# The files of this run. The next run into this directory replaces them and no others.\n"


class OutputDirectory:
    """An empty directory to write into.

    Attributes:
        path: of the directory.
        notice: what became of an earlier run that has left no list of its files, "" where none has.
    """

    def __init__(self, path: Path):
        """Make it, and let earlier results wait.

        Raises:
            FileExistsError: it holds something else than an earlier run.
            OSError: it cannot be made.
        """
        self.path, self.notice = path, ""
        self._earlier = path / _EARLIER
        self._kept: set[Path] = set()
        path.mkdir(parents=True, exist_ok=True)
        unlisted = (path / _RESULT).exists() and not (path / MANIFEST).exists()
        if self.waits:  # the run before was killed before it had begun
            self._put_aside()
            self._bring_back()
        elif (path / BEGUN).exists() or unlisted:
            self._put_aside()
        there = [each for each in path.iterdir() if not each.name.startswith(_LEFT)]
        if there and not (path / MANIFEST).is_file():
            raise FileExistsError(f"{path} holds something else than an earlier run")
        if there:
            self._earlier.mkdir()
            for each in there:
                each.rename(self._earlier / each.name)
        (path / BEGUN).touch()

    @property
    def waits(self) -> bool:
        """Whether earlier results wait for the run to begin."""
        return self._earlier.exists()

    def leave(self) -> None:
        """Note which files were written; or, where the run has not begun, bring back the others."""
        if self.waits:
            for each in self._written():
                each.unlink()
            self._remove_empty(self.path)
            self._bring_back()
            return
        (self.path / BEGUN).unlink(missing_ok=True)
        names = sorted(each.relative_to(self.path).as_posix() for each in self._written())
        (self.path / MANIFEST).write_text(_HEAD + "".join(f"{n}\n" for n in names), "utf-8")

    def begun(self) -> None:
        """The run is under way: remove the files of the earlier one, keep those of others."""
        if not self.waits:
            return
        manifest = self._earlier / MANIFEST
        for name in manifest.read_text("utf-8").splitlines():
            listed = self._earlier / name
            inside = self._earlier in listed.parents and ".." not in listed.parts
            if inside and not name.startswith("#") and listed.is_file():
                listed.unlink()
        manifest.unlink()
        self._remove_empty(self._earlier)
        self._bring_back()

    def _written(self) -> Iterator[Path]:
        """Yield the files of this run."""
        for each in sorted(self.path.rglob("*")):
            name = each.relative_to(self.path)
            others = name.parts[0] == _EARLIER or name.parts[0].startswith(_LEFT)
            if not (others or each.is_dir() or name in self._kept):
                yield each

    def _bring_back(self) -> None:
        """Move what waits to where it was."""
        for each in [each for each in self._earlier.rglob("*") if not each.is_dir()]:
            name = each.relative_to(self._earlier)
            place = self.path / name
            place.parent.mkdir(parents=True, exist_ok=True)
            while place.exists():
                place = place.with_name(f"{place.name}.kept")
            each.rename(place)
            self._kept.add(place.relative_to(self.path))
        shutil.rmtree(self._earlier)

    def _put_aside(self) -> None:
        """Move what a run has left that was killed, or of a version without a list of files."""
        names = (f"{_LEFT}_{number}" for number in itertools.count(1))
        aside = next(self.path / name for name in names if not (self.path / name).exists())
        left = [
            each
            for each in self.path.iterdir()
            if each.name != _EARLIER and not each.name.startswith(_LEFT)
        ]
        aside.mkdir()
        for each in left:
            each.rename(aside / each.name)
        self.notice = f"the run before has not listed its files: what was here is in {aside}/"

    def _remove_empty(self, directory: Path) -> None:
        """Remove directories in which nothing is."""
        for each in sorted(directory.rglob("*"), reverse=True):
            if each.is_dir() and not each.is_symlink() and not any(each.iterdir()):
                each.rmdir()
