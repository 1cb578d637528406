import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_runtime.lockstep import Exchange, Heard, Peer, Presence

TICK = 2_000_000
LOOK = 0.05
"""Between two looks of an idle executor [s]."""


def is_lost(peer, since, until):
    """Await its answer from one time to another [s]; return whether it has been lost meanwhile."""
    looks = round((until - since) / LOOK)
    return any([peer.expire(since + LOOK * look) for look in range(looks + 1)])


def test_awaited_until_it_answers():
    peer = Peer("bridge", grace=1.0)
    assert not peer.ready(0)
    peer.answer(0)
    assert peer.ready(0)
    assert not peer.ready(TICK)


def test_lost_after_the_grace_period_and_back_with_its_next_word():
    peer = Peer("bridge", grace=1.0)
    peer.answer(0)
    assert not is_lost(peer, 10.0, 11.0)
    assert peer.expire(11.05)
    assert peer.presence is Presence.LOST and peer.losses == 1
    assert peer.ready(5 * TICK), "ticks go on without it"
    assert not peer.expire(99.0), "a loss is told once"
    peer.answer(0)
    assert peer.presence is Presence.EXPECTED
    assert not peer.ready(5 * TICK), "it is awaited again, as soon as it speaks"


def test_one_that_is_lost_still_owes_its_answer():
    """So a world that stands still goes on asking it, and finds it before the next tick."""
    peer = Peer("bridge", grace=1.0)
    assert peer.owes(0)
    peer.answer(0)
    assert not peer.owes(0) and peer.owes(TICK)
    assert is_lost(peer, 10.0, 11.1)
    assert peer.presence is Presence.LOST and peer.owes(TICK)
    assert not Peer("imu", start_grace=None).owes(0), "nobody has asked it"


def test_a_sign_of_life_starts_the_grace_period_again():
    peer = Peer("controller", grace=1.0)
    peer.answer(TICK)
    for now in (0.0, 1.0, 2.0, 3.0):
        assert not is_lost(peer, now, now + 0.9)
        peer.answer(0)  # an earlier word, said again
    assert peer.ready(TICK) and not peer.ready(2 * TICK)


def test_first_word_may_take_longer():
    peer = Peer("bridge", grace=1.0, start_grace=30.0)
    assert not is_lost(peer, 0.0, 29.9)
    peer.answer(0)
    assert not is_lost(peer, 40.0, 40.9)
    assert is_lost(peer, 40.9, 41.1)


def test_one_that_is_not_awaited_before_it_is_heard():
    peer = Peer("imu", grace=1.0, start_grace=None)
    assert peer.ready(TICK) and peer.presence is Presence.ABSENT
    assert not is_lost(peer, 0.0, 99.0)
    peer.answer(0)
    assert not peer.ready(TICK)


def test_one_that_was_absent_can_be_asked():
    peer = Peer("planner", grace=1.0, start_grace=None)
    peer.expect()
    assert not peer.ready(0)
    assert not is_lost(peer, 10.0, 10.9)
    assert is_lost(peer, 10.9, 11.1) and peer.ready(0)
    peer.expect()
    assert peer.presence is Presence.LOST, "who is lost comes back by an answer alone"


def test_one_that_was_absent_can_get_longer_for_its_first_answer():
    peer = Peer("imu", grace=1.0, start_grace=None)
    peer.expect(start_grace=30.0)
    assert not is_lost(peer, 10.0, 39.9)
    peer.answer(0)
    assert is_lost(peer, 40.0, 41.1)


@pytest.mark.parametrize("share, lost_after", [(0.0, 1.0), (0.4, 1.6), (0.9, 9.0), (1.0, 10.0)])
def test_time_in_which_it_is_busy_is_no_silence(share, lost_after):
    """It is looked at from 0.1 s on; ten grace periods are the end."""
    now = 0.0
    peer = Peer("planner", grace=1.0, busy=lambda: 100.0 + share * now)
    peer.answer(0)
    while not peer.expire(now):
        now += 0.01
    assert now == pytest.approx(lost_after, abs=0.04)


def test_one_that_has_ended_before_it_is_awaited_is_lost_at_once():
    peer = Peer("planner", grace=20.0, busy=lambda: None)
    peer.answer(0)
    assert not peer.expire(0.0) and not peer.expire(0.1)
    assert peer.expire(0.11)


def test_one_that_ends_while_it_is_awaited_is_lost_at_once():
    busy = [100.0]
    peer = Peer("planner", grace=20.0, busy=lambda: busy[0])
    peer.answer(0)
    assert not is_lost(peer, 0.0, 0.6)
    busy[0] = None
    assert is_lost(peer, 0.6, 0.75)


