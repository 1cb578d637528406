import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_runtime.patient_clock import PatientClock

GAPS = st.lists(st.floats(0.0, 100.0), max_size=50)


def read_through(clock, gaps):
    """Read a clock after each gap [s]; return the wall times and the times read."""
    walls = [1000.0]
    for gap in gaps:
        walls.append(walls[-1] + gap)
    return walls, [clock.read(wall) for wall in walls]


@given(GAPS)
def test_each_gap_counts_up_to_the_longest_look(gaps):
    _, times = read_through(PatientClock(0.25), gaps)
    expected = 1000.0 + sum(min(gap, 0.25) for gap in gaps)
    assert times[-1] == pytest.approx(expected, abs=1e-9)


@given(GAPS)
def test_what_is_missed_and_what_is_read_are_the_wall_s_time(gaps):
    clock = PatientClock(0.25)
    walls, times = read_through(clock, gaps)
    assert times == sorted(times)
    assert times[-1] + clock.missed == pytest.approx(walls[-1], abs=1e-9)


@given(GAPS)
def test_without_a_longest_look_it_is_the_wall_s_time(gaps):
    walls, times = read_through(PatientClock(math.inf), gaps)
    assert times == walls


@pytest.mark.parametrize("longest", [0.0, -1.0, math.nan])
def test_the_longest_look_is_above_zero(longest):
    with pytest.raises(ValueError, match="longest_look is"):
        PatientClock(longest)
