"""Parameters of `flight_controller` that make the autopilot."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from husky_description.gimbal import Gimbal
from husky_pu.autopilot.airframe import airframe_parameters
from husky_pu.autopilot.autopilot import Autopilot, AutopilotConfig
from husky_pu.autopilot.flight_parameters import read_overrides
from husky_pu.autopilot.imu import NO_ERRORS, ImuErrors
from husky_pu.autopilot.parameter_file import ParameterFile
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_pu.mavlink.frames import read_key
from husky_runtime.nodes.parameters import declare, declare_mounting, declare_robot, declare_sensing


def declare_memory(node: Node) -> ParameterFile | None:
    """Return where parameters outlast the process, None for nowhere."""
    path = declare(
        node,
        "parameter_file",
        "",
        "where parameters that are set over MAVLink outlast the process; empty for nowhere",
    )
    if not path:
        return None
    try:
        memory = ParameterFile(Path(path).expanduser())
    except OSError as error:
        raise ValueError(
            f"parameter parameter_file is {path!r}, it must be a file that can be read and "
            f"written: {error.strerror}"
        ) from error
    if memory.warning:
        node.get_logger().warning(memory.warning)
    return memory


def declare_autopilot(node: Node, memory: ParameterFile | None, *, lockstep: bool) -> Autopilot:
    """Return the autopilot that the parameters describe, with what its memory holds."""
    robot = declare_robot(node, **declare_mounting(node))
    seed = declare(node, "seed", 0, "of the sensors' errors", 0, 2**31 - 1)
    ideal = declare_sensing(node, "gyroscope, accelerometer, compass, barometer") == "ideal"
    inertia = declare(
        node,
        "inertia",
        [0.03, 0.03, 0.05],
        "about roll, pitch, yaw of all that flies together [kg m^2]; sets the rate loops",
    )
    if len(inertia) != 3 or not all(1e-4 <= j <= 10.0 for j in inertia):
        raise ValueError(f"parameter inertia is {list(inertia)}, it must be 3 of 1e-4 to 10")
    key = declare(node, "signing_key", "", "of MAVLink, 64 hexadecimal digits; empty for none")
    overrides = declare(
        node, "parameters", "", "of the autopilot that differ: NAME=VALUE, NAME=VALUE"
    )
    autopilot = Autopilot(
        mixer_of(robot),
        AutopilotConfig(
            inertia=(inertia[0], inertia[1], inertia[2]),
            errors=NO_ERRORS if ideal else ImuErrors(),
            seed=seed,
            parameters=airframe_parameters(robot),
            kept=memory.values if memory is not None else {},
            overrides=read_overrides(overrides),
            signing_key=read_key(key) if key else b"",
            lockstep=lockstep,
            gimbal=Gimbal.of(robot),
        ),
    )
    parameters = autopilot.parameters
    parameters.outlasting = memory is not None
    for problem in parameters.unfit:
        node.get_logger().warning(f"a stored parameter is not taken: {problem}")
    for name in parameters.kept.keys() & read_overrides(overrides).keys():
        node.get_logger().warning(f"{name} of `parameters` stands above the stored one")
    return autopilot
