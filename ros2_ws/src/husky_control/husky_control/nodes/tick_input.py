"""What a tick takes from another node: the newest word that it may know, and who is waited for."""

from __future__ import annotations

import time
from typing import Generic, TypeVar

from rclpy.node import Node

from husky_control.estimation.timed_buffer import TimedBuffer
from husky_runtime.lockstep import START_GRACE, Peer
from husky_runtime.nodes.message_guard import refuser
from husky_runtime.nodes.presence import runs

MessageT = TypeVar("MessageT")


class TickInput(Generic[MessageT]):
    """Keeps the messages of one topic until the tick that may know them.

    Attributes:
        peer: who sends them, as lockstep waits for it.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        peer: Peer,
        delay_ns: int,
        size: int,
        without: str,
        *,
        from_start: bool = False,
    ):
        """Nothing has come yet.

        Args:
            node: the controller's.
            topic: of the messages.
            peer: who sends them.
            delay_ns: in lockstep a tick waits for the word of this long before it [ns].
            size: most messages that are kept.
            without: what the controller does when the peer has fallen silent.
            from_start: in lockstep the first tick waits for the first word of a peer that runs;
                otherwise those after its first word do.
        """
        self.peer = peer
        self._node = node
        self._messages: TimedBuffer[MessageT] = TimedBuffer(refuser(node, topic), size)
        self._delay_ns = delay_ns
        self._without = without
        self._from_start = from_start
        self._now_ns = -1

    def await_tick(self, time_ns: int) -> None:
        """From now on messages are of this tick [ns]."""
        if self._now_ns < 0 and self._from_start and runs(self._node, self.peer.name):
            self.peer.expect(START_GRACE)
        self._now_ns = time_ns
        reached = self._messages.reach(time_ns)
        if reached >= 0:
            self.peer.answer(reached)

    def _keep(self, stamp: int, message: MessageT) -> bool:
        """Keep a message; return whether it is one of about now."""
        if not self._messages.add(stamp, message, self._now_ns):
            return False
        self.peer.answer(stamp)
        return True

    def ready(self, time_ns: int) -> bool:
        """Return whether a tick of this time has what it is to know."""
        due = time_ns - self._delay_ns
        return self.peer.ready(max(0, due) if self._from_start else due)

    def watch(self, time_ns: int) -> None:
        """A tick waits: give a silent peer up."""
        if not self.ready(time_ns) and self.peer.expire(time.monotonic()):
            self._node.get_logger().warning(f"{self.peer.name} is silent: {self._without}")

    def restart(self, time_ns: int) -> None:
        """The world starts again at an earlier time: what was known is of another time."""
        self.peer.restart(self._messages.restart(time_ns))
        self._now_ns = -1
