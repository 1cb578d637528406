"""Who says when a cycle of the bus begins, and hears that it has ended.

Real drives have no beat of their own: a clock gives it. Simulated devices have no time but the
world's: the simulation brings a pacer for each bus, under the bus's name in the entry-point group
`husky_drivers.pacer`. So the drive bridge does not know which bus it has.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from typing import Generic, Protocol, TypeVar

from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock

from husky_drivers.ethercat.bus import Bus
from husky_runtime import graph
from husky_runtime.nodes import qos, stamps
from husky_runtime.nodes.message_guard import refuser
from husky_runtime.stamp_gate import StampGate, Turn

MessageT = TypeVar("MessageT")

GROUP = "husky_drivers.pacer"
"""Entry-point group of pacers, each under the name of its bus."""


class BridgeCycle(Protocol):
    """What a pacer asks of a bridge."""

    lockstep: bool
    imu_stamp_ns: int
    """Stamp of the IMU sample behind the newest joint command [ns]."""

    def begin(self, time_ns: int, renewed: bool = False) -> bool:
        """Begin the cycle of a tick; return whether it has ended, else it waits for its command.

        Args:
            time_ns: the tick's stamp [ns].
            renewed: time has jumped: everybody must hear of it.
        """

    def tell_again(self) -> None:
        """Tell the joints of the last cycle again: somebody has lost a message, or waits."""

    def restart(self, reason: str) -> None:
        """Time starts again: nothing of before counts, nothing may move."""


class Pacer(Protocol):
    """What begins the cycles."""

    @property
    def hot(self) -> Sequence[Subscription]:
        """Subscriptions that a tick waits for."""

    @property
    def hot_timers(self) -> Sequence[Timer]:
        """Timers that begin ticks."""

    def cycle_ended(self, time_ns: int) -> None:
        """The cycle of a tick [ns] has ended, or the bridge is being closed."""


class TickGrid:
    """Stamps of ticks by a clock that never jumps: whole periods from a beginning.

    Consumers of the joint states take a stamp that is not one period behind the last for a gap
    (`husky_runtime.stamp_gate`), so a stamp must not carry how late its tick has begun. A tick that
    is late by a period or more leaves out those that it has missed.
    """

    def __init__(self, steady_ns: int, wall_ns: int, period: int = graph.TICK_PERIOD_NS):
        """Begin at a time of the steady clock, which is a time of the wall clock [ns]."""
        self._steady_ns, self._wall_ns, self._period = steady_ns, wall_ns, period
        self._tick = -1

    def stamp(self, steady_ns: int) -> int:
        """Return the stamp of the tick that begins now, later than the last [ns since 1970]."""
        self._tick = max(self._tick + 1, (steady_ns - self._steady_ns) // self._period)
        return self._wall_ns + self._tick * self._period


class ClockPacer:
    """The beat of real devices: this machine's steady clock, every tick period.

    Stamps are wall time as it was at the start, which later corrections of the clock do not move.
    """

    def __init__(self, node: LifecycleNode, cycle: BridgeCycle, bus: Bus | None = None):
        """Start the timer."""
        grid = TickGrid(time.monotonic_ns(), time.time_ns())

        def begin() -> None:
            cycle.begin(grid.stamp(time.monotonic_ns()))

        self.hot: list[Subscription] = []
        self.hot_timers = [node.create_timer(graph.TICK_PERIOD, begin)]

    def cycle_ended(self, time_ns: int) -> None:
        """Nobody has to hear of it."""


class StreamPacer(Generic[MessageT]):
    """Begins a cycle with each message of a stream whose stamps are the far side's time."""

    def __init__(
        self,
        node: Node,
        cycle: BridgeCycle,
        topic: str,
        stamp_of: Callable[[MessageT], int],
    ):
        """Hear nothing yet: whoever subscribes hands what comes to `_on_message`.

        Args:
            node: the bridge's.
            cycle: what is begun.
            topic: of the stream.
            stamp_of: tells a message's stamp [ns].
        """
        self._cycle, self._stamp_of = cycle, stamp_of
        self._gate: StampGate[MessageT] = StampGate(
            graph.TICK_PERIOD_NS,
            refuser(node, topic),
            graph.CLOCK_LAG_NS,
            replay=not cycle.lockstep,
        )
        self.hot: list[Subscription] = []
        self.hot_timers: list[Timer] = []

    def _on_message(self, message: MessageT) -> None:
        for turn, each in self._gate.admit(self._stamp_of(message), message):
            if turn is Turn.REPEAT:
                self._cycle.tell_again()
                self._say_again()
                continue
            if turn is Turn.RESTART:
                self._cycle.restart("the world has been reset")
            self._take(each)
            ended = self._cycle.begin(self._stamp_of(each), renewed=turn is not Turn.NEXT)
            if turn is Turn.RESTART and ended:
                self._cycle.tell_again()

    def _take(self, message: MessageT) -> None:
        """Use what a message brings, before its cycle begins."""

    def _say_again(self) -> None:
        """Say the last word to the far side again."""

    def cycle_ended(self, time_ns: int) -> None:
        """Nobody has to hear of it."""


class WorldClockPacer(StreamPacer[Clock]):
    """The beat of simulated devices on a wire: the world's time, told every tick."""

    def __init__(self, node: LifecycleNode, cycle: BridgeCycle, bus: Bus | None = None):
        """Subscribe to the clock."""
        super().__init__(node, cycle, graph.CLOCK, lambda clock: stamps.to_ns(clock.clock))
        self.hot.append(node.create_subscription(Clock, graph.CLOCK, self._on_message, qos.CONTROL))


PacerFactory = Callable[[LifecycleNode, BridgeCycle, Bus], Pacer]


def find_pacer(bus: str, pace: str) -> PacerFactory:
    """Return what makes the pacer of a bus.

    Args:
        bus: its name.
        pace: "hardware" for real devices; "lockstep" or "realtime" for simulated ones.
    """
    if pace == "hardware":
        return ClockPacer
    for point in entry_points(group=GROUP):
        if point.name == bus:
            factory: PacerFactory = point.load()
            return factory
    return WorldClockPacer
