"""The simulated Gold Twitter: what trips it, watchdogs, injected faults."""

import math

import pytest
from drive_rig import AXIS, JOINT, RATED, ROBOT, TICK, Rig

from husky_drivers.cia402 import DriveState
from husky_drivers.ethercat.bus import AlState, SdoAbort


def test_following_error_trips_after_its_time():
    rig = Rig(x6065=5000, x6066=40)
    rig.enable()
    rig.step(0x0F, position=5000)
    rig.step(0x0F, 100, position=5000)
    assert rig.state is DriveState.OPERATION_ENABLED  # at the window, not beyond
    rig.step(0x0F, position=-5001)
    rig.step(0x0F, 19, position=-5001)
    assert rig.state is DriveState.OPERATION_ENABLED
    assert rig.statusword & 0x2000
    rig.step(0x0F, position=-5001)
    assert rig.state is DriveState.FAULT
    assert rig.read(0x603F, "<H") == 0x8611
    assert [(e.position, e.error_code) for e in rig.segment.emergencies()] == [
        (i, 0x8611) for i in range(12)
    ]
    assert rig.segment.emergencies() == ()


def test_fault_reaction_may_brake_for_a_tracking_fault_only():
    rig = Rig(x605e=2, x6085=1_000_000)
    rig.enable()
    rig.motion = (0, 20_000, 0.0)
    rig.segment.inject(JOINT, "fault:8611")
    rig.step(0x0F)
    assert rig.state is DriveState.FAULT_REACTION_ACTIVE
    assert rig.command["kind"] == 2
    rig.step(0x0F, 9)
    assert rig.state is DriveState.FAULT
    other = Rig(x605e=2, x6085=1_000_000)
    other.enable()
    other.motion = (0, 20_000, 0.0)
    other.segment.inject(JOINT, "fault:2340")
    other.step(0x0F)
    assert other.state is DriveState.FAULT
    assert other.command["kind"] == 0


def peak_time(current):
    """Time from rest until the mean current is the rated one (closed form of the filter) [s]."""
    tau = -ROBOT.drive.peak_duration / math.log(1 - RATED / ROBOT.drive.peak_current)
    return -tau * math.log(1 - RATED / current)


@pytest.mark.parametrize("current", [ROBOT.drive.peak_current, 18.0])
def test_peak_current_lasts_as_long_as_the_filter_says(current):
    rig = Rig()
    rig.enable()
    torque = 0.0218 * 30 * 0.7
    peak = ROBOT.drive.peak_current * torque
    assert rig.step(0x0F)["torque_limit"] == pytest.approx(peak)
    rig.motion = (0, 0, -current)
    ticks = 0
    while rig.command["torque_limit"] > RATED * torque * 1.001:
        rig.step(0x0F)
        ticks += 1
    assert ticks * TICK == pytest.approx(peak_time(current), abs=2 * TICK)
    rig.frame(0x0F)
    assert rig.statusword & 0x0800
    rig.motion = (0, 0, 0.0)
    ticks = 0
    while rig.command["torque_limit"] < peak * 0.999:
        rig.step(0x0F)
        ticks += 1
    tau = peak_time(current) / -math.log(1 - RATED / current)
    assert ticks * TICK == pytest.approx(-tau * math.log(0.9), abs=2 * TICK)


def test_peak_lasts_three_seconds():
    assert peak_time(ROBOT.drive.peak_current) == pytest.approx(3.0)


def test_continuous_current_lasts():
    rig = Rig()
    rig.enable()
    rig.motion = (0, 0, RATED * 0.999)
    rig.step(0x0F, 10000)
    assert rig.command["torque_limit"] > RATED * 0.0218 * 30 * 0.7 * 1.2


@pytest.mark.parametrize(("volts", "code"), [(9.0, 0x3120), (99.0, 0x3310)])
def test_bus_voltage(volts, code):
    rig = Rig()
    rig.enable()
    rig.volts = volts
    rig.step(0x0F)
    assert rig.state is DriveState.FAULT
    assert rig.command["kind"] == 0
    assert rig.read(0x603F, "<H") == code
    rig.volts = 22.2
    rig.step(0x00)
    rig.step(0x80, 2)
    assert rig.statusword == 0x0250
    assert rig.read(0x6079, "<I") == 22200


