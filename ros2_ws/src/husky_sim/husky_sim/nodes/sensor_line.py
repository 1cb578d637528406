"""A sensor on its serial line, and the driver that is awaited before a run starts."""

from __future__ import annotations

import time
from typing import Generic, Protocol, TypeVar

from rclpy.node import Node

from husky_runtime.lockstep import Peer
from husky_runtime.nodes.parameters import declare
from husky_runtime.nodes.presence import default_serial_port
from husky_runtime.ports.pty_port import PtyPort, SerialDevice


class Sensor(SerialDevice, Protocol):
    """A device that streams what it measures, and that can be made to fail."""

    @property
    def streaming(self) -> bool:
        """Whether its driver has told it to stream."""

    def inject(self, fault: str, intensity: float | None = None) -> None:
        """Start a fault, or heal it with an empty name; raises ValueError for another name."""


SensorT = TypeVar("SensorT", bound=Sensor)


class SensorLine(Generic[SensorT]):
    """Carries the bytes of a sensor, its `device`."""

    def __init__(self, node: Node, device: SensorT, parameter: str, what: str, driver: Peer):
        """Make the port.

        Args:
            node: the plant.
            device: the sensor.
            parameter: name of the plant's parameter that says where the port appears.
            what: what appears there, for the parameter's description.
            driver: who is awaited at the start only; also the name of the port by default.
        """
        self.device = device
        self._node = node
        self._driver = driver
        name = driver.name.removesuffix("_driver")
        default = default_serial_port(node, name)
        self._port = PtyPort(declare(node, parameter, default, f"where {what} appears"))

    def is_set_up(self) -> bool:
        """Return whether the driver listens, so that no run misses a sample, or is given up."""
        if self.device.streaming:
            self._driver.answer(0)
        elif self._driver.expire(time.monotonic()):
            warn_of_silence(self._node, self._driver)
        return self._driver.ready(0)

    def service(self) -> None:
        """Carry what is on the wire."""
        self._port.service(self.device)

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
