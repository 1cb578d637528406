"""Parameters of `pixhawk_bridge` that describe the dialogue and the unit."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from husky_description.nodes.parameters import declare
from husky_description.robot import Robot
from husky_pu.mavlink_client import ClientConfig
from husky_pu.mavlink_frames import read_key
from husky_pu.mixer import Mixer
from husky_pu.propulsion_bridge import Limits


def declare_config(node: Node, lockstep: bool) -> ClientConfig:
    """Declare what is wanted of the connection; return it.

    Raises:
        ValueError: the signing key's file holds none.
        OSError: it cannot be read.
    """
    key_file = declare(
        node, "signing_key", "", "file with the key in 64 hexadecimal digits; none: no signing"
    )
    return ClientConfig(
        target_system=declare(
            node,
            "target_system",
            0,
            "system id of the autopilot, 0: the first heard",
            lower=0,
            upper=255,
        ),
        source_system=declare(
            node,
            "source_system",
            0,
            "system id of this companion, 0: the autopilot's",
            lower=0,
            upper=255,
        ),
        telemetry_rate=declare(
            node,
            "telemetry_rate",
            50.0,
            "rate of attitudes and pulses, and of the state that is published [Hz]",
            lower=1.0,
            upper=200.0,
        ),
        battery_rate=declare(
            node,
            "battery_rate",
            10.0,
            "rate at which the battery is asked for [Hz]",
            lower=0.5,
            upper=50.0,
        ),
        link_timeout=declare(
            node,
            "link_timeout",
            0.8,
            "silence of an autopilot after which it is lost [s]",
            lower=0.1,
            upper=10.0,
        ),
        grace=declare(
            node,
            "grace",
            3.0,
            "wall time an autopilot may give no sign of life in lockstep [s]",
            lower=1.5,
            upper=60.0,
        ),
        lockstep=lockstep,
        signing_key=_load_key(key_file),
    )


def declare_limits(node: Node, robot: Robot) -> Limits:
    """Declare how fast thrust may rise; return it with what the robot's unit can do."""
    mixer = Mixer(robot)
    return Limits(
        mixer.max_collective,
        [float(scale) for scale in mixer.moment_scale],
        declare(
            node,
            "thrust_rate",
            80.0,
            "how fast the collective thrust may rise [N/s]",
            lower=1.0,
            upper=1000.0,
        ),
        vectoring=robot.fans.mounting == "vectoring",
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
        return read_key(Path(path).read_text())
    except ValueError as error:
        raise ValueError(f"parameter signing_key, file {path}: {error}") from None
