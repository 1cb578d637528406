"""What a T265 is to its driver: the camera, or the simulated device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from husky_drivers.t265.frames import PoseFrame


class BackendError(RuntimeError):
    """A backend cannot work on this machine at all; says which version is missing, and why."""


class T265Backend(Protocol):
    """A source of pose frames. One thread uses it.

    Attributes:
        path: where the device is, for reports.
        retry_period: time to wait before `open` is tried again [s].
    """

    path: str
    retry_period: float

    def open(self) -> None:
        """Start the stream; raises OSError when the device is not there, or taken."""

    def poll(self, timeout: float) -> Sequence[PoseFrame]:
        """Wait for frames at most this long [s]; return those that have come, oldest first.

        Raises:
            OSError: the device is gone.
        """

    def close(self) -> None:
        """Stop the stream and give the device back; does nothing when it is not open."""

    def counters(self) -> Mapping[str, int]:
        """Return what is counted on the way, for reports."""
