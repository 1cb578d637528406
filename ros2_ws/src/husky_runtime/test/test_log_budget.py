"""A device that changes its state all the time does not fill the log."""

from hypothesis import given
from hypothesis import strategies as st

from husky_runtime.log_budget import LINES, PERIOD, LogBudget


def test_what_changes_seldom_is_said_at_once():
    budget = LogBudget()
    times = [1.0 + i * PERIOD / LINES for i in range(100)]
    assert [budget.line("streaming", time) for time in times] == ["streaming"] * 100


def test_what_was_held_back_is_counted():
    budget = LogBudget()
    said = [budget.line(str(i), 10.0 + 0.1 * i) for i in range(40)]
    assert said == [str(i) for i in range(LINES)] + [None] * (40 - LINES)
    last = budget.line("stale", 10.0 + PERIOD)
    assert last == f"stale (changes before it that are not logged: {40 - LINES})"
    assert budget.line("streaming", 11.0 + PERIOD) == "streaming"


@given(st.lists(st.floats(0.0, 10.0), max_size=300))
def test_never_more_than_two_sets_in_a_minute(waits):
    """However changes come: at the end of one minute and the begin of the next, at most."""
    budget, now, said, held = LogBudget(), 100.0, [], 0
    for wait in waits:
        now += wait
        line = budget.line("x", now)
        if line is None:
            held += 1
            continue
        said.append(now)
        assert line == ("x" if not held else f"x (changes before it that are not logged: {held})")
        held = 0
    for first in said:
        assert sum(first <= time < first + PERIOD for time in said) <= 2 * LINES
