"""A course for climbing: flat approach, foot of the slope, slope; the parameters for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from husky_bringup.system import ParameterValue
from husky_description.arrays import Array
from husky_runtime import graph

MOUNTINGS = {"vector": "vectoring", "body_z": "fixed"}
"""How the fans are mounted in each thrust mode."""
CLEAR = 0.5
"""Way past the foot of the slope after which all feet are on the straight [m]."""
_RESERVE = 2.0
"""Length of the slope beyond what is walked [m]."""


@dataclass(frozen=True)
class Course:
    """Where the ground rises."""

    slope_deg: float  # [deg]
    approach: float = 0.8  # flat, from the robot's start to the foot of the slope [m]
    blend: float = 1.5  # radius of the foot of the slope [m]
    length: float = 12.0  # of the straight slope [m]
    friction: float = 0.7  # sliding friction [-]

    def plant(self) -> dict[str, ParameterValue]:
        """Return the plant's parameters."""
        if self.slope_deg == 0.0:
            return {"terrain": "flat", "friction": self.friction}
        return {
            "terrain": "ramp",
            "slope_deg": float(self.slope_deg),
            "terrain_approach": self.approach,
            "terrain_blend": self.blend,
            "terrain_length": self.length,
            "friction": self.friction,
        }

    @property
    def slope(self) -> float:
        """Inclination of the straight part [rad]."""
        return math.radians(self.slope_deg)

    @property
    def normal(self) -> Array:
        """Outward normal of the straight part, in world (3,)."""
        return np.array([-math.sin(self.slope), 0.0, math.cos(self.slope)])

    @property
    def uphill(self) -> Array:
        """Unit vector up the straight part, in world (3,)."""
        return np.array([math.cos(self.slope), 0.0, math.sin(self.slope)])

    @property
    def foot(self) -> Array:
        """Where the straight part begins, in world [m] (3,)."""
        x = self.approach + self.blend * math.sin(self.slope)
        return np.array([x, 0.0, self.blend * (1.0 - math.cos(self.slope))])

    def along(self, position: Array) -> float:
        """Return how far up the straight part a position in world is [m]; negative before it."""
        return float((position - self.foot) @ self.uphill)

    def height(self, position: Array) -> float:
        """Return the height of a position over the ground, at right angles to it [m]."""
        if self.slope_deg == 0.0:
            return float(position[2])
        along = self.along(position)
        if 0.0 <= along <= self.length:
            return float((position - self.foot) @ self.normal)
        if along < 0.0:
            middle = np.array([self.approach, 0.0, self.blend])
            if position[0] <= middle[0]:
                return float(position[2])
            return self.blend - float(np.linalg.norm((position - middle)[[0, 2]]))
        middle = self.crest_middle
        if position[0] >= middle[0]:
            return float(position[2] - middle[2]) - self.blend
        return float(np.linalg.norm((position - middle)[[0, 2]])) - self.blend

    @property
    def crest_middle(self) -> Array:
        """Centre of the arc between slope and level top, below the ground, in world [m] (3,)."""
        crest: Array = self.foot + self.length * self.uphill - self.blend * self.normal
        return crest


def course_for(
    slope_deg: float, way: float, friction: float, blend: float = Course.blend
) -> Course:
    """Return a course that is long enough for a way on the slope [m]; the blend is in m."""
    length = max(2.0, way + CLEAR + _RESERVE)
    return Course(slope_deg, blend=blend, length=length, friction=friction)


def climbing_settings(
    course: Course,
    seed: int,
    thrust_mode: str = "vector",
    controller: Mapping[str, ParameterValue] | None = None,
) -> dict[str, dict[str, ParameterValue]]:
    """Return parameters by node name; the thrust mode is a key of `MOUNTINGS`.

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
