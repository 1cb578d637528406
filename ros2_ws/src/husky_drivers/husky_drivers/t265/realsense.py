"""The camera itself, through librealsense's Python module `pyrealsense2`."""

from __future__ import annotations

import errno
import importlib
import importlib.metadata
import queue
import re
from collections.abc import Mapping, Sequence
from typing import Any

from husky_description.rotation import Vector
from husky_drivers.t265.backend import BackendError
from husky_drivers.t265.frames import PoseFrame

REMOVED_IN = (2, 54)
"""librealsense 2.54.1 removed the T265; 2.53.1 is the last version that has it."""

_HOW = (
    "the last librealsense with the T265 is 2.53.1: its wheels end at Python 3.10, for a newer "
    "Python build it from source with BUILD_PYTHON_BINDINGS and BUILD_WITH_TM2 on"
)


def load_librealsense() -> Any:
    """Import `pyrealsense2`, if it is none of those without the T265.

    Raises:
        BackendError: it is not installed, or of a version without the T265.
    """
    try:
        module = importlib.import_module("pyrealsense2")
        if not hasattr(module, "pipeline"):  # As an installation from source has it.
            module = importlib.import_module("pyrealsense2.pyrealsense2")
    except ImportError as error:
        raise BackendError(f"pyrealsense2 cannot be imported ({error}); {_HOW}") from error
    version = _version(module)
    numbers = tuple(int(number) for number in re.findall(r"\d+", version)[:2])
    if numbers >= REMOVED_IN:
        raise BackendError(f"pyrealsense2 is version {version}, without the T265; {_HOW}")
    return module


def _version(module: Any) -> str:
    version = getattr(module, "__version__", "")
    if not version:
        try:
            version = importlib.metadata.version("pyrealsense2")
        except importlib.metadata.PackageNotFoundError:
            version = "unknown"
    return str(version)


class RealsenseBackend:
    """Pose stream of a T265 on USB.

    librealsense calls back in a thread of its own for each frame; a queue carries the frames over.
    """

    retry_period = 0.5

    def __init__(self, librealsense: Any, serial_number: str = ""):
        """Prepare the module `pyrealsense2` for one camera, "" for any; nothing is opened yet."""
        self.path = f"USB {serial_number}" if serial_number else "USB"
        self._library = librealsense
        self._serial_number = serial_number
        self._pipeline: Any = None
        self._frames: queue.SimpleQueue[PoseFrame] = queue.SimpleQueue()
        self._others = 0

    def open(self) -> None:
        """Start the pose stream; raises OSError when there is none, or librealsense cannot."""
        library = self._library
        self._frames = queue.SimpleQueue()
        try:
            context = library.context()
            self._find(context)
            config = library.config()
            if self._serial_number:
                config.enable_device(self._serial_number)
            config.enable_stream(library.stream.pose)
            pipeline = library.pipeline(context)
            pipeline.start(config, self._on_frame)
        except RuntimeError as error:
            raise OSError(errno.EIO, f"librealsense: {error}") from error
        self._pipeline = pipeline

    def _find(self, context: Any) -> None:
        info = self._library.camera_info
        found = [
            (device.get_info(info.name), device.get_info(info.serial_number))
            for device in context.query_devices()
        ]
        for name, number in found:
            if "T265" in name and self._serial_number in ("", number):
                return
        wanted = f"T265 {self._serial_number}".strip()
        there = ", ".join(" ".join(device) for device in found) or "nothing"
        version = _version(self._library)
        raise OSError(errno.ENODEV, f"no {wanted} on USB; librealsense {version} finds {there}")

    def _on_frame(self, frame: Any) -> None:
        """Take a frame, in librealsense's thread."""
        if not frame.is_pose_frame():
            self._others += 1
            return
        pose = frame.as_pose_frame().get_pose_data()
        q = pose.rotation
        self._frames.put(
            PoseFrame(
                number=int(frame.get_frame_number()),
                time_ms=float(frame.get_timestamp()),
                translation=_vector(pose.translation),
                velocity=_vector(pose.velocity),
                acceleration=_vector(pose.acceleration),
                rotation=(q.x, q.y, q.z, q.w),
                angular_velocity=_vector(pose.angular_velocity),
                angular_acceleration=_vector(pose.angular_acceleration),
                tracker_confidence=int(pose.tracker_confidence),
                mapper_confidence=int(pose.mapper_confidence),
            )
        )

    def poll(self, timeout: float) -> Sequence[PoseFrame]:
        """Wait for frames; one that was unplugged merely falls silent."""
        try:
            frames = [self._frames.get(timeout=timeout)]
        except queue.Empty:
            return ()
        while not self._frames.empty():
            frames.append(self._frames.get())
        return frames

    def close(self) -> None:
        """Stop the stream."""
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            try:
                pipeline.stop()
            except RuntimeError:
                pass  # Unplugged: there is nothing left to stop.

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were no poses."""
        return {"other_frames": self._others}


def _vector(vector: Any) -> Vector:
    return vector.x, vector.y, vector.z
