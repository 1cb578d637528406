"""The robot's side alone: a file that names its devices, and the nodes that drive them.

The file says where the devices are and nothing else; what may be set otherwise is a parameter of a
node, as in simulation:

    robot: carbon                                   # optional, as of `bringup.sh --robot`
    drives: {interface: eth1}                       # optional: frame_timeout, priority,
                                                    #   serial_numbers, a list in joint order
    vn200: {port: /dev/husky-imu}                   # optional: baud
    pixhawk: {port: /dev/husky-pixhawk}             # optional: baud; or connection, signing_key
    t265: {}                                        # optional: serial_number; backend, port
    d435: {}                                        # optional: serial_number, profile, decimation;
                                                    #   backend, port

`pixhawk` and `t265` may be left out with the propulsion unit, `d435` with the depth camera.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from husky_bringup.system import NodeSpec, ParameterValue, robot_path, with_settings
from husky_description.actuation import DRIVES
from husky_description.robot import ROBOTS, Robot, load_robot
from husky_runtime import graph

_WALL_TIME: Mapping[str, ParameterValue] = {"use_sim_time": False}
"""Of nodes without a parameter that says that they run on the robot."""


class _Key(NamedTuple):
    """One key of a section: its type, and what stands for it when it is left out.

    Attributes:
        kind: `str`, `int`, `float`, or `list` of whole numbers from 0, one for each joint.
        default: None for a key that must be there.
        least, greatest: range of a number.
        words: that a text may be, () for any.
    """

    kind: type
    default: str | int | float | tuple[int, ...] | None
    least: float = -math.inf
    greatest: float = math.inf
    words: tuple[str, ...] = ()


_CAMERA = {
    "serial_number": _Key(str, ""),
    "backend": _Key(str, "realsense", words=("realsense", "sim")),
    "port": _Key(str, ""),
}
_SECTIONS: Mapping[str, Mapping[str, _Key]] = {
    "drives": {
        "interface": _Key(str, None),
        "frame_timeout": _Key(float, 0.002, 0.0005, 1.0),
        "priority": _Key(int, 80, 0, 98),
        "serial_numbers": _Key(list, ()),
    },
    "vn200": {"port": _Key(str, None), "baud": _Key(int, 921600, 9600, 921600)},
    "pixhawk": {
        "port": _Key(str, ""),
        "baud": _Key(int, 921600, 9600, 3000000),
        "connection": _Key(str, ""),
        "signing_key": _Key(str, ""),
    },
    "t265": _CAMERA,
    "d435": {
        **_CAMERA,
        "profile": _Key(str, "640x480x15"),
        "decimation": _Key(int, 4, 1, 8),
    },
}
_REQUIRED = ("drives", "vn200")
_TYPE_NAMES = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    list: "a list of whole numbers",
}

Section = Mapping[str, Any]
"""Every key of a section with a value of its type."""


@dataclass(frozen=True)
class Hardware:
    """Devices of a robot and where they are; sections as the module's example.

    Attributes:
        robot_name: one of `ROBOTS`, or the path of a robot's file.
        robot: its numbers.
        drives, vn200: sections that every robot has.
        pixhawk, t265: sections of the propulsion unit, None without them.
        d435: section of the depth camera, None without it.
    """

    robot_name: str
    robot: Robot
    drives: Section
    vn200: Section
    pixhawk: Section | None
    t265: Section | None
    d435: Section | None

    @property
    def connection(self) -> str:
        """Connection to the Pixhawk, as of `pixhawk_bridge`'s parameter."""
        assert self.pixhawk is not None
        serial = f"serial:{self.pixhawk['port']}:{self.pixhawk['baud']}"
        return str(self.pixhawk["connection"]) or serial


