"""The newest messages of a stream, in the order of their stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

MessageT = TypeVar("MessageT")

_AHEAD_NS = 100_000_000
"""A message so far ahead of the tick is doubted: it is of before a reset, or wrong, or ticks have
stood still [ns]."""
_LEAD_NS = 10_000_000
"""A message that is so far ahead of a later one of about now was wrong [ns]."""


class TimedBuffer(Generic[MessageT]):
    """Keeps messages until the tick that may know them.

    A message that is older than the last is late, comes a second time, or belongs to a world that
    starts again: it is set aside, and counts only if time does start again. One that is far ahead
    of the ticks counts only if they jump to its time before the stream tells of an earlier one.
    """

    def __init__(self, refuse: Callable[[str], None], size: int):
        """Nothing has come yet.

        Args:
            refuse: told why, when a message is not used.
            size: most messages that are kept.
        """
        self._refuse = refuse
        self._entries: deque[tuple[int, MessageT]] = deque(maxlen=size)
        self._aside: deque[tuple[int, MessageT]] = deque(maxlen=size)
        self._ahead: deque[tuple[int, MessageT]] = deque()

    def __len__(self) -> int:
        """The number of messages that are kept."""
        return len(self._entries)

    def add(self, stamp: int, message: MessageT, now: int) -> bool:
        """Keep a message, or set it aside; return False for one that is far ahead.

        Args:
            stamp: of the message [ns].
            message: to keep.
            now: stamp of the newest tick [ns], negative before the first.
        """
        entries = self._entries
        if 0 <= now < stamp - _AHEAD_NS:
            if len(self._ahead) == entries.maxlen:
                self._refuse_ahead(now)
            self._ahead.append((stamp, message))
            return False
        while self._ahead:
            self._refuse_ahead(now)
        if now >= 0 and stamp > now - _LEAD_NS:
            while entries and entries[-1][0] > stamp + _LEAD_NS:
                self._refuse(f"its stamp was {(entries.pop()[0] - stamp) / 1e9:.3f} s ahead")
        if entries and stamp < entries[-1][0]:
            self._aside.append((stamp, message))
            return True
        while self._aside:
            late = self._aside.popleft()[0]
            self._refuse(f"its stamp {late / 1e9:.3f} s is older than the last")
        entries.append((stamp, message))
        return True

    def reach(self, now: int) -> int:
        """A tick begins: keep what was far ahead of the last one and no longer is.

        Args:
            now: its stamp [ns].

        Returns:
            Stamp of the newest of these [ns], -1 for none.
        """
        if not self._ahead:
            return -1
        ahead, self._ahead = self._ahead, deque()
        return max(stamp if self.add(stamp, message, now) else -1 for stamp, message in ahead)

    def _refuse_ahead(self, now: int) -> None:
        stamp = self._ahead.popleft()[0]
        self._refuse(f"its stamp is {stamp / 1e9:.3f} s, now is {now / 1e9:.3f} s")

    def known(self, due: int) -> tuple[int, MessageT] | None:
        """Return the newest message stamped until `due` [ns], or None; older ones are forgotten."""
        entries = self._entries
        while len(entries) > 1 and entries[1][0] <= due:
            entries.popleft()
        return entries[0] if entries and entries[0][0] <= due else None

    def newest(self) -> tuple[int, MessageT] | None:
        """Return the message with the newest stamp, or None."""
        return self._entries[-1] if self._entries else None

    def restart(self, time: int) -> int:
        """Time starts again: what was set aside counts, what was kept does not.

        Args:
            time: of the first tick of the new time [ns].

        Returns:
            Stamp of the newest message that is kept [ns], -1 for none.
        """
        kept = [entry for entry in self._aside if entry[0] < time + _AHEAD_NS]
        for entries in (self._aside, self._entries, self._ahead):
            entries.clear()
        self._entries.extend(kept)
        return kept[-1][0] if kept else -1
