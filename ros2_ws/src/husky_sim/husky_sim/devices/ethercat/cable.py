"""The cable between a master and the drives, and its faults: frames that are lost, late, changed.

Faults hit the answers on their way back; the drives have had the frame. A frame that does not reach
all drives is a fault of the line: `cut`, `silent` and `unpowered` of `husky_sim.devices.drives`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from husky_sim.devices.ethercat.frames import HEADER, datagrams
from husky_sim.devices.ethercat.wired_segment import Frame, WiredSegment

TARGET = "cable"
"""Name by which faults are injected here and not into a drive."""
_REMEMBERED = 8
"""Cycles that a replayed answer is old."""


class Cable:
    """Passes frames through the drives and brings back what comes of it."""

    def __init__(self, wired: WiredSegment):
        """Lay the cable to some drives; without faults."""
        self._wired = wired
        self._fault, self._left = "", 0
        self._late: list[bytearray] = []
        self._before: deque[bytearray] = deque(maxlen=_REMEMBERED)
        self._changes: dict[str, Callable[[bytearray], list[bytearray]]] = {
            "lost": lambda frame: [],
            "set_up_lost": lambda frame: [],
            "late": self._hold,
            "duplicated": lambda frame: [frame, frame],
            "replayed": self._replay,
            "truncated": lambda frame: [frame[: len(frame) // 2]],
            "corrupted": _corrupt,
            "counter": _count_less,
        }

    @property
    def faults(self) -> str:
        """Faults that `inject` takes."""
        return ", ".join(f"{name}:<n>" for name in self._changes)

    def inject(self, fault: str) -> None:
        """Let something happen to the next answers.

        Args:
            fault: name and number of answers, e.g. lost:3. "set_up_lost" hits answers to frames
                without process data of a drive in OP, the others hit those with.

        Raises:
            ValueError: there is no such fault; lists those there are.
        """
        name, _, number = fault.partition(":")
        if name not in self._changes or not (number.isdecimal() and 0 < int(number) <= 1_000_000):
            raise ValueError(
                f"no fault {fault!r} of the {TARGET}; there are {self.faults}, n from 1 to 1000000"
            )
        self._fault, self._left = name, int(number)

    def clear(self) -> None:
        """End the fault; what was late is lost."""
        self._fault, self._left = "", 0
        self._late.clear()

    def pass_frame(self, frame: bytearray) -> tuple[list[bytearray], Frame]:
        """Pass an Ethernet frame through the drives, in place.

        Returns:
            The frames that come back, and the kind of this one.
        """
        kind = self._wired.pass_frame(frame)
        if kind is Frame.FOREIGN:
            return [], kind
        answers = [frame]
        if self._late:
            answers, self._late = [*self._late, frame], []
        cyclic = kind is Frame.CYCLIC
        if cyclic:
            self._before.append(frame)
        if self._left and cyclic != (self._fault == "set_up_lost"):
            self._left -= 1
            answers[-1:] = self._changes[self._fault](frame)
        return answers, kind

    def _hold(self, frame: bytearray) -> list[bytearray]:
        self._late.append(frame)
        return []

    def _replay(self, frame: bytearray) -> list[bytearray]:
        """Return an answer of some cycles before, with the frame's index."""
        old = bytearray(self._before[0])
        for now, then in zip(datagrams(frame), datagrams(old), strict=False):
            old[then.header + 1] = frame[now.header + 1]
        return [old]


def _corrupt(frame: bytearray) -> list[bytearray]:
    """Return a frame whose first datagram has another command and length."""
    changed = bytearray(frame)
    changed[HEADER] ^= 0xFF
    changed[HEADER + 6] ^= 0xFF
    return [changed]


def _count_less(frame: bytearray) -> list[bytearray]:
    """Return a frame whose process data has a working counter that is 1 too low."""
    changed = bytearray(frame)
    counter = next(iter(datagrams(frame))).end
    value = int.from_bytes(frame[counter : counter + 2], "little")
    changed[counter : counter + 2] = max(0, value - 1).to_bytes(2, "little")
    return [changed]
