"""The dialogue with a scripted device in simulated time: order, repetition, loss, wrong rates."""

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vn200_script import DIALOGUE, STEP, Line, Script, streaming_line

from husky_drivers.vn200.binary import IMU_LAYOUT
from husky_drivers.vn200.protocol import BAUDS, ProtocolError
from husky_drivers.vn200.requests import scan_order
from husky_drivers.vn200.session import SessionConfig, SessionState


# Start ------------------------------------------------------------------------------------------
def test_the_dialogue_with_a_device_from_the_factory():
    line = streaming_line()
    assert line.device.heard == DIALOGUE
    assert line.session.setup.model == "VN-200T-CR"
    assert len(line.samples) == pytest.approx(80, abs=2)


def test_a_device_at_the_right_rate_is_not_told_to_change_it():
    line = streaming_line(device=Script(baud=921600))
    assert line.device.heard == DIALOGUE[2:]


@pytest.mark.parametrize("at_new", [False, True])
@pytest.mark.parametrize("baud", [b for b in BAUDS if b != 921600])
def test_the_reply_to_a_change_of_rate_may_come_at_either(baud, at_new):
    line = Line(Script(baud, at_new))
    line.run_until(SessionState.STREAMING, 1.5)
    assert line.device.baud == 921600


def test_another_rate_and_divisor_can_be_wanted():
    line = Line(baud=230400, rate=400)
    line.run_until(SessionState.CONFIGURING, 1.0)
    line.run(0.1)
    assert b"$VNWRG,05,230400" in b"".join(line.device.heard)
    assert line.device.output == ("1", "2", "01", "0131")


@pytest.mark.parametrize("lost", range(1, len(DIALOGUE)))
def test_one_lost_message_of_the_dialogue_is_made_up_for(lost):
    device = Script()
    line = Line(device)
    for _ in range(lost):
        before = len(device.heard)
        while len(device.heard) == before:
            line.step()
    device.lose = 1
    line.run_until(SessionState.STREAMING, 2.0)
    line.run(0.1)
    assert len(line.samples) > 70


def test_a_request_without_echo_is_repeated_every_half_second():
    device = Script(baud=921600)
    line = Line(device)
    line.run_until(SessionState.CONFIGURING, 1.0)
    device.lose = 2
    line.run(1.2)
    times = [time for time, _, data in line.sent if data == DIALOGUE[3]]
    assert len(times) == 3
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([0.5, 0.5], abs=2 * STEP)
    assert line.session.state is SessionState.STREAMING


def test_a_device_that_answers_something_else_is_asked_again_not_believed():
    device = Script(baud=921600)
    line = Line(device)
    line.run_until(SessionState.CONFIGURING, 1.0)
    device.answer = lambda data: b"$VNRRG,06,1*68\r\n"
    line.run(1.0)
    assert line.session.state is SessionState.CONFIGURING
    device.answer = None
    line.run_until(SessionState.STREAMING, 1.0)


def test_another_makers_device_is_reported_and_not_used():
    device = Script(baud=921600)
    device.model = "XY-7"
    line = Line(device)
    line.run(1.0)
    assert line.session.state is SessionState.CONFIGURING
    assert "XY-7" in line.session.problem


def test_a_refusal_is_reported():
    device = Script(baud=921600)
    line = Line(device)
    line.run_until(SessionState.CONFIGURING, 1.0)
    device.answer = lambda data: b"$VNERR,0C*02\r\n"
    line.run(0.7)
    assert line.session.problem == "device error 0C (insufficient baud rate)"
    assert line.session.device_errors == 2


def test_damage_on_the_way_to_the_device_is_made_up_for_at_once():
    device = Script(baud=921600)
    line = Line(device)
    line.run_until(SessionState.CONFIGURING, 1.0)
    device.answer = lambda data: b"$VNERR,03*72\r\n"
    line.run(0.01)
    device.answer = None
    assert line.run_until(SessionState.STREAMING, 1.0) < 0.1


