"""Twelve ideal drives written from the standard, and a master on them."""

import math
import struct

import numpy as np

from husky_description.robot import load_robot
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.axes import settings_of
from husky_drivers.ethercat.bus import GOLD_TWITTER, AlState, AlStatus, Emergency, SdoAbort
from husky_drivers.ethercat.master import Master
from husky_drivers.ethercat.pdo import MAPPINGS, mapped
from husky_drivers.joint_master.phase import Phase

ROBOT = load_robot()
SETTINGS = settings_of(ROBOT)
COUNTS = 8192 * 30 / (2 * math.pi)
TORQUE_PER_AMPERE = 0.0218 * 30 * 0.7
RATED = ROBOT.drive.continuous_current
STAND = ROBOT.stand_joint_position
ZERO = np.zeros(12)
# statuswords of a Gold Twitter
DISABLED, READY, ON, ENABLED, STOPPING, FAULT = 0x0250, 0x0231, 0x0233, 0x1237, 0x0217, 0x0218
NEXT = {
    (DISABLED, 0x06): READY,
    (READY, 0x07): ON,
    (ON, 0x0F): ENABLED,
    (ENABLED, 0x02): STOPPING,
    **{(state, 0x00): DISABLED for state in (READY, ON, ENABLED, STOPPING)},
}

FORMATS = {
    (entry.index, entry.subindex): entry.format
    for entry in vars(od).values()
    if isinstance(entry, od.ObjectEntry)
}


class IdealDrives:
    """A bus of twelve drives that obey at once, brake for `brake` frames, and can be broken."""

    slave_count = 12
    expected_working_counter = 36

    def __init__(self):
        self.words = [DISABLED] * 12
        self.previous = [0] * 12
        self.al = [int(AlState.PREOP)] * 12
        self.position = np.rint(STAND * COUNTS).astype(int)
        self.velocity = np.zeros(12, int)
        self.current = np.zeros(12, int)
        self.digital = [8] * 12
        self.deaf = set()  # do not change state
        self.away = set()  # do not take part
        self.brake = 3
        self.braking = [0] * 12
        self.frames = []
        self.objects = {}
        self.waiting = []
        self.mode_shown = None
        self.watchdogs = [None] * 12
        self.refuses = None

    def open(self):
        self.opened = True

    def close(self, outputs=b""):
        self.exchange(outputs)
        self.opened = False

    def identity(self, position):
        return GOLD_TWITTER

    def bring_to(self, state):
        for i in range(12):
            self.request_state(state, i)

    def request_state(self, state, position):
        if position not in self.away:
            self.al[position] = int(state)

    def al_states(self):
        return [
            AlStatus(0, 0) if i in self.away else AlStatus(al, 0x001B if al & 0x10 else 0)
            for i, al in enumerate(self.al)
        ]

    def set_watchdog(self, position, seconds):
        self.watchdogs[position] = seconds

    def emergencies(self):
        waiting, self.waiting = self.waiting, []
        return waiting

    def sdo_read(self, position, index, subindex=0):
        if index != 0x6061:
            if (position, index, subindex) in self.objects:
                return self.objects[position, index, subindex]
            if index in MAPPINGS:
                maps = mapped(index)
                return struct.pack("<I", maps[subindex - 1]) if subindex else bytes([len(maps)])
            return bytes(struct.calcsize(FORMATS[index, subindex]))
        if self.mode_shown is not None:
            return struct.pack("<b", self.mode_shown)
        return struct.pack("<b", self.rows[position][5] if self.frames else 0)

    def sdo_write(self, position, index, subindex, data):
        if self.refuses == (position, index):
            raise SdoAbort(0x06090030, position, index, subindex)
        self.objects[position, index, subindex] = data

    def trip(self, axis, code):
        self.words[axis] = FAULT
        self.waiting.append(Emergency(axis, code))

    def exchange(self, outputs):
        self.rows = list(struct.iter_unpack("<iihHHbbh", bytes(outputs)))
        self.frames.append(self.rows)
        inputs = b"".join(
            struct.pack(
                "<iIiHhhI",
                self.position[i],
                self.digital[i],
                self.velocity[i],
                self.words[i],
                0,
                self.current[i],
                22200,
            )
            for i in range(12)
        )
        counter = 0
        for i in range(12):
            if i in self.away:
                continue
            counter += 3 if self.al[i] == AlState.OP else 1
            if self.al[i] == AlState.OP and i not in self.deaf:
                self.obey(i, self.rows[i][4])
        return memoryview(inputs), counter

    def obey(self, i, word):
        if self.words[i] == FAULT and word & 0x80 and not self.previous[i] & 0x80:
            self.words[i] = DISABLED
        if self.words[i] == STOPPING and word == 0x02:
            self.braking[i] += 1
            if self.braking[i] >= self.brake:
                self.words[i] = DISABLED
        elif (self.words[i], word) in NEXT:
            self.words[i], self.braking[i] = NEXT[self.words[i], word], 0
        self.previous[i] = word


class Loop:
    """A master on ideal drives, with a controller that holds the stance."""

    def __init__(self, **overrides):
        self.bus = IdealDrives()
        self.master = Master(self.bus, settings_of(ROBOT, **overrides), ROBOT)
        self.master.configure()
        self.master.start()
        self.command = (8, STAND, ZERO, ZERO)

    def tick(self, ticks=1, command=True):
        for _ in range(ticks):
            if command:
                assert self.master.set_command(*self.command) == ""
            self.master.exchange()

    def enable(self):
        self.tick()
        assert self.master.enable() == ""
        self.until(Phase.ENABLED, 100)

    def until(self, phase, limit, command=True):
        for ticks in range(limit):
            if self.master.phase is phase:
                return ticks
            self.tick(command=command)
        raise AssertionError(f"{phase} not within {limit} ticks: {self.master.phase}")

    @property
    def rows(self):
        return self.bus.rows
