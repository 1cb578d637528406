"""Who is heard, who is lost, what is asked: against an autopilot on pymavlink's own parser."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from husky_pu.companion import command_requests as commands
from husky_pu.companion.client import ClientConfig, MavlinkClient

TELEMETRY = {31, 83, 36, 291, 147, 1, 290}


# Finding the autopilot --------------------------------------------------------------------------
def test_it_finds_the_autopilot_and_asks_for_telemetry(pair):
    asked = pair.autopilot.of("COMMAND_LONG")
    assert {message.command for message in asked} == {511}
    intervals = {int(message.param1): message.param2 for message in asked}
    assert set(intervals) == TELEMETRY
    assert [intervals[n] for n in (31, 83, 291, 36, 147, 1, 290)] == [20000] * 4 + [100000] * 3
    for message in asked:
        assert (message.target_system, message.target_component) == (1, 1)
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 191)
        assert message.get_msgbuf()[0] == 0xFD
    assert pair.client.rejected_intervals == 0


def test_other_peoples_heartbeats_are_no_autopilot(make_autopilot):
    station = make_autopilot(255, 190, autopilot=mavlink.MAV_AUTOPILOT_INVALID)
    gimbal = make_autopilot(1, 154)
    client = MavlinkClient(ClientConfig(4))
    for other in (station, gimbal):
        other.heartbeat()
        client.feed(other.take_output(), 0.0)
    assert not client.connected
    assert client.foreign == 2


def test_a_fixed_target_is_waited_for(make_autopilot):
    client = MavlinkClient(ClientConfig(4, target_system=7))
    for system, expected in ((1, False), (7, True)):
        autopilot = make_autopilot(system)
        autopilot.heartbeat()
        client.feed(autopilot.take_output(), 0.0)
        assert client.connected is expected
    assert client.target == (7, 1)


def test_heartbeats_are_those_of_a_companion_once_a_second(pair):
    for _ in range(35):
        pair.now += 0.1
        pair.client.heartbeat(pair.now)
    pair.carry()
    beats = pair.autopilot.of("HEARTBEAT")
    assert len(beats) == 4
    assert (beats[0].type, beats[0].autopilot, beats[0].get_srcComponent()) == (18, 8, 191)


# Losing it --------------------------------------------------------------------------------------
def test_silence_is_a_loss_within_a_second_and_ends_by_itself(pair):
    pair.autopilot.telemetry(20)
    pair.carry()
    pair.wait(0.7)
    assert pair.client.connected
    pair.wait(0.1)
    assert not pair.client.connected
    assert pair.client.losses == 1
    asked = len(pair.autopilot.of("COMMAND_LONG"))
    pair.autopilot.telemetry(2000)
    pair.carry()
    pair.wait(0.5)
    assert pair.client.connected
    assert len(pair.autopilot.of("COMMAND_LONG")) == asked + len(TELEMETRY)


def test_heartbeats_alone_may_be_a_second_apart(pair):
    for _ in range(3):
        pair.wait(1.5)
        pair.autopilot.heartbeat()
        pair.carry()
    assert pair.client.losses == 0


def test_in_lockstep_stamps_tell_who_is_late(make_autopilot, make_pair):
    pair = make_pair(make_autopilot(), lockstep=True).connect()
    pair.client.advance(0)
    pair.autopilot.telemetry(20)
    pair.carry()
    pair.wait(0.5)
    pair.client.advance(700_000_000)
    pair.wait(0.1)
    assert pair.client.connected
    pair.client.advance(900_000_000)
    pair.wait(0.1)
    assert not pair.client.connected


def test_a_world_that_stands_is_no_loss_while_the_autopilot_answers(make_autopilot, make_pair):
    pair = make_pair(make_autopilot(), lockstep=True).connect()
    pair.wait(60.0)
    assert pair.client.losses == 0
    asked = pair.autopilot.of("COMMAND_LONG")
    assert asked[-1].command == commands.REQUEST_MESSAGE
    pair.autopilot.deaf = 1000
    pair.wait(3.5)
    assert not pair.client.connected


@pytest.mark.parametrize("stop", [4.0, 20.0])
@pytest.mark.parametrize("lockstep", [False, True])
def test_a_companion_that_was_stopped_does_not_lose_its_autopilot(
    make_autopilot, make_pair, lockstep, stop
):
    """Stopped together they go on; an autopilot that stays silent is lost as soon as ever."""
    pair = make_pair(make_autopilot(), lockstep=lockstep, longest_look=0.1).connect()
    pair.autopilot.telemetry(20)
    pair.carry()
    pair.autopilot.deaf = 1000  # until it runs again
    pair.now += stop
    pair.wait(0.4)
    assert pair.client.connected
    pair.wait(3.5)
    assert not pair.client.connected and pair.client.losses == 1


def test_on_the_robot_a_companion_that_was_stopped_asks_anew(pair):
    pair.autopilot.telemetry(20)
    pair.carry()
    pair.now += 4.0
    pair.client.poll(pair.now)
    assert not pair.client.connected


def test_a_restart_asks_again(pair):
    pair.autopilot.armed = True
    pair.autopilot.heartbeat()
    pair.autopilot.telemetry(5000)
    pair.carry()
    asked = len(pair.autopilot.of("COMMAND_LONG"))
    for boot_ms, boots in ((4950, 0), (20, 0), (40, 0), (60, 1)):
        assert pair.client.telemetry.report.armed
        pair.autopilot.telemetry(boot_ms)
        pair.carry()
        assert pair.client.telemetry.boots == boots
        assert pair.client.take_bundles()[-1].boot_us == 1000 * boot_ms
    assert not pair.client.telemetry.report.armed
    pair.wait(0.5)
    assert len(pair.autopilot.of("COMMAND_LONG")) == asked + len(TELEMETRY)


def test_a_line_that_is_gone_ends_commands(pair):
    pair.autopilot.deaf = 10
    answer = pair.ask(400, 1.0)
    pair.client.closed("unplugged", pair.now)
    assert answer.done(pair.now)
    assert answer.text == "no connection: unplugged"
    assert not pair.client.connected


# Commands ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("lost", [0, 1, 2])
def test_lost_answers_are_asked_for_again_with_confirmation(pair, lost):
    pair.autopilot.deaf = lost
    answer = pair.ask(400, 1.0)
    pair.wait(1.0)
    assert answer.accepted
    assert [m.confirmation for m in pair.autopilot.of("COMMAND_LONG") if m.command == 400] == list(
        range(lost + 1)
    )


def test_no_answer_at_all_ends_within_a_second(pair):
    pair.autopilot.deaf = 99
    answer = pair.ask(400, 1.0)
    pair.wait(0.8)
    assert not answer.done(pair.now)
    pair.wait(0.15)
    assert answer.done(pair.now)
    assert answer.text == "no answer to command 400 after 3 attempts"


@pytest.mark.parametrize("before", [True, False])
def test_a_refusal_tells_why(pair, before):
    pair.autopilot.results[400] = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    pair.autopilot.refusal = "Arming denied: throttle is high" if before else ""
    answer = pair.ask(400, 1.0)
    if not before:
        assert not answer.done(pair.now)
        pair.autopilot.text("Arming denied: throttle is high")
        pair.carry()
    assert answer.done(pair.now)
    assert not answer.accepted
    assert answer.text == "temporarily rejected: Arming denied: throttle is high"


def test_a_refusal_without_words_waits_a_moment_for_them(pair):
    pair.autopilot.results[176] = mavlink.MAV_RESULT_DENIED
    answer = pair.ask(176, 1.0, 6.0)
    assert not answer.done(pair.now)
    pair.wait(0.15)
    assert answer.done(pair.now)
    assert answer.text == "denied"


def test_progress_is_waited_for(pair):
    pair.autopilot.results[400] = mavlink.MAV_RESULT_IN_PROGRESS
    answer = pair.ask(400, 1.0)
    pair.wait(0.25)
    assert answer.sent == 1
    assert not answer.done(pair.now)


def test_answers_to_somebody_else_are_not_ours(pair):
    pair.autopilot.deaf = 99
    answer = pair.ask(400, 1.0)
    pair.autopilot.send(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190))
    pair.carry()
    assert answer.result is None


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.sampled_from([0, 1, 4, 5])), max_size=12))
def test_a_command_ends_once_and_stays_ended(steps):
    command, now = commands.CommandRequest(400, (0.0,) * 7), 0.0
    ended = None
    for answered, result in steps:
        now += 0.2
        command.due(now)
        if answered and command.sent:
            command.acknowledge(result, now)
        if ended is None and command.done(now + 1.0):
            ended = (command.result, command.problem)
        if ended is not None:
            assert (command.result, command.problem) == ended
        assert command.sent <= command.attempts
