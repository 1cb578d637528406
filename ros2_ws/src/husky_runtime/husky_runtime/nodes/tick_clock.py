"""How regular ticks come and how long they take, in wall time."""

from __future__ import annotations

import time

import numpy as np

from husky_description.arrays import Array

_KEPT = 1024
"""Ticks whose times are kept."""


class TickClock:
    """Times of the last ticks.

    Attributes:
        ticks: counted since the start.
        overruns: ticks whose work took longer than the period.
    """

    def __init__(self, period: float):
        """Start to count; a tick may take a period [s]."""
        self.ticks = 0
        self.overruns = 0
        self._period = period
        self._starts = np.full(_KEPT, np.nan)
        self._durations = np.full(_KEPT, np.nan)
        self._started = 0.0

    def start(self) -> None:
        """A tick begins."""
        self._started = time.perf_counter()

    def end(self) -> None:
        """Its work is done."""
        slot = self.ticks % _KEPT
        duration = time.perf_counter() - self._started
        self._starts[slot] = self._started
        self._durations[slot] = duration
        self.ticks += 1
        if duration > self._period:
            self.overruns += 1

    def durations(self, count: int = _KEPT) -> Array:
        """Return how long the newest ticks worked, oldest first [s]."""
        return self._newest(self._durations, count)

    def periods(self, count: int = _KEPT) -> Array:
        """Return the times between the starts of the newest ticks, oldest first [s]."""
        return np.diff(self._newest(self._starts, count))

    def _newest(self, ring: Array, count: int) -> Array:
        count = min(count, self.ticks, _KEPT)
        return ring[np.arange(self.ticks - count, self.ticks) % _KEPT]


def percentile_ms(times: Array, percent: float) -> float:
    """Return a percentile of times [s] in milliseconds, nan when there are none."""
    return 1e3 * float(np.percentile(times, percent)) if len(times) else float("nan")
