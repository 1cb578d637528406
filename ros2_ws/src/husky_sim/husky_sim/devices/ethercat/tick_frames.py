"""Frames and ticks: the tick that a frame with process data belongs to.

In lockstep each tick takes one such frame, and one that comes before its tick is held. A master in
lockstep does not know by the wall clock that an answer is lost. So a frame that an injected fault
has lost comes back as it was sent, with working counters of 0.
"""

from __future__ import annotations

from husky_sim.devices.ethercat.cable import Cable
from husky_sim.devices.ethercat.wired_segment import Frame, WiredSegment


class TickFrames:
    """Passes frames through a cable, each in its tick. Not for several threads at a time.

    Attributes:
        passed: frames that have passed the drives.
        awaited: whether the tick has not had its frame.
        open: whether the tick has not ended.
    """

    def __init__(self, wired: WiredSegment, cable: Cable, *, lockstep: bool):
        """Start before the first tick.

        Args:
            wired: the drives.
            cable: between them and the master.
            lockstep: whether a frame waits for its tick; else it passes when it comes.
        """
        self._wired, self._cable, self._lockstep = wired, cable, lockstep
        self.passed = 0
        self.awaited = self.open = False
        self._held: bytearray | None = None  # a frame that has come before its tick

    def come(self, frame: bytearray) -> list[bytearray]:
        """Pass a frame or hold it; return the frames that go back now.

        Several in one tick pass, as those of a master that starts anew.
        """
        answers = self._pass_held()  # frames on a cable do not overtake one another
        early = self._lockstep and not (self.awaited or self.open)
        if early and self._wired.is_cyclic(frame):
            self._held = frame
            return answers
        return [*answers, *self._pass(frame)]

    def begin(self) -> list[bytearray]:
        """Begin a tick, whose motors are known; return the answers to a frame that was held."""
        self.open = True
        return self.await_another()

    def await_another(self) -> list[bytearray]:
        """Await a frame in this tick, whether or not one has come; return answers as `begin`."""
        self.awaited = True
        return self._pass_held()

    def end(self) -> None:
        """End the tick: what comes from now on belongs to the next one."""
        self.open = False

    def _pass_held(self) -> list[bytearray]:
        held, self._held = self._held, None
        return [] if held is None else self._pass(held)

    def _pass(self, frame: bytearray) -> list[bytearray]:
        sent = frame[:] if self._lockstep else frame
        answers, kind = self._cable.pass_frame(frame)
        self.passed += 1
        if kind is Frame.CYCLIC:
            self.awaited = False
            if self._lockstep and not answers:
                return [sent]
        return answers
