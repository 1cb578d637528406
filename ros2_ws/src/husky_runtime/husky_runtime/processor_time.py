"""What a process has had of the processors: `/proc/<pid>/task/<tid>/schedstat` of the kernel."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import NamedTuple


class ProcessorTime(NamedTuple):
    """Of all threads of a process since they started."""

    worked: float
    """On a processor [s]."""
    waited: float
    """Ready to run, without a processor [s]."""


def processor_time(process: int) -> ProcessorTime:
    """Return what a process has had; 0 for one that is gone, or if the kernel does not count."""
    worked = waited = 0
    for task in Path(f"/proc/{process}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):  # a thread that has ended meanwhile
            words = task.read_text().split()
            worked, waited = worked + int(words[0]), waited + int(words[1])
    return ProcessorTime(worked / 1e9, waited / 1e9)
