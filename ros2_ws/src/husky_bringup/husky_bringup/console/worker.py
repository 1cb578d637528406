"""A thread for calls that block: who draws does not wait for them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
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
    """Makes one call after the other in a thread, and keeps the results until somebody asks.

    Of the calls under one key that wait, only the newest is made.
    """

    def __init__(self) -> None:
        """Make no call yet; the thread begins with the first."""
        self._changed = threading.Condition()
        self._waiting: dict[Hashable, _Call] = {}
        self._under_way: Hashable = None
        self._done: list[Callable[[], None]] = []
        self._closed = False
        self._thread: threading.Thread | None = None

    def ask(
        self,
        key: Hashable,
        make: Callable[[], Any],
        take: Callable[[Any], None],
        fail: Callable[[str], None],
    ) -> None:
        """Have a call made, from any thread; nothing happens any more after the end.

        Args:
            key: of the call, not None.
            make: is called in the worker's thread.
            take: gets what it returns, in the thread of `hand_over`.
            fail: gets the words of what it raises, there too.
        """
        with self._changed:
            if self._closed:
                return
            self._waiting[key] = _Call(make, take, fail)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
                self._thread.start()
            self._changed.notify()

    def is_busy(self, key: Hashable) -> bool:
        """Whether a call of this key waits or is under way."""
        with self._changed:
            return key in self._waiting or key == self._under_way

    def hand_over(self) -> None:
        """Pass on the results that have come since."""
        with self._changed:
            done, self._done = self._done, []
        for each in done:
            each()

    def close(self) -> None:
        """Make no further call; does not wait for the one that is under way."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._under_way = None
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                key = next(iter(self._waiting))
                call, self._under_way = self._waiting.pop(key), key
            try:
                done = partial(call.take, call.make())
            except Exception as error:  # of nodes and the middleware: the next call may do well
                done = partial(call.fail, str(error) or type(error).__name__)
            with self._changed:
                self._under_way = None
                self._done.append(done)
