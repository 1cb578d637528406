"""A sensor on its line, and the driver that is awaited before a run starts."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from rclpy.node import Node

from husky_runtime.lockstep import Peer
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.ports.pty_port import PtyPort
from husky_runtime.ports.socket_port import StreamDevice


class Sensor(StreamDevice, Protocol):
    """A device that streams what it measures, and that can be made to fail."""

    @property
    def streaming(self) -> bool:
        """Whether its driver has told it to stream."""

    def inject(self, fault: str, intensity: float | None = None) -> None:
        """Start a fault, or heal it with an empty name; raises ValueError for another name."""


SensorT = TypeVar("SensorT", bound=Sensor)


class SensorPort(Protocol):
    """The device's end of a line: a pseudo-terminal, or a stream socket."""

    @property
    def connected(self) -> bool:
        """True while a driver is there, as of the last `service`."""

    def service(self, device: Any) -> object:
        """Carry what is on the wire in both directions."""

    def unplug(self) -> None:
        """Pull the plug."""

    def replug(self) -> None:
        """Plug in again."""

    def close(self) -> None:
        """Unplug for good."""


class SensorLine(Generic[SensorT]):
    """Carries the bytes of a sensor, its `device`."""

    def __init__(
        self,
        node: Node,
        device: SensorT,
        parameter: str,
        what: str,
        driver: Peer,
        make_port: Callable[[str], SensorPort] = PtyPort,
    ):
        """Make the port.

        Args:
            node: the plant.
            device: the sensor.
            parameter: name of the plant's parameter that says where the port appears.
            what: what appears there, for the parameter's description.
            driver: who is awaited at the start only; also the name of the port by default.
            make_port: makes the port at a path.
        """
        self.device = device
        self._node = node
        self._driver = driver
        name = driver.name.removesuffix("_driver")
        default = default_serial_port(node, name)
        self._port = make_port(declare(node, parameter, default, f"where {what} appears"))

    def is_set_up(self) -> bool:
        """Return whether the driver listens, so that no run misses a sample, or is given up."""
        if self.device.streaming:
            self._driver.answer(0)
        elif self._driver.expire(time.monotonic()):
            warn_of_silence(self._node, self._driver)
        return self._driver.ready(0)

    @property
    def connected(self) -> bool:
        """True while a driver has the line open, as of the last `service`."""
        return self._port.connected

    def service(self) -> object:
        """Carry what is on the wire; return what the port says of it."""
        return self._port.service(self.device)

    def inject(self, fault: str) -> None:
        """Pull the plug, or plug in and start `<fault>[:<intensity>]`, or heal with "".

        Raises:
            ValueError: no such fault.
        """
        if fault == "unplug":
            self._port.unplug()
            return
        kind, _, intensity = fault.partition(":")
        self._port.replug()
        self.device.inject(kind, float(intensity) if intensity else None)

    def close(self) -> None:
        """Give the wire back."""
        self._port.close()


def warn_of_silence(node: Node, peer: Peer) -> None:
    """Say that a peer is not waited for any more."""
    node.get_logger().warning(
        f"{peer.name} is silent: going on without it, the run is not deterministic"
    )
