"""Which leg stands when, from the gait table (T12): the grid of a cycle and where it is split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from husky_control.gait.table import Gait
from husky_description.arrays import Array
from husky_description.kinematics import LEGS

_SAME = 1e-9
"""Shares of the period that are no further apart are one event."""


@dataclass(frozen=True)
class Schedule:
    """One cycle of a gait on a grid."""

    grid: Array  # nodes as shares of the period from 0 to 1 (N + 1,)
    switches: tuple[int, ...]  # nodes inside the cycle where a leg lifts off or touches down
    stance: NDArray[np.bool_]  # whether each leg stands in each interval (N, 4)
    # share of the period at the middle of the stance that covers an interval; of a stance that
    # reaches over the ends of the cycle it may lie outside; zero in the swing (N, 4)
    middle: Array

    @property
    def slots(self) -> int:
        """Most legs that stand at once."""
        return int(self.stance.sum(axis=1).max())

    def slot_legs(self) -> NDArray[np.int_]:
        """The leg in each slot of each interval, -1 where there is none (N, slots).

        With a slot for every leg each has its own; with fewer the standing legs fill them in order.
        """
        table = np.full((len(self.stance), self.slots), -1)
        for row, standing in zip(table, self.stance, strict=True):
            legs = np.flatnonzero(standing)
            row[legs if self.slots == LEGS else np.arange(len(legs))] = legs
        return table


def make_schedule(gait: Gait, intervals: int) -> Schedule:
    """Spread intervals over the phases of a gait's cycle; the cycle begins at phase 0.

    Args:
        gait: row of the gait table.
        intervals: N, of the whole cycle; each phase gets its share, one at least.

    Raises:
        ValueError: there are fewer intervals than phases, or no leg ever lifts or stands.
    """
    if not 0.0 < gait.duty < 1.0:
        raise ValueError(f"gait {gait.name}: duty is {gait.duty}, it must be between 0 and 1")
    touchdown = np.array(gait.touchdown_phase)
    events = np.sort(np.concatenate([[0.0, 1.0], touchdown % 1.0, (touchdown + gait.duty) % 1.0]))
    events = events[np.concatenate([[True], np.diff(events) > _SAME])]
    if 1.0 - events[-1] < _SAME:
        events[-1] = 1.0
    lengths = np.diff(events)
    if intervals < len(lengths):
        raise ValueError(
            f"gait {gait.name} has {len(lengths)} phases, {intervals} intervals are too few"
        )
    counts = _counts(lengths, intervals)
    pieces = [
        np.linspace(start, end, count + 1)[1:]
        for start, end, count in zip(events[:-1], events[1:], counts, strict=True)
    ]
    grid = np.concatenate([[0.0], *pieces])
    centre = 0.5 * (grid[:-1] + grid[1:])
    since = (centre[:, None] - touchdown) % 1.0
    stance = since < gait.duty
    middle = np.where(stance, centre[:, None] - since + 0.5 * gait.duty, 0.0)
    return Schedule(grid, tuple(np.cumsum(counts)[:-1].tolist()), stance, middle)


def _counts(lengths: Array, intervals: int) -> NDArray[np.int_]:
    """Whole numbers of intervals in proportion to lengths, one each at least."""
    counts = np.maximum(1, np.floor(lengths * intervals)).astype(int)
    while counts.sum() < intervals:
        counts[np.argmax(lengths / counts)] += 1
    while counts.sum() > intervals:
        counts[np.argmin(np.where(counts > 1, lengths / counts, np.inf))] -= 1
    return counts
