"""The master against twelve ideal drives: what stops them, lost drives, resets, garbage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ideal_drives import (
    COUNTS,
    DISABLED,
    ENABLED,
    FAULT,
    ON,
    RATED,
    ROBOT,
    SETTINGS,
    STOPPING,
    ZERO,
    Loop,
)

from husky_description.kinematics import Kinematics
from husky_drivers.joint_master.phase import Phase

# stopping


LONGEST = 0.65
"""Time from the last command in which all torque goes, with a brake that never ends [s]."""


def test_silence_puts_the_robot_down_and_then_stops_all_drives(enabled):
    """Targets go from the stance to the perch without a jump; no drive brakes before they have."""
    enabled.tick(5)
    enabled.bus.brake = 10_000  # a brake that never ends
    targets, ticks = [], 0
    while ENABLED in enabled.bus.words or STOPPING in enabled.bus.words:
        enabled.tick(command=False)
        ticks += 1
        if enabled.master.phase is Phase.SETTLING:
            assert {row[4] for row in enabled.rows} == {0x0F} and {
                row[5] for row in enabled.rows
            } == {8}
            targets.append([row[0] / COUNTS for row in enabled.rows])
    assert 0.5 < ticks * SETTINGS.tick <= LONGEST
    assert enabled.master.phase is Phase.OFF
    assert enabled.master.reason == "no joint command"
    assert np.abs(np.diff(targets, axis=0)).max() < 0.06  # rad a tick, below the joints' limit
    feet = Kinematics(ROBOT).foot_positions(np.array(targets[-1]))
    np.testing.assert_allclose(-feet[:, 2], ROBOT.sit_height, atol=0.001)


def test_a_cut_takes_torque_with_the_next_frame(enabled):
    enabled.tick(5)
    enabled.master.cut("cut")
    enabled.tick()
    assert {(row[3], row[4]) for row in enabled.rows} == {(0, 0)}
    assert enabled.master.phase is Phase.OFF and "emergency stop" in enabled.master.enable()


def test_a_cut_ends_a_stop_that_is_under_way(enabled):
    enabled.tick(5)
    enabled.master.emergency_stop()
    enabled.tick(20)
    assert enabled.master.phase is Phase.SETTLING
    enabled.master.cut("cut")
    enabled.tick()
    assert {(row[3], row[4]) for row in enabled.rows} == {(0, 0)}


def test_joints_that_do_not_follow_positions_are_held_at_rest(enabled):
    """A robot that sinks damped, or has no torque, does not stand: there is nothing to settle."""
    enabled.command = (9, ZERO, ZERO, ZERO)
    enabled.tick(5)
    enabled.master.disable()
    enabled.tick()
    assert {(row[1], row[5], row[7]) for row in enabled.rows} == {(0, 9, 0)}
    assert enabled.until(Phase.QUICK_STOP, 400) + 1 == SETTINGS.hold_ticks


def test_drives_off_after_their_brake(enabled):
    enabled.until(Phase.OFF, 400, command=False)
    assert set(enabled.bus.words) == {DISABLED}
    enabled.tick(2)
    assert {row[3] for row in enabled.rows} == {0}  # no torque is allowed either


def test_commands_that_come_back_do_not_enable(enabled):
    enabled.tick(20, command=False)
    enabled.tick(400)
    assert enabled.master.phase is Phase.OFF
    assert set(enabled.bus.words) == {DISABLED}


def test_a_few_lost_commands_are_bridged(enabled):
    enabled.tick(4)
    before = enabled.rows
    enabled.tick(4, command=False)
    enabled.tick()
    assert enabled.master.phase is Phase.ENABLED
    assert enabled.rows == before


def test_emergency_stop_is_latched(enabled):
    enabled.master.emergency_stop()
    enabled.until(Phase.QUICK_STOP, 400)
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x02}
    enabled.until(Phase.OFF, 20)
    assert "emergency stop" in enabled.master.enable()
    assert enabled.master.emergency_stopped
    assert enabled.master.reset_faults() == ""
    enabled.until(Phase.OFF, 20)
    assert not enabled.master.emergency_stopped
    enabled.enable()


def test_emergency_stop_works_without_a_controller_and_when_off(loop):
    loop.master.emergency_stop()
    loop.tick(10, command=False)
    loop.tick()
    assert "emergency stop" in loop.master.enable()


def test_disable(enabled):
    enabled.master.disable()
    enabled.until(Phase.OFF, 400)
    assert enabled.master.reason == "disabled"


def test_restart_forgets_the_command_and_takes_torque_with_the_next_frame(enabled):
    enabled.tick(5)
    enabled.master.restart("the world has been reset")
    enabled.tick(command=False)
    assert {(row[3], row[4]) for row in enabled.rows} == {(0, 0)}
    assert enabled.master.reason == "the world has been reset"
    assert "no joint command" in enabled.master.enable()


# lost drives


@pytest.mark.parametrize(("mode", "ticks"), [(8, 285), (9, SETTINGS.hold_ticks)])
def test_without_one_lost_drive_the_others_settle_then_stop(enabled, mode, ticks):
    enabled.command = (mode, *enabled.command[1:])
    enabled.tick(5)
    enabled.bus.trip(5, 0x8611)
    enabled.tick(2)
    assert enabled.master.phase is Phase.SETTLING
    assert enabled.master.reason == "front_right_knee: fault (position tracking)"
    enabled.tick()
    rows = enabled.rows
    assert [row[4] for row in rows] == [0x0F] * 5 + [0x00] + [0x0F] * 6
    assert {row[5] for row in rows} == {mode}
    assert enabled.until(Phase.QUICK_STOP, 400) + 2 == ticks
    enabled.until(Phase.OFF, 20)
    assert enabled.bus.words == [DISABLED] * 5 + [FAULT] + [DISABLED] * 6
    assert enabled.master.reason == "front_right_knee: fault (position tracking)"


@pytest.mark.parametrize("left_in", [DISABLED, ON])
def test_a_drive_that_falls_without_a_command_is_not_taken_back(enabled, left_in):
    enabled.tick(5)
    enabled.bus.words[3] = left_in
    enabled.tick(2)
    assert enabled.master.phase is Phase.SETTLING
    enabled.tick()
    assert enabled.rows[3][4] == 0x00
    enabled.until(Phase.OFF, 400)
    assert ENABLED not in enabled.bus.words


def test_settling_goes_on_when_the_controller_dies_too(enabled):
    enabled.bus.trip(5, 0x8611)
    enabled.tick(2)
    enabled.tick(6, command=False)
    assert enabled.master.phase is Phase.SETTLING
    assert "front_right_knee" in enabled.master.reason


def test_all_drives_lost_is_off_at_once(enabled):
    enabled.bus.words = [DISABLED] * 12
    enabled.tick(3)
    assert enabled.master.phase is Phase.OFF


def test_a_drive_lost_while_enabling(loop):
    loop.tick()
    loop.master.enable()
    while ENABLED not in loop.bus.words:
        loop.tick()
    loop.bus.words[9] = DISABLED
    loop.tick(2)
    assert loop.master.phase in (Phase.QUICK_STOP, Phase.OFF)
    assert "hind_right_hip_frontal: switch on disabled" in loop.master.reason
    loop.until(Phase.OFF, 20)


# fault reset


def test_reset_is_an_edge_on_faulty_drives_only(loop):
    loop.bus.trip(5, 0x8611)
    loop.bus.deaf.add(5)
    loop.tick()
    assert loop.master.reset_faults() == ""
    words = []
    for _ in range(6):
        loop.tick()
        words.append([row[4] for row in loop.rows])
    assert {tuple(sorted(set(w))) for w in words} == {(0x00,), (0x00, 0x80)}
    assert all(w[i] == 0 for w in words for i in range(12) if i != 5)
    assert [w[5] for w in words] in ([0, 0x80] * 3, [0x80, 0] * 3)
    loop.bus.deaf.clear()
    loop.until(Phase.OFF, 30)
    assert loop.master.status()[5].error_code == 0
    loop.enable()


def test_faults_are_not_reset_unasked(loop):
    loop.bus.trip(5, 0x8611)
    loop.tick(200)
    assert loop.bus.words[5] == FAULT
    status = loop.master.status()[5]
    assert (status.error_code, status.error) == (0x8611, "position tracking")


def test_a_reset_that_does_not_help_says_so(loop):
    loop.bus.trip(5, 0x2340)
    loop.bus.deaf.add(5)
    loop.tick()
    loop.master.reset_faults()
    loop.until(Phase.OFF, 300)
    assert loop.master.reason == "not reset: front_right_knee: fault (short circuit)"


def test_reset_is_refused_while_drives_run(enabled):
    assert "drives are not off" in enabled.master.reset_faults()


# working counter


def test_inputs_of_a_short_exchange_are_not_used(enabled):
    enabled.tick(3)
    before = enabled.master.position.copy()
    enabled.bus.away.add(0)
    enabled.bus.position += 5000
    assert enabled.master.set_command(*enabled.command) == ""
    assert not enabled.master.exchange()
    assert enabled.master.position == pytest.approx(before)
    assert enabled.master.working_counter == 33
    assert enabled.master.short_cycles == 1
    enabled.bus.away.clear()
    enabled.tick()
    assert enabled.master.phase is Phase.ENABLED
    assert enabled.master.position != pytest.approx(before)


def test_short_exchanges_in_a_row_stop_all_drives(enabled):
    enabled.bus.away.add(0)
    enabled.tick(2)
    assert enabled.master.phase is Phase.ENABLED
    enabled.tick()
    assert enabled.master.phase is Phase.SETTLING
    assert "front_left_hip_frontal does not answer" in enabled.master.reason
    enabled.until(Phase.QUICK_STOP, 400)
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x02}
    # nothing is heard of the drives any more: torque is taken by the clock
    assert enabled.until(Phase.OFF, 100) < SETTINGS.quick_stop_timeout_ticks
    enabled.tick()
    assert {row[4] for row in enabled.rows} == {0x00}


def test_a_drive_that_left_op_is_brought_back_by_a_reset(enabled):
    enabled.bus.al[6] = 0x14
    enabled.bus.words[6] = DISABLED
    enabled.tick(400)
    assert "hind_left_hip_frontal left OP (process data watchdog)" in enabled.master.reason
    enabled.master.reset_faults()
    enabled.until(Phase.OFF, 50)
    enabled.enable()


# garbage


@given(st.lists(st.binary(min_size=264, max_size=264), min_size=1, max_size=6), st.integers(0, 60))
@settings(max_examples=25)  # each takes 50 ms
def test_garbage_from_the_drives_never_raises(frames, counter):
    loop = Loop()
    loop.enable()
    honest = loop.bus.exchange
    for data in frames:
        loop.bus.exchange = lambda outputs, data=data: (
            honest(outputs) and (memoryview(data), counter)
        )
        loop.tick()
        loop.master.status()
    loop.bus.exchange = honest
    for _ in range(500):
        loop.tick(command=False)
    assert loop.master.phase is Phase.OFF
    assert ENABLED not in loop.bus.words


def test_status_tells_what_the_drive_tells(enabled):
    enabled.bus.current[3] = -250
    enabled.bus.position[3] -= 391
    enabled.bus.digital[4] = 0
    enabled.tick(5)
    enabled.master.poll_mailbox()
    rows = enabled.master.status()
    assert [row.joint for row in rows] == list(ROBOT.joint_names)
    assert rows[3].statusword == 0x1237
    assert rows[3].state.title == "operation enabled"
    assert rows[3].current == pytest.approx(-0.25 * RATED)
    assert rows[3].bus_voltage == pytest.approx(22.2)
    assert rows[3].following_error == pytest.approx(391 / COUNTS, rel=0.01)
    assert rows[3].mode_of_operation == 8
    assert (rows[3].safe_torque_off, rows[4].safe_torque_off) == (False, True)


def test_stop_removes_torque_and_closes(enabled):
    enabled.master.stop()
    assert {row[4] for row in enabled.rows} == {0}
    assert not enabled.bus.opened
