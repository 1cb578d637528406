"""The nodes of the robot and their parameters: one table for shell, launch file and tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from husky_description.actuation import BUS_SERVOS, DRIVES
from husky_description.mujoco_model import flying_inertia
from husky_description.robot import ROBOTS, Robot, load_robot
from husky_runtime import graph

ParameterValue = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

TIMES = ("lockstep", "realtime")
"""Clocks of a simulated robot."""
_TILT_ENDS_FLIGHT = "FD_FAIL_R=45, FD_FAIL_P=45, FD_FAIL_R_TTRI=0.1, CA_FAILURE_MODE=0"
"""Of the unit alone, which tips over when it loses a fan: three could hold it level, but not its
heading, and ropes are about it. Legs may stand on any slope, and the three fans go on."""


@dataclass(frozen=True)
class NodeSpec:
    """One process of the graph.

    Attributes:
        package: ROS package.
        executable: its executable.
        parameters: set on its command line.
    """

    package: str
    executable: str
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Node name: each executable makes one node of its own name."""
        return self.executable

    def ros_arguments(self, params_file: str | None = None, namespace: str = "/") -> list[str]:
        """Return what stands behind `--ros-args`: the file, then our values, which go before it."""
        # What a file says of a node by name goes before what is said of any node. Here a name is
        # one in the root namespace; rcl takes no other.
        named = params_file is not None and namespace == "/"
        whose = f"{self.name}:" if named else ""
        arguments = [] if params_file is None else ["--params-file", params_file]
        for key, value in self.parameters.items():
            arguments += ["-p", f"{whose}{key}:={to_yaml(value)}"]
        return arguments

    def command(self, *, params_file: str | None = None, namespace: str = "/") -> list[str]:
        """Return the command line that starts it: the executable's, as launch starts one.

        The genuine `ros2 run` would be a parent that dies of a signal, with a code of its own.

        Raises:
            ValueError: it is not installed.
        """
        from ament_index_python.packages import PackageNotFoundError, get_package_prefix

        try:
            installed = Path(get_package_prefix(self.package), "lib", self.package)
        except PackageNotFoundError as error:
            raise ValueError(f"package {self.package} is not installed") from error
        executable = installed / self.executable
        if not executable.is_file():
            raise ValueError(f"{self.executable} of {self.package} is not installed: {installed}")
        remap = ["-r", f"__ns:={namespace}"] if namespace != "/" else []
        return [str(executable), "--ros-args", *remap, *self.ros_arguments(params_file, namespace)]


def to_yaml(value: ParameterValue) -> str:
    """Write a parameter value so that ROS reads it back with the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a double-quoted scalar of YAML
    if isinstance(value, tuple):
        return f"[{', '.join(map(to_yaml, value))}]"
    return repr(value)


def simulated_robot(
    time: str = "lockstep",
    settings: Mapping[str, Mapping[str, ParameterValue]] | None = None,
    record: str | None = None,
    remote: bool = False,
    *,
    wakes: bool = False,
    console: bool = False,
) -> tuple[NodeSpec, ...]:
    """Return every node of the robot in simulation.

    The plant's parameter `robot` selects the robot, one of `ROBOTS` or the path of a file; `body`
    what of it stands there, `bus` the bus of its drives, `mounting` how its fans are mounted,
    `camera` whether its depth camera is on: then the ground is mapped, the robot is localised, and
    the navigator takes goals. The planner takes part when the controller's parameter `planner` says
    so.

    Args:
        time: one of `TIMES`.
        settings: further parameters by node name.
        record: directory of the bag, or None for no recorder.
        remote: whether the remote control takes part.
        wakes: whether a velocity command sets a standing robot in motion, for operators' tools.
        console: whether there is a page for the browser.

    Raises:
        ValueError: unknown clock, robot or body, or settings of a node that is not there.
    """
    settings = settings or {}
    plant = settings.get(graph.PLANT, {})
    body, robot = str(plant.get("body", "robot")), robot_path(str(plant.get("robot", ROBOTS[0])))
    bus = str(plant.get("bus", graph.BUSES[0]))
    _check_word("time", time, TIMES)
    _check_word("body", body, graph.BODIES)
    _check_word("bus", bus, graph.BUSES)
    if "robot" in plant:
        settings = {**settings, graph.PLANT: {**plant, "robot": robot}}
    numbers = load_robot(robot)
    told: dict[str, ParameterValue] = {"robot": robot} if robot != ROBOTS[0] else {}
    mounting = plant.get("mounting", "")
    controller = settings.get(graph.LOW_LEVEL_CONTROLLER, {})
    choice = _Choice(
        time=time,
        body=body,
        robot=numbers,
        told=told,
        bus=bus,
        mounted={"mounting": mounting} if mounting else {},
        planner=bool(controller.get("planner", False)),
        wakes=wakes,
    )
    specs = [NodeSpec("husky_sim", graph.PLANT, {"time": time}), *_NODES[numbers.actuation](choice)]
    if plant.get("camera", False):
        specs += _navigation(choice)
    if remote:
        specs.append(NodeSpec("husky_pu", graph.RC_TRANSMITTER, {"time": time}))
    if record is not None:
        specs.append(NodeSpec("husky_bringup", graph.RECORDER, {"output": record}))
    if console:
        specs.append(NodeSpec("husky_bringup", graph.CONSOLE))
    return with_settings(specs, settings)


def _check_word(name: str, value: str, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}, it must be one of {', '.join(allowed)}")


def with_settings(
    specs: Sequence[NodeSpec], settings: Mapping[str, Mapping[str, ParameterValue]]
) -> tuple[NodeSpec, ...]:
    """Return nodes with further parameters.

    Raises:
        ValueError: settings of a node that is not there.
    """
    names = [spec.name for spec in specs]
    for name in settings:
        if name not in names:
            raise ValueError(f"there is no node {name!r}, the graph has {', '.join(names)}")
    return tuple(
        NodeSpec(spec.package, spec.executable, {**spec.parameters, **settings.get(spec.name, {})})
        for spec in specs
    )


def robot_path(robot: str) -> str:
    """Return a robot's name, or the whole path of its file: nodes need not start where we are."""
    return str(Path(robot).absolute()) if robot not in ROBOTS and Path(robot).is_file() else robot


