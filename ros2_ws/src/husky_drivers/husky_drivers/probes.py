"""Which device answers on a wire, and what it is: asked without setting anything up.

Each probe opens its device as the driver does, asks, and gives it back. No drive gets beyond PREOP,
no register of an IMU is written, no fan is told anything. A segment that has a master already is
left alone (`husky_drivers.ethercat.interface.claim_interface`).
"""

from __future__ import annotations

import select
import termios
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from husky_description.robot import Robot
from husky_drivers.camera_link import BackendError, CameraBackend, FrameT
from husky_drivers.d435 import choice as d435_choice
from husky_drivers.d435 import realsense as d435_realsense
from husky_drivers.d435.frames import DepthFrame
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.bus import GOLD_TWITTER, AlState, Bus, BusOptions, SdoAbort
from husky_drivers.ethercat.soem_bus import SoemBus
from husky_drivers.librealsense import describe_camera
from husky_drivers.t265 import choice as t265_choice
from husky_drivers.t265 import realsense as t265_realsense
from husky_drivers.t265.frames import Confidence, PoseFrame
from husky_drivers.vn200 import requests
from husky_drivers.vn200.binary import IMU_LAYOUT
from husky_drivers.vn200.protocol import AsciiMessage, Register
from husky_drivers.vn200.requests import Request
from husky_drivers.vn200.stream import StreamParser
from husky_runtime.ports.serial_line import SerialPort, open_serial, read_bytes

_DEVICE_NAME = 0x1008
_SCAN_PATIENCE, _ANSWER_PATIENCE = 3.0, 0.5
"""Wall time for the baud rate of a VN-200 to be found, and for one answer [s]."""
_DWELL = 0.04
"""Time that an answer may take while the rate is looked for, beyond that of its bytes [s]."""
_FRAME_PATIENCE = 5.0
"""Wall time in which a camera that has started sends its first frame [s]."""


class ProbeResult(NamedTuple):
    """Outcome of a probe.

    Attributes:
        found: sentences on what answers, the device first, then its parts.
        problem: why the device cannot be used, "" for a good one.
    """

    found: tuple[str, ...]
    problem: str = ""


# EtherCAT ---------------------------------------------------------------------------------------
def probe_drives(
    robot: Robot, interface: str, patience: float, serial_numbers: Sequence[int] = ()
) -> ProbeResult:
    """Ask every slave of a segment for its identity; leave all of them in INIT.

    Args:
        robot: whose joints the drives move.
        interface: network interface.
        patience: time after which a frame counts as lost [s].
        serial_numbers: that the drives must have, joint after joint; () takes any.
    """
    bus: Bus = SoemBus(robot, BusOptions(interface, patience))
    try:
        bus.open()
        return _identify(bus, robot, serial_numbers)
    except OSError as error:
        return ProbeResult((), str(error))
    finally:
        bus.close()


def _identify(bus: Bus, robot: Robot, serial_numbers: Sequence[int]) -> ProbeResult:
    """Describe the slaves of an open segment, and name what is wrong with them."""
    count, names = bus.slave_count, robot.joint_names
    found, problems = [f"{count} slaves answer"], []
    if count != len(names):
        problems.append(f"{count} slaves answer, expected are {len(names)}")
    for position, al in enumerate(bus.al_states()):
        joint = names[position] if position < len(names) else f"slave {position}"
        identity = bus.identity(position)
        name, serial = _text(bus, position), _serial_number(bus, position)
        found.append(
            f"{joint}: {name}, vendor 0x{identity.vendor:08X}, product 0x{identity.product:08X}, "
            f"revision 0x{identity.revision:08X}, serial number {serial}, {al.state}"
        )
        if (identity.vendor, identity.product) != (GOLD_TWITTER.vendor, GOLD_TWITTER.product):
            problems.append(f"{joint} is no Gold Twitter")
        elif al.status != AlState.PREOP:
            problems.append(f"{joint} is in {al.state} instead of PREOP ({al.reason})")
        wanted = serial_numbers[position] if position < len(serial_numbers) else serial
        if serial != str(wanted):
            problems.append(f"{joint} has serial number {serial}, it must be {wanted}")
    return ProbeResult(tuple(found), "; ".join(problems))


def _text(bus: Bus, position: int) -> str:
    try:
        return bus.sdo_read(position, _DEVICE_NAME).decode("ascii", "replace").rstrip("\0 ")
    except SdoAbort as abort:
        return f"no device name ({abort})"


def _serial_number(bus: Bus, position: int) -> str:
    try:
        value = bus.sdo_read(position, od.SERIAL_NUMBER.index, od.SERIAL_NUMBER.subindex)
    except SdoAbort:
        return "unknown"
    return str(int.from_bytes(value, "little"))


# VN-200 -----------------------------------------------------------------------------------------
def probe_vn200(path: str, baud: int) -> ProbeResult:
    """Ask a VN-200 for model, serial number and firmware.

    Its baud rate is looked for as the driver does, beginning with the wanted one, and stays. Its
    output is paused meanwhile.
    """
    try:
        port = open_serial(path, baud)
    except (OSError, ValueError, termios.error) as error:
        return ProbeResult((), str(error))
    try:
        dialogue = _Vn200Dialogue(port)
        found_at = dialogue.find(baud)
        if not found_at:
            return ProbeResult((), "nothing answers as a VN-200 does, at any baud rate")
        told = [dialogue.read(register) for register in _IDENTITY]
        dialogue.ask(requests.pause(False), _ANSWER_PATIENCE)
    except (OSError, termios.error) as error:
        return ProbeResult((), str(error))
    finally:
        port.close()
    model, serial, firmware = told
    found = f"{model}, serial number {serial}, firmware {firmware}, at {found_at} baud"
    return ProbeResult((found,), "" if model.startswith("VN-200") else f"{model!r} is no VN-200")