# Registers that somebody else has set -------------------------------------------------------------
def configured(limit=0.5, **registers):
    """Return a line whose device at the right rate had these registers, and what was written."""
    device = Script(921600, **registers)
    line = Line(device)
    line.run_until(SessionState.STREAMING, limit)
    return line, [data.decode().split("*")[0] for data in device.heard if b"WRG" in data]


def test_outputs_of_others_go_off_before_ours_goes_on():
    line, written = configured(
        r75=("1", "16", "01", "0029"),
        r76=("1", "4", "05", "0139", "000C"),
        r77=("3", "80", "01", "1"),
    )
    assert written == [
        "$VNWRG,06,0",
        "$VNWRG,76,0,4,05,0139,000C",
        "$VNWRG,77,2,80,01,1",  # port 2 keeps what it gets
        "$VNWRG,75,1,1,01,0131",
    ]
    assert list(line.session.setup.changes.values()) == [
        "ASCII output VNYPR was on: turned off",
        "binary output 2 was on at 200 Hz (1,4,05,0139,000C): turned off",
        "binary output 3 was on at 10 Hz (3,80,01,1): turned off",
        "binary output 1 was 1,16,01,0029: set to 1,1,01,0131",
    ]


def test_a_device_that_is_as_it_should_be_is_not_written_to():
    line, written = configured(r06=("0",), r75=("1", "01", "1", "131"), r76=("2", "4", "01", "29"))
    assert written == []
    assert line.session.setup.changes == {}


def test_groups_that_we_do_not_know_are_turned_off_all_the_same():
    _, written = configured(r76=("1", "4", "81", "8139", "0001"), r06=("19",))
    assert written[:2] == ["$VNWRG,06,0", "$VNWRG,76,0,4,81,8139,0001"]


def test_register_30_gets_what_the_dialogue_needs_and_keeps_the_rest():
    line, written = configured(r30=("2", "1", "1", "2", "0", "2", "0"))
    assert written[0] == "$VNWRG,30,0,0,1,2,1,2,1"
    assert line.session.setup.changes[30] == (
        "protocol control was 2,1,1,2,0,2,0: set to 0,0,1,2,1,2,1"
    )


def test_a_turned_frame_is_refused_until_somebody_corrects_it():
    device = Script(921600, r26=("0", "1", "0", "-1", "0", "0", "0", "0", "1"))
    line = Line(device)
    line.run(3.0)
    assert line.session.state is SessionState.CONFIGURING
    assert line.session.problem == (
        "reference frame rotation (register 26) is 0,1,0,-1,0,0,0,0,1, "
        "expected 1,0,0,0,1,0,0,0,1: all samples would be turned. If the device is mounted so, set "
        "the parameter frame_rotation; if not, send $VNWRG,26,1,0,0,0,1,0,0,0,1*XX, $VNWNV*57, "
        "$VNRST*4D"
    )
    assert not any(b"WRG" in data for data in device.heard)
    device.registers["26"] = ("1.0", "0", "0", "0", "+1", "0", "0", "0", "1.000000")
    line.run_until(SessionState.STREAMING, 1.0)
    assert line.session.problem == ""


def test_a_turned_frame_can_be_what_is_wanted():
    turned = ("-1", "0", "0", "0", "-1", "0", "0", "0", "1")
    line = Line(Script(921600, r26=turned), frame_rotation=tuple(float(c) for c in turned))
    line.run_until(SessionState.STREAMING, 0.5)


@pytest.mark.parametrize("held", [(), ("1",), ("nan",) * 9, ("1", "x", *"0000000")])
def test_a_frame_that_is_none_is_refused(held):
    line = Line(Script(921600, r26=held))
    line.run(1.0)
    assert line.session.problem.startswith("reference frame rotation (register 26) is ")


def test_a_register_30_that_is_too_short_is_told():
    line = Line(Script(921600, r30=("0", "0")))
    line.run(1.0)
    assert line.session.problem == "register 30 holds '0,0'"