def test_what_a_compiler_had_that_it_has_started_counts_when_that_has_ended():
    """From then on the kernel tells less; what it had since the last look is not known."""
    now = 0.0
    peer = Peer("planner", grace=1.0, busy=lambda: 100.0 + now if now < 5.0 else 20.0)
    peer.answer(0)
    while not peer.expire(now):
        now += 0.01
    assert now == pytest.approx(6.0, abs=0.15)


@pytest.mark.parametrize("stop", [4.0, 20.0, 3600.0])
def test_a_judge_that_was_stopped_condemns_nobody(stop):
    """Its peers were stopped too: they still have nearly all of the grace period to answer."""
    peer = Peer("controller", grace=1.0)
    peer.answer(0)
    assert not is_lost(peer, 0.0, 0.1)
    assert not is_lost(peer, 0.1 + stop, 0.8 + stop)
    assert is_lost(peer, 0.8 + stop, 1.1 + stop), "it never came back"


def test_a_judge_that_looks_seldom_finds_a_dead_peer():
    peer = Peer("controller", grace=1.0)
    peer.answer(0)
    assert [peer.expire(10.0 * look) for look in range(13)].index(True) <= 11


def test_on_the_robot_a_silence_counts_however_it_came_about():
    peer = Peer("controller", grace=1.0, longest_look=math.inf)
    peer.answer(0)
    assert not peer.expire(0.0) and peer.expire(4.0)


def test_restart_forgets_answers_of_before():
    peer = Peer("bridge")
    peer.answer(500 * TICK)
    peer.restart()
    assert not peer.ready(0)
    peer.restart(answered=TICK)
    assert peer.ready(TICK) and not peer.ready(2 * TICK)


@pytest.mark.parametrize("grace", [0.0, -1.0, float("nan")])
def test_grace_must_be_above_zero(grace):
    with pytest.raises(ValueError, match="grace of peer 'x'"):
        Peer("x", grace=grace)
    with pytest.raises(ValueError, match="grace of peer 'x'"):
        Peer("x", start_grace=grace)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.one_of(st.none(), st.integers(0, 50)))))
def test_never_lost_within_the_grace_period_of_a_word(history):
    """Whatever it says and whenever it is asked for: silence of a period comes before each loss."""
    peer = Peer("x", grace=1.0)
    peer.answer(0)
    now = heard = 0.0
    answered = 0
    for passed, word in history:
        now += passed
        if word is None:
            assert not (peer.expire(now) and now - heard <= 1.0)
        else:
            peer.answer(word)
            answered, heard = max(answered, word), now
        assert peer.ready(answered)
        assert peer.ready(answered + 1) == (peer.presence is Presence.LOST)


def tell_again(exchange, stamp):
    exchange.ask(stamp)
    exchange.ask_again()


def copies(exchange, stamps):
    """Hear answers as they come; return those that nobody has asked for."""
    return [stamp for stamp in stamps if exchange.hear(stamp, now=100) is Heard.COPY]


@pytest.fixture
def exchange():
    return Exchange(Peer("controller"))


def test_a_second_answer_is_a_stranger_unless_it_was_asked_for(exchange):
    assert copies(exchange, [0, 2, 2, 4]) == [2]
    tell_again(exchange, 6)
    assert copies(exchange, [6, 6, 6]) == [6]


def test_a_slow_peer_may_owe_for_two_questions_at_once(exchange):
    """What is owed for tick 2 comes after tick 4 has been told again, and before its answer."""
    assert copies(exchange, [0]) == []
    tell_again(exchange, 2)
    assert copies(exchange, [2]) == []
    tell_again(exchange, 4)
    assert copies(exchange, [2, 4, 4]) == []


def test_what_is_not_said_again_is_not_owed_for_ever(exchange):
    tell_again(exchange, 2)
    assert copies(exchange, [2, 4]) == []  # the repeated question, or its second answer, was lost
    assert copies(exchange, [4]) == [4]


def test_the_last_word_may_be_older_than_the_question(exchange):
    """A peer that waits for somebody itself shows that it lives."""
    assert copies(exchange, [2]) == []
    for _ in range(3):
        tell_again(exchange, 4)
    assert copies(exchange, [2, 2, 2, 4]) == []
    tell_again(exchange, 6)
    exchange.restart()
    assert copies(exchange, [4, 4]) == [4]
