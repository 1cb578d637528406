"""The thread that serves a D435: hands its images out, and tells of one that sees nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from husky_drivers.camera_link import CameraBackend, CameraLink, CameraPatience, CameraState
from husky_drivers.d435.frames import DepthFrame
from husky_drivers.d435.gate import LEAST_VALID, DepthGate, Verdict
from husky_drivers.silence import WorldTime


class D435Backend(CameraBackend[DepthFrame], Protocol):
    """The camera, or the simulated device."""

    def taken(self, frame: DepthFrame) -> None:
        """Tell the device that a frame has been passed on or dropped; raises OSError."""


@dataclass(frozen=True)
class DepthLinkConfig(CameraPatience):
    """Limits at which an open device counts as frozen, failed or covered.

    Attributes:
        stale_after, silence_timeout: as of `CameraPatience` [s].
        least_valid: share of pixels with depth below which the camera counts as covered [-].
    """

    stale_after: float = 0.5
    silence_timeout: float = 5.0
    least_valid: float = LEAST_VALID


class D435Link(CameraLink[DepthFrame]):
    """Holds the stream of depth images.

    Attributes:
        gate: which frames are good, with its counters; read by other threads for reports only.
    """

    backend: D435Backend

    def __init__(
        self,
        backend: D435Backend,
        config: DepthLinkConfig,
        on_frame: Callable[[DepthFrame, int], None],
        on_event: Callable[[str], None] = lambda text: None,
        world_time: WorldTime = lambda: None,
    ):
        """Prepare; nothing is opened yet.

        Args:
            backend: the device.
            config: when it counts as failed.
            on_frame: called in the link's thread with each good frame and the host's time of its
                arrival [ns since 1970].
            on_event: called in the link's thread with a sentence when the state changes.
            world_time: of the device; called in the link's thread.
        """
        super().__init__("d435", backend, config, on_event, world_time)
        self.gate = DepthGate(config.least_valid)
        self._on_frame = on_frame
        self._seen = CameraState.STREAMING

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of frames by verdict."""
        return vars(self.gate.counters)

    # In the thread ------------------------------------------------------------------------------
    def _take(self, frame: DepthFrame, host_ns: int) -> bool:
        verdict = self.gate.judge(frame)
        if verdict in (Verdict.GOOD, Verdict.COVERED):
            self._on_frame(frame, host_ns)
        self.backend.taken(frame)  # A dropped one too: a camera in lockstep waits for it.
        seen = _STATE_OF_VERDICT.get(verdict)
        if seen is None:
            return False
        self._seen = seen
        return True

    def _judge(self) -> None:
        self._enter(self._seen)


_STATE_OF_VERDICT = {
    Verdict.GOOD: CameraState.STREAMING,
    Verdict.COVERED: CameraState.COVERED,
    Verdict.STUCK: CameraState.STUCK,
}
