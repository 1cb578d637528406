"""A camera's driver: its backend is chosen when the node is configured; its link is reported."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, TypeVar

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from husky_drivers.camera_link import BackendError, CameraLink, CameraState
from husky_runtime.nodes import diagnostics
from husky_runtime.nodes.device_node import DeviceNode

CameraLinkT = TypeVar("CameraLinkT", bound=CameraLink[Any])


class CameraNode(DeviceNode[CameraLinkT]):
    """Holds a camera's link in the active state.

    Configuring fails when the backend cannot work here. A camera that is not there yet is no
    failure: it is waited for.
    """

    def __init__(self, name: str) -> None:
        """Make the node; nothing is chosen or opened yet."""
        super().__init__(name)
        self._backend_name = ""
        self._problem = ""
        self._last_report = (time.monotonic(), 0)

    # For the kinds of cameras -------------------------------------------------------------------
    def choose_backend(self) -> None:
        """Make the backend that the parameters name; raises BackendError."""
        raise NotImplementedError

    def make_camera_link(self) -> CameraLinkT:
        """Return a fresh link to the backend, not started."""
        raise NotImplementedError

    def measured(self, link: CameraLinkT) -> Mapping[str, object]:
        """Return what the camera's frames show, for reports."""
        raise NotImplementedError

    def judge(self, link: CameraLinkT) -> tuple[bytes, str]:
        """Return level and message for a link to a camera that is there."""
        raise NotImplementedError

    # Lifecycle ----------------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the backend; fails, and says why, when it cannot work on this machine."""
        try:
            self.choose_backend()
        except BackendError as error:
            self._problem = f"backend {self._backend_name}: {error}"
            self.get_logger().error(self._problem)
            return TransitionCallbackReturn.FAILURE
        self._problem = ""
        return super().on_configure(state)

    def make_link(self) -> CameraLinkT:
        """Return a fresh link to the backend, not started."""
        self._last_report = (time.monotonic(), 0)
        return self.make_camera_link()

    # Report -------------------------------------------------------------------------------------
    def report(self) -> diagnostics.Report:
        """Return level, message and values for `/diagnostics`."""
        link = self._link
        if link is None:
            level = diagnostics.ERROR if self._problem else diagnostics.WARN
            values: dict[str, object] = {"backend": self._backend_name, "problem": self._problem}
            return level, self._problem or "not active", values
        state, counts = link.state, link.counts
        now = time.monotonic()
        last, last_good = self._last_report
        self._last_report = (now, counts["good"])
        values = {
            "state": state.value,
            "backend": self._backend_name,
            "device": link.backend.path,
            "rate": f"{(counts['good'] - last_good) / max(now - last, 1e-3):.1f}",
            **self.measured(link),
            **counts,
            "times_frozen": link.times_frozen,
            **link.backend.counters(),
            "connections": link.connections,
            "reconnects": max(0, link.connections - 1),
            "problem": link.error,
        }
        if state in (CameraState.STOPPED, CameraState.NO_DEVICE):
            return diagnostics.ERROR, f"{state.value}: {link.error}", values
        return *self.judge(link), values
