"""The simulated Gold Twitter, in bytes: states, modes, what a stop does."""

import math

import numpy as np
import pytest
from drive_rig import AXIS, JOINT, RATED, TICK, TORQUE, Rig

from husky_drivers.cia402 import DriveState


def test_identity_and_counters():
    rig = Rig()
    identity = rig.segment.identity(AXIS)
    assert (identity.vendor, identity.product, identity.revision) == (0x9A, 0x30924, 0x10420)
    assert [rig.read(0x1018, "<I", sub) for sub in (1, 2, 3)] == [0x9A, 0x30924, 0x10420]
    assert rig.segment.expected_working_counter == 36
    assert rig.counter == 36


def test_enabling_shows_the_statuswords_of_a_real_drive():
    rig = Rig()
    seen = []
    for word in (0x00, 0x06, 0x07, 0x0F, 0x0F):
        rig.tick()
        rig.frame(word)
        seen.append(rig.statusword)
    # SOEM issues 245 and 518; bit 12 (follows the target) comes with the cyclic modes
    assert seen == [0x0250, 0x0250, 0x0231, 0x0233, 0x1237]


def test_fault_and_reset_as_seen_on_a_real_drive():
    rig = Rig()
    rig.enable()
    rig.segment.inject(JOINT, "fault:7300")
    rig.step(0x0F, 2)
    assert rig.statusword == 0x0218
    assert rig.read(0x603F, "<H") == 0x7300
    rig.step(0x80, 2)
    assert rig.statusword == 0x0218  # what tripped it still stands
    rig.segment.clear(JOINT)
    rig.step(0x80, 3)
    assert rig.statusword == 0x0218  # held high: no edge
    rig.step(0x00)
    rig.step(0x80, 2)
    assert rig.statusword == 0x0250
    assert rig.read(0x603F, "<H") == 0


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0F, DriveState.OPERATION_ENABLED),
        (0x07, DriveState.SWITCHED_ON),  # 5
        (0x06, DriveState.READY_TO_SWITCH_ON),  # 8
        (0x00, DriveState.SWITCH_ON_DISABLED),  # 9
        (0x80, DriveState.SWITCH_ON_DISABLED),
        (0x8F, DriveState.OPERATION_ENABLED),  # not a command
        (0x02, DriveState.QUICK_STOP_ACTIVE),  # 11
    ],
)
def test_commands_from_operation_enabled(word, state):
    rig = Rig(x6085=1000)
    rig.enable()
    rig.motion = (0, 10000, 0.0)
    rig.step(word, 3)
    assert rig.state is state
    assert (rig.command["kind"] != 0) == (state in TORQUE)


def test_a_drive_without_a_mode_is_not_enabled():
    rig = Rig()
    for word in (0x06, 0x07, 0x0F, 0x0F):
        rig.step(word, mode=0)
    assert rig.state is DriveState.SWITCHED_ON


def test_mode_display_follows_supported_modes_only():
    rig = Rig()
    assert rig.read(0x6502, "<I") == 0x380
    for mode, shown in ((8, 8), (9, 9), (10, 10), (1, 10), (-5, 10)):
        rig.step(0, mode=mode)
        assert rig.read(0x6061, "<b") == shown


def test_targets_reach_the_power_stage_in_si():
    rig = Rig()
    rig.write(AXIS, 0x2111, 1, "<f", 2.0e-4)  # A per count/s
    rig.write(AXIS, 0x2112, 1, "<f", 75.0)  # 1/s
    counts = 8192 * 30 / (2 * math.pi)
    torque = 0.0218 * 30 * 0.7  # N m per A at the joint
    rig.enable()
    c = rig.step(0x0F, mode=8, position=24576, velocity=-8192, limit=500, offset=-100)
    assert c["kind"] == 1
    assert c["position"] == pytest.approx(24576 / counts)
    assert c["velocity"] == pytest.approx(-8192 / counts)
    assert c["torque"] == pytest.approx(-0.1 * RATED * torque)
    assert c["kd"] == pytest.approx(2.0e-4 * counts * torque, rel=1e-6)
    assert c["kp"] == pytest.approx(75.0 * 2.0e-4 * counts * torque, rel=1e-6)
    assert c["torque_limit"] == pytest.approx(0.5 * RATED * torque)
    c = rig.step(0x0F, mode=9, velocity=4096, torque=999, offset=50)
    assert (c["kind"], c["velocity"]) == (2, pytest.approx(4096 / counts))
    assert c["torque"] == pytest.approx(0.05 * RATED * torque)
    c = rig.step(0x0F, mode=10, torque=200, offset=50)
    assert (c["kind"], c["torque"]) == (3, pytest.approx(0.25 * RATED * torque))


