"""The pilot's joystick as sticks and switches, the schedule of frames, and the line they go on."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_pu.radio.rc_mapping import FrameSchedule, JoyLayout, JoyQueue, RcMapping
from husky_pu.radio.sbus import BAUD, SbusChannel, SbusParser, encode, frame_of_pulses
from husky_pu.radio.sbus_line import SbusLine
from husky_runtime.ports.pty_port import PtyPort

LAYOUT = JoyLayout(throttle=1, roll=3, pitch=4, yaw=0, arm=0, kill=1, mode=2)


def pulses(mapping, axes=(0.0,) * 5, buttons=(0, 0, 0), now=0.0):
    assert mapping.joy(axes, buttons, now)
    return mapping.frame(now).pulses


@pytest.mark.parametrize(
    ("axes", "channel", "pulse"),
    [
        ((0, -1, 0, 0, 0), SbusChannel.THROTTLE, 1000),
        ((0, 0, 0, 0, 0), SbusChannel.THROTTLE, 1500),
        ((0, 1, 0, 0, 0), SbusChannel.THROTTLE, 2000),
        ((0, 0, 0, 1, 0), SbusChannel.ROLL, 1000),
        ((0, 0, 0, 0, 1), SbusChannel.PITCH, 2000),
        ((1, 0, 0, 0, 0), SbusChannel.YAW, 1000),
        ((0.01, 0, 0, 0, 0), SbusChannel.YAW, 1500),
        ((-0.5, 0, 0, 0, 0), SbusChannel.YAW, 1500 + 500 * 0.48 / 0.98),
        ((7.0, 0, 0, 0, 0), SbusChannel.YAW, 1000),
    ],
)
def test_sticks(axes, channel, pulse):
    step = 1000 / 1600
    assert pulses(RcMapping(LAYOUT), axes)[channel] == pytest.approx(pulse, abs=step)


def test_a_throttle_that_springs_back_rests_at_none():
    mapping = RcMapping(LAYOUT, upper_half=True)
    for stick, pulse in ((-1.0, 1000), (0.0, 1000), (1.0, 2000)):
        assert pulses(mapping, (0, stick, 0, 0, 0))[SbusChannel.THROTTLE] == pulse


def test_switches_are_levels():
    mapping = RcMapping(LAYOUT)
    for buttons in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (0, 0, 0)):
        found = pulses(mapping, buttons=buttons)
        wanted = tuple(2000 if button else 1000 for button in buttons)
        assert (found[SbusChannel.ARM], found[SbusChannel.KILL], found[SbusChannel.MODE]) == wanted


def test_momentary_buttons_turn_switches_over():
    mapping = RcMapping(LAYOUT, momentary=True)
    arm = [pulses(mapping, buttons=(b, 0, 0))[SbusChannel.ARM] for b in (0, 1, 1, 0, 1, 0)]
    assert arm == [1000, 2000, 2000, 2000, 1000, 1000]


def test_silence_is_failsafe_with_throttle_low():
    mapping = RcMapping(LAYOUT)
    assert mapping.frame(0.0).failsafe
    mapping.joy((0, 1, 0, 1, 0), (1, 0, 0), 10.0)
    assert not mapping.frame(10.5).failsafe
    frame = mapping.frame(10.51)
    assert frame.failsafe
    assert frame.pulses[SbusChannel.THROTTLE] == 1000
    assert frame.pulses[SbusChannel.ROLL] == 1500
    assert frame.pulses[SbusChannel.ARM] == 2000
    mapping.restart(0.0)
    assert not mapping.frame(0.4).failsafe
    assert mapping.frame(0.6).failsafe


@pytest.mark.parametrize(
    ("axes", "buttons", "reason"),
    [
        ((0, math.nan, 0, 0, 0), (0, 0, 0), "axis 1 for throttle is nan"),
        ((0, 0, 0, math.inf, 0), (0, 0, 0), "axis 3 for roll is inf"),
        ((0, 0), (0, 0, 0), "no axis 3 for roll, there are 2"),
        ((0, 0, 0, 0, 0), (), "no button 0 for arm, there are 0"),
    ],
)
def test_a_bad_message_is_refused_whole(axes, buttons, reason):
    mapping = RcMapping(LAYOUT)
    mapping.joy((0.5, -1, 0, 0, 0), (1, 0, 0), 0.0)
    before = mapping.frame(0.1)
    assert not mapping.joy(axes, buttons, 0.4)
    assert (mapping.refused, mapping.refusal) == (1, reason)
    assert mapping.frame(0.1) == before
    assert mapping.frame(0.6).failsafe


def test_what_is_nowhere_rests():
    mapping = RcMapping(JoyLayout(-1, -1, -1, -1, -1, -1, -1))
    found = pulses(mapping, (), ())
    assert found[:7] == (1500, 1500, 1000, 1500, 1000, 1000, 1000)


@given(st.lists(st.integers(0, 30_000_000), max_size=60), st.sampled_from([0, 10_000_000]))
def test_each_multiple_of_the_period_has_its_frame_once(steps, ahead):
    schedule, time_ns, sent = FrameSchedule(14_000_000, ahead), 0, []
    assert list(schedule.due(0)[0]) == []
    for step in steps:
        time_ns += step
        frames, back = schedule.due(time_ns)
        assert not back
        sent += frames
    assert sent == list(range(1, (time_ns + ahead) // 14_000_000 + 1 if steps else 1))


def test_a_flight_controller_never_waits_for_the_clock_that_waits_for_it():
    schedule, sent = FrameSchedule(14_000_000, 10_000_000), 0
    for tick in range(0, 2_000_000_000, 2_000_000):
        if tick % 10_000_000 == 0:
            sent += len(schedule.due(tick)[0])
        assert sent >= tick // 14_000_000


def test_a_reset_and_a_jump_begin_anew():
    schedule = FrameSchedule(14_000_000)
    schedule.due(5_000_000_000)
    assert schedule.due(28_000_000) == (range(2, 3), True)
    assert list(schedule.due(28_000_000 + 50 * 14_000_000)[0]) == list(range(3, 53))
    frames, back = schedule.due(60_000_000_000)  # frame 4286 is due at 60.004 s
    assert (list(frames), back) == ([], False)
    assert list(schedule.due(60_004_000_000)[0]) == [4286]


def test_the_line_survives_losing_its_port(tmp_path):
    path, frame = tmp_path / "sbus", encode(frame_of_pulses([1234.0] * 16))
    line = SbusLine(str(path))
    assert not line.write(frame, 0.0)
    assert (line.connected, line.dropped) == (False, 1)
    parser = SbusParser()
    with PtyPort(path) as port:
        assert not line.write(frame, 0.05)  # too early to look again
        assert line.write(frame, 0.2)
        assert len(parser.feed(port.read(BAUD))) == 1
        assert port.host_baud == BAUD
        port.unplug()
        assert not line.write(frame, 1.0)
        assert line.error
        port.replug()
        assert line.write(frame, 2.0)
        assert parser.feed(port.read(BAUD)) == parser.feed(frame)
    assert (line.sent, line.connections, parser.garbage_bytes) == (2, 2, 0)
    line.close()
    assert not line.connected


def test_a_joystick_message_counts_from_the_first_time_after_its_stamp():
    """So it does not matter whether it came before or after the clock of its own time."""
    for told_before in (False, True):
        queue = JoyQueue()
        if told_before:
            assert list(queue.due(0.10)) == []
        queue.push(0.10, [1.0], [0], 0.10 if told_before else 0.09)
        assert list(queue.due(0.10)) == []
        assert list(queue.due(0.11)) == [([1.0], [0])]
        assert list(queue.due(0.12)) == []


@pytest.mark.parametrize("stamp", [0.0, 1.8e9])
def test_a_stamp_of_another_clock_counts_at_once(stamp):
    queue = JoyQueue()
    queue.push(stamp, [1.0], [0], 40.0)
    assert list(queue.due(40.0)) == [([1.0], [0])]


def test_what_waits_is_forgotten_when_time_goes_back():
    queue = JoyQueue()
    queue.push(40.0, [1.0], [0], 40.0)
    queue.clear()
    assert list(queue.due(41.0)) == []