def test_watchdog_removes_torque_after_100_ms():
    rig = Rig()
    rig.enable()
    rig.tick(49)
    assert rig.state is DriveState.OPERATION_ENABLED
    assert rig.tick()["kind"] == 0
    assert rig.state is DriveState.SWITCH_ON_DISABLED
    assert rig.segment.al_states()[AXIS].status == 0x14
    assert rig.segment.al_states()[AXIS].code == 0x001B
    rig.frame(0x0F)
    assert rig.counter == 12  # inputs only
    assert rig.state is DriveState.SWITCH_ON_DISABLED
    rig.segment.bring_to(AlState.SAFEOP)
    rig.segment.bring_to(AlState.OP)
    rig.frame(0x00)
    assert rig.counter == 36


def test_watchdog_can_be_set():
    rig = Rig()
    rig.segment.set_watchdog(AXIS, 0.02)
    rig.enable()
    rig.tick(9)
    assert rig.command["kind"] == 1
    assert rig.tick()["kind"] == 0
    with pytest.raises(ValueError, match=r"0\.0001"):
        rig.segment.set_watchdog(AXIS, 0.0)


@pytest.mark.parametrize(
    ("option", "state"),
    [
        (0, DriveState.SWITCH_ON_DISABLED),
        (1, DriveState.FAULT),
        (2, DriveState.SWITCH_ON_DISABLED),
        (3, DriveState.QUICK_STOP_ACTIVE),
    ],
)
def test_abort_connection_option(option, state):
    rig = Rig(x6007=option, x6085=100_000)
    rig.enable()
    rig.motion = (0, 20_000, 0.0)
    rig.tick(50)
    assert rig.state is state
    assert (rig.command["kind"] != 0) == (option == 3)
    rig.tick(200)
    assert rig.command["kind"] == 0


def test_leaving_op_removes_torque():
    rig = Rig()
    rig.enable()
    rig.segment.bring_to(AlState.SAFEOP)
    assert rig.command["kind"] == 0


@pytest.mark.parametrize(
    "left_in", [DriveState.SWITCH_ON_DISABLED, DriveState.SWITCHED_ON, DriveState.FAULT]
)
def test_sto_removes_torque_within_a_tick(left_in):
    rig = Rig()
    rig.segment.drives[AXIS].record["sto_state"] = left_in
    rig.enable()
    assert rig.read(0x2086, "<I") == 0
    rig.segment.inject(JOINT, "sto")
    assert rig.tick()["kind"] == 0
    assert rig.state is left_in
    inputs = rig.frame(0x0F)
    assert inputs[1] & 0x08 == 0
    assert rig.read(0x2086, "<I") != 0
    for word in (0x80, 0x00, 0x80, 0x06, 0x07, 0x0F, 0x0F):
        assert rig.step(word)["kind"] == 0
    rig.segment.clear(JOINT)
    for word in (0x00, 0x80):
        rig.step(word)
    rig.enable()
    assert rig.frame(0x0F)[1] & 0x08


def test_disturbed_timing_falls_without_a_command():
    rig = Rig()
    rig.enable()
    rig.segment.inject(JOINT, "disturbed_timing")
    assert rig.tick()["kind"] == 0
    rig.frame(0x0F)
    assert rig.statusword == 0x0250
    assert rig.read(0x603F, "<H") == 0
    rig.step(0x0F, 10)
    assert rig.state is DriveState.SWITCH_ON_DISABLED
    rig.enable()


def test_a_silent_drive_misses_from_the_counter_and_stops_by_itself():
    rig = Rig()
    rig.enable(position=77)
    rig.segment.inject(JOINT, "silent")
    rig.motion = (4711, 0, 0.0)
    inputs = rig.frame(0x0F)
    assert rig.counter == 33
    assert inputs[0] == 0  # stale
    rig.step(0x0F, 49)
    assert rig.command["kind"] == 1
    rig.step(0x0F)
    assert rig.command["kind"] == 0
    assert rig.segment.al_states()[AXIS].status == 0
    with pytest.raises(SdoAbort, match="timed out"):
        rig.read(0x6041, "<H")
