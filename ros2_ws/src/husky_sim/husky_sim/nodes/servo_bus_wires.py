"""The plant's end of the servo bus: bytes on a pseudo-terminal, and the lockstep over them."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from husky_runtime import graph
from husky_runtime.nodes.executor import executor_of
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.ports.pty_port import PtyPort
from husky_sim.devices.bus_servos.bus import EmulatedServoBus
from husky_sim.devices.bus_servos.motors import BusServoMotors
from husky_sim.nodes.answered_wire import JointWires, peer_of
from husky_sim.nodes.world_clock import WorldClock
from husky_sim.world import World

PREFIX = "servo:"
"""Stands before a joint's name as the target of a fault."""
BUS = "servo_bus"
"""Target of faults of the line itself."""


class ServoBusWires(JointWires):
    """The servos' line.

    The servos speak only when they are asked, and the clock is all that the bridge hears of a
    tick: here it is told at every tick. The tick is answered by the bridge's last word of it on the
    line (`EmulatedServoBus.cycle_words`, `health_words`); every other packet is a sign of life. A
    line that nobody has open is waited for like a silent bridge, for the grace period.
    """

    def __init__(
        self,
        node: Node,
        world: World,
        motors: BusServoMotors,
        grace: float,
        clock: WorldClock,
        advance: Callable[[], None],
    ):
        """Make the port; arguments as of `open_joint_wires`."""
        servo = world.robot.bus_servo
        super().__init__(node, world, peer_of(node, world, graph.SERVO_BRIDGE, grace))
        self._clock, self._advance = clock, advance
        self.bus = EmulatedServoBus(servo, world.robot.joint_names, motors)
        what = "where the servos' line appears"
        path = declare(node, "servo_port", default_serial_port(node, "servos"), what)
        self._port = PtyPort(path)
        self._cycle_ns = round(servo.cycle * 1e9)
        self._told_ns = -1
        self.hot_wires = (self.carry,)
        self._waker = LineWaker(node)
        self._waker.watch(self._port)

    # The line -----------------------------------------------------------------------------------
    def carry(self) -> bool:
        """Carry what is on the line; return whether something was."""
        bus, port = self.bus, self._port
        packets, words = bus.packets, self._last_words()
        port.service(bus)
        if bus.packets == packets:
            return False
        answered = self._last_words() > words and self._told_ns >= 0
        self.peer.answer(self._told_ns if answered else self.peer.answered)
        if answered:
            self._advance()
        return True

    def _last_words(self) -> int:
        """Return how many words have been heard that end a tick of this one's kind.

        Only such a one answers it: a word that is late by a tick does not, from before a reset say.
        """
        begins_cycle = self._told_ns % self._cycle_ns == 0
        return self.bus.cycle_words if begins_cycle else self.bus.health_words

    # The tick -----------------------------------------------------------------------------------
    def is_set_up(self) -> bool:
        """Return whether the bridge has been heard on the line, or is given up."""
        if self.bus.packets:
            return True
        if self._world.has_legs:
            self._give_up_if_silent(time.monotonic())
        return self.peer.ready(0)

    def tell(self) -> None:
        """Tell the time: to the bridge it says that a tick has begun."""
        self._told_ns = self._world.time_ns
        self._send()

    def _say(self) -> None:
        self._clock.tell(self._told_ns)

    def advance(self) -> None:
        """Let a tick's time pass for the servos."""
        self.bus.advance(graph.TICK_PERIOD)

    # Rest ---------------------------------------------------------------------------------------
    def restart(self) -> None:
        """The world is back at time 0."""
        super().restart()
        self.bus.restart()
        self._told_ns = -1

    def inject(self, target: str, fault: str) -> bool:
        """Make a servo or the line fail; return False for another's target.

        Raises:
            ValueError: no such joint or fault.
        """
        if target == BUS:
            if fault not in ("", "unplug"):
                raise ValueError(f"fault of the line is {fault!r}, it must be unplug or empty")
            if fault:
                self._port.unplug()
            else:
                self._port.replug()
                self._waker.watch(self._port)
            return True
        if not target.startswith(PREFIX):
            return False
        self.bus.inject(target.removeprefix(PREFIX), fault)
        return True

    def targets(self) -> list[str]:
        """Return the names that `inject` knows."""
        return [BUS, *(PREFIX + name for name in self._world.robot.joint_names)]

    def close(self) -> None:
        """Give the line back."""
        self._waker.close()
        self._port.close()


class LineWaker:
    """Ends the executor's wait when bytes come on a line: they are no message that would."""

    def __init__(self, node: Node):
        """Start the thread."""
        self._node = node
        self._epoll = select.epoll()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="servo line", daemon=True)
        self._thread.start()

    def watch(self, port: PtyPort) -> None:
        """Watch a port that has been plugged in."""
        self._epoll.register(port.fileno(), select.EPOLLIN | select.EPOLLET)

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._epoll.poll(0.2):
                executor = executor_of(self._node)
                if executor is not None:
                    executor.end_wait()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()
        self._epoll.close()
