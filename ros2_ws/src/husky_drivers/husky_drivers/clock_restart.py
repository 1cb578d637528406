"""A device's clock that goes back: started again, or an old sample that comes once more."""

from __future__ import annotations

BEGINNING_NS = 100_000_000
"""A clock that goes back to less than this has been started again [ns]."""
LASTING = 20
"""So many samples in a row, each later than the one before, are no repeats."""


class ClockRestart:
    """Judges samples that are not later than the newest.

    One from the beginning of the device's time is believed at once. Any other is a repeat, of a
    buffer that was sent twice, say, unless it goes on from there.
    """

    def __init__(self, beginning_ns: int = BEGINNING_NS, lasting: int = LASTING) -> None:
        """No repeat has been seen.

        Args:
            beginning_ns: the time below which a sample is from the beginning [ns].
            lasting: samples in a row after which they are no repeats.
        """
        self._beginning_ns = beginning_ns
        self._lasting = lasting
        self._behind_ns = -1.0
        self._count = 0

    def moved_on(self) -> None:
        """A sample that is later than the newest has come."""
        self._count = 0

    def is_restart(self, time_ns: float, newest_ns: float) -> bool:
        """Return whether a sample of this time [ns] shows that the clock has been started again."""
        if time_ns == newest_ns:
            return False
        self._count = self._count + 1 if self._count and time_ns > self._behind_ns else 1
        self._behind_ns = time_ns
        if time_ns >= self._beginning_ns and self._count < self._lasting:
            return False
        self._count = 0
        return True
