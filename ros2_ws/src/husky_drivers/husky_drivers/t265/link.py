"""The thread that serves a T265: hands its poses out, and tells of tracking and of jumps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from husky_drivers.camera_link import CameraBackend, CameraLink, CameraPatience, CameraState
from husky_drivers.silence import WorldTime
from husky_drivers.t265.frames import Confidence, PoseFrame
from husky_drivers.t265.gate import JumpLimits, PoseGate

T265Backend = CameraBackend[PoseFrame]
"""The camera, or the simulated device."""


@dataclass(frozen=True)
class LinkConfig(CameraPatience):
    """When a device that is open counts as failed, and when it jumps.

    Attributes:
        stale_after, silence_timeout: as of `CameraPatience` [s].
        limits: what counts as a jump.
    """

    stale_after: float = 0.1
    silence_timeout: float = 1.0
    limits: JumpLimits = JumpLimits()  # noqa: RUF009 - frozen


class T265Link(CameraLink[PoseFrame]):
    """Holds the stream of poses.

    Attributes:
        gate: which frames are good, with its counters; read by other threads for reports only.
    """

    def __init__(
        self,
        backend: T265Backend,
        config: LinkConfig,
        on_frame: Callable[[PoseFrame, int], None],
        on_event: Callable[[str], None] = lambda text: None,
        world_time: WorldTime = lambda: None,
    ):
        """Prepare; nothing is opened yet.

        Args:
            backend: the device.
            config: when it counts as failed.
            on_frame: called in the link's thread with each good frame and the host's time of its
                arrival [ns since 1970].
            on_event: called in the link's thread with a sentence when the state changes, and when
                the pose has jumped.
            world_time: of the device; called in the link's thread.
        """
        super().__init__("t265", backend, config, on_event, world_time)
        self.gate = PoseGate(config.limits)
        self._on_frame = on_frame
        self._jumps_told = 0

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of frames by verdict."""
        return vars(self.gate.counters)

    # In the thread ------------------------------------------------------------------------------
    def _take(self, frame: PoseFrame, host_ns: int) -> bool:
        if not self.gate.accept(frame):
            return False
        self._on_frame(frame, host_ns)
        return True

    def _judge(self) -> None:
        self._enter(_STATE_OF_CONFIDENCE[self.gate.confidence])
        jumps = self.gate.counters.jumps
        if jumps > self._jumps_told:
            self._jumps_told = jumps
            self._on_event(f"the pose has jumped by {self.gate.last_jump:.2f}")


_STATE_OF_CONFIDENCE = {
    int(Confidence.FAILED): CameraState.LOST,
    int(Confidence.LOW): CameraState.LOW_CONFIDENCE,
    int(Confidence.MEDIUM): CameraState.TRACKING,
    int(Confidence.HIGH): CameraState.TRACKING,
}
