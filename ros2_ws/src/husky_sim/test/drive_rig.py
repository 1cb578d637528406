"""A simulated Gold Twitter, spoken to in bytes written by hand."""

import struct

import numpy as np

from husky_description.robot import load_robot
from husky_drivers.cia402 import DriveState
from husky_drivers.ethercat.bus import AlState
from husky_sim.devices.drives.segment import SimulatedSegment

TICK = 0.002
ROBOT = load_robot()
JOINT, AXIS = "front_right_knee", 5
RATED = ROBOT.drive.continuous_current
TORQUE = {
    DriveState.OPERATION_ENABLED,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT_REACTION_ACTIVE,
}


class Rig:
    """A segment at OP and one drive of it under test; the others get the same frames."""

    def __init__(self, **written: int):
        self.segment = SimulatedSegment(ROBOT, tick=TICK)
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
        self.segment.bring_to(AlState.SAFEOP)
        self.segment.bring_to(AlState.OP)
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
        assert self.state is DriveState.OPERATION_ENABLED

    @property
    def state(self):
        return self.segment.states()[AXIS]

    @property
    def command(self):
        return self.segment.servo_command()[AXIS]
