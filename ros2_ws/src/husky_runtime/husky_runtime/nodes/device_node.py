"""A lifecycle node whose device belongs to the active state."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from rclpy.clock import ROSClock
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription

from husky_runtime.log_budget import LogBudget
from husky_runtime.nodes.one_clock import OneClock
from husky_runtime.nodes.parameters import declare


class Link(Protocol):
    """What holds a device: a thread that opens it, and opens it again when it is gone."""

    def start(self) -> None:
        """Start the thread."""

    def stop(self) -> None:
        """End the thread and give the device back."""


LinkT = TypeVar("LinkT", bound=Link)


class DeviceNode(OneClock, LifecycleNode, Generic[LinkT]):
    """Opens its device on activation and gives it back on deactivation.

    A device that is not there yet is no failure: it is waited for. Whoever makes one says what
    the link is, and calls `autostart` as the last act of its constructor.
    """

    hot: Sequence[Subscription] = ()

    def __init__(self, name: str) -> None:
        """Make the node; nothing is opened yet."""
        super().__init__(name)
        self._link: LinkT | None = None
        self._budget = LogBudget()

    def autostart(self) -> None:
        """Declare the parameter `autostart`; unless it says no, configure and activate."""
        wanted = declare(self, "autostart", True, "configure and activate at start")
        if wanted and self.trigger_configure() is TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def make_link(self) -> LinkT:
        """Return a fresh link to the device, not started."""
        raise NotImplementedError

    def say(self, text: str) -> None:
        """Log a change of the device's state, few of them a minute if it changes all the time."""
        line = self._budget.line(text, time.monotonic())
        if line is not None:
            self.get_logger().info(line)

    def world_time(self) -> float | None:
        """Return the simulated time [s], None where there is none, or has been none yet."""
        clock = self.get_clock()
        if not (isinstance(clock, ROSClock) and clock.ros_time_is_active):
            return None
        return 1e-9 * clock.now().nanoseconds or None

    def part(self, link: LinkT) -> None:
        """Say a last word to the device before it is given back."""

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the device."""
        result = super().on_activate(state)
        self._link = self.make_link()
        self._link.start()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the device back."""
        self.close()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the device back, from whatever state."""
        self.close()
        return super().on_shutdown(state)

    def quiet(self) -> None:
        """Nothing to do: what comes from the device comes in the link's thread."""

    def close(self) -> None:
        """Part from the device, stop the thread and close the device."""
        link, self._link = self._link, None
        if link is not None:
            self.part(link)
            link.stop()
