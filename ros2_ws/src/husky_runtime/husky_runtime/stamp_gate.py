"""Which stamps of a stream are believed: one message out of turn neither moves time nor resets it.

Streams that make the ticks come once a tick, each stamp one period after the last. Whatever else
comes is *doubted*: it is held back, and believed only when the next message goes on from there. So
a message of somebody else, or of long ago, falls out as soon as the stream goes on; frames that
were lost, and a world that starts again, are followed one message later.

Another topic of the same source, the *witness*, must agree: a gap is believed only near its time,
and time starts again only after the witness has gone back. Near time 0 a new start is believed
without it: its messages are too rare to tell.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Generic, TypeVar

MessageT = TypeVar("MessageT")


class Turn(Enum):
    """What a stamp means."""

    NEXT = "next"
    """The tick after the last."""
    REPEAT = "repeat"
    """The last one again: its answer was lost, or something is to be heard of us."""
    GAP = "gap"
    """Later than the next, and confirmed: messages have been lost."""
    RESTART = "restart"
    """Earlier than the last, and confirmed: time starts again."""


class StampGate(Generic[MessageT]):
    """Judges a stream's messages by their stamps; `last` is the newest believed [ns], or -1."""

    def __init__(
        self,
        period: int,
        refuse: Callable[[str], None],
        lag: int,
        *,
        replay: bool = False,
    ):
        """Nothing has come yet.

        Args:
            period: between two stamps [ns].
            refuse: told why, when a doubted message turns out to be wrong.
            lag: by how much the witness may be behind [ns].
            replay: behind a gap the message that was held back counts as well as the one that
                confirms it; otherwise only the newer.
        """
        self.last = -1
        self._period = period
        self._refuse = refuse
        self._lag = lag
        self._replay = replay
        self._doubted: tuple[int, MessageT] | None = None
        self._witness: int | None = None
        self._restarts = 0
        self._announced = False

    def hear_witness(self, stamp: int, restarts: int = 0) -> None:
        """The witness tells the time [ns] and, where it does, how often that has started again."""
        if self._witness is not None and (stamp < self._witness or restarts != self._restarts):
            self._announced = True
        elif stamp >= self.last - self._lag:
            self._announced = False
        self._witness, self._restarts = stamp, restarts

    def admit(self, stamp: int, message: MessageT) -> list[tuple[Turn, MessageT]]:
        """Return the messages to act on now, each with its turn; none when this one is doubted.

        Args:
            stamp: of the message [ns].
            message: is held back when it is doubted.
        """
        if stamp == self.last:
            return [(Turn.REPEAT, message)]
        if self.last < 0 or stamp == self.last + self._period:
            self._drop_doubted()
            self.last = stamp
            return [(Turn.NEXT, message)]
        held = self._doubted
        goes_on = held is not None and held[0] <= stamp <= held[0] + self._period
        again = held is not None and held[0] == stamp
        if held is None or not goes_on or not self._is_witnessed(stamp, again):
            if not goes_on:
                self._drop_doubted()
            self._doubted = (stamp, message)
            return []
        turn = Turn.GAP if stamp > self.last else Turn.RESTART
        self.last, self._doubted, self._announced = stamp, None, False
        if turn is Turn.GAP and self._replay and held[0] < stamp:
            return [(turn, held[1]), (Turn.NEXT, message)]
        return [(turn, message)]

    def _is_witnessed(self, stamp: int, again: bool) -> bool:
        """Return whether the witness, if there is one, tells about the same time.

        The same message again shows less than the next one: then it must tell this very tick.
        """
        lag = self._period if again else self._lag
        near = self._witness is None or -self._period <= stamp - self._witness <= lag
        if stamp > self.last:
            return near
        begins = stamp <= self._lag and (self._witness is None or self.last <= self._lag)
        return near and (self._announced or begins)

    def _drop_doubted(self) -> None:
        """The stream has not gone on from what was doubted."""
        if self._doubted is not None:
            told, awaited = self._doubted[0] / 1e9, (self.last + self._period) / 1e9
            self._doubted = None
            self._refuse(f"its stamp is {told:.3f} s, awaited is {awaited:.3f} s")
