"""The camera itself, through librealsense's Python module `pyrealsense2`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from husky_drivers.d435.frames import DepthFrame, Intrinsics
from husky_drivers.librealsense import LibrealsenseBackend, import_librealsense

MODEL = "D435"
"""In the names of the D435, the D435i and the D435f."""
GREATEST_DECIMATION = 8
"""Of librealsense's filter; the least is 1."""

_HOW = "install it with pip (pyrealsense2), any version knows the D435"
_LONGEST_READOUT_US = 200_000
"""From the middle of the exposure to readout [us]; the longest exposure is 165 ms."""


def load_librealsense() -> Any:
    """Import `pyrealsense2`.

    Raises:
        BackendError: it is not installed.
    """
    return import_librealsense(_HOW)


@dataclass(frozen=True)
class DepthStream:
    """The depth stream that is asked of a camera.

    Attributes:
        width, height: of the camera's image [pixels].
        rate: images per second [Hz].
        decimation: pixels that become one, in each direction.
    """

    width: int = 640
    height: int = 480
    rate: int = 15
    decimation: int = 4

    @property
    def profile(self) -> str:
        """Size and rate as realsense-ros writes them."""
        return f"{self.width}x{self.height}x{self.rate}"

    @classmethod
    def of_profile(cls, profile: str, decimation: int) -> DepthStream:
        """Return the stream of a profile "WIDTHxHEIGHTxFPS".

        Raises:
            ValueError: it is no such text.
        """
        match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d{0,3})x([1-9]\d{0,2})", profile, re.ASCII)
        if match is None:
            raise ValueError(
                f"parameter profile is {profile!r}, it must be WIDTHxHEIGHTxFPS in pixels and Hz, "
                f"{cls().profile} for example"
            )
        width, height, rate = map(int, match.groups())
        return cls(width, height, rate, decimation)


class RealsenseBackend(LibrealsenseBackend[DepthFrame]):
    """Depth stream of a D435 on USB."""

    def __init__(self, librealsense: Any, stream: DepthStream, serial_number: str = ""):
        """Prepare; nothing is opened yet.

        Args:
            librealsense: the module `pyrealsense2`.
            stream: that the camera is asked for.
            serial_number: of the camera, "" for any.
        """
        super().__init__(librealsense, MODEL, serial_number)
        self._stream = stream
        self._depth_unit = 0.0
        self._decimate = None
        if stream.decimation > 1:
            self._decimate = librealsense.decimation_filter(float(stream.decimation))

    def _enable(self, device: Any, config: Any) -> str:
        library, stream = self._library, self._stream
        self._depth_unit = float(device.first_depth_sensor().get_depth_scale())
        config.enable_stream(
            library.stream.depth, stream.width, stream.height, library.format.z16, stream.rate
        )
        return f"depth stream {stream.profile}"

    def _convert(self, frame: Any) -> DepthFrame | None:
        if frame.is_frameset():
            frame = frame.as_frameset().get_depth_frame()
        if not frame or not frame.is_depth_frame():
            return None
        image = frame if self._decimate is None else self._decimate.process(frame)
        i = image.get_profile().as_video_stream_profile().get_intrinsics()
        return DepthFrame(
            number=int(frame.get_frame_number()),
            time_ms=self._exposed_at(frame),
            intrinsics=Intrinsics(i.width, i.height, i.fx, i.fy, i.ppx, i.ppy),
            depth_unit=self._depth_unit,
            depth=np.array(image.get_data(), np.uint16),  # A copy: librealsense wants its memory.
        )

    def _exposed_at(self, frame: Any) -> float:
        """Return the camera's time in the middle of the exposure [ms].

        librealsense's time of a frame is that of its readout. The metadata tell the difference, on
        a machine that has them.
        """
        time_ms = float(frame.get_timestamp())
        metadata = self._library.frame_metadata_value
        read, exposed = metadata.frame_timestamp, metadata.sensor_timestamp
        if frame.supports_frame_metadata(read) and frame.supports_frame_metadata(exposed):
            delay = frame.get_frame_metadata(read) - frame.get_frame_metadata(exposed)
            if 0 <= delay < _LONGEST_READOUT_US:  # Both counters wrap, not at once.
                time_ms -= 1e-3 * delay
        return time_ms

    def taken(self, frame: DepthFrame) -> None:
        """Nothing to do: the camera does not wait."""