_IDENTITY = (Register.MODEL, Register.SERIAL_NUMBER, Register.FIRMWARE)


class _Vn200Dialogue:
    """Questions to a VN-200 on an open port, each until its answer comes."""

    def __init__(self, port: SerialPort):
        self._port = port
        self._parser = StreamParser(IMU_LAYOUT)

    def find(self, wanted: int) -> int:
        """Pause the device, at each rate in turn; return the one at which it answers, 0 for none.

        Raises:
            OSError: the line is gone.
        """
        end = time.monotonic() + _SCAN_PATIENCE
        while time.monotonic() < end:
            for baud in requests.scan_order(wanted, wanted):
                self._port.baudrate = baud
                self._parser.reset()
                dwell = _DWELL + requests.answer_time(baud)
                if self.ask(requests.pause(True), dwell) is not None:
                    return baud
        return 0

    def read(self, register: Register) -> str:
        """Return the content of a register, "unknown" without an answer."""
        for _ in range(3):
            answer = self.ask(requests.read(register), _ANSWER_PATIENCE)
            if answer is not None:
                return ",".join(answer.fields[1:])
        return "unknown"

    def ask(self, request: Request, patience: float) -> AsciiMessage | None:
        """Send a request; return its answer, None when none comes in time [s]."""
        descriptor = self._port.fileno()
        end = time.monotonic() + patience
        with open(descriptor, "wb", buffering=0, closefd=False) as line:
            line.write(request.message)
        while (left := end - time.monotonic()) > 0:
            ready, _, _ = select.select([descriptor], [], [], left)
            for message in self._parser.feed(read_bytes(descriptor)) if ready else ():
                if isinstance(message, AsciiMessage) and request.answered_by(message):
                    return message
        return None


# Cameras ----------------------------------------------------------------------------------------
def probe_t265(backend_name: str, port: str, serial_number: str) -> ProbeResult:
    """Open the camera and wait for a pose.

    Args:
        backend_name: "realsense" for the camera, "sim" for the stand-in.
        port: of the stand-in.
        serial_number: of the camera, "" for any.
    """

    def describe(frame: PoseFrame) -> str:
        return f"poses come, confidence {Confidence(frame.tracker_confidence).name.lower()}"

    return _probe_camera(
        t265_realsense.MODEL,
        lambda: t265_choice.make_backend(backend_name, port, serial_number),
        "pose",
        describe,
        lambda: _identify_camera(
            backend_name, t265_realsense.load_librealsense, t265_realsense.MODEL, serial_number
        ),
    )


def probe_d435(
    backend_name: str, port: str, serial_number: str, profile: str, decimation: int
) -> ProbeResult:
    """Open the depth camera and wait for an image.

    Args:
        backend_name: "realsense" for the camera, "sim" for the stand-in.
        port: of the stand-in.
        serial_number: of the camera, "" for any.
        profile: of the camera's images, "WIDTHxHEIGHTxFPS".
        decimation: pixels that become one, in each direction.
    """

    def describe(frame: DepthFrame) -> str:
        height, width = frame.depth.shape
        share = np.count_nonzero(frame.depth) / frame.depth.size
        return f"images of {width} x {height} come, {share:.0%} of the pixels have depth"

    return _probe_camera(
        d435_realsense.MODEL,
        lambda: d435_choice.make_backend(
            backend_name,
            port,
            serial_number,
            d435_realsense.DepthStream.of_profile(profile, decimation),
        ),
        "image",
        describe,
        lambda: _identify_camera(
            backend_name, d435_realsense.load_librealsense, d435_realsense.MODEL, serial_number
        ),
    )


def _probe_camera(
    model: str,
    make_backend: Callable[[], CameraBackend[FrameT]],
    kind: str,
    describe: Callable[[FrameT], str],
    identify: Callable[[], Iterable[str]],
) -> ProbeResult:
    """Open a camera, wait for a frame and describe both.

    Args:
        model: of the camera.
        make_backend: makes its backend.
        kind: of its frames.
        describe: describes a frame.
        identify: returns what is known of the camera itself.
    """
    try:
        backend = make_backend()
    except (BackendError, ValueError) as error:
        return ProbeResult((), str(error))
    try:
        backend.open()
        end = time.monotonic() + _FRAME_PATIENCE
        frames = list(backend.poll(0.1))
        while not frames and time.monotonic() < end:
            frames += backend.poll(0.1)
        backend.close()
        if not frames:
            problem = f"{backend.path}: no {kind} within {_FRAME_PATIENCE:.0f} s"
            return ProbeResult((), problem)
        what = ", ".join((model, *identify()))
    except OSError as error:
        return ProbeResult((), str(error))
    finally:
        backend.close()
    return ProbeResult((f"{what} on {backend.path}, {describe(frames[-1])}",))


def _identify_camera(
    backend_name: str, load: Callable[[], Any], model: str, serial_number: str
) -> Iterable[str]:
    """Return serial number and firmware of a camera, as librealsense reports them."""
    if backend_name != "realsense":
        return ("the stand-in",)
    return describe_camera(load(), model, serial_number)
