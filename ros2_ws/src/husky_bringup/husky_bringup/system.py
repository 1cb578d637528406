"""The nodes of the robot and their parameters: one table for shell, launch file and tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from husky_description import graph
from husky_description.mujoco_model import flying_inertia
from husky_description.robot import load_robot

ParameterValue = bool | int | float | str | tuple[float, ...]

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

    def command(self, *, params_file: str | None = None) -> list[str]:
        """Return the `ros2 run` command line that starts it."""
        arguments = ["ros2", "run", self.package, self.executable, "--ros-args"]
        if params_file is not None:
            arguments += ["--params-file", params_file]
        for key, value in self.parameters.items():
            arguments += ["-p", f"{key}:={to_yaml(value)}"]
        return arguments


def to_yaml(value: ParameterValue) -> str:
    """Write a parameter value so that ROS reads it back with the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"' if value == "" or not value.isidentifier() else value
    if isinstance(value, tuple):
        return f"[{', '.join(map(repr, value))}]"
    return repr(value)


def simulated_robot(
    time: str = "lockstep",
    settings: Mapping[str, Mapping[str, ParameterValue]] | None = None,
    record: str | None = None,
    remote: bool = False,
) -> tuple[NodeSpec, ...]:
    """Return every node of the robot in simulation.

    Which robot it is says the plant's parameter `body`, how its fans are mounted its `mounting`;
    the planner takes part when the controller's parameter `planner` says so.

    Args:
        time: one of `TIMES`.
        settings: further parameters by node name.
        record: directory of the bag, or None for no recorder.
        remote: whether the remote control takes part.

    Raises:
        ValueError: unknown clock, or settings of a node that is not there.
    """
    if time not in TIMES:
        raise ValueError(f"time is {time!r}, it must be one of {', '.join(TIMES)}")
    # Without a real-time kernel ticks come late now and then; the drives need not brake for that.
    patience: dict[str, ParameterValue] = {"command_timeout": 0.03} if time == "realtime" else {}
    settings = settings or {}
    body = str(settings.get(graph.PLANT, {}).get("body", "robot"))
    if body not in graph.BODIES:
        raise ValueError(f"body is {body!r}, it must be one of {', '.join(graph.BODIES)}")
    mounting = settings.get(graph.PLANT, {}).get("mounting", "")
    mounted: dict[str, ParameterValue] = {"mounting": mounting} if mounting else {}
    specs = [NodeSpec("husky_sim", graph.PLANT, {"time": time})]
    if body != "unit":
        fans: dict[str, ParameterValue] = {"propulsion": True, **mounted} if body != "robot" else {}
        specs += [
            NodeSpec("husky_drivers", graph.DRIVE_BRIDGE, {"time": time, "bus": "sim", **patience}),
            NodeSpec("husky_drivers", graph.VN200_DRIVER, {"clock": "device"}),
            NodeSpec("husky_control", graph.LOW_LEVEL_CONTROLLER, {"time": time, **fans}),
        ]
        if settings.get(graph.LOW_LEVEL_CONTROLLER, {}).get("planner", False):
            specs.append(NodeSpec("husky_control", graph.PLANNER))
    if body != "robot":
        pixhawk: dict[str, ParameterValue] = {
            "time": time,
            "inertia": flying_inertia(load_robot(), body),
        }
        if body == "unit":
            pixhawk["parameters"] = _TILT_ENDS_FLIGHT
        specs += [
            NodeSpec("husky_pu", graph.FLIGHT_CONTROLLER, {**pixhawk, **mounted}),
            NodeSpec("husky_pu", graph.PIXHAWK_BRIDGE, {"time": time, **mounted}),
            NodeSpec("husky_drivers", graph.T265_DRIVER, {"clock": "device"}),
        ]
    if remote:
        specs.append(NodeSpec("husky_pu", graph.RC_TRANSMITTER, {"time": time}))
    if record is not None:
        specs.append(NodeSpec("husky_bringup", graph.RECORDER, {"output": record}))
    names = [spec.name for spec in specs]
    for name in settings:
        if name not in names:
            raise ValueError(f"there is no node {name!r}, the graph has {', '.join(names)}")
    return tuple(
        NodeSpec(spec.package, spec.executable, {**spec.parameters, **settings.get(spec.name, {})})
        for spec in specs
    )
