"""The plant's side of the depth camera: images on their ticks, cast beside the physics."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from rclpy.node import Node

from husky_drivers.d435.frames import DepthImage
from husky_runtime import graph
from husky_runtime.nodes.presence import make_peer
from husky_runtime.ports.socket_port import SocketPort
from husky_sim.devices.d435.device import D435Device
from husky_sim.devices.d435.optics import D435Optics
from husky_sim.nodes.sensor_line import SensorLine, warn_of_silence
from husky_sim.world import World

_TARGET = "d435"
"""Name of the camera for faults."""
_LOOK_NS = 10_000_000
"""Simulated time between two looks at the wire, unless the world waits for the driver [ns]."""
_TAKING_NS = 20_000_000
"""Simulated time that the driver has to take an image before the world waits for it [ns], less
where the next image comes earlier: it works meanwhile, beside the physics."""


class _Exposure(NamedTuple):
    """An image on its way.

    Attributes:
        number: of the image, which its noise depends on.
        time_ns: of the exposure [ns].
        due_ns: when the host gets it [ns].
        image: being cast in the other thread.
    """

    number: int
    time_ns: int
    due_ns: int
    image: Future[DepthImage]


class CameraWire:
    """Takes an image of the world every period and sends it after the camera's latency.

    The rays of an image are cast in a thread of their own, on a copy of the state at its tick,
    while the world goes on. In lockstep the world waits for the rays at the tick at which the image
    is due, and 20 ms later until the driver has taken it: images and their times do not depend on
    how fast anything runs. In realtime an image that is not ready comes late, and where the rays
    cannot keep up exposures are left out.

    Attributes:
        peer: the driver.
    """

    def __init__(self, node: Node, world: World, seed: int, grace: float, lockstep: bool):
        """Open the camera's socket.

        Args:
            node: the plant.
            world: with a robot that carries the camera.
            seed: of the camera's errors.
            grace: wall time that a silent driver is waited for [s].
            lockstep: whether the world waits for images and for the driver.

        Raises:
            ValueError: there is no robot in the world that carries the camera.
        """
        if not world.has_legs:
            raise ValueError("camera is true, but body is 'unit': the robot carries the camera")
        self._node, self._world, self._lockstep = node, world, lockstep
        figures = world.robot.d435
        self._optics = D435Optics(world.model, figures, seed)
        self._device = D435Device(figures, seed)
        self.peer = make_peer(node, graph.D435_DRIVER, grace)
        self._line = SensorLine(
            node,
            self._device,
            "d435_port",
            "the depth camera's socket",
            self.peer,
            SocketPort,
        )
        self._period_ns = round(1e9 / figures.rate)
        self._latency_ns = round(1e9 * figures.latency)
        self._taking_ns = min(_TAKING_NS, self._period_ns - 2 * graph.TICK_PERIOD_NS)
        self._most_under_way = 2 + self._latency_ns // self._period_ns
        self._thread = ThreadPoolExecutor(1, "d435")
        self._exposures: deque[_Exposure] = deque()
        self._restart_counts()

    def _restart_counts(self) -> None:
        for exposure in self._exposures:
            exposure.image.cancel()
        self._exposures.clear()
        self._next_ns, self._number = self._period_ns, 0
        self._owe_nothing()

    def _owe_nothing(self) -> None:
        """Forget the image that the driver has to take."""
        self._sent_ns, self._sent = -1, -1

    def is_set_up(self) -> bool:
        """Return whether the driver listens, so that no run misses an image."""
        return self._line.is_set_up()

    # The tick -------------------------------------------------------------------------------
    def advance(self) -> None:
        """Take in that a tick has gone by: expose if it is time to, send what is due."""
        now = self._world.time_ns
        if now >= self._next_ns:
            self._next_ns += self._period_ns
            if self._lockstep or len(self._exposures) < self._most_under_way:
                self._expose()
            self._number += 1
        while self._exposures and self._exposures[0].due_ns <= now:
            if not self._lockstep and not self._exposures[0].image.done():
                break
            number, time_ns, _, image = self._exposures.popleft()
            sent = self._device.send(number, time_ns, image.result())
            if sent is not None:
                self._sent_ns, self._sent = now, sent
            self.service()
        if now % _LOOK_NS == 0:
            self.service()

    def _expose(self) -> None:
        """Begin an image of the world as it is now."""
        now, state = self._world.time_ns, self._optics.snapshot(self._world.data)
        image = self._thread.submit(self._optics.image, self._number, state)
        self._exposures.append(_Exposure(self._number, now, now + self._latency_ns, image))

    def ready(self) -> bool:
        """Return whether the driver has taken what it had to take by now, or is given up."""
        late = self._world.time_ns >= self._sent_ns + self._taking_ns
        return not self._lockstep or not late or self.peer.ready(self._sent_ns)

    def service(self) -> bool:
        """Carry what is on the wire; return whether the driver said anything."""
        heard = bool(self._line.service())
        if not self._line.connected:  # A driver that comes back says START again.
            self._device.hang_up()
            self._owe_nothing()
        if heard and self._device.taken == self._sent:
            self.peer.answer(max(0, self._sent_ns))
        return heard

    def await_answer(self, now: float) -> None:
        """Lockstep: give up a driver that is silent; `now` is monotonic wall time [s]."""
        self.service()
        if self.peer.owes(self._sent_ns) and self.peer.expire(now):
            warn_of_silence(self._node, self.peer)

    # Rest -----------------------------------------------------------------------------------
    def restart(self, seed: int) -> None:
        """Begin at the world's time 0 again."""
        self._restart_counts()
        self._optics.restart(seed)
        self._device.restart(seed)
        self.peer.restart()

    def inject(self, target: str, fault: str) -> bool:
        """Make the camera fail; return False for another target; raises ValueError."""
        if target != _TARGET:
            return False
        self._line.inject(fault)
        self._owe_nothing()
        return True

    def targets(self) -> list[str]:
        """Return the names that `inject` knows."""
        return [_TARGET]

    def close(self) -> None:
        """Give the wire back."""
        self._thread.shutdown(cancel_futures=True)
        self._line.close()
