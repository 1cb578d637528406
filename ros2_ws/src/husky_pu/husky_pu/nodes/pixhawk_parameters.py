"""Parameters of `pixhawk_bridge` that describe the dialogue and the unit."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from husky_description.gimbal import Gimbal
from husky_description.robot import Robot
from husky_pu.autopilot.weighted_mixer import mixer_of
from husky_pu.companion.bridge import Limits
from husky_pu.companion.client import ClientConfig
from husky_pu.companion.flight_settings import rules_of
from husky_pu.mavlink.frames import read_key
from husky_runtime.nodes.one_clock import longest_look
from husky_runtime.nodes.parameters import declare

_DIALOGUE = {
    "target_system": ("system id of the autopilot, 0: the first heard", 0, 255),
    "source_system": ("system id of this companion, 0: the autopilot's", 0, 255),
    "telemetry_rate": (
        "rate of attitudes and pulses, and of the state that is published [Hz]",
        1.0,
        200.0,
    ),
    "battery_rate": ("rate at which the battery is asked for [Hz]", 0.5, 50.0),
    "link_timeout": ("silence of an autopilot after which it is lost [s]", 0.1, 10.0),
    "grace": ("wall time an autopilot may give no sign of life in lockstep [s]", 1.5, 60.0),
}
"""Parameters that are attributes of `ClientConfig`: what they are, and their range."""


def declare_config(node: Node, robot: Robot, lockstep: bool) -> ClientConfig:
    """Declare what is wanted of the connection; return it.

    Raises:
        ValueError: the signing key's file holds none.
        OSError: it cannot be read.
    """
    what = "file with the key in 64 hexadecimal digits; none: no signing"
    key_file = declare(node, "signing_key", "", what)
    fans = len(robot.rotor_names)
    defaults = ClientConfig(fans)
    given = {
        name: declare(node, name, getattr(defaults, name), *row) for name, row in _DIALOGUE.items()
    }
    return ClientConfig(
        fans,
        lockstep=lockstep,
        signing_key=_load_key(key_file),
        rules=rules_of(robot.battery.cells),
        longest_look=longest_look(node),
        **given,
    )


def declare_limits(node: Node, robot: Robot) -> Limits:
    """Declare how fast thrust may rise; return it with what the robot's unit can do."""
    mixer = mixer_of(robot)
    return Limits(
        mixer.max_collective,
        [float(scale) for scale in mixer.moment_scale],
        declare(
            node, "thrust_rate", 80.0, "how fast the collective thrust may rise [N/s]", 1.0, 1000.0
        ),
        vectoring=Gimbal.of(robot) is not None,
    )


def _load_key(path: str) -> bytes:
    """Return the key in a file, nothing for no path.

    Raises:
        ValueError: the file holds none.
        OSError: it cannot be read.
    """
    if not path:
        return b""
    try:
        return read_key(Path(path).read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"parameter signing_key, file {path}: {error}") from None
