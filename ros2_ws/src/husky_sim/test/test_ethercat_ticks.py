"""Frames in lockstep: one with process data a tick, however early it comes."""

import struct

import pytest
from ethercat_line import B_READ, IN, L_BOTH, Line, frame_of

from husky_drivers.cia402 import DriveState
from husky_drivers.ethercat.pdo import RX, ProcessImage
from husky_sim.devices.ethercat.cable import Cable
from husky_sim.devices.ethercat.frames import datagrams
from husky_sim.devices.ethercat.tick_frames import TickFrames

SHUTDOWN, SWITCH_ON = 0x06, 0x07
SELF_TEST = 12
"""Ticks after which the drives have started."""


class Rig:
    """Drives in OP; a master that makes its frames by hand, with an index of its choice."""

    def __init__(self, *, lockstep=True):
        self.line = Line()
        self.line.bring_to_op()
        for _ in range(SELF_TEST):
            self.line.tick()
        self.cable = Cable(self.line.wired)
        self.frames = TickFrames(self.line.wired, self.cable, lockstep=lockstep)

    def cyclic(self, index, controlword=SHUTDOWN):
        """Return a frame with a controlword for each drive."""
        outputs = ProcessImage(RX, self.line.count)
        outputs.fields["controlword"] = controlword
        frame = frame_of((L_BOTH, 0, 0, outputs.data + bytes(IN * self.line.count)))
        frame[17] = index
        return frame

    def other(self):
        return frame_of((B_READ, 0, 0x0130, b"\0\0"))

    def begin(self):
        """Begin a tick; return the answers to a frame that was held."""
        self.line.tick()
        return self.frames.begin()

    @property
    def state(self):
        return self.line.segment.states()[0]


def told(answers):
    """Return index and working counter of the one answer."""
    (answer,) = answers
    (datagram,) = datagrams(answer)
    return answer[17], struct.unpack_from("<H", answer, datagram.end)[0]


@pytest.fixture
def rig():
    return Rig()


def test_a_frame_that_comes_before_its_tick_is_held(rig):
    assert rig.frames.come(rig.cyclic(1)) == []
    assert rig.state is DriveState.SWITCH_ON_DISABLED
    assert told(rig.begin()) == (1, 36)
    assert rig.state is DriveState.READY_TO_SWITCH_ON
    assert not rig.frames.awaited and rig.frames.open


def test_another_frame_of_the_same_tick_passes(rig):
    """A master that has started anew sends other outputs."""
    rig.begin()
    rig.frames.come(rig.cyclic(1))
    assert told(rig.frames.come(rig.cyclic(2, SWITCH_ON))) == (2, 36)
    assert rig.state is DriveState.SWITCHED_ON


def test_after_the_end_of_a_tick_the_same_frame_belongs_to_the_next(rig):
    rig.begin()
    rig.frames.come(rig.cyclic(1))
    rig.frames.end()
    assert rig.frames.come(rig.cyclic(2)) == []
    assert told(rig.begin()) == (2, 36)


def test_frames_do_not_overtake_one_another(rig):
    assert told(rig.frames.come(rig.other())) == (0, 12)
    rig.frames.come(rig.cyclic(1))
    held, other = rig.frames.come(rig.other())
    assert told([held]) == (1, 36) and told([other]) == (0, 12)
    rig.frames.come(rig.cyclic(2))
    assert told(rig.frames.come(rig.cyclic(3))) == (2, 36)
    assert told(rig.begin()) == (3, 36)


def test_a_frame_that_is_lost_comes_back_as_it_was_sent(rig):
    rig.begin()
    rig.cable.inject("lost:1")
    sent = rig.cyclic(1)
    (answer,) = rig.frames.come(sent[:])
    assert answer == sent and rig.state is DriveState.READY_TO_SWITCH_ON
    rig.frames.end()
    rig.begin()
    assert told(rig.frames.come(rig.cyclic(3))) == (3, 36)


def test_without_lockstep_a_frame_passes_when_it_comes():
    rig = Rig(lockstep=False)
    assert told(rig.frames.come(rig.cyclic(1))) == (1, 36)
    rig.cable.inject("lost:1")
    assert rig.frames.come(rig.cyclic(2)) == []