def test_output_is_off_before_a_slower_line_must_carry_it():
    device = Script(921600, r75=("1", "1", "01", "0139"), r76=("1", "1", "01", "0029"))
    line = Line(device, baud=230400, rate=400)
    line.run_until(SessionState.CHANGING_BAUD, 0.5)
    assert (device.registers["75"][0], device.registers["76"][0], device.registers["06"]) == (
        "0",
        "0",
        ("0",),
    )
    line.run_until(SessionState.CONFIGURING, 0.5)
    line.run(0.1)
    assert device.baud == 230400
    assert line.session.setup.changes[5] == "baud rate was 921600: set to 230400"
    assert device.registers["75"] == ("1", "2", "01", "0131")


# Rates ------------------------------------------------------------------------------------------
def test_the_scan_visits_every_rate_and_the_likely_ones_often():
    order = scan_order(57600, 921600)
    assert order[0] == 57600
    assert set(order) == set(BAUDS)
    for start in range(len(order) - 5):
        assert {115200, 921600} & set(order[start : start + 6])


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("delay", [0.0, 0.13, 0.29, 0.47, 0.61, 0.83])
def test_a_device_that_comes_back_at_any_rate_is_found(baud, delay):
    """Back within 1 s at the likely rates, within 1.5 s at any, whatever the scan was doing."""
    line = Line(Script())
    line.device.silent = True
    line.run(1.0 + delay)
    line.device.silent = False
    line.device.baud = baud
    took = line.run_until(SessionState.STREAMING, 1.5)
    assert took < (1.0 if baud in (921600, 115200) else 1.5)


# Silence ----------------------------------------------------------------------------------------
def test_silence_makes_the_line_stale_and_the_device_is_asked_without_disturbing_it():
    line = streaming_line()
    heard = len(line.device.heard)
    line.device.tick = lambda: b""
    took = line.run_until(SessionState.STALE, 1.0)
    assert took == pytest.approx(0.05, abs=2 * STEP)
    line.run(0.2)
    assert line.device.heard[heard : heard + 2] == [b"$VNRRG,75*71\r\n", b"$VNASY,1*4E\r\n"]
    line.run(2.0)
    assert line.session.state is SessionState.STALE
    assert DIALOGUE[0] not in line.device.heard[heard:]
    assert line.reopened == 0
    del line.device.tick
    line.run_until(SessionState.STREAMING, 0.01)
    assert line.session.times_stale == 1


def test_a_world_that_stands_still_is_no_silence_to_tell_of():
    device, later = Script(), [0.0]
    line = streaming_line(device, world_time=lambda: device.time + later[0])
    line.device.tick = lambda: b""
    line.run(2.0)
    assert line.session.state is SessionState.STALE  # the device is asked, and answers
    assert line.session.told_state is SessionState.STREAMING and line.session.times_stale == 0
    later[0] = 0.06
    line.run(0.3)
    assert line.session.told_state is SessionState.STALE and line.session.times_stale == 1
    del line.device.tick
    line.run_until(SessionState.STREAMING, 0.01)
    assert line.session.times_stale == 1


def test_silence_in_a_world_that_begins_again():
    device, world = Script(), [0.0]
    line = streaming_line(device, world_time=lambda: world[0])
    line.device.tick = lambda: b""
    line.run(0.2)
    assert line.session.told_state is SessionState.STREAMING
    world[0] = 0.06
    line.run(0.2)
    assert line.session.told_state is SessionState.STALE


def test_a_dead_line_is_reopened():
    line = streaming_line()
    line.device.silent = True
    line.run(0.05 + 0.25 + 3 * STEP)
    assert line.reopened == 1
    line.run(3.0)
    assert line.reopened >= 3  # once for each scan in vain
    line.device.silent = False
    assert line.run_until(SessionState.STREAMING, 2.0) < 1.0


def test_a_paused_device_is_resumed():
    line = streaming_line()
    line.device.paused = True
    line.run_until(SessionState.STALE, 0.1)
    assert line.run_until(SessionState.STREAMING, 1.0) < 0.1


def test_a_device_that_forgot_its_setting_is_configured_again():
    line = streaming_line()
    line.device.output = ("0", "1", "00")
    line.run_until(SessionState.CONFIGURING, 0.1)
    assert line.run_until(SessionState.STREAMING, 1.0) < 0.1


