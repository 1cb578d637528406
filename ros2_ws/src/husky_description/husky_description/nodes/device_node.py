"""A lifecycle node whose device belongs to the active state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription

from husky_description.nodes.parameters import declare


class Link(Protocol):
    """What holds a device: a thread that opens it, and opens it again when it is gone."""

    def start(self) -> None:
        """Start the thread."""

    def stop(self) -> None:
        """End the thread and give the device back."""


LinkT = TypeVar("LinkT", bound=Link)


class DeviceNode(LifecycleNode, Generic[LinkT]):
    """Opens its device on activation and gives it back on deactivation.

    A device that is not there yet is no failure: it is waited for. Whoever makes one says what
    the link is, and calls `autostart` as the last act of its constructor.
    """

    hot: Sequence[Subscription] = ()

    def __init__(self, name: str) -> None:
        """Make the node; nothing is opened yet."""
        super().__init__(name)
        self._link: LinkT | None = None

    def autostart(self) -> None:
        """Declare the parameter `autostart`; unless it says no, configure and activate."""
        wanted = declare(self, "autostart", True, "configure and activate at start")
        if wanted and self.trigger_configure() is TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def make_link(self) -> LinkT:
        """Return a fresh link to the device, not started."""
        raise NotImplementedError

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
