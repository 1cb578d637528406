"""Tells a machine that has no processor for a process from a process that is late by itself.

The kernel counts how long each thread was ready to run and had to wait for a processor
(`/proc/<pid>/task/<tid>/schedstat`). A node that is slow, stopped or dead does not wait.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from husky_runtime.processor_time import processor_time

LATE = 0.01
"""Five ticks, after which drives and motors let go: whoever has waited less than this for a
processor was not late because of it [s]."""
STARVED = 0.05
"""Share of the time that a node waits for a processor, above which real time is not kept."""
_ATTEMPTS = 10
_STEP = 0.02
"""How far a world goes on before it looks whether a process beside it keeps up [s]."""
CROWDED = 0.6
"""Share of the time that something waits for a processor, which the robot alone does not cause."""
LATE_WORDS = (
    "ticks old",
    "IMU sample is",
    "no joint command",
    "drives are not operational",
    "sensors lost",
)
"""How safety checks and drives say that somebody was late."""


def in_real_time(session: Any, attempt: Callable[[], None]) -> None:
    """Make an attempt that needs the machine to keep real time.

    It is made again if it fails while a node has waited for a processor, and skipped in the end if
    some node is starved. What fails otherwise has failed.
    """
    all_attempts = _Watch(session)
    for left in reversed(range(_ATTEMPTS)):
        this_attempt = _Watch(session)
        try:
            attempt()
            return
        except (AssertionError, pytest.fail.Exception) as failure:
            _, waited = this_attempt.hungriest()
            name, total = all_attempts.hungriest()
            share = total / all_attempts.period
            if waited < LATE or (left == 0 and share < STARVED):
                raise
            told = f"{name} waited {100 * share:.0f} % of the time for a processor: {failure}"
    pytest.skip(f"not judged: this machine is too busy for real time: {told}")


def while_the_machine_keeps_up(attempt: Callable[[], None]) -> None:
    """Make an attempt that needs real time of processes which it starts itself.

    It is skipped when it fails while something waits for a processor most of the time, or when the
    robot itself has told in what is printed that ticks came late. What fails otherwise has failed.
    """
    before, start = _pressure(), time.monotonic()
    try:
        attempt()
    except AssertionError as failure:
        share = (_pressure() - before) / (time.monotonic() - start)
        late = [word for word in LATE_WORDS if word in str(failure)]
        if share < CROWDED and not late:
            raise
        told = f"something waited {100 * share:.0f} % of the time for a processor, {late}"
        print(failure)  # with the log of a minute: `pytest -s` shows it
        pytest.skip(f"not judged: this machine is too busy for real time: {told}")


def _pressure() -> float:
    """Return how long something has waited for a processor since this machine started [s]."""
    try:
        words = Path("/proc/pressure/cpu").read_text().split()
    except OSError:  # a kernel that does not tell
        return 0.0
    return int(words[4].removeprefix("total=")) / 1e6


class Beside:
    """A process beside the graph, for which the world waits as lockstep lets it wait for nodes.

    It goes on as soon as the process has nothing to do, or has worked for as long as the world has
    gone on: more it could not have done on a processor of its own. So whatever it does late, as
    when somebody blocks it, it does late in simulated time too, however busy the machine is.
    """

    def __init__(self, process: int):
        """Take a process by its number."""
        self._process = process
        self._worked = processor_time(process).worked

    def advance(self, session: Any, duration: float) -> None:
        """Let a session's world go on for a while [s]."""
        steps = max(1, round(duration / _STEP))
        for _ in range(steps):
            session.advance(duration / steps)
            self._catch_up(duration / steps)

    def _catch_up(self, step: float) -> None:
        most = self._worked + step
        while not self._rests() and processor_time(self._process).worked < most:
            time.sleep(0.001)
        self._worked = processor_time(self._process).worked

    def _rests(self) -> bool:
        """Return whether no thread works or is ready to, nor has meanwhile handed on what to do."""
        before = processor_time(self._process)
        for task in Path(f"/proc/{self._process}/task").glob("*/stat"):
            with contextlib.suppress(OSError):  # a thread that has ended meanwhile
                if task.read_text().rpartition(")")[2].split()[0] in "RD":
                    return False
        return processor_time(self._process) == before


class _Watch:
    """Watches the nodes and this process from now on."""

    def __init__(self, session: Any):
        names = [spec.name for spec in session.specs if session.processes.running(spec.name)]
        self._processes = {name: session.processes.process_group(name) for name in names}
        self._processes["the test"] = os.getpid()
        self._start = time.monotonic()
        self._before = self._waits()

    @property
    def period(self) -> float:
        """Wall time since then [s]."""
        return time.monotonic() - self._start

    def hungriest(self) -> tuple[str, float]:
        """Return who has waited most for a processor since then, and how long [s]."""
        waits = {name: waited - self._before[name] for name, waited in self._waits().items()}
        name = max(waits, key=waits.__getitem__)
        return name, waits[name]

    def _waits(self) -> dict[str, float]:
        return {name: processor_time(pid).waited for name, pid in self._processes.items()}
