"""Which message of a stream a tick knows."""

from hypothesis import given
from hypothesis import strategies as st

from husky_control.estimation.timed_buffer import TimedBuffer

MS = 1_000_000


class Stream:
    """A buffer, and what it has refused; messages are their own stamps [ms]."""

    def __init__(self):
        self.refused = []
        self.buffer = TimedBuffer(self.refused.append, 16)

    def send(self, *milliseconds, now):
        """Add messages at a tick [ms]."""
        for stamp in milliseconds:
            self.buffer.add(round(stamp * MS), stamp, now * MS)

    def known(self, due):
        """The message that a tick knows [ms], None for none."""
        known = self.buffer.known(round(due * MS))
        return known[1] if known is not None else None


def test_a_tick_knows_the_newest_message_that_was_due():
    stream = Stream()
    assert stream.known(10) is None
    stream.send(0, 5, 10, 15, now=8)
    assert [stream.known(due) for due in (4, 5, 12, 100)] == [0, 5, 10, 15]
    assert stream.known(4) is None and not stream.refused


def test_a_message_that_is_too_far_ahead_is_refused_when_the_stream_goes_on():
    stream = Stream()
    stream.send(10, 111, now=10)
    assert stream.known(1000) == 10
    stream.send(11, now=10)
    assert stream.buffer.reach(111 * MS) == -1
    assert stream.known(1000) == 11 and len(stream.refused) == 1


def test_a_tick_that_jumps_to_messages_ahead_knows_them():
    """Joint states have ended for a while, the stream has not."""
    stream = Stream()
    stream.send(10, 11, 300, 301, 302, 420, now=10)
    assert stream.known(1000) == 11
    assert stream.buffer.reach(302 * MS) == 302 * MS
    assert [stream.known(due) for due in (300, 301, 1000)] == [300, 301, 302]
    assert not stream.refused, "one is still ahead"
    stream.send(303, now=303)
    assert stream.known(1000) == 303 and len(stream.refused) == 1


def test_of_messages_ahead_the_newest_wait():
    stream = Stream()
    stream.send(*range(200, 240), now=10)
    assert len(stream.refused) == 40 - 16
    assert stream.refused[0] == "its stamp is 0.200 s, now is 0.010 s"
    stream.buffer.reach(239 * MS)
    assert [stream.known(due) for due in (223, 224, 1000)] == [None, 224, 239]


def test_messages_ahead_are_of_before_when_time_starts_again():
    stream = Stream()
    stream.send(1000, now=10)
    assert stream.buffer.restart(0) == -1
    assert stream.buffer.reach(1000 * MS) == -1 and stream.known(2000) is None


def test_messages_that_are_stale_or_come_again_change_nothing():
    stream = Stream()
    stream.send(100, 105, 3, 50, 100, 110, now=105)
    assert stream.known(105) == 105 and stream.known(110) == 110
    assert len(stream.refused) == 3 and "older" in stream.refused[0]


def test_one_that_was_a_little_ahead_gives_way_to_the_stream():
    stream = Stream()
    stream.send(100, 190, 102, 104, now=103)
    assert stream.known(104) == 104 and len(stream.refused) == 1


def test_a_changed_word_about_the_same_time_counts():
    stream = Stream()
    stream.buffer.add(5 * MS, "connected", 5 * MS)
    stream.buffer.add(5 * MS, "not connected", 5 * MS)
    assert stream.known(6) == "not connected"


def test_messages_of_a_new_time_wait_for_it():
    stream = Stream()
    stream.send(1000, 1005, now=1005)
    stream.send(0, 1.25, 2.5, now=1005)
    assert stream.known(1005) == 1005
    assert stream.buffer.restart(0) == round(2.5 * MS)
    assert stream.known(1.3) == 1.25 and not stream.refused


@given(st.lists(st.integers(0, 5000), max_size=40), st.integers(1000, 4000))
def test_the_stream_is_known_again_after_whatever_has_come(stamps, now):
    stream = Stream()
    stream.send(*stamps, now=now)
    stream.buffer.reach(now * MS)
    stream.send(*range(now, now + 30), now=now)
    assert stream.known(now + 29) == now + 29