@dataclass(frozen=True)
class _Choice:
    """What is chosen of a robot.

    Attributes:
        time: one of `TIMES`.
        body: what of it stands in the world.
        robot: its numbers.
        told: to every node that loads the robot.
        bus: of its drives, one of `graph.BUSES`.
        mounted: to every node that must know how its fans are mounted.
        planner: whether the planner takes part.
        wakes: whether a velocity command sets a standing robot in motion.
    """

    time: str
    body: str
    robot: Robot
    told: Mapping[str, ParameterValue]
    bus: str
    mounted: Mapping[str, ParameterValue]
    planner: bool
    wakes: bool


def _with_drives(choice: _Choice) -> list[NodeSpec]:
    """Return the nodes of a robot as Husky Carbon is: legs, propulsion unit, or both."""
    specs: list[NodeSpec] = []
    if choice.body != "unit":
        told = {"time": choice.time, "bus": choice.bus, **_patience(choice), **choice.told}
        if choice.bus != graph.BUSES[0]:
            segment = {"time": choice.time, **choice.told}
            specs.append(NodeSpec("husky_sim", graph.DRIVE_SEGMENT, segment))
            if choice.time == "realtime":
                told["frame_timeout"] = _FRAME_TIMEOUT
        specs += _legs(choice, NodeSpec("husky_drivers", graph.DRIVE_BRIDGE, told))
    if choice.body != "robot":
        specs += _unit(choice)
    return specs


_FRAME_TIMEOUT = 0.02
"""Without a real-time kernel simulated drives answer late now and then [s]."""


def _patience(choice: _Choice) -> dict[str, ParameterValue]:
    """Without a real-time kernel ticks come late now and then; the joints need not stop then."""
    return {"command_timeout": 0.03} if choice.time == "realtime" else {}


def _with_servos(choice: _Choice) -> list[NodeSpec]:
    """Return the nodes of a robot as Husky-beta is; `robot_with_unit` is the one that flies.

    Raises:
        ValueError: a body or a bus that it has not.
    """
    if choice.body == "unit":
        raise ValueError(
            f"body is {choice.body!r}: of {choice.robot.name} there are robot, robot_with_unit: "
            "its propellers are at its knees"
        )
    if choice.bus != graph.BUSES[0]:
        raise ValueError(f"bus is {choice.bus!r}: {choice.robot.name} has servos, no drives")
    told: dict[str, ParameterValue] = {"time": choice.time, **_patience(choice), **choice.told}
    specs = _legs(choice, NodeSpec("husky_drivers", graph.SERVO_BRIDGE, told))
    return specs if choice.body == "robot" else [*specs, *_unit(choice)]


_NODES: Mapping[str, Callable[[_Choice], list[NodeSpec]]] = {
    DRIVES: _with_drives,
    BUS_SERVOS: _with_servos,
}
"""The nodes of a robot besides plant, remote control and recorder, by its kind of actuation."""


def _legs(choice: _Choice, bridge: NodeSpec) -> list[NodeSpec]:
    """Return the nodes of a robot on legs, whose joints hang on a bridge."""
    told = choice.told
    controller: dict[str, ParameterValue] = {"time": choice.time, **told}
    if choice.body != "robot":
        controller |= {"propulsion": True, **choice.mounted}
    if choice.wakes:
        controller["walk_on_command"] = True
    return [
        bridge,
        NodeSpec("husky_drivers", graph.VN200_DRIVER, {"clock": "device", **told}),
        NodeSpec("husky_control", graph.LOW_LEVEL_CONTROLLER, controller),
        *([NodeSpec("husky_control", graph.PLANNER, dict(told))] if choice.planner else []),
    ]


def _navigation(choice: _Choice) -> list[NodeSpec]:
    """Return depth camera, mapper, localizer and navigator.

    Raises:
        ValueError: the body has no camera.
    """
    if choice.body == "unit":
        raise ValueError("camera is true, but body is 'unit': the robot carries the depth camera")
    return [
        NodeSpec("husky_drivers", graph.D435_DRIVER, {"clock": "device", **choice.told}),
        NodeSpec("husky_navigation", graph.ELEVATION_MAPPER, dict(choice.told)),
        NodeSpec("husky_navigation", graph.LOCALIZER, dict(choice.told)),
        NodeSpec("husky_navigation", graph.NAVIGATOR, dict(choice.told)),
    ]


def _unit(choice: _Choice) -> list[NodeSpec]:
    """Return the nodes of the propulsion unit on a body."""
    told = {**choice.told, **choice.mounted}
    pixhawk: dict[str, ParameterValue] = {
        "time": choice.time,
        "inertia": flying_inertia(choice.robot, choice.body),
    }
    if choice.body == "unit":
        pixhawk["parameters"] = _TILT_ENDS_FLIGHT
    return [
        NodeSpec("husky_pu", graph.FLIGHT_CONTROLLER, {**pixhawk, **told}),
        NodeSpec("husky_pu", graph.PIXHAWK_BRIDGE, {"time": choice.time, **told}),
        NodeSpec("husky_drivers", graph.T265_DRIVER, {"clock": "device", **choice.told}),
    ]
