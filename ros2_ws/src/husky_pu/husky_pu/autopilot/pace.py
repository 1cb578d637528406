"""Frames without time stamps in lockstep: one for each period of the clock, by counting."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Frame = TypeVar("Frame")

_MARGIN_NS = 10_000_000
"""Age of a frame when it acts [ns]: who writes it may see time in steps of 10 ms."""
_MOST = 8
"""Frames kept at most; more than that and the newest count."""


class FramePace(Generic[Frame]):
    """Hands frames out at a fixed period, however early each has come.

    The first frame acts 10 ms after it has come, after a restart 24 ms after time 0: by then it has
    come in every run. From there on each period takes exactly one.
    """

    def __init__(self, period_ns: int):
        """Start without frames, which come a period apart [ns]."""
        self._period = period_ns
        self._queue: deque[Frame] = deque()
        self._next_ns: int | None = None

    def push(self, frame: Frame, now_ns: int) -> None:
        """Take a frame that has come."""
        if self._next_ns is None:
            self._next_ns = now_ns + _MARGIN_NS
        self._queue.append(frame)
        if len(self._queue) > _MOST:
            self._queue.popleft()

    def due(self, now_ns: int) -> bool:
        """Whether a frame has to act now."""
        return self._next_ns is not None and now_ns >= self._next_ns

    def ready(self, now_ns: int) -> bool:
        """Whether a tick at this time can go on: none is due, or there is one."""
        return not self.due(now_ns) or bool(self._queue)

    def next_due(self, now_ns: int) -> Frame | None:
        """Return the frame that acts now, if one is due and there."""
        if not self.due(now_ns) or not self._queue:
            return None
        assert self._next_ns is not None
        self._next_ns += self._period
        return self._queue.popleft()

    def lost(self) -> None:
        """Nobody writes any more: the next frame is a first one."""
        self._queue.clear()
        self._next_ns = None

    def restart(self) -> None:
        """Time starts at 0; whoever wrote frames goes on to."""
        self._queue.clear()
        if self._next_ns is not None:
            self._next_ns = self._period + _MARGIN_NS