def test_quick_stop_takes_speed_over_deceleration():
    speed, deceleration = 200_000, 4_000_000  # counts/s, counts/s^2: 50 ms
    rig = Rig(x605a=2, x6085=deceleration)
    rig.enable()
    rig.motion = (0, speed, 0.0)
    demands = [float(rig.step(0x02)["velocity"])]
    while rig.state is DriveState.QUICK_STOP_ACTIVE:
        assert rig.command["kind"] == 2
        demands.append(float(rig.step(0x02)["velocity"]))
    assert rig.state is DriveState.SWITCH_ON_DISABLED
    assert rig.command["kind"] == 0
    ticks = len(demands) - 1
    assert ticks == math.ceil(speed / deceleration / TICK)
    counts = 8192 * 30 / (2 * math.pi)
    slope = np.diff(demands[:-1]) / TICK
    assert slope == pytest.approx(np.full(ticks - 1, -deceleration / counts))


def test_quick_stop_option_6_holds_until_voltage_is_disabled():
    rig = Rig(x605a=6, x6085=4_000_000)
    rig.enable()
    rig.motion = (0, -40_000, 0.0)
    rig.step(0x02, 50)
    assert rig.state is DriveState.QUICK_STOP_ACTIVE
    assert (rig.command["kind"], rig.command["velocity"]) == (2, 0.0)
    rig.step(0x0F)
    assert rig.state is DriveState.OPERATION_ENABLED  # transition 16
    rig.step(0x02)
    rig.step(0x00)
    assert rig.state is DriveState.SWITCH_ON_DISABLED


def test_quick_stop_option_2_does_not_go_back():
    rig = Rig(x605a=2, x6085=100_000)
    rig.enable()
    rig.motion = (0, 40_000, 0.0)
    rig.step(0x02)
    rig.step(0x0F, 3)
    assert rig.state is DriveState.QUICK_STOP_ACTIVE


def test_quick_stop_option_0_drops_torque_at_once():
    rig = Rig(x605a=0)
    rig.enable()
    rig.step(0x02)
    assert rig.state is DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("option", "word", "end"),
    [("x605b", 0x06, DriveState.READY_TO_SWITCH_ON), ("x605c", 0x07, DriveState.SWITCHED_ON)],
)
def test_slow_down_before_lower_states(option, word, end):
    rig = Rig(**{option: 1, "x6084": 1_000_000})
    rig.enable()
    rig.motion = (0, 20_000, 0.0)
    rig.step(word)
    ticks = 0
    while rig.state is DriveState.OPERATION_ENABLED:
        assert rig.command["kind"] == 2
        rig.step(word)
        ticks += 1
    assert (rig.state, ticks) == (end, 10)
    assert rig.command["kind"] == 0


def test_enable_operation_calls_a_slow_down_off():
    rig = Rig(x605c=1, x6084=1_000_000)
    rig.enable()
    rig.motion = (0, 20_000, 0.0)
    rig.step(0x07, 3)
    rig.step(0x0F, 30)
    assert rig.state is DriveState.OPERATION_ENABLED
    assert rig.command["kind"] == 1


def test_halt_stops_and_lets_go_on():
    rig = Rig(x6085=10_000_000)
    rig.enable(mode=9)
    rig.motion = (0, 20_000, 0.0)
    c = rig.step(0x10F, 30, mode=9, velocity=20_000)
    assert (c["kind"], c["velocity"]) == (2, 0.0)
    assert rig.state is DriveState.OPERATION_ENABLED
    assert not rig.statusword & 0x1000
    c = rig.step(0x0F, mode=9, velocity=20_000)
    assert c["velocity"] > 0.5
