"""Poses of the base and joints over the last 2 s, for images that come late."""

from __future__ import annotations

import bisect
from collections import deque
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array

_KEPT = 100
"""Poses, and joint positions: 2 s at 50 Hz."""
_LONGEST_GAP_NS = 200_000_000
"""Between two of them, beyond which nothing between them is known [ns]."""


class BasePose(NamedTuple):
    """Pose of the base in odom: rotation (3, 3) and position [m] (3,)."""

    rotation: Array
    position: Array


class PoseHistory:
    """The newest poses of the base in odom, by their stamps."""

    def __init__(self) -> None:
        """Start without poses."""
        self._times: deque[int] = deque(maxlen=_KEPT)
        self._poses: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)

    def clear(self) -> None:
        """Forget all poses."""
        self._times.clear()
        self._poses.clear()

    @property
    def newest(self) -> int:
        """Stamp of the newest pose [ns], -1 without one."""
        return self._times[-1] if self._times else -1

    def add(self, time_ns: int, position: Array, orientation: Array) -> None:
        """Add a pose.

        Args:
            time_ns: its stamp [ns], after that of the newest.
            position: of the base in odom [m] (3,).
            orientation: unit quaternion (x, y, z, w), base to odom.

        Raises:
            ValueError: the stamp is not after the newest.
        """
        if time_ns <= self.newest:
            raise ValueError(f"stamp {time_ns} ns is not after {self.newest} ns")
        self._times.append(time_ns)
        self._poses.append((orientation, position))

    def at(self, time_ns: int) -> BasePose | None:
        """Return the pose at a time [ns] between two poses; None where it is not known.

        The position is interpolated along a line; the attitude along the chord of its quaternions,
        which over 20 ms differs from the arc by less than a microradian.
        """
        found = _bracket(self._times, time_ns)
        if found is None:
            return None
        before, after, share = found
        (first, here), (second, there) = self._poses[before], self._poses[after]
        nearer = second if first @ second >= 0.0 else -second
        mixed = (1.0 - share) * first + share * nearer
        return BasePose(
            rotation_matrix(mixed / np.sqrt(mixed @ mixed)), here + share * (there - here)
        )


class JointHistory:
    """The newest joint positions, by their stamps."""

    def __init__(self) -> None:
        """Start without any."""
        self._times: deque[int] = deque(maxlen=_KEPT)
        self._positions: deque[Array] = deque(maxlen=_KEPT)

    def add(self, time_ns: int, positions: Array) -> None:
        """Add joint positions (12,) [rad] of a time [ns].

        A time before the newest is that of a world that has started again: the rest is forgotten.
        """
        if self._times and time_ns == self._times[-1]:
            return
        if self._times and time_ns < self._times[-1]:
            self._times.clear()
            self._positions.clear()
        self._times.append(time_ns)
        self._positions.append(positions)

    def at(self, time_ns: int) -> Array | None:
        """Return the joint positions (12,) [rad] at a time [ns]; None where they are not known.

        They are interpolated along a line, which over 20 ms a joint that swings by 0.5 rad at 2 Hz
        leaves by 4 mrad.
        """
        found = _bracket(self._times, time_ns)
        if found is None:
            return None
        before, after, share = found
        here, there = self._positions[before], self._positions[after]
        between: Array = here + share * (there - here)
        return between


def _bracket(times: deque[int], time_ns: int) -> tuple[int, int, float] | None:
    """Return the places around a time [ns], and its share of the way; None where it is not known.

    Args:
        times: ascending [ns].
        time_ns: looked up [ns]. One that is there is both places, with share 0.
    """
    after = bisect.bisect_left(times, time_ns)
    if after == len(times):
        return None
    end = times[after]
    if end == time_ns:
        return after, after, 0.0
    if after == 0 or end - times[after - 1] > _LONGEST_GAP_NS:
        return None
    start = times[after - 1]
    return after - 1, after, (time_ns - start) / (end - start)


def rotation_matrix(quaternion: Array) -> Array:
    """Return the matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
