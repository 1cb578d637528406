"""When a recorded message happened: the robot's time, taken from the stamps of the messages.

A run that is faster or slower than real time must play back at the pace of the robot, so a bag's
log times are the stamps. Topics differ in how far their stamps can be trusted, hence these rules:

- The topics of the tick set the *present*: of those that are heard, the first in the graph's table.
- Where none of them is heard, wall time is the present.
- A stamp within `WINDOW_NS` of the present is the log time of its message. All others (no stamp, or
  one of another clock, such as wall time of somebody's own node) get the present.
- When the present jumps back, time has been reset; from then on log times are shifted, so that they
  go on where they were and the bag stays in order. The messages keep the stamps they came with.
"""

from __future__ import annotations

import struct

WINDOW_NS = 5_000_000_000
"""How far from the present a stamp may lie [ns]; longer than the deepest queue holds."""

_UNKNOWN_RANK = 1 << 30
_STAMP_LITTLE = struct.Struct("<iI")
_STAMP_BIG = struct.Struct(">iI")


def read_stamp(message: bytes) -> int:
    """Return the stamp at the start of a serialized message, in nanoseconds; -1 if it has none.

    No stamp is before 0; whoever sends one, or a message that is cut short, says nothing of time.

    Args:
        message: CDR with its encapsulation header of 4 bytes, of a type that begins with a
            `builtin_interfaces/Time` or a `std_msgs/Header`.
    """
    if len(message) < 4 + _STAMP_LITTLE.size:
        return -1
    layout = _STAMP_LITTLE if message[1] & 1 else _STAMP_BIG
    seconds, nanoseconds = layout.unpack_from(message, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds) if seconds >= 0 else -1


def near(stamp: int, present: int) -> int:
    """Return a stamp [ns] that is near the present, for any other one the present [ns]."""
    return stamp if stamp >= 0 and abs(stamp - present) <= WINDOW_NS else present


class LogTime:
    """Turns stamps into log times that never jump back by more than `WINDOW_NS`.

    Attributes:
        present: newest log time of the topic that sets it [ns], None until it has been heard.
        resets: how often time jumped back.
    """

    def __init__(self) -> None:
        """Know no time yet."""
        self.present: int | None = None
        self.resets = 0
        self._rank = _UNKNOWN_RANK
        self._newest = 0
        self._shift = 0

    @property
    def is_paced(self) -> bool:
        """Whether a topic that sets the present has been heard."""
        return self._rank != _UNKNOWN_RANK

    def go_by(self, now: int) -> int:
        """Return the log time of a message while nothing has told the robot's time: wall time [ns].

        The robot's time, once it is told, goes on from there, unless it is the same clock.
        """
        self.present = max(now, self.present or 0)
        return self.present

    def pace(self, rank: int, stamp: int) -> int:
        """Return the log time of a message of a topic that may set the present [ns].

        Args:
            rank: place of its topic; the lowest that has been heard sets the present.
            stamp: of the message [ns].
        """
        if rank > self._rank:
            return self.place(stamp)
        if self._rank == _UNKNOWN_RANK and self.present is not None:
            self._rank = rank
            if abs(stamp - self.present) > WINDOW_NS:
                self._shift = self.present - stamp
        elif rank < self._rank:
            # The stamps of all ticking topics are of one clock, so this is no jump.
            self._rank = rank
        elif stamp < self._newest:
            self.resets += 1
            self._shift += self._newest - stamp
        self._newest = stamp
        self.present = stamp + self._shift
        return self.present

    def place(self, stamp: int) -> int:
        """Return the log time of a message with a stamp that may be of another clock [ns].

        Raises:
            ValueError: nothing has set the present yet.
        """
        if self.present is None:
            raise ValueError("no message has set the present yet")
        return near(stamp + self._shift, self.present)
