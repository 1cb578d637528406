"""Stamps of the ticks of real devices."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from husky_drivers.nodes.pacer import TickGrid

PERIOD = 2_000_000
WALL = 1_795_000_000_123_456_789


@given(st.lists(st.integers(0, PERIOD - 1), min_size=1, max_size=50))
def test_late_ticks_have_the_stamps_of_punctual_ones(delays):
    """However late each begins, within its period."""
    grid = TickGrid(5_000, WALL, PERIOD)
    stamps = [grid.stamp(5_000 + (k + 1) * PERIOD + late) for k, late in enumerate(delays)]
    assert stamps == [WALL + (k + 1) * PERIOD for k in range(len(delays))]


@given(st.lists(st.integers(0, 10 * PERIOD), min_size=2, max_size=50))
def test_stamps_are_whole_periods_apart_and_never_go_back(steps):
    grid, now, stamps = TickGrid(0, WALL, PERIOD), 0, []
    for step in steps:
        now += step
        stamps.append(grid.stamp(now))
    gaps = [b - a for a, b in pairwise(stamps)]
    assert all(gap >= PERIOD and gap % PERIOD == 0 for gap in gaps)


def test_missed_ticks_are_left_out():
    grid = TickGrid(0, WALL, PERIOD)
    assert grid.stamp(PERIOD) == WALL + PERIOD
    assert grid.stamp(4 * PERIOD + 1) == WALL + 4 * PERIOD
