"""What the processes of a graph hold: memory, descriptors, threads, shared memory, log files.

Read from /proc and /dev/shm, by process group: a node is what was started for it, and what that
has started.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
_SHARED = "/dev/shm/"
_ACCESS_MODE = 0o3
"""Of the flags in /proc/PID/fdinfo; 0 is reading only."""
_FLAGS = re.compile(r"^flags:\s*(\d+)$", re.MULTILINE)


@dataclass(frozen=True)
class Usage:
    """What the processes of one node hold."""

    memory: int  # resident or swapped out, of their own: neither files nor shared memory [bytes]
    descriptors: int  # open
    threads: int  # running


@dataclass(frozen=True)
class Sample:
    """What all nodes hold at one time."""

    time: float  # simulated [s]
    wall: float  # of a clock that never jumps back [s]
    nodes: Mapping[str, Usage]  # by name
    shared_entries: int  # files of /dev/shm that they have open or mapped
    shared_bytes: int  # that these take
    log_bytes: int  # length of all other files that they have open to write


class ResourceMeter:
    """Looks at the processes of some nodes."""

    def __init__(self, groups: Mapping[str, int], single: Mapping[str, int], data: Path):
        """Name them.

        Args:
            groups: process group of each node, by name.
            single: processes listed beside them without the rest of their groups, by name.
            data: directory of files that grow by design and are no logs: the bag.
        """
        self._names = {group: name for name, group in groups.items()}
        self._single = {process: name for name, process in single.items()}
        self._data = f"{data.resolve()}/"

    def look(self, simulated: float) -> Sample:
        """Return what they hold now, at a simulated time [s]."""
        totals: dict[str, list[int]] = {}
        shared: set[str] = set()
        written: set[str] = set()
        for name, process in self._processes():
            try:
                held = _held(process)
                files = _open_files(process)
                mapped = _mapped(process)
            except (FileNotFoundError, ProcessLookupError):
                continue  # it has ended meanwhile
            total = totals.setdefault(name, [0, 0, 0])
            for index, value in enumerate((held["memory"], len(files), held["threads"])):
                total[index] += value
            shared |= {path for path, _ in files if path.startswith(_SHARED)} | mapped
            written |= {path for path, writes in files if writes and self._is_log(path)}
        return Sample(
            simulated,
            time.monotonic(),
            {name: Usage(*total) for name, total in totals.items()},
            len(shared),
            sum(512 * status.st_blocks for status in _statuses(shared)),
            sum(status.st_size for status in _statuses(written)),
        )

    def _is_log(self, path: str) -> bool:
        """Return whether a file that is written is one that ought not to grow."""
        regular = path.startswith("/") and not path.startswith(("/dev/", "/proc/"))
        return regular and not path.startswith(self._data)

    def _processes(self) -> Iterator[tuple[str, Path]]:
        """Yield the processes of the nodes, and the single ones."""
        for process in _PROC.iterdir():
            if not process.name.isdigit():
                continue
            try:
                # Behind the name in brackets: state, parent, group.
                words = (process / "stat").read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue
            name = self._single.get(int(process.name)) or self._names.get(int(words[2]))
            if name is not None:
                yield name, process


def _held(process: Path) -> dict[str, int]:
    """Return a process's own memory [bytes] and threads."""
    rows = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
    kilobytes = sum(int(rows.get(row, "0 kB").split()[0]) for row in ("RssAnon", "VmSwap"))
    return {"memory": 1024 * kilobytes, "threads": int(rows.get("Threads", "0"))}


def _open_files(process: Path) -> list[tuple[str, bool]]:
    """Return what each open descriptor is, and whether it can write."""
    files = []
    for entry in (process / "fd").iterdir():
        try:
            path = os.readlink(entry)
            flags = _FLAGS.search((process / "fdinfo" / entry.name).read_text())
        except FileNotFoundError:
            continue  # closed meanwhile
        files.append((path, flags is not None and bool(int(flags[1], 8) & _ACCESS_MODE)))
    return files


def _mapped(process: Path) -> set[str]:
    """Return the files of /dev/shm that a process has mapped."""
    lines = (process / "maps").read_text().splitlines()
    paths = (line.split(maxsplit=5)[-1] for line in lines if _SHARED in line)
    return {path.removesuffix(" (deleted)") for path in paths if path.startswith(_SHARED)}


def _statuses(paths: Iterable[str]) -> Iterator[os.stat_result]:
    """Yield the status of files, without those that are gone."""
    for path in paths:
        with contextlib.suppress(OSError):
            yield os.stat(path)
