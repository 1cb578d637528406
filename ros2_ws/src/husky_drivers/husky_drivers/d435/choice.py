"""The choice of a D435: the camera, or the simulated device."""

from __future__ import annotations

from husky_drivers.d435.link import D435Backend
from husky_drivers.d435.realsense import DepthStream, RealsenseBackend, load_librealsense
from husky_drivers.d435.sim import SimBackend

BACKENDS = ("sim", "realsense")
"""Names of the backends."""


def make_backend(
    name: str, port: str, serial_number: str = "", stream: DepthStream | None = None
) -> D435Backend:
    """Return a backend; nothing is opened yet.

    Args:
        name: one of `BACKENDS`.
        port: of `sim`: path of its socket.
        serial_number: of `realsense`: which camera, "" for any.
        stream: of `realsense`: what is asked of the camera, None for the default.

    Raises:
        BackendError: it cannot work here.
        ValueError: there is no such backend.
    """
    if name == "sim":
        return SimBackend(port)
    if name == "realsense":
        return RealsenseBackend(load_librealsense(), stream or DepthStream(), serial_number)
    raise ValueError(f"backend is {name!r}, it must be one of {', '.join(BACKENDS)}")
