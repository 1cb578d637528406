"""The camera itself, through librealsense's Python module `pyrealsense2`."""

from __future__ import annotations

import re
from typing import Any

from husky_description.rotation import Vector
from husky_drivers.camera_link import BackendError
from husky_drivers.librealsense import LibrealsenseBackend, import_librealsense, version_of
from husky_drivers.t265.frames import PoseFrame

REMOVED_IN = (2, 54)
"""librealsense 2.54.1 removed the T265; 2.53.1 is the last version that has it."""
MODEL = "T265"
"""In the camera's name."""

_HOW = (
    "the last librealsense with the T265 is 2.53.1: its wheels end at Python 3.10, for a newer "
    "Python build it from source with BUILD_PYTHON_BINDINGS and BUILD_WITH_TM2 on"
)


def load_librealsense() -> Any:
    """Import `pyrealsense2`, if it is none of those without the T265.

    Raises:
        BackendError: it is not installed, or of a version without the T265.
    """
    module = import_librealsense(_HOW)
    version = version_of(module)
    numbers = tuple(int(number) for number in re.findall(r"\d+", version)[:2])
    if numbers >= REMOVED_IN:
        raise BackendError(f"pyrealsense2 is version {version}, without the T265; {_HOW}")
    return module


class RealsenseBackend(LibrealsenseBackend[PoseFrame]):
    """Pose stream of a T265 on USB."""

    def __init__(self, librealsense: Any, serial_number: str = ""):
        """Prepare the module `pyrealsense2` for one camera, "" for any; nothing is opened yet."""
        super().__init__(librealsense, MODEL, serial_number)

    def _enable(self, device: Any, config: Any) -> str:
        config.enable_stream(self._library.stream.pose)
        return "pose stream"

    def _convert(self, frame: Any) -> PoseFrame | None:
        if not frame.is_pose_frame():
            return None
        pose = frame.as_pose_frame().get_pose_data()
        q = pose.rotation
        return PoseFrame(
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


def _vector(vector: Any) -> Vector:
    return vector.x, vector.y, vector.z
