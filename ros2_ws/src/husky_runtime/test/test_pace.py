"""When it is time to tell again."""

import pytest

from husky_runtime.pace import Pace


@pytest.mark.parametrize("period", [2, 10, 20])
def test_what_happens_more_often_is_told_at_the_pace(period):
    pace = Pace(20, 1)
    told = [time for time in range(0, 100, period) if pace.due(time)]
    assert told == [0, 20, 40, 60, 80]


def test_a_little_early_is_in_time_and_once_told_is_told():
    pace = Pace(20, 1)
    assert [pace.due(time) for time in (5, 5, 23, 24, 42, 43)] == [
        True, False, False, True, False, True,
    ]  # fmt: skip


def test_time_that_goes_back_is_told_at_once():
    pace = Pace(20, 1)
    assert [pace.due(time) for time in (100, 110, 4, 10, 24)] == [True, False, True, False, True]
