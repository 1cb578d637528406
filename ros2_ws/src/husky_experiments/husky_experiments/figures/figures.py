"""All figures of a recording: what the robot was asked, what it did, how near its limits it was."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from husky_description.robot import Robot
from husky_experiments.figures.body import attitude, body, path
from husky_experiments.figures.feet import contact_forces, gait
from husky_experiments.figures.joints import joint_angles, joint_angles_close, torques, tracking
from husky_experiments.figures.propulsion import battery, fans, t265, unit_attitude
from husky_experiments.recordings.recording import MissingTopicError, Recording
from husky_runtime import graph

DRAWINGS: tuple[Callable[[Recording, Robot, Path], Path], ...] = (
    joint_angles,
    joint_angles_close,
    tracking,
    torques,
    body,
    attitude,
    contact_forces,
    gait,
    path,
)
"""Every figure of a robot on legs, in the order in which they are drawn."""
UNIT_DRAWINGS = (battery, unit_attitude, fans, t265)
"""Figures of the propulsion unit, drawn where there is one."""


def make_all(recording: Recording, robot: Robot, directory: Path) -> list[Path]:
    """Draw every figure that the recording has data for, into a directory that is made if need be.

    Returns:
        The PNG files written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    unit = recording.has(graph.FAN_STATE)
    alone = unit and not recording.has(graph.JOINT_STATES)
    drawings = ((body,) if alone else DRAWINGS) + (UNIT_DRAWINGS if unit else ())
    written = []
    for draw in drawings:
        try:
            written.append(draw(recording, robot, directory))
        except MissingTopicError:
            continue
    return written
