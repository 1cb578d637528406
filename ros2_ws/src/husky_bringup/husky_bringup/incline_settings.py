"""Parameters of the nodes for a climb."""

from __future__ import annotations

from collections.abc import Mapping

from husky_bringup.incline_course import Course
from husky_bringup.system import ParameterValue
from husky_description import graph

MOUNTINGS = {"vector": "vectoring", "body_z": "fixed"}
"""How the fans are mounted in each thrust mode."""


def climbing_settings(
    course: Course,
    seed: int,
    thrust_mode: str = "vector",
    controller: Mapping[str, ParameterValue] | None = None,
) -> dict[str, dict[str, ParameterValue]]:
    """Return parameters by node name.

    Args:
        course: the ground.
        seed: of all sensor noise.
        thrust_mode: key of `MOUNTINGS`.
        controller: live parameters of the controller.

    Raises:
        ValueError: no such thrust mode.
    """
    if thrust_mode not in MOUNTINGS:
        raise ValueError(f"thrust_mode is {thrust_mode!r}, it must be {' or '.join(MOUNTINGS)}")
    mounting: dict[str, ParameterValue] = {"mounting": MOUNTINGS[thrust_mode]}
    world: dict[str, ParameterValue] = {"seed": seed, "body": "robot_with_unit", **course.plant()}
    return {
        graph.PLANT: {**world, **mounting},
        graph.FLIGHT_CONTROLLER: dict(mounting),
        graph.PIXHAWK_BRIDGE: dict(mounting),
        graph.LOW_LEVEL_CONTROLLER: {"planner": True, **(controller or {}), **mounting},
    }
