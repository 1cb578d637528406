"""Which stamps are believed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_runtime.stamp_gate import StampGate, Turn

MS = 1_000_000
PERIOD = 2 * MS


LAG = 50 * MS


class Stream:
    """A gate, and what it has let through and refused; messages are their own stamps."""

    def __init__(self, **options):
        self.refused = []
        self.gate = StampGate(PERIOD, self.refused.append, LAG, **options)

    def witness(self, *milliseconds, restarts=0):
        """The witness tells times [ms]."""
        for stamp in milliseconds:
            self.gate.hear_witness(stamp * MS, restarts)

    def send(self, *milliseconds):
        """Send stamps [ms]; return the turns and stamps [ms] that are acted on."""
        acted = []
        for stamp in milliseconds:
            admitted = self.gate.admit(stamp * MS, stamp)
            acted += [(turn.value, message) for turn, message in admitted]
        return acted


def running(**options):
    """A stream at 102 ms whose witness has told 100 ms."""
    stream = Stream(**options)
    stream.send(98)
    stream.witness(90, 100)
    stream.send(100, 102)
    return stream


def test_a_stream_goes_on_tick_by_tick_and_a_repeated_message_is_told_as_such():
    assert Stream().send(0, 2, 2, 4) == [("next", 0), ("next", 2), ("repeat", 2), ("next", 4)]


@pytest.mark.parametrize("wrong", [0, 50, 100, 101, 103, 106, 5000])
def test_one_message_out_of_turn_is_refused_and_the_stream_goes_on(wrong):
    stream = running()
    assert stream.send(wrong, 104, 106) == [("next", 104), ("next", 106)]
    assert len(stream.refused) == 1
    assert f"{wrong / 1e3:.3f} s, awaited is 0.104 s" in stream.refused[0]


@given(st.integers(0, 10**6).filter(lambda ms: ms not in (102, 104)))
def test_no_single_stamp_is_acted_on_out_of_turn(wrong):
    stream = running()
    assert stream.send(wrong) == []
    assert stream.send(104) == [("next", 104)]


@given(st.lists(st.integers(0, 101), max_size=30))
def test_a_flood_of_old_messages_starts_no_new_time(stamps):
    stream = running()
    assert stream.send(*stamps) == []
    assert stream.send(104) == [("next", 104)]


def test_lost_messages_are_a_gap_that_the_next_message_confirms():
    assert running().send(110, 112) == [("gap", 112)]
    assert running(replay=True).send(110, 112) == [("gap", 110), ("next", 112)]


def test_a_gap_that_the_witness_does_not_see_is_none():
    stream = running()
    assert stream.send(5000, 5002, 5004, 104) == [("next", 104)]
    stream.witness(5000)
    assert stream.send(5000, 5002) == [("gap", 5002)]


@given(st.integers(105, 10**6), st.integers(1, 30))
def test_the_same_message_again_makes_no_gap_that_the_witness_does_not_tell(stamp, times):
    stream = running()
    assert stream.send(*[stamp] * times) == []
    stream.witness(stamp)
    assert stream.send(stamp) == [("gap", stamp)]


def test_a_new_time_is_announced_by_the_witness_and_confirmed_by_telling_it_twice():
    stream = running()
    stream.witness(0)
    assert stream.send(0, 0, 2) == [("restart", 0), ("next", 2)]
    assert not stream.refused


def test_a_witness_that_counts_restarts_need_not_go_back():
    stream = Stream()
    stream.witness(0)
    stream.send(*range(0, 62, 2))
    assert stream.send(0, 0) == []
    stream.witness(0, restarts=1)
    assert stream.send(0) == [("restart", 0)]


def test_a_wrong_word_of_the_witness_alone_does_nothing_and_is_forgotten():
    stream = running()
    stream.witness(0, 110)
    assert stream.send(0, 0, 104) == [("next", 104)]


def test_near_time_0_a_new_start_needs_no_announcement():
    stream = Stream()
    stream.witness(0)
    assert stream.send(0, 2, 4, 0, 0)[-1] == ("restart", 0)


def test_without_a_witness_time_starts_again_only_at_0():
    stream = Stream()
    stream.send(5000, 5002)
    assert stream.send(4000, 4000, 4002) == []
    assert stream.send(0, 2) == [("restart", 2)]


def test_who_was_first_misled_finds_the_stream():
    stream = Stream()
    stream.send(90_000)
    assert stream.send(0, 2, 4) == [("restart", 2), ("next", 4)]


@given(st.lists(st.integers(0, 400).map(lambda tick: 2 * tick), max_size=60))
def test_it_goes_on_whatever_has_come_before(stamps):
    stream = Stream()
    stream.send(*stamps)
    stream.witness(1000, 2000)
    assert [turn for turn, _ in stream.send(2000, 2002, 2004, 2006)][-2:] == ["next", "next"]
    assert stream.gate.last == 2006 * MS
    assert Turn("next") is Turn.NEXT
