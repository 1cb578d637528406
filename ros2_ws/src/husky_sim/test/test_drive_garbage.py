"""The simulated Gold Twitter: mailbox, garbage on the wire, any order of words."""

import math
import struct

import numpy as np
import pytest
from drive_rig import AXIS, JOINT, ROBOT, TORQUE, Rig
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from husky_drivers.cia402 import DriveState, decode_statusword
from husky_drivers.ethercat.bus import AlState, SdoAbort
from husky_sim.devices.drives.drive import FAULTS
from husky_sim.devices.drives.segment import SimulatedSegment


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
    assert segment.al_states()[0] == (0x12, 0x001D)
    segment.request_state(AlState.OP, 1)
    assert segment.al_states()[1] == (0x12, 0x0011)
    segment.request_state(AlState.PREOP, 1)
    assert segment.al_states()[1] == (0x02, 0)
    assert segment.exchange(bytes(216))[1] == 0


@given(st.lists(st.binary(min_size=216, max_size=216), max_size=8))
@settings(max_examples=60)
def test_garbage_on_the_wire_never_raises_and_nothing_is_enabled_out_of_turn(frames):
    rig = GARBAGE
    rig.step(0x00)
    rig.segment.bring_to(AlState.SAFEOP)
    rig.segment.bring_to(AlState.OP)
    before = rig.segment.states()
    for data in frames:
        rig.tick()
        inputs, counter = rig.segment.exchange(data)
        assert (len(inputs), counter) == (264, 36)
        after = rig.segment.states()
        rig.segment.servo_command()
        for i in range(12):
            word = struct.unpack_from("<H", data, 18 * i + 12)[0]
            if after[i] is DriveState.OPERATION_ENABLED and before[i] is not after[i]:
                assert before[i] is DriveState.SWITCHED_ON
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
        if before is DriveState.FAULT and after is not before:
            assert word & 0x80 and not self.word & 0x80
            assert after is DriveState.SWITCH_ON_DISABLED
        if after is DriveState.OPERATION_ENABLED and before is not after:
            assert word & 0x8F == 0x0F
            assert not sto
            assert before in (DriveState.SWITCHED_ON, DriveState.QUICK_STOP_ACTIVE)
        # what the frame carried was from before it
        assert decode_statusword(self.rig.statusword) is before
        self.word = word

    @precondition(lambda self: self.rig.state is not DriveState.OPERATION_ENABLED)
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
        if state is DriveState.OPERATION_ENABLED:
            assert command["kind"] in (1, 2, 3)
        if state in (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE):
            assert command["kind"] == 2  # a ramp of speed, never a target
        if self.rig.segment.drives[AXIS].record["sto"]:
            self.rig.tick()
            assert self.rig.command["kind"] == 0


DriveMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestDriveMachine = DriveMachine.TestCase
