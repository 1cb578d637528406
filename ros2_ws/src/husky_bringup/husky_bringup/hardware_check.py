"""The check before a robot starts: each device of a hardware file is asked whether it is there.

`bringup.sh --hardware FILE --dry-run` ends with it; without `--dry-run` no node is started unless
every device answers, so no drive gets torque while a part of the robot is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from husky_bringup.hardware import Hardware, Section
from husky_drivers.probes import ProbeResult, probe_d435, probe_drives, probe_t265, probe_vn200
from husky_drivers.real_time import machine_lacks
from husky_pu.companion.probe import probe_pixhawk
from husky_pu.mavlink.frames import read_key


class Device(NamedTuple):
    """A device that is asked.

    Attributes:
        name: its section in the file, and where it is.
        probe: asks it.
    """

    name: str
    probe: Callable[[], ProbeResult]


def devices_of(hardware: Hardware) -> list[Device]:
    """Return the devices that a hardware file names."""
    drives, imu = hardware.drives, hardware.vn200
    patience = drives["frame_timeout"]
    devices = [
        Device(
            f"drives on {drives['interface']}",
            lambda: probe_drives(
                hardware.robot, drives["interface"], patience, drives["serial_numbers"]
            ),
        ),
        Device(f"vn200 on {imu['port']}", lambda: probe_vn200(imu["port"], imu["baud"])),
    ]
    if hardware.pixhawk is not None:
        devices.append(Device(f"pixhawk on {hardware.connection}", lambda: _ask_pixhawk(hardware)))
    for name, camera, probe in (
        ("t265", hardware.t265, probe_t265),
        ("d435", hardware.d435, probe_d435),
    ):
        if camera is not None:
            where = camera["port"] or f"USB {camera['serial_number']}".strip()
            devices.append(Device(f"{name} on {where}", partial(_ask_camera, probe, camera)))
    return devices


def _ask_camera(probe: Callable[..., ProbeResult], camera: Section) -> ProbeResult:
    given = {key: value for key, value in camera.items() if key != "backend"}
    return probe(camera["backend"], **given)


def _ask_pixhawk(hardware: Hardware) -> ProbeResult:
    assert hardware.pixhawk is not None
    key_file = hardware.pixhawk["signing_key"]
    try:
        key = read_key(Path(key_file).read_text("utf-8")) if key_file else b""
        return ProbeResult((probe_pixhawk(hardware.connection, key),))
    except (OSError, ValueError) as error:
        return ProbeResult((), str(error))


def check_devices(devices: Sequence[Device], output: TextIO | None = None) -> list[str]:
    """Ask every device and print a line for each, its parts below; return what is missing.

    Args:
        devices: as of `devices_of`.
        output: where to print, standard output by default.
    """
    missing = []
    for device in devices:
        found, problem = device.probe()
        if problem:
            missing.append(device.name)
        headline = problem or (found[0] if found else "answers")
        print(
            f"{'MISSING' if problem else 'ok     '}  {device.name}: {headline}",
            file=output,
            flush=True,
        )
        for line in found if problem else found[1:]:
            print(f"         {line}", file=output)
    return missing


def print_machine(output: TextIO | None = None) -> None:
    """Print what this machine lacks for hard real time, a line each; that is no failure."""
    for lack in machine_lacks():
        print(f"note     {lack}", file=output)
