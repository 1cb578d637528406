"""Common part of the drivers of cameras: a backend, and the thread that serves it."""

from __future__ import annotations

import errno
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar

from husky_drivers.silence import Silence, WorldTime

LATEST_TIME_MS = 2.0**31 * 1e3
"""First time of a frame that no stamp of ROS can hold [ms]."""
_LONGEST_WAIT = 0.05
"""Longest wait for frames [s]: bounds how late silence, and the wish to stop, are noticed."""


class BackendError(RuntimeError):
    """A backend cannot work on this machine at all; says which version is missing, and why."""


class CameraFrame(Protocol):
    """One frame of a camera's stream."""

    @property
    def time_ns(self) -> int:
        """The camera's time of the frame [ns]."""


FrameT = TypeVar("FrameT", bound=CameraFrame)
FrameT_co = TypeVar("FrameT_co", bound=CameraFrame, covariant=True)


class CameraBackend(Protocol[FrameT_co]):
    """A source of frames: the camera, or the simulated device. One thread uses it.

    Attributes:
        path: where the device is, for reports.
        retry_period: time to wait before `open` is tried again [s].
    """

    path: str
    retry_period: float

    def open(self) -> None:
        """Start the stream; raises OSError when the device is not there, or taken."""

    def poll(self, timeout: float) -> Sequence[FrameT_co]:
        """Wait for frames at most this long [s]; return those that have come, oldest first.

        Raises:
            OSError: the device is gone.
        """

    def close(self) -> None:
        """Stop the stream and give the device back; does nothing when it is not open."""

    def counters(self) -> Mapping[str, int]:
        """Return what is counted on the way, for reports."""


@dataclass(frozen=True)
class CameraPatience:
    """Time without frames after which an open device counts as frozen, and as failed.

    Attributes:
        stale_after: time without a new frame after which the stream counts as frozen [s].
        silence_timeout: the same after which the device is closed and opened again [s].
    """

    stale_after: float
    silence_timeout: float


@dataclass
class WireCounters:
    """Counts of the parser of a simulated camera's wire; each byte is in a frame, garbage, or still
    pending.

    Attributes:
        bytes: bytes fed.
        frames: frames with a right CRC.
        crc_errors: headers whose frame had a wrong CRC: damaged, cut short, or no frame at all.
        garbage_bytes: bytes that belong to no frame.
    """

    bytes: int = 0
    frames: int = 0
    crc_errors: int = 0
    garbage_bytes: int = 0


class CameraState(Enum):
    """State of a link: the first four are any camera's, the next the T265's, the last the D435's.

    COVERED is a camera whose images have hardly any depth, STUCK one that repeats its last image.
    """

    STOPPED = "stopped"
    NO_DEVICE = "no device"
    WAITING = "waiting for the first frame"
    FROZEN = "frozen"

    TRACKING = "tracking"
    LOW_CONFIDENCE = "tracking, low confidence"
    LOST = "tracking lost"

    STREAMING = "streaming"
    COVERED = "covered"
    STUCK = "stuck"


class CameraLink(ABC, Generic[FrameT]):
    """Opens a camera, hands its frames out in a thread, and opens it again when it is gone.

    Attributes:
        backend: the device.
        state: see `CameraState`.
        error: why the device is not open, "" when it is.
        connections: how often it has been opened.
        times_frozen: how often the stream has frozen.
    """

    def __init__(
        self,
        name: str,
        backend: CameraBackend[FrameT],
        patience: CameraPatience,
        on_event: Callable[[str], None] = lambda text: None,
        world_time: WorldTime = lambda: None,
    ):
        """Prepare; nothing is opened yet.

        Args:
            name: of the thread.
            backend: the device.
            patience: when it counts as failed.
            on_event: called in the link's thread with a sentence when the state changes.
            world_time: of the device; called in the link's thread.
        """
        self.state = CameraState.STOPPED
        self.error = ""
        self.connections = 0
        self.times_frozen = 0
        self._name = name
        self.backend = backend
        self._patience = patience
        self._on_event = on_event
        self._told = ""
        self._silence = Silence(world_time)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the device; the link cannot be started again."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    @property
    @abstractmethod
    def counts(self) -> Mapping[str, int]:
        """Counts of frames by verdict, `good` among them; read by other threads for reports."""

    # For the kinds of cameras, in the thread ----------------------------------------------------
    @abstractmethod
    def _take(self, frame: FrameT, host_ns: int) -> bool:
        """Hand a frame out if it is good; return whether it is new, good or not.

        Args:
            frame: as it has come.
            host_ns: the host's time of its arrival [ns since 1970].
        """

    @abstractmethod
    def _judge(self) -> None:
        """Enter the state that the frames show, after new ones have been taken."""

    # In the thread ------------------------------------------------------------------------------
    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._open_and_serve()
        finally:
            self.state = CameraState.STOPPED

    def _open_and_serve(self) -> None:
        """Serve the device until it is gone, or the link is to stop."""
        device = self.backend
        try:
            device.open()
            self.connections += 1
            self.error = ""
            self._serve()
        except OSError as error:
            self.error = error.strerror or str(error)
        finally:
            device.close()
        if not self._stop.is_set():
            self._enter(CameraState.NO_DEVICE)
            self._stop.wait(device.retry_period)

    def _serve(self) -> None:
        """Take frames until the link is to stop.

        Raises:
            OSError: the device is gone, or has been silent for too long.
        """
        poll, take = self.backend.poll, self._take
        stale_after = self._patience.stale_after
        wait = min(_LONGEST_WAIT, stale_after)
        self._enter(CameraState.WAITING)
        last = time.monotonic()
        self._silence.heard()
        while not self._stop.is_set():
            frames = poll(wait)
            host_ns = time.time_ns()
            now = time.monotonic()
            newest: FrameT | None = None
            for frame in frames:
                if take(frame, host_ns):
                    newest = frame
            if newest is not None:
                last = now
                self._silence.heard(1e-9 * newest.time_ns)
                self._judge()
            elif now - last > stale_after:
                self._look_at_silence(now - last)

    def _look_at_silence(self, wall: float) -> None:
        """A stream whose world stands still is late, not frozen; `wall` [s] is how late.

        Raises:
            OSError: the device has been silent for too long.
        """
        silent, longest = self._silence.lasts(wall), self._patience.silence_timeout
        if silent > longest:
            raise OSError(errno.ETIMEDOUT, f"no frame for {longest:g} s")
        if silent > self._patience.stale_after and self.state is not CameraState.WAITING:
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
