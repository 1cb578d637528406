"""The parameters `clock` and `latency` of a driver whose device has a clock of its own."""

from __future__ import annotations

from rclpy.node import Node

from husky_drivers.vn200.clock import DeviceClock, HostClock
from husky_runtime.nodes.parameters import declare


def declare_clock(node: Node, what: str) -> DeviceClock | HostClock:
    """Declare both and return the clock that they describe.

    Args:
        node: the driver.
        what: one of the things that are stamped, as the descriptions call it.
    """
    clock = declare(
        node,
        "clock",
        "device",
        f"whose time stamps the {what}s: the device's own, which is simulated time in the "
        "simulation, or the host's, which the device's is mapped to",
        allowed=("device", "host"),
    )
    latency = declare(
        node,
        "latency",
        0.0,
        f"smallest delay from {what} to arrival, taken off stamps of clock host [s]",
        0.0,
        0.1,
    )
    return DeviceClock() if clock == "device" else HostClock(latency)
