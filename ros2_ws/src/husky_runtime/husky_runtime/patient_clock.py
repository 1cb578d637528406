"""Wall time for watchdogs of processes that may be stopped: SIGSTOP, `docker compose pause`.

A watchdog measures for how long a peer has been silent. A process that was stopped, often together
with its peers, finds a long silence at its first look although nobody had a chance to speak. By
this clock such a gap counts as one look, so the peer keeps nearly all of its time to answer. Time
passes with every look, so a process that gets the processor seldom still finds a dead peer, later.
"""

from __future__ import annotations

LONGEST_LOOK = 0.1
"""Longest time between two looks that counts in full [s].

An idle executor looks every 50 ms, a busy one every 2 ms: silence is found as soon as by the wall.
"""


class PatientClock:
    """Monotonic wall time, of which a gap between two reads counts for a moment at most.

    A watchdog that waits reads it at least twice in `longest_look`. For one thread, or under a
    lock.

    Attributes:
        missed: wall time that has not been counted so far [s].
    """

    def __init__(self, longest_look: float = LONGEST_LOOK):
        """Start at the first read.

        Args:
            longest_look: most that the time between two reads counts [s]; infinite for the wall's
                time as it is.

        Raises:
            ValueError: it is not above 0.
        """
        if not longest_look > 0.0:
            raise ValueError(f"longest_look is {longest_look!r} s, it must be above 0")
        self.missed = 0.0
        self._longest = longest_look
        self._read_at: float | None = None

    def read(self, now: float) -> float:
        """Return the time [s] at a monotonic wall time [s]; equal to it until a gap is missed."""
        if self._read_at is not None:
            self.missed += max(0.0, now - self._read_at - self._longest)
        self._read_at = now
        return now - self.missed
