"""Log times follow the robot's time."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_bringup.log_time import WINDOW_NS, LogTime, read_stamp

SECOND = 1_000_000_000


@given(st.integers(0, 2**31 - 1), st.integers(0, SECOND - 1), st.booleans())
def test_stamp_of_both_byte_orders(seconds: int, nanoseconds: int, little: bool) -> None:
    order = "<" if little else ">"
    message = bytes((0, int(little), 0, 0)) + struct.pack(f"{order}iI", seconds, nanoseconds)
    assert read_stamp(message + b"rest") == seconds * SECOND + nanoseconds


@given(st.integers(-(2**31), -1), st.integers(0, 11))
def test_what_is_before_0_or_cut_short_is_no_stamp(seconds: int, length: int) -> None:
    message = bytes((0, 1, 0, 0)) + struct.pack("<iI", seconds, 0)
    assert read_stamp(message) == -1
    assert read_stamp(message[:length]) == -1


def test_nothing_has_a_place_before_the_present_is_known() -> None:
    with pytest.raises(ValueError, match="present"):
        LogTime().place(0)


def test_the_first_ticking_topic_sets_the_present() -> None:
    log = LogTime()
    assert log.pace(2, 10) == 10
    assert log.pace(0, 8) == 8, "a better clock takes over without a reset"
    assert log.pace(2, 12) == 12, "its own stamp, close to the present"
    assert (log.present, log.resets) == (8, 0)


def test_a_stamp_of_another_clock_gets_the_present() -> None:
    log = LogTime()
    log.pace(0, 3 * SECOND)
    assert log.place(1_700_000_000 * SECOND) == 3 * SECOND
    assert log.place(3 * SECOND + WINDOW_NS) == 3 * SECOND + WINDOW_NS
    assert log.place(3 * SECOND + WINDOW_NS + 1) == 3 * SECOND


def test_after_a_reset_log_times_go_on() -> None:
    log = LogTime()
    log.pace(0, 20 * SECOND)
    assert log.pace(0, 0) == 20 * SECOND
    assert log.pace(0, SECOND) == 21 * SECOND
    assert log.place(SECOND) == 21 * SECOND
    assert log.place(20 * SECOND) == 21 * SECOND, "a straggler from before the reset"
    assert log.resets == 1


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 100 * SECOND)), min_size=1))
def test_the_present_never_goes_back_on_one_clock(stamps: list[tuple[int, int]]) -> None:
    log = LogTime()
    newest = -1
    for rank, stamp in [(0, 0), *stamps]:
        logged = log.pace(rank, stamp)
        assert log.present is not None
        assert log.present >= newest
        assert abs(logged - log.present) <= WINDOW_NS
        newest = log.present
