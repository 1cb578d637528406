"""Distributed clocks of a line of simulated drives (ETG.1000.4, registers 0x0900 to 0x0934).

A local clock starts with its drive's power and drifts. The system time is the local one with the
master's offset; the clock follows the first drive's system time, which a datagram with the command
FRMW or ARMW brings to all others, one frame after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

HOP = 500
"""Time from one slave to the next, either way [ns] (assumed)."""
_CAPTURED = 1_000_000
"""Difference to the reference clock from which a slave's clock no longer follows it [ns]."""
_GAIN = 4
"""A clock follows this part of the difference at every comparison (assumed)."""

_CLOCK = np.dtype(
    [
        ("epoch", "i8"),  # time at which the local clock was 0 [ns]
        ("drift", "i8"),  # parts in 10^9
        ("correction", "i8"),  # by which it has followed the reference [ns]
        ("offset", "i8"),  # of the system time [ns]
        ("delay", "i8"),  # of a frame from the reference [ns]
        ("difference", "i8"),  # to the reference when they were compared last [ns]
    ],
    align=True,
)


@njit(cache=True)
def _local(clock: Any, now: int, hops: int) -> int:
    """Return a local clock when a frame that enters the line now has made some hops [ns]."""
    time = now - clock.epoch + HOP * hops
    local: int = time + time * clock.drift // 1_000_000_000 + clock.correction
    return local


@njit(cache=True)
def _follow(clocks: Any, first: int, end: int, now: int, reference: int, away: Any) -> None:
    """Compare the clocks from `first` to before `end` with a reference; let them follow it."""
    for i in range(first, end):
        if away[i]:
            continue
        clock = clocks[i]
        time = _local(clock, now, i) + clock.offset - reference - clock.delay
        difference = time & 0xFFFFFFFF
        if difference >= 1 << 31:
            difference -= 1 << 32
        clock.difference = difference
        if abs(difference) < _CAPTURED:
            clock.correction -= difference // _GAIN


@njit(cache=True)
def hand_on(clocks: Any, reference: int, now: int, sent: int, away: Any) -> int:
    """Read a clock's system time; let those behind follow it, those before it what was sent.

    Args:
        clocks: records of `Clocks.records`.
        reference: position of the clock that is read.
        now: time at which the frame enters the line [ns].
        sent: lower 32 bits of the time that the master has sent [ns].
        away: (n,) not 0 for a drive that frames do not reach.

    Returns:
        System time of the reference [ns].
    """
    _follow(clocks, 0, reference, now, sent, away)
    time: int = _local(clocks[reference], now, reference) + clocks[reference].offset
    _follow(clocks, reference + 1, len(clocks), now, time & 0xFFFFFFFF, away)
    return time


class Clocks:
    """Clocks of all drives of a line.

    Attributes:
        records: one record a clock, for kernels.
    """

    def __init__(self, now: Callable[[], int], drift_ppm: Sequence[float], away: NDArray[np.int32]):
        """Start them.

        Args:
            now: time [ns] at which the frame that is processed enters the line.
            drift_ppm: of each local clock against that.
            away: not 0 for a drive that frames do not reach, kept up to date by others.
        """
        self._now, self._away = now, away
        self.records = np.zeros(len(drift_ppm), _CLOCK)
        self.records["drift"] = np.rint(np.array(drift_ppm) * 1e3)
        self.follow(0, 0, 0)  # compiled, so that no frame waits
        self.local(0)

    def restart(self, i: int) -> None:
        """Start a clock from 0, as its drive has just got power."""
        drift = self.records["drift"][i]
        self.records[i] = np.zeros((), _CLOCK)
        self.records["drift"][i], self.records["epoch"][i] = drift, self._now()

    def local(self, i: int, hops: int | None = None) -> int:
        """Return a local clock [ns] when the frame has made some hops, by default up to there."""
        return int(_local(self.records[i], self._now(), i if hops is None else hops))

    def system(self, i: int) -> int:
        """Return a system time when the frame comes there [ns]."""
        return self.local(i) + int(self.records["offset"][i])

    def set(self, i: int, offset: int, delay: int) -> None:
        """Set offset and delay of a system time [ns]."""
        self.records["offset"][i], self.records["delay"][i] = offset, delay

    def forget_correction(self, i: int) -> None:
        """Let a clock run as it does without a reference."""
        self.records["correction"][i] = 0

    def follow(self, first: int, end: int, reference: int) -> None:
        """Compare clocks with a time; let them follow it.

        Args:
            first: of them; those that are away are left out.
            end: the one behind the last.
            reference: the time's lower 32 bits [ns].
        """
        _follow(self.records, first, end, self._now(), reference, self._away)

    def difference(self, i: int) -> int:
        """Return the difference to the reference at the last comparison [ns]."""
        return int(self.records["difference"][i])
