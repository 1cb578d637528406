"""Threads for calls that block: who draws does not wait for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any


@dataclass(frozen=True, eq=False)
class _Call:
    """A call that is to be made.

    Attributes:
        make: blocks, and returns a result or raises.
        take: takes the result.
        fail: takes the words of the error.
    """

    make: Callable[[], Any]
    take: Callable[[Any], None]
    fail: Callable[[str], None]


class Worker:
    """Makes the calls of each lane one after the other, and keeps the results until asked.

    Lanes do not wait for each other: each has a thread as long as it has calls. Of the calls
    of one name that wait in a lane, only the newest is made.
    """

    def __init__(self) -> None:
        """Make no call yet."""
        self._lock = threading.Lock()
        self._waiting: dict[str, dict[str, _Call]] = {}
        self._under_way: dict[str, str] = {}
        self._done: list[Callable[[], None]] = []
        self._closed = False

    def ask(
        self,
        lane: str,
        name: str,
        make: Callable[[], Any],
        take: Callable[[Any], None],
        fail: Callable[[str], None],
    ) -> None:
        """Have a call made, from any thread; nothing happens any more after the end.

        Args:
            lane: in which it waits for its turn.
            name: of the call in its lane.
            make: is called in the lane's thread.
            take: gets what it returns, in the thread of `hand_over`.
            fail: gets the words of what it raises, there too.
        """
        with self._lock:
            if self._closed:
                return
            is_new = lane not in self._waiting
            self._waiting.setdefault(lane, {})[name] = _Call(make, take, fail)
        if is_new:
            work = partial(self._work, lane)
            threading.Thread(target=work, name=f"worker {lane}", daemon=True).start()

    def is_busy(self, lane: str, name: str) -> bool:
        """Whether a call of this name waits or is under way."""
        with self._lock:
            return name in self._waiting.get(lane, ()) or name == self._under_way.get(lane)

    def hand_over(self) -> None:
        """Pass on the results that have come since."""
        with self._lock:
            done, self._done = self._done, []
        for each in done:
            each()

    def close(self) -> None:
        """Make no further call; does not wait for those that are under way."""
        with self._lock:
            self._closed = True
            for calls in self._waiting.values():
                calls.clear()

    def _work(self, lane: str) -> None:
        """Make the calls of a lane until there are none."""
        while True:
            with self._lock:
                calls = self._waiting[lane]
                if not calls:
                    del self._waiting[lane]
                    return
                name = next(iter(calls))
                call, self._under_way[lane] = calls.pop(name), name
            try:
                done = partial(call.take, call.make())
            except Exception as error:  # of nodes and the middleware: the next call may do well
                done = partial(call.fail, str(error) or type(error).__name__)
            with self._lock:
                del self._under_way[lane]
                self._done.append(done)
