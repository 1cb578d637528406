"""Checks of depth frames: repeated, missing, without depth, stuck, impossible."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from husky_drivers.camera_link import LATEST_TIME_MS
from husky_drivers.clock_restart import ClockRestart
from husky_drivers.d435.frames import DepthFrame

LEAST_VALID = 0.05
"""Share of pixels with depth below which a camera counts as covered, if nothing else is wanted."""

_BEGINNING_NS = 500_000_000
"""A clock that goes back to less has been started again [ns]: some images, at 10 Hz or more."""
_LASTING = 5
"""So many frames in a row, each later than the one before, are no repeats."""
_DEPTH_UNITS = (1e-5, 0.01)
"""Least and greatest depth unit that is believed [m]; librealsense's are 1e-4 and 1e-3."""


class Verdict(Enum):
    """Verdict on a frame; good and covered ones are handed out."""

    GOOD = "good"
    COVERED = "covered"
    STUCK = "stuck"
    REPEATED = "repeated"
    INVALID = "invalid"


@dataclass
class DepthCounters:
    """Counts of frames by verdict since the driver started.

    Attributes:
        good: frames handed out.
        covered: those of them with hardly any depth.
        stuck: frames with a new time and the image of the frame before; dropped.
        repeated: frames whose time did not move on, see `ClockRestart`; dropped.
        invalid: frames with impossible intrinsics, depth unit or time; dropped.
        missed: frames missing between two, by their numbers.
        clock_restarts: times the camera's clock went back: it has been started again.
    """

    good: int = 0
    covered: int = 0
    stuck: int = 0
    repeated: int = 0
    invalid: int = 0
    missed: int = 0
    clock_restarts: int = 0


class DepthGate:
    """Lets new and sane frames through and counts the others.

    Attributes:
        counters: see `DepthCounters`.
        valid: share of the pixels that had depth in the last new frame [-], 0 before the first.
    """

    def __init__(self, least_valid: float = LEAST_VALID):
        """Start without a frame; `least_valid` is the share of `valid` that is not covered [-]."""
        self.counters = DepthCounters()
        self.valid = 0.0
        self._least_valid = least_valid
        self._last: DepthFrame | None = None
        self._restart = ClockRestart(_BEGINNING_NS, _LASTING)

    def judge(self, frame: DepthFrame) -> Verdict:
        """Return the verdict on a frame, and count it."""
        counters = self.counters
        if not _sane(frame):
            counters.invalid += 1
            return Verdict.INVALID
        last = self._last
        if last is not None:
            if frame.time_ms > last.time_ms:
                self._restart.moved_on()
                counters.missed += max(0, frame.number - last.number - 1)
            elif _is_first_again(frame, last) or self._restart.is_restart(
                1e6 * frame.time_ms, 1e6 * last.time_ms
            ):
                counters.clock_restarts += 1
                last = None
            else:
                counters.repeated += 1
                return Verdict.REPEATED
        self._last = frame
        self.valid = np.count_nonzero(frame.depth) / frame.depth.size
        if self.valid < self._least_valid or not self.valid:
            # An image without depth is true, and like any other without depth.
            counters.good += 1
            counters.covered += 1
            return Verdict.COVERED
        if last is not None and np.array_equal(frame.depth, last.depth):
            # Depth is never measured without noise: the sensor repeats an old image.
            counters.stuck += 1
            return Verdict.STUCK
        counters.good += 1
        return Verdict.GOOD


def _is_first_again(frame: DepthFrame, last: DepthFrame) -> bool:
    """Return whether another frame has the time of the last, both soon after a clock's start."""
    same_time = frame.time_ms == last.time_ms < 1e-6 * _BEGINNING_NS
    return same_time and frame.number != last.number


def _sane(frame: DepthFrame) -> bool:
    i = frame.intrinsics
    least, greatest = _DEPTH_UNITS
    return (  # Written so that a NaN is refused.
        i.width > 0
        and i.height > 0
        and frame.depth.shape == (i.height, i.width)
        and 0.0 < i.fx < math.inf
        and 0.0 < i.fy < math.inf
        and abs(i.cx) < math.inf
        and abs(i.cy) < math.inf
        and least <= frame.depth_unit <= greatest
        and 0.0 <= frame.time_ms < LATEST_TIME_MS
    )
