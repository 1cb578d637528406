"""The choice of a T265: the camera, or the simulated device."""

from __future__ import annotations

from husky_drivers.t265.link import T265Backend
from husky_drivers.t265.realsense import RealsenseBackend, load_librealsense
from husky_drivers.t265.sim import SimBackend

BACKENDS = ("sim", "realsense")
"""Names of the backends."""


def make_backend(name: str, port: str, serial_number: str = "") -> T265Backend:
    """Return a backend; nothing is opened yet.

    Args:
        name: one of `BACKENDS`.
        port: of `sim`: its serial port.
        serial_number: of `realsense`: which camera, "" for any.

    Raises:
        BackendError: it cannot work here.
        ValueError: there is no such backend.
    """
    if name == "sim":
        return SimBackend(port)
    if name == "realsense":
        return RealsenseBackend(load_librealsense(), serial_number)
    raise ValueError(f"backend is {name!r}, it must be one of {', '.join(BACKENDS)}")
