"""A course for climbing: flat approach, foot of the slope, slope; how the robot climbs it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from husky_bringup.system import ParameterValue
from husky_description.arrays import Array
from husky_experiments.scripts import ready_fans, stand_up
from husky_experiments.session import Session
from husky_runtime import graph

MOUNTINGS = {"vector": "vectoring", "body_z": "fixed"}
"""How the fans are mounted in each thrust mode."""
_CLEAR = 0.5
"""Way past the foot of the slope after which all feet are on the straight [m]."""
_RESERVE = 2.0
"""Length of the slope beyond what is walked [m]."""
_LOW = 0.4
"""Share of its height over the feet below which a climbing robot has fallen."""
_CHECK = 0.2
"""Between two looks at whether it has fallen [s]."""


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
        over = float((position - self.foot) @ self.normal)
        if self.along(position) >= 0.0:
            return over
        centre = np.array([self.approach, 0.0, self.blend])
        if position[0] <= self.approach:
            return float(position[2])
        return self.blend - float(np.linalg.norm((position - centre)[[0, 2]]))


def course_for(
    slope_deg: float, way: float, friction: float, blend: float = Course.blend
) -> Course:
    """Return a course that is long enough for a way on the slope [m]; the blend is in m."""
    length = max(2.0, way + _CLEAR + _RESERVE)
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


def place(session: Session) -> Array:
    """Return the true position of the base in world [m] (3,)."""
    assert session.truth is not None
    at = session.truth.pose.pose.position
    return np.array([at.x, at.y, at.z])


def has_fallen(session: Session, course: Course, stand_height: float = 0.5) -> bool:
    """Return whether a climbing robot has fallen: given up, or its body down on the ground."""
    state = session.state
    if state is None or session.truth is None:
        return False
    stopped = state.mode in ("damping", "emergency_stop", "passive")
    return stopped or course.height(place(session)) < _LOW * stand_height


def get_ready(session: Session, *, fans: bool = True) -> None:
    """Stand up, arm the fans, and enter the mode `wair`."""
    stand_up(session)
    if fans:
        ready_fans(session)
    session.set_mode("wair", reached="wair", within=1.0)


def go(session: Session, course: Course, duration: float, speed: float) -> bool:
    """Walk at a speed [m/s] for a while [s]; return whether the robot is on its legs still."""
    session.set_velocity(speed)
    end = session.time + duration
    while session.time < end - 1e-9:
        session.advance(min(_CHECK, end - session.time))
        if has_fallen(session, course):
            return False
    return True


def go_to(session: Session, course: Course, along: float, speed: float, within: float) -> bool:
    """Walk at a speed [m/s], negative backwards, until the base is so far up the straight part [m],
    negative before it; return whether it got there within a time [s].
    """
    end = session.time + within
    while (course.along(place(session)) - along) * math.copysign(1.0, speed) < 0.0:
        if session.time > end or not go(session, course, _CHECK, speed):
            return False
    return True


def climb_onto(session: Session, course: Course, speed: float) -> bool:
    """Walk from the flat until all feet are on the straight slope; return whether it got there."""
    if course.slope_deg == 0.0:
        return go(session, course, 3.0, speed)
    way = _CLEAR - course.along(place(session))
    return go_to(session, course, _CLEAR, speed, 5.0 + 3.0 * way / speed)
