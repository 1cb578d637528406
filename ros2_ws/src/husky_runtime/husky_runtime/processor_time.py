"""What a process has had of the processors: `/proc/<pid>/task/<tid>/schedstat` of the kernel."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import NamedTuple

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")
_CHILDREN = slice(13, 15)
"""Of the words behind a process's name in its `stat`: user and system time of children [ticks]."""


class ProcessorTime(NamedTuple):
    """Of all threads of a process since they started, and of the processes that it has started."""

    worked: float
    """On a processor [s]."""
    waited: float
    """Ready to run, without a processor [s]; of a child that has ended nothing is known."""


def processor_time(process: int) -> ProcessorTime:
    """Return what a process has had; 0 for one that is gone, or if the kernel does not count.

    A process that waits for one that it has started, as for a compiler, so works all the same.
    """
    worked = waited = 0.0
    with contextlib.suppress(OSError):
        words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        worked = _TICK * sum(map(int, words[_CHILDREN]))
    for task in Path(f"/proc/{process}/task").glob("*"):
        with contextlib.suppress(OSError):  # a thread that has ended meanwhile
            words = (task / "schedstat").read_text().split()
            worked, waited = worked + 1e-9 * int(words[0]), waited + 1e-9 * int(words[1])
        with contextlib.suppress(OSError):  # or a kernel that does not tell
            for child in (task / "children").read_text().split():
                of_child = processor_time(int(child))
                worked, waited = worked + of_child.worked, waited + of_child.waited
    return ProcessorTime(worked, waited)
