"""The master against twelve ideal drives, tick by tick: set-up, scaling, enabling, commands."""

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ideal_drives import (
    COUNTS,
    DISABLED,
    ENABLED,
    ON,
    RATED,
    ROBOT,
    SETTINGS,
    STAND,
    TORQUE_PER_AMPERE,
    ZERO,
    IdealDrives,
    Loop,
)

from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import AlState, Identity
from husky_drivers.ethercat.commissioning import DriveError
from husky_drivers.ethercat.master import Master
from husky_drivers.joint_master.phase import Phase

# set-up


def test_configuration_writes_what_the_settings_say():
    bus = IdealDrives()
    Master(bus, SETTINGS, ROBOT).configure()

    def number(index, subindex, code):
        return struct.unpack(code, bus.objects[4, index, subindex])[0]

    assert number(0x6075, 0, "<I") == round(RATED * 1000)
    assert number(0x6073, 0, "<H") == round(ROBOT.drive.peak_current / RATED * 1000)
    assert number(0x60C2, 1, "<B") * 10 ** number(0x60C2, 2, "<b") == pytest.approx(0.002)
    window = ROBOT.drive.following_error_window
    assert number(0x6065, 0, "<I") == round(window * COUNTS)
    # cascade: outer gain kp / kd in 1/s, inner gain kd in A per count/s
    assert number(0x2112, 1, "<f") == pytest.approx(300 / 4)
    assert number(0x2111, 1, "<f") == pytest.approx(4 / TORQUE_PER_AMPERE / COUNTS)
    brake = number(0x6085, 0, "<I") / COUNTS
    assert ROBOT.joint_velocity_limit[4] / brake == pytest.approx(0.05)
    assert number(0x6007, 0, "<h") == 1
    assert bus.watchdogs == [0.05] * 12
    assert bus.al == [AlState.SAFEOP] * 12


def test_configuration_names_the_drive_that_refuses():
    bus = IdealDrives()
    bus.refuses = (5, 0x6085)
    with pytest.raises(DriveError, match=r"front_right_knee: .*0x6085.*out of range"):
        Master(bus, SETTINGS, ROBOT).configure()


def test_configuration_counts_and_identifies(monkeypatch):
    bus = IdealDrives()
    monkeypatch.setattr(bus, "slave_count", 11, raising=False)
    with pytest.raises(DriveError, match="11 slaves on the bus, expected 12"):
        Master(bus, SETTINGS, ROBOT).configure()
    bus = IdealDrives()
    monkeypatch.setattr(bus, "identity", lambda position: Identity(1, 2, 3))
    with pytest.raises(DriveError, match=r"front_left_hip_frontal.*not a Gold Twitter"):
        Master(bus, SETTINGS, ROBOT).configure()


def test_start_names_the_drive_that_stays_behind():
    bus = IdealDrives()
    master = Master(bus, SETTINGS, ROBOT)
    master.configure()
    bus.away.add(3)
    with pytest.raises(DriveError, match="front_right_hip_frontal"):
        master.start()


@pytest.mark.parametrize(
    ("name", "value"), [("tick", 0.0), ("confirm_ticks", 0), ("enable_window", math.nan)]
)
def test_settings_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        settings_of(ROBOT, **{name: value})


def test_gains_are_checked_and_written_while_running(enabled):
    for kp, kd in ((-1.0, 4.0), (math.inf, 4.0), (300.0, 0.0), (300.0, math.nan)):
        with pytest.raises(ValueError, match=r"k[pd] is"):
            enabled.master.set_gains(kp, kd).result()
    enabled.master.set_gains(200.0, 5.0).result()
    assert struct.unpack("<f", enabled.bus.objects[11, 0x2112, 1])[0] == pytest.approx(40.0)


# scaling


def test_inputs_in_si(loop):
    loop.bus.position[:] = 24576  # a tenth of a joint turn
    loop.bus.velocity[:] = -8192
    loop.bus.current[:] = 500
    loop.tick()
    assert loop.master.position == pytest.approx(np.full(12, 2 * math.pi / 10))
    assert loop.master.velocity == pytest.approx(np.full(12, -2 * math.pi / 30))
    assert loop.master.effort == pytest.approx(np.full(12, 0.5 * RATED * TORQUE_PER_AMPERE))


def test_outputs_in_the_drives_units(enabled):
    effort = np.linspace(-9.9, 9.9, 12)
    velocity = np.linspace(-2.0, 2.0, 12)
    enabled.tick(3)
    enabled.command = (8, STAND, velocity, effort)
    enabled.tick()
    for i, row in enumerate(enabled.rows):
        position, speed, torque, limit, word, mode, _, offset = row
        assert position == round(STAND[i] * COUNTS)
        assert speed == pytest.approx(velocity[i] * COUNTS, abs=0.5)
        assert offset == pytest.approx(effort[i] / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5)
        assert limit == pytest.approx(10.0 / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5)
        assert (torque, word, mode) == (0, 0x0F, 8)
    enabled.command = (10, STAND, ZERO, effort)
    enabled.tick()
    assert [row[2] for row in enabled.rows] == pytest.approx(
        effort / TORQUE_PER_AMPERE / RATED * 1e3, abs=0.5
    )
    assert {(row[5], row[7]) for row in enabled.rows} == {(10, 0)}


# enabling


def test_all_are_switched_on_before_any_is_enabled(loop):
    loop.bus.deaf.add(7)
    loop.tick()
    assert loop.master.enable() == ""
    loop.tick(50)
    assert set(loop.bus.words) == {ON, DISABLED}
    loop.bus.deaf.clear()
    loop.until(Phase.ENABLED, 100)
    assert loop.master.reason == ""


