"""The simulated Gold Twitter, spoken to in bytes written here by hand."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from husky_description.robot import load_robot
from husky_drivers.bus import AlState, SdoAbort
from husky_drivers.cia402 import State, decode_statusword
from husky_sim.drive import FAULTS
from husky_sim.segment import SimulatedSegment

TICK = 0.002
ROBOT = load_robot()
JOINT, AXIS = "front_right_knee", 5
RATED = ROBOT.drive.continuous_current
TORQUE = {State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE}


class Rig:
    """A segment at OP and one drive of it under test; the others get the same frames."""

    def __init__(self, **written: int):
        self.segment = SimulatedSegment(ROBOT, TICK)
        self.segment.open()
        self.volts = 22.2
        self.motion = (0, 0, 0.0)  # counts, counts/s, A
        for i in range(12):
            self.assign(i)
            self.write(i, 0x6075, 0, "<I", round(RATED * 1e3))
            self.write(i, 0x6073, 0, "<H", round(ROBOT.drive.peak_current / RATED * 1e3))
            for index, value in written.items():
                code = "<h" if index.startswith("x605") or index == "x6007" else "<I"
                code = "<H" if index == "x6066" else code
                self.write(i, int(index[1:], 16), 0, code, value)
        self.segment.request_state(AlState.SAFEOP)
        self.segment.request_state(AlState.OP)
        for _ in range(12):
            self.tick()
            self.frame(0, mode=0)

    def assign(self, axis):
        for index, maps in ((0x1C12, (0x1605, 0x1618)), (0x1C13, (0x1A03, 0x1A1D, 0x1A1F, 0x1A18))):
            self.write(axis, index, 0, "<B", 0)
            for slot, mapping in enumerate(maps, 1):
                self.write(axis, index, slot, "<H", mapping)
            self.write(axis, index, 0, "<B", len(maps))

    def write(self, axis, index, subindex, code, value):
        self.segment.sdo_write(axis, index, subindex, struct.pack(code, value))

    def read(self, index, code, subindex=0, axis=AXIS):
        return struct.unpack(code, self.segment.sdo_read(axis, index, subindex))[0]

    def frame(self, word, mode=8, position=0, velocity=0, torque=0, limit=60000, offset=0):
        """Send the same outputs to all; returns the inputs of the drive under test."""
        one = struct.pack("<iihHHbbh", position, velocity, torque, limit, word, mode, 0, offset)
        data, self.counter = self.segment.exchange(one * 12)
        inputs = struct.unpack_from("<iIiHhhI", data, 22 * AXIS)
        self.statusword = inputs[3]
        return inputs

    def tick(self, ticks=1):
        position, velocity, current = self.motion
        for _ in range(ticks):
            self.segment.set_servo_state(
                np.full(12, position, np.int32),
                np.full(12, velocity, np.int32),
                np.full(12, current),
                self.volts,
            )
        return self.command

    def step(self, word, ticks=1, **targets):
        for _ in range(ticks):
            self.tick()
            self.frame(word, **targets)
        return self.command

    def enable(self, **targets):
        for word in (0x06, 0x07, 0x0F):
            self.step(word, **targets)
        assert self.state is State.OPERATION_ENABLED

    @property
    def state(self):
        return self.segment.states()[AXIS]

    @property
    def command(self):
        return self.segment.servo_command()[AXIS]


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
        (0x0F, State.OPERATION_ENABLED),
        (0x07, State.SWITCHED_ON),  # 5
        (0x06, State.READY_TO_SWITCH_ON),  # 8
        (0x00, State.SWITCH_ON_DISABLED),  # 9
        (0x80, State.SWITCH_ON_DISABLED),
        (0x8F, State.OPERATION_ENABLED),  # not a command
        (0x02, State.QUICK_STOP_ACTIVE),  # 11
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
    assert rig.state is State.SWITCHED_ON


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
    while rig.state is State.QUICK_STOP_ACTIVE:
        assert rig.command["kind"] == 2
        demands.append(float(rig.step(0x02)["velocity"]))
    assert rig.state is State.SWITCH_ON_DISABLED
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
    assert rig.state is State.QUICK_STOP_ACTIVE
    assert (rig.command["kind"], rig.command["velocity"]) == (2, 0.0)
    rig.step(0x0F)
    assert rig.state is State.OPERATION_ENABLED  # transition 16
    rig.step(0x02)
    rig.step(0x00)
    assert rig.state is State.SWITCH_ON_DISABLED


def test_quick_stop_option_2_does_not_go_back():
    rig = Rig(x605a=2, x6085=100_000)
    rig.enable()
    rig.motion = (0, 40_000, 0.0)
    rig.step(0x02)
    rig.step(0x0F, 3)
    assert rig.state is State.QUICK_STOP_ACTIVE


def test_quick_stop_option_0_drops_torque_at_once():
    rig = Rig(x605a=0)
    rig.enable()
    rig.step(0x02)
    assert rig.state is State.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("option", "word", "end"),
    [("x605b", 0x06, State.READY_TO_SWITCH_ON), ("x605c", 0x07, State.SWITCHED_ON)],
)
def test_slow_down_before_lower_states(option, word, end):
    rig = Rig(**{option: 1, "x6084": 1_000_000})
    rig.enable()
    rig.motion = (0, 20_000, 0.0)
    rig.step(word)
    ticks = 0
    while rig.state is State.OPERATION_ENABLED:
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
    assert rig.state is State.OPERATION_ENABLED
    assert rig.command["kind"] == 1


def test_halt_stops_and_lets_go_on():
    rig = Rig(x6085=10_000_000)
    rig.enable(mode=9)
    rig.motion = (0, 20_000, 0.0)
    c = rig.step(0x10F, 30, mode=9, velocity=20_000)
    assert (c["kind"], c["velocity"]) == (2, 0.0)
    assert rig.state is State.OPERATION_ENABLED
    assert not rig.statusword & 0x1000
    c = rig.step(0x0F, mode=9, velocity=20_000)
    assert c["velocity"] > 0.5


def test_following_error_trips_after_its_time():
    rig = Rig(x6065=5000, x6066=40)
    rig.enable()
    rig.step(0x0F, position=5000)
    rig.step(0x0F, 100, position=5000)
    assert rig.state is State.OPERATION_ENABLED  # at the window, not beyond
    rig.step(0x0F, position=-5001)
    rig.step(0x0F, 19, position=-5001)
    assert rig.state is State.OPERATION_ENABLED
    assert rig.statusword & 0x2000
    rig.step(0x0F, position=-5001)
    assert rig.state is State.FAULT
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
    assert rig.state is State.FAULT_REACTION_ACTIVE
    assert rig.command["kind"] == 2
    rig.step(0x0F, 9)
    assert rig.state is State.FAULT
    other = Rig(x605e=2, x6085=1_000_000)
    other.enable()
    other.motion = (0, 20_000, 0.0)
    other.segment.inject(JOINT, "fault:2340")
    other.step(0x0F)
    assert other.state is State.FAULT
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
    assert rig.state is State.FAULT
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
    assert rig.state is State.OPERATION_ENABLED
    assert rig.tick()["kind"] == 0
    assert rig.state is State.SWITCH_ON_DISABLED
    assert rig.segment.al_status(AXIS) == 0x14
    assert rig.segment.al_status_code(AXIS) == 0x001B
    rig.frame(0x0F)
    assert rig.counter == 12  # inputs only
    assert rig.state is State.SWITCH_ON_DISABLED
    rig.segment.request_state(AlState.SAFEOP)
    rig.segment.request_state(AlState.OP)
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
        (0, State.SWITCH_ON_DISABLED),
        (1, State.FAULT),
        (2, State.SWITCH_ON_DISABLED),
        (3, State.QUICK_STOP_ACTIVE),
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
    rig.segment.request_state(AlState.SAFEOP)
    assert rig.command["kind"] == 0


@pytest.mark.parametrize("left_in", [State.SWITCH_ON_DISABLED, State.SWITCHED_ON, State.FAULT])
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
    assert rig.state is State.SWITCH_ON_DISABLED
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
    assert rig.segment.al_status(AXIS) == 0
    with pytest.raises(SdoAbort, match="timed out"):
        rig.read(0x6041, "<H")


def test_what_cannot_be_injected():
    segment = SimulatedSegment(ROBOT)
    for bad in ("fire", "fault:", "fault:zz", "fault:0", "fault:12345", ""):
        with pytest.raises(ValueError, match="fault"):
            segment.inject(JOINT, bad)
    with pytest.raises(ValueError, match="disturbed_timing"):
        segment.inject(JOINT, "fire")
    with pytest.raises(ValueError, match=JOINT):
        segment.inject("tail", FAULTS[1])


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x5FFF, 0, b"\0", 0x06020000),
        (0x2111, 9, b"\0\0\0\0", 0x06090011),
        (0x6064, 0, b"\0\0\0\0", 0x06010002),
        (0x605A, 0, b"\2", 0x06070010),
        (0x605A, 0, b"\7\0", 0x06090030),
        (0x2111, 1, struct.pack("<f", math.nan), 0x06090030),
        (0x2110, 1, struct.pack("<f", 1.0), 0x06090030),
        (0x6075, 0, bytes(4), 0x06090030),
        (0x60C2, 1, b"\4", 0x06090030),
        (0x1C12, 0, b"\0", 0x08000022),
    ],
)
def test_mailbox_refusals(index, subindex, data, code):
    rig = Rig()
    with pytest.raises(SdoAbort) as refused:
        rig.segment.sdo_write(AXIS, index, subindex, data)
    assert refused.value.code == code


def test_assignment_rules():
    segment = SimulatedSegment(ROBOT)
    segment.open()
    assert segment.sdo_read(0, 0x1C12, 1) == b"\x00\x16"  # 0x1600 after power on
    with pytest.raises(SdoAbort, match="not in this state"):
        segment.sdo_write(0, 0x1C12, 1, b"\x05\x16")  # count is not 0
    segment.sdo_write(0, 0x1C12, 0, b"\0")
    with pytest.raises(SdoAbort, match="cannot be mapped"):
        segment.sdo_write(0, 0x1C12, 1, b"\xff\x16")


def test_safeop_needs_the_mappings_and_op_needs_safeop():
    segment = SimulatedSegment(ROBOT)
    segment.open()
    segment.request_state(AlState.SAFEOP, 0)
    assert (segment.al_status(0), segment.al_status_code(0)) == (0x12, 0x001D)
    segment.request_state(AlState.OP, 1)
    assert (segment.al_status(1), segment.al_status_code(1)) == (0x12, 0x0011)
    segment.request_state(AlState.PREOP, 1)
    assert (segment.al_status(1), segment.al_status_code(1)) == (0x02, 0)
    assert segment.exchange(bytes(216))[1] == 0


@given(st.lists(st.binary(min_size=216, max_size=216), max_size=8))
@settings(max_examples=60)
def test_garbage_on_the_wire_never_raises_and_nothing_is_enabled_out_of_turn(frames):
    rig = GARBAGE
    rig.step(0x00)
    rig.segment.request_state(AlState.SAFEOP)
    rig.segment.request_state(AlState.OP)
    before = rig.segment.states()
    for data in frames:
        rig.tick()
        inputs, counter = rig.segment.exchange(data)
        assert (len(inputs), counter) == (264, 36)
        after = rig.segment.states()
        rig.segment.servo_command()
        for i in range(12):
            word = struct.unpack_from("<H", data, 18 * i + 12)[0]
            if after[i] is State.OPERATION_ENABLED and before[i] is not after[i]:
                assert before[i] is State.SWITCHED_ON
                assert word & 0x8F == 0x0F
            command = rig.segment.command[i]
            assert (command["kind"] == 0) or after[i] in TORQUE
            assert all(np.isfinite(command[name]) for name in command.dtype.names)
        before = after


@given(st.binary(max_size=400).filter(lambda data: len(data) != 216))
@settings(max_examples=30)
def test_frames_of_another_length_reach_no_drive(data):
    before = GARBAGE.segment.states()
    assert GARBAGE.segment.exchange(data)[1] == 0
    assert GARBAGE.segment.states() == before


GARBAGE = Rig()


class DriveMachine(RuleBasedStateMachine):
    """Any commands, motions and faults in any order: what must hold whatever comes."""

    @initialize(
        quick=st.sampled_from([0, 1, 2, 5, 6]),
        fault=st.sampled_from([0, 1, 2]),
        lower=st.sampled_from([0, 1]),
    )
    def power_on(self, quick, fault, lower):
        self.rig = Rig(
            x605a=quick, x605e=fault, x605b=lower, x605c=lower, x6084=500_000, x6085=900_000
        )
        self.word = 0
        self.before = self.rig.state

    @rule(
        word=st.one_of(st.sampled_from([0x06, 0x07, 0x0F, 0x80, 0x02, 0x10F]), st.integers(0, 511)),
        mode=st.sampled_from([8, 9, 10, 0, 3]),
        position=st.integers(-9000, 9000),
    )
    def frame(self, word, mode, position):
        before, sto = self.rig.state, self.rig.segment.drives[AXIS].record["sto"]
        self.rig.frame(word, mode=mode, position=position, velocity=-position)
        after = self.rig.state
        if before is State.FAULT and after is not before:
            assert word & 0x80 and not self.word & 0x80
            assert after is State.SWITCH_ON_DISABLED
        if after is State.OPERATION_ENABLED and before is not after:
            assert word & 0x8F == 0x0F
            assert not sto
            assert before in (State.SWITCHED_ON, State.QUICK_STOP_ACTIVE)
        # what the frame carried was from before it
        assert decode_statusword(self.rig.statusword) is before
        self.word = word

    @precondition(lambda self: self.rig.state is not State.OPERATION_ENABLED)
    @rule()
    def enable(self):
        for word in (0x00, 0x80, 0x06, 0x07, 0x0F):
            self.rig.step(word)
            self.word = word

    @rule(
        speed=st.integers(-60_000, 60_000),
        current=st.floats(-30, 30),
        volts=st.sampled_from([22.2, 22.2, 22.2, 5.0, 120.0]),
    )
    def tick(self, speed, current, volts):
        before = self.rig.state
        self.rig.motion = (0, speed, current)
        self.rig.volts = volts
        self.rig.tick()
        if before not in TORQUE:
            assert self.rig.state not in TORQUE  # time alone enables nothing

    @rule(fault=st.sampled_from(["sto", "fault:8611", "fault:2340", "disturbed_timing"]))
    def inject(self, fault):
        self.rig.segment.inject(JOINT, fault)

    @rule()
    def clear(self):
        self.rig.segment.clear()

    @invariant()
    def torque_in_torque_states_only(self):
        if not hasattr(self, "rig"):
            return
        command, state = self.rig.command, self.rig.state
        if command["kind"]:
            assert state in TORQUE
            assert command["torque_limit"] >= 0.0
        if state is State.OPERATION_ENABLED:
            assert command["kind"] in (1, 2, 3)
        if state in (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE):
            assert command["kind"] == 2  # a ramp of speed, never a target
        if self.rig.segment.drives[AXIS].record["sto"]:
            self.rig.tick()
            assert self.rig.command["kind"] == 0


DriveMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestDriveMachine = DriveMachine.TestCase