def test_a_device_that_restarts_at_its_flash_settings_is_found_again():
    line = streaming_line()
    line.device.output = ("0", "1", "00")
    line.device.baud = 115200
    line.run_until(SessionState.STALE, 0.1)
    assert line.run_until(SessionState.STREAMING, 2.0) < 1.0


def test_garbage_from_a_stale_line_raises_doubt_about_its_rate_at_once():
    line = streaming_line(silence_timeout=60.0)
    line.device.silent = True
    line.run_until(SessionState.STALE, 0.1)
    for _ in range(5):
        line.session.feed(bytes(50), line.now)
    assert line.session.state is SessionState.PROBING
    assert not line.session.reopen_wanted


def test_a_frozen_sample_is_no_sample():
    line = streaming_line()
    line.device.frozen = True
    count = len(line.samples)
    line.run(0.5)
    assert line.session.state is SessionState.STALE
    assert line.reopened == 0
    assert len(line.samples) == count
    assert line.session.samples.counters.repeated > 300
    line.device.frozen = False
    line.run_until(SessionState.STREAMING, 0.01)


# Anything ---------------------------------------------------------------------------------------
@settings(max_examples=60)
@given(
    chaos=st.lists(
        st.one_of(
            st.tuples(st.just("feed"), st.binary(max_size=80)),
            st.tuples(
                st.just("feed"),
                st.sampled_from(
                    [
                        *DIALOGUE,
                        b"$VNERR,03*72\r\n",
                        b"$VNERR,zz*48\r\n",
                        b"$VNERR*5E\r\n",
                        b"$VNRRG*4B\r\n",
                        b"$VNRRG,75*71\r\n",
                        b"$VNRRG,01,VN-200T-CR*31\r\n",
                        b"$VNRRG,75,1,4,01,0139*7E\r\n",
                        IMU_LAYOUT.encode(5, 0, 0, 0, 1, 0, 0, 0, 0, 0, -9.81),
                        IMU_LAYOUT.encode(5, 0, 0, 0, math.nan, 0, 0, 0, 0, 0, math.inf),
                    ]
                ),
            ),
            st.tuples(st.just("wait"), st.floats(0.0, 3.0)),
            st.tuples(st.just("start"), st.none()),
        ),
        max_size=30,
    ),
    baud=st.sampled_from(BAUDS),
)
def test_whatever_arrives_nothing_raises_and_a_good_device_is_found_afterwards(chaos, baud):
    line = Line(Script(baud))
    session = line.session
    for what, value in chaos:
        if what == "feed":
            session.feed(value, line.now)
        elif what == "start":
            session.start(line.now)
        else:
            line.now += value
        if line.now >= session.deadline:
            session.poll(line.now)
        assert session.baud in BAUDS
        assert line.now <= session.deadline < line.now + 60.0
    line.run_until(SessionState.STREAMING, 4.0)


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"baud": 100000}, "baud is 100000, it must be one of"),
        ({"rate": 300}, "rate is 300 Hz, it must be a divisor of 800"),
        ({"baud": 115200}, "rate is 800 Hz: packets of 54 bytes fit into 115200 baud up to 213 Hz"),
        ({"stale_after": 0.001}, "stale_after is 0.001 s, it must be within 0.0025 and 60"),
        ({"silence_timeout": math.nan}, "silence_timeout is nan s"),
        ({"frame_rotation": (1.0,) * 9}, "frame_rotation is .* nine numbers of a rotation matrix"),
        ({"frame_rotation": (1.0,)}, "frame_rotation is .1.0., it must be nine numbers"),
        ({"frame_rotation": (-1.0, 0, 0, 0, -1.0, 0, 0, 0, -1.0)}, "must be nine numbers"),
    ],
)
def test_a_bad_configuration_says_what_is_allowed(config, words):
    with pytest.raises(ValueError, match=words):
        SessionConfig(**config)


def test_scripted_device_refuses_nonsense():
    """The script itself must not take damaged requests for good ones."""
    with pytest.raises(ProtocolError):
        Script().hear(b"$VNASY,0*00\r\n", 115200)