def test_states_are_confirmed_for_consecutive_readings():
    for confirm in (10, 30):
        loop = Loop(confirm_ticks=confirm)
        loop.tick()
        loop.master.enable()
        # four frames until the states are seen; twelve mode readings, one a tick
        assert loop.until(Phase.ENABLED, 200) == max(confirm, 12) + confirm + 4


def test_enabling_gives_up_after_its_timeout(loop):
    loop.bus.deaf.add(7)
    loop.tick()
    loop.master.enable()
    assert loop.until(Phase.OFF, 400) == 251
    assert loop.master.reason == "not enabled: hind_left_hip_sagittal: switch on disabled"
    loop.tick(3)
    assert set(loop.bus.words) == {DISABLED}


def test_a_mode_that_is_not_shown_is_not_trusted(loop):
    loop.bus.mode_shown = 1
    loop.tick()
    loop.master.enable()
    loop.until(Phase.OFF, 400)
    assert "a drive does not show the mode" in loop.master.reason
    assert ENABLED not in loop.bus.words


def test_targets_start_where_the_joints_are(loop):
    loop.bus.position += 1500
    loop.tick()
    loop.master.enable()
    while loop.master.phase is not Phase.ENABLED:
        loop.bus.position += 1  # still moving by hand until torque comes
        at = loop.bus.position.copy()
        was_enabled = ENABLED in loop.bus.words
        loop.tick()
        if not was_enabled:
            assert np.abs([row[0] for row in loop.rows] - at).max() <= 2
        assert {(row[1], row[2], row[7]) for row in loop.rows} == {(0, 0, 0)}
    # then they close on the command at the hand-over speed
    step = SETTINGS.handover_velocity * SETTINGS.tick * COUNTS
    last = np.array([row[0] for row in loop.rows])
    for _ in range(40):
        loop.tick()
        now = np.array([row[0] for row in loop.rows])
        assert np.abs(now - last).max() <= step + 1
        last = now
    assert last == pytest.approx(np.rint(STAND * COUNTS))


def test_position_control_after_damping_starts_at_the_joint(enabled):
    enabled.tick(3)
    enabled.command = (9, STAND, ZERO, ZERO)
    enabled.bus.position -= 4000
    enabled.tick(3)
    enabled.command = (8, STAND, ZERO, ZERO)
    enabled.tick()
    step = SETTINGS.handover_velocity * SETTINGS.tick * COUNTS
    assert np.abs([row[0] for row in enabled.rows] - enabled.bus.position).max() <= step + 1


def test_what_refuses_to_enable(loop):
    bus, master = loop.bus, loop.master
    loop.tick()
    loop.tick(5, command=False)
    assert "no joint command" in master.enable()
    loop.tick()
    loop.bus.position[8] += round(0.25 * COUNTS)
    loop.tick()
    assert "hind_left_knee: target is 0.250 rad from the joint" in master.enable()
    bus.position[8] = round(STAND[8] * COUNTS)
    bus.digital[2] = 0
    loop.tick()
    assert master.enable() == "safe torque off: front_left_knee"
    bus.digital[2] = 8
    bus.trip(4, 0x7300)
    loop.tick()
    assert master.enable() == "front_right_hip_sagittal: fault (feedback)"
    bus.words[4] = DISABLED
    bus.away.add(1)
    loop.tick()
    assert "counter 33 of 36: front_left_hip_sagittal does not answer" in master.enable()
    bus.away.clear()
    loop.tick()
    assert master.enable() == ""
    assert "drives are not off" in master.enable()


# commands


def replace(values, where, value):
    changed = np.array(values)
    changed[where] = value
    return changed


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ((8, replace(STAND, 5, math.nan), ZERO, ZERO), "front_right_knee: position"),
        ((8, STAND, replace(ZERO, 0, math.inf), ZERO), "velocity .* not finite"),
        (
            (8, STAND, ZERO, replace(ZERO, 11, -10.5)),
            r"hind_right_knee: effort .* -10.5 is outside",
        ),
        ((8, replace(STAND, 2, 0.3), ZERO, ZERO), "front_left_knee: position .* outside"),
        ((9, STAND, np.full(12, 30.0), ZERO), "velocity .* 30 is outside"),
        ((1, STAND, ZERO, ZERO), "mode of operation 1 is not one of"),
        ((8, STAND[:11], ZERO, ZERO), "11 numbers of position"),
    ],
)
def test_bad_commands_are_refused_whole(enabled, command, words):
    enabled.tick(3)
    before = enabled.rows
    reason = enabled.master.set_command(*command)
    assert re.search(words, reason), reason
    assert enabled.master.refused_commands == 1
    enabled.master.exchange()
    assert enabled.rows == before


def test_refused_commands_do_not_feed_the_watchdog(enabled):
    for _ in range(6):
        enabled.master.set_command(8, np.full(12, math.nan), ZERO, ZERO)
        enabled.master.exchange()
    assert enabled.master.phase is Phase.SETTLING
    assert enabled.master.reason == "no joint command"


@given(
    st.lists(st.floats(width=64, allow_nan=True, allow_infinity=True), min_size=36, max_size=36),
    st.integers(-128, 127),
)
@settings(max_examples=60)
def test_any_command_leads_to_an_answer_and_to_numbers_that_fit(values, mode):
    values = np.array(values)
    reason = RUNNING.master.set_command(mode, values[:12], values[12:24], values[24:])
    within = (
        mode in (8, 9, 10)
        and np.isfinite(values).all()
        and np.all(np.abs(values[12:24]) <= 29.7)
        and np.all(np.abs(values[24:]) <= 10.0)
        and np.all(values[:12] >= SETTINGS.position_lower)
        and np.all(values[:12] <= SETTINGS.position_upper)
    )
    assert (reason == "") == within
    RUNNING.master.exchange()


RUNNING = Loop()