def read_hardware(path: Path) -> Hardware:
    """Read a file of devices.

    Raises:
        ValueError: it cannot be read, or a key is unknown, missing or has a value that is not
            allowed: one line names the file, the key and what is allowed.
    """
    try:
        content = yaml.safe_load(path.read_text("utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no YAML in UTF-8: {' '.join(str(error).split())}") from error
    try:
        return parse_hardware(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def parse_hardware(content: object) -> Hardware:
    """Check what such a file holds and return it.

    Raises:
        ValueError: as `read_hardware`, without the file.
    """
    known = ("robot", *_SECTIONS)
    if not isinstance(content, dict):
        raise ValueError(f"it holds no keys; allowed are {', '.join(known)}")
    for key in content:
        if key not in known:
            raise ValueError(f"there is no key {key!r}; allowed are {', '.join(known)}")
    for key in _REQUIRED:
        if key not in content:
            raise ValueError(f"key {key} is missing, with {_allowed(key)}")
    name = content.get("robot", ROBOTS[0])
    if not isinstance(name, str):
        raise ValueError(f"robot is {name!r}, it must be a text: {', '.join(ROBOTS)}, or a path")
    name = robot_path(name)
    robot = load_robot(name)
    if robot.actuation != DRIVES:
        raise ValueError(f"robot is {name!r}, which has no drives; allowed are robots with drives")
    sections = {key: _section(key, content[key]) for key in _SECTIONS if key in content}
    serials, count = sections["drives"]["serial_numbers"], len(robot.joint_names)
    if len(serials) not in (0, count):
        raise ValueError(f"drives.serial_numbers has {len(serials)} numbers, it must have {count}")
    pixhawk, t265 = sections.get("pixhawk"), sections.get("t265")
    if pixhawk is not None and bool(pixhawk["port"]) == bool(pixhawk["connection"]):
        raise ValueError("pixhawk needs either port or connection")
    for key in ("t265", "d435"):
        camera = sections.get(key)
        if camera is not None and (camera["backend"] == "sim") != bool(camera["port"]):
            raise ValueError(f"{key}.port belongs to {key}.backend sim, which needs it")
    d435 = sections.get("d435")
    return Hardware(name, robot, sections["drives"], sections["vn200"], pixhawk, t265, d435)


def _allowed(section: str) -> str:
    return ", ".join(_SECTIONS[section])


def _section(name: str, given: object) -> Section:
    """Return a section with every key; raises ValueError."""
    keys = _SECTIONS[name]
    if not isinstance(given, dict):
        raise ValueError(f"{name} is {given!r}, it must have keys: {_allowed(name)}")
    for key in given:
        if key not in keys:
            raise ValueError(f"there is no key {name}.{key}; allowed are {_allowed(name)}")
    values = {}
    for key, rule in keys.items():
        if key not in given and rule.default is None:
            raise ValueError(f"key {name}.{key} is missing, it must be {_TYPE_NAMES[rule.kind]}")
        value = given.get(key, rule.default)
        values[key] = _checked(f"{name}.{key}", value, rule) if key in given else value
    return values


def _checked(name: str, value: object, rule: _Key) -> object:
    """Return a value of a key's type; raises ValueError."""
    if rule.kind is float and type(value) is int:
        value = float(value)
    if type(value) is not rule.kind or value == "":
        raise ValueError(f"{name} is {value!r}, it must be {_TYPE_NAMES[rule.kind]}")
    if isinstance(value, list):
        if not all(type(each) is int and each >= 0 for each in value):
            raise ValueError(f"{name} is {value!r}, it must be {_TYPE_NAMES[list]} from 0")
        return tuple(value)
    if isinstance(value, str):
        if rule.words and value not in rule.words:
            raise ValueError(f"{name} is {value!r}, it must be one of {', '.join(rule.words)}")
    elif not rule.least <= float(str(value)) <= rule.greatest:
        raise ValueError(f"{name} is {value}, it must be {rule.least:g} to {rule.greatest:g}")
    return value


# Nodes ------------------------------------------------------------------------------------------
def robot_on_hardware(
    hardware: Hardware,
    settings: Mapping[str, Mapping[str, ParameterValue]] | None = None,
    record: str | None = None,
    *,
    console: bool = False,
) -> tuple[NodeSpec, ...]:
    """Return every node of the robot's own computers; nothing of them is simulated.

    Args:
        hardware: its devices.
        settings: further parameters by node name.
        record: directory of the bag, or None for no recorder.
        console: whether there is a page for the browser.

    Raises:
        ValueError: settings of a node that is not there.
    """
    name = hardware.robot_name
    told: dict[str, ParameterValue] = {"robot": name} if name != ROBOTS[0] else {}
    controller: dict[str, ParameterValue] = {"time": "realtime", "walk_on_command": True}
    if hardware.pixhawk is not None:
        controller["propulsion"] = True
    drives = dict(hardware.drives)
    serials = tuple(str(number) for number in drives.pop("serial_numbers"))
    if serials:
        drives["serial_numbers"] = serials
    specs = [
        NodeSpec(
            "husky_drivers",
            graph.DRIVE_BRIDGE,
            {"time": "hardware", "bus": "soem", **drives, **told},
        ),
        NodeSpec("husky_drivers", graph.VN200_DRIVER, {"clock": "host", **hardware.vn200, **told}),
        NodeSpec("husky_control", graph.LOW_LEVEL_CONTROLLER, {**controller, **_WALL_TIME, **told}),
        *_unit(hardware, told),
        *_camera(graph.D435_DRIVER, hardware.d435, told),
    ]
    if _asks_for_plans(settings or {}):
        specs.append(NodeSpec("husky_control", graph.PLANNER, {**_WALL_TIME, **told}))
    if record is not None:
        specs.append(NodeSpec("husky_bringup", graph.RECORDER, {"output": record, **_WALL_TIME}))
    if console:
        specs.append(NodeSpec("husky_bringup", graph.CONSOLE, dict(_WALL_TIME)))
    return with_settings(specs, settings or {})


def _asks_for_plans(settings: Mapping[str, Mapping[str, ParameterValue]]) -> bool:
    return bool(settings.get(graph.LOW_LEVEL_CONTROLLER, {}).get("planner", False))


def _unit(hardware: Hardware, told: Mapping[str, ParameterValue]) -> list[NodeSpec]:
    """Return the nodes of the propulsion unit's devices, as far as they are named."""
    specs = []
    if hardware.pixhawk is not None:
        pixhawk: dict[str, ParameterValue] = {
            "time": "hardware",
            "connection": hardware.connection,
            "signing_key": hardware.pixhawk["signing_key"],
        }
        specs.append(NodeSpec("husky_pu", graph.PIXHAWK_BRIDGE, {**pixhawk, **told}))
    return [*specs, *_camera(graph.T265_DRIVER, hardware.t265, told)]


def _camera(
    driver: str, section: Section | None, told: Mapping[str, ParameterValue]
) -> list[NodeSpec]:
    """Return the driver of a camera, if its section is there."""
    if section is None:
        return []
    given = {key: value for key, value in section.items() if value}
    return [NodeSpec("husky_drivers", driver, {"clock": "host", **given, **told})]
