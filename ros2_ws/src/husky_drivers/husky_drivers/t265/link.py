"""The thread that serves a T265: opens it, hands its frames out, and opens it again."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from husky_drivers.silence import Silence, WorldTime
from husky_drivers.t265.backend import T265Backend
from husky_drivers.t265.frames import Confidence, PoseFrame
from husky_drivers.t265.gate import JumpLimits, PoseGate

_LONGEST_WAIT = 0.05
"""Longest wait for frames [s]: bounds how late silence, and the wish to stop, are noticed."""


@dataclass(frozen=True)
class LinkConfig:
    """When a device that is open counts as failed.

    Attributes:
        stale_after: time without a new frame after which the stream counts as frozen [s].
        silence_timeout: the same after which the device is closed and opened again [s].
        limits: what counts as a jump.
    """

    stale_after: float = 0.1
    silence_timeout: float = 1.0
    limits: JumpLimits = JumpLimits()  # noqa: RUF009 - frozen


class CameraState(Enum):
    """What a link is doing."""

    STOPPED = "stopped"
    NO_DEVICE = "no device"
    WAITING = "waiting for the first frame"
    TRACKING = "tracking"
    LOW_CONFIDENCE = "tracking, low confidence"
    LOST = "tracking lost"
    FROZEN = "frozen"


class T265Link:
    """Holds the stream of poses.

    Attributes:
        backend: the device.
        gate: which frames are good, with its counters; read by other threads for reports only.
        state: see `CameraState`.
        error: why the device is not open, "" when it is.
        connections: how often it has been opened.
        times_frozen: how often the stream has frozen.
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
        self.backend = backend
        self.gate = PoseGate(config.limits)
        self.state = CameraState.STOPPED
        self.error = ""
        self.connections = 0
        self.times_frozen = 0
        self._config = config
        self._on_frame = on_frame
        self._on_event = on_event
        self._told = ""
        self._silence = Silence(world_time)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._run, name="t265", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the device; the link cannot be started again."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    # In the thread ------------------------------------------------------------------------------
    def _run(self) -> None:
        backend = self.backend
        while not self._stop.is_set():
            try:
                backend.open()
                self.connections += 1
                self.error = ""
                self._serve()
            except OSError as error:
                self.error = error.strerror or str(error)
            finally:
                backend.close()
            if not self._stop.is_set():
                self._enter(CameraState.NO_DEVICE)
                self._stop.wait(backend.retry_period)
        self.state = CameraState.STOPPED

    def _serve(self) -> None:
        """Hand frames out until the link is to stop.

        Raises:
            OSError: the device is gone, or has been silent for too long.
        """
        config, accept, on_frame = self._config, self.gate.accept, self._on_frame
        counters = self.gate.counters
        poll = self.backend.poll
        jumps = counters.jumps
        wait = min(_LONGEST_WAIT, config.stale_after)
        self._enter(CameraState.WAITING)
        last = time.monotonic()
        self._silence.heard()
        while not self._stop.is_set():
            frames = poll(wait)
            host_ns = time.time_ns()
            now = time.monotonic()
            good = counters.good
            for frame in frames:
                if accept(frame):
                    on_frame(frame, host_ns)
            if counters.good > good:
                last = now
                self._silence.heard(1e-9 * frames[-1].time_ns)
                self._enter(_STATE_OF_CONFIDENCE[self.gate.confidence])
                if counters.jumps > jumps:
                    jumps = counters.jumps
                    self._on_event(f"the pose has jumped by {self.gate.last_jump:.2f}")
            elif now - last > config.stale_after:
                self._look_at_silence(now - last)

    def _look_at_silence(self, wall: float) -> None:
        """A stream whose world stands still is late, not frozen; `wall` [s] is how late.

        Raises:
            OSError: the device has been silent for too long.
        """
        silent, longest = self._silence.lasts(wall), self._config.silence_timeout
        if silent > longest:
            raise OSError(errno.ETIMEDOUT, f"no frame for {longest:g} s")
        if silent > self._config.stale_after and self.state is not CameraState.WAITING:
            self._enter(CameraState.FROZEN)

    def _enter(self, state: CameraState) -> None:
        """Note the state, and tell of a change once."""
        if state is self.state and state is not CameraState.NO_DEVICE:
            return
        self.times_frozen += state is CameraState.FROZEN
        self.state = state
        text = f"{state.value}: {self.error}" if self.error else state.value
        if text != self._told:
            self._told = text
            self._on_event(text)


_STATE_OF_CONFIDENCE = {
    int(Confidence.FAILED): CameraState.LOST,
    int(Confidence.LOW): CameraState.LOW_CONFIDENCE,
    int(Confidence.MEDIUM): CameraState.TRACKING,
    int(Confidence.HIGH): CameraState.TRACKING,
}
