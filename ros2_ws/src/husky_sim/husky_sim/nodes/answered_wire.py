"""A wire whose far side answers every tick, and the wires of the joints made of it."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.subscription import Subscription

from husky_runtime.lockstep import Peer
from husky_runtime.nodes.presence import make_peer
from husky_sim.nodes.sensor_line import warn_of_silence
from husky_sim.world import World

_RESEND_PERIOD = 0.1
"""Wall time after which an unanswered state is sent again: best effort may lose one [s]."""


def peer_of(node: Node, world: World, name: str, grace: float) -> Peer:
    """Return who is waited for in each tick; in a world without legs only once it has been heard.

    Args:
        node: the plant.
        world: without legs a driver or bridge of the robot has nothing to do in it.
        name: of the other node.
        grace: wall time that it is waited for when it is silent [s].
    """
    if world.has_legs:
        return make_peer(node, name, grace)
    return make_peer(node, name, grace, start_grace=None)


class AnsweredWire(ABC):
    """Tells the state of each tick and hears that it is answered.

    Attributes:
        peer: who answers.
    """

    def __init__(self, node: Node, world: World, peer: Peer):
        """Nothing has been told; `node` is the plant."""
        self._node, self._world, self.peer = node, world, peer
        self._sent_at = time.monotonic()

    @abstractmethod
    def _say(self) -> None:
        """Put the state that was told last on the wire."""

    def _send(self) -> None:
        self._sent_at = time.monotonic()
        self._say()

    def ready(self) -> bool:
        """Return whether the state of now has been answered, or nobody is waited for."""
        return self.peer.ready(self._world.time_ns)

    def await_answer(self, now: float) -> None:
        """Lockstep: tell again what may have been lost; give a silent peer up.

        Args:
            now: monotonic wall time [s].
        """
        if not self.peer.owes(self._world.time_ns):
            return
        if now - self._sent_at > _RESEND_PERIOD:
            self._send()
        self._give_up_if_silent(now)

    def watch(self, now: float) -> None:
        """Realtime: give a silent peer up; as `await_answer`."""
        if not self.ready():
            self._give_up_if_silent(now)

    def _give_up_if_silent(self, now: float) -> None:
        if self.peer.expire(now):
            self._lose_peer()

    def _lose_peer(self) -> None:
        """Go on without the peer."""
        warn_of_silence(self._node, self.peer)


class JointWires(AnsweredWire):
    """Wires of the joints, as the plant sees them.

    Attributes:
        peer: who commands the joints.
        hot: subscriptions that a tick waits for.
        hot_wires: wires that a tick waits for: each, called, carries what is on it, if there is
            any.
    """

    hot: Sequence[Subscription] = ()
    hot_wires: Sequence[Callable[[], bool]] = ()

    @abstractmethod
    def tell(self) -> None:
        """Tell the state of now."""

    def is_set_up(self) -> bool:
        """Return whether a run may start; the first state is told to whoever is there."""
        return True

    def advance(self) -> None:
        """A tick has gone by."""

    def restart(self) -> None:
        """The world is back at time 0."""
        self.peer.restart()

    def inject(self, target: str, fault: str) -> bool:
        """Make something fail; return False for another's target; raises ValueError."""
        return False

    def targets(self) -> list[str]:
        """Return the names that `inject` knows."""
        return []

    def close(self) -> None:
        """Give the wires back."""
