"""Cameras on USB through librealsense's Python module `pyrealsense2`."""

from __future__ import annotations

import errno
import importlib
import importlib.metadata
import queue
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic

from husky_drivers.camera_link import BackendError, FrameT


def import_librealsense(advice: str) -> Any:
    """Import `pyrealsense2`.

    Args:
        advice: where it can be had, for the error.

    Raises:
        BackendError: it is not installed.
    """
    try:
        module = importlib.import_module("pyrealsense2")
        if not hasattr(module, "pipeline"):  # As an installation from source has it.
            module = importlib.import_module("pyrealsense2.pyrealsense2")
    except ImportError as error:
        raise BackendError(f"pyrealsense2 cannot be imported ({error}); {advice}") from error
    return module


def version_of(module: Any) -> str:
    """Return the version of a `pyrealsense2`, "unknown" if nothing tells it."""
    version = getattr(module, "__version__", "")
    if not version:
        try:
            version = importlib.metadata.version("pyrealsense2")
        except importlib.metadata.PackageNotFoundError:
            version = "unknown"
    return str(version)


def find_camera(library: Any, context: Any, model: str, serial_number: str) -> Any:
    """Return a camera on USB.

    Args:
        library: the module.
        context: of librealsense.
        model: that the camera's name must have in it.
        serial_number: of the camera, "" for any.

    Raises:
        OSError: there is none; says what is there.
    """
    info = library.camera_info
    there = []
    for device in context.query_devices():
        name, number = device.get_info(info.name), device.get_info(info.serial_number)
        if model in name and serial_number in ("", number):
            return device
        there.append(f"{name} {number}")
    wanted = f"{model} {serial_number}".strip()
    found, version = ", ".join(there) or "nothing", version_of(library)
    raise OSError(errno.ENODEV, f"no {wanted} on USB; librealsense {version} finds {found}")


def describe_camera(library: Any, model: str, serial_number: str) -> Iterator[str]:
    """Return serial number and firmware of a camera, as librealsense reports them.

    Raises:
        OSError: there is none.
    """
    device = find_camera(library, library.context(), model, serial_number)
    info = library.camera_info
    yield f"serial number {device.get_info(info.serial_number)}"
    yield f"firmware {device.get_info(info.firmware_version)}"


class LibrealsenseBackend(ABC, Generic[FrameT]):
    """One stream of a camera on USB.

    librealsense calls back in a thread of its own for each frame; a queue carries the frames over.
    """

    retry_period = 0.5

    def __init__(self, library: Any, model: str, serial_number: str = ""):
        """Prepare; nothing is opened yet.

        Args:
            library: the module `pyrealsense2`.
            model: that the camera's name must have in it.
            serial_number: of the camera, "" for any.
        """
        self.path = f"USB {serial_number}" if serial_number else "USB"
        self._library = library
        self._model = model
        self._serial_number = serial_number
        self._pipeline: Any = None
        self._frames: queue.SimpleQueue[FrameT] = queue.SimpleQueue()
        self._others = 0

    @abstractmethod
    def _enable(self, device: Any, config: Any) -> str:
        """Ask for the stream of a camera in a configuration; return its name, for errors.

        Raises:
            RuntimeError: of librealsense.
        """

    @abstractmethod
    def _convert(self, frame: Any) -> FrameT | None:
        """Return a frame of librealsense, None for one of another stream; in librealsense's thread.

        Raises:
            RuntimeError: of librealsense.
        """

    def open(self) -> None:
        """Start the stream; raises OSError when there is no camera, or librealsense cannot."""
        library = self._library
        self._frames = queue.SimpleQueue()
        stream = self._model
        try:
            context = library.context()
            device = find_camera(library, context, self._model, self._serial_number)
            config = library.config()
            # Of several cameras the one that was found.
            config.enable_device(device.get_info(library.camera_info.serial_number))
            stream = self._enable(device, config)
            pipeline = library.pipeline(context)
            pipeline.start(config, self._on_frame)
        except RuntimeError as error:
            raise OSError(errno.EIO, f"librealsense: {error} ({stream})") from error
        self._pipeline = pipeline

    def _on_frame(self, frame: Any) -> None:
        """Take a frame, in librealsense's thread."""
        try:
            converted = self._convert(frame)
        except RuntimeError:
            converted = None  # There is nobody to raise it to.
        if converted is None:
            self._others += 1
        else:
            self._frames.put(converted)

    def poll(self, timeout: float) -> Sequence[FrameT]:
        """Wait for frames; a camera that was unplugged merely falls silent."""
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
        """Return how many frames were of another stream, or could not be converted."""
        return {"other_frames": self._others}
