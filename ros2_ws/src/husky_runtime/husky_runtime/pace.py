"""What is told now and then of what happens all the time."""

from __future__ import annotations


class Pace:
    """Says when it is time to tell again, by stamps; also when time has gone back."""

    def __init__(self, period_ns: int, slack_ns: int):
        """It is time at once.

        Args:
            period_ns: between two tellings [ns].
            slack_ns: by how much one may come early, less than a period of what happens [ns].
        """
        self._least_ns = period_ns - slack_ns
        self._told_ns: int | None = None

    def due(self, time_ns: int) -> bool:
        """Return whether it is time, with what happens at a time [ns]; then it counts as told."""
        if self._told_ns is not None and 0 <= time_ns - self._told_ns < self._least_ns:
            return False
        self._told_ns = time_ns
        return True
