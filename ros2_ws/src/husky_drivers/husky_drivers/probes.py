"""Which device answers on a wire, and what it is: asked without setting anything up.

Each probe opens its device as the driver does, asks, and gives it back. No drive gets beyond PREOP,
no register of an IMU is written, no fan is told anything. A segment that has a master already is
left alone (`husky_drivers.ethercat.interface.claim_interface`).
"""

from __future__ import annotations

import select
import termios
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from husky_description.robot import Robot
from husky_drivers.ethercat import objects as od
from husky_drivers.ethercat.bus import GOLD_TWITTER, AlState, Bus, BusOptions, SdoAbort
from husky_drivers.ethercat.soem_bus import SoemBus
from husky_drivers.t265.backend import BackendError
from husky_drivers.t265.choice import make_backend
from husky_drivers.t265.frames import Confidence
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
_POSE_PATIENCE = 5.0
"""Wall time in which a camera that has started tells its first pose [s]."""


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


# T265 -------------------------------------------------------------------------------------------
def probe_t265(backend_name: str, port: str, serial_number: str) -> ProbeResult:
    """Open the camera and wait for a pose.

    Args:
        backend_name: "realsense" for the camera, "sim" for the stand-in.
        port: of the stand-in.
        serial_number: of the camera, "" for any.
    """
    try:
        backend = make_backend(backend_name, port, serial_number)
        backend.open()
    except (BackendError, OSError) as error:
        return ProbeResult((), str(error))
    try:
        end = time.monotonic() + _POSE_PATIENCE
        frames = list(backend.poll(0.1))
        while not frames and time.monotonic() < end:
            frames += backend.poll(0.1)
    except OSError as error:
        return ProbeResult((), str(error))
    finally:
        backend.close()
    if not frames:
        return ProbeResult((), f"{backend.path}: no pose within {_POSE_PATIENCE:.0f} s")
    confidence = Confidence(frames[-1].tracker_confidence).name.lower()
    what = ", ".join(("T265", *_describe_camera(backend_name, serial_number)))
    return ProbeResult((f"{what} on {backend.path}, poses come, confidence {confidence}",))


def _describe_camera(backend_name: str, serial_number: str) -> Iterator[str]:
    """Return serial number and firmware of the camera, as librealsense tells them."""
    if backend_name != "realsense":
        yield "the stand-in"
        return
    from husky_drivers.t265.realsense import load_librealsense

    library = load_librealsense()
    info = library.camera_info
    for device in library.context().query_devices():
        number = device.get_info(info.serial_number)
        if "T265" in device.get_info(info.name) and serial_number in ("", number):
            yield f"serial number {number}"
            yield f"firmware {device.get_info(info.firmware_version)}"
            return
