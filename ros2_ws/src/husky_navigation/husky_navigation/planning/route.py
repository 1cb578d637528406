"""A route: legs on which the robot walks, climbs or flies, from where it is to its goal."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.route_search import WALK
from husky_navigation.planning.travel_costs import RADIAN, TravelCosts


class PlanePose(NamedTuple):
    """Where a robot stands in `map`: place [m] and heading [rad]."""

    x: float
    y: float
    yaw: float


class Refusal(enum.Enum):
    """Reasons for which there is no route."""

    START_OUTSIDE = "the robot is off the map"
    GOAL_OUTSIDE = "the goal is off the map"
    START_OCCUPIED = "the robot stands where it cannot walk"
    GOAL_OCCUPIED = "the goal is on or too near an obstacle, or on a slope"
    NO_WAY = "no way leads to the goal on ground that the robot can take"
    BATTERY = "the battery does not last for the way to the goal"
    OFF_PATH = "the robot is more than 0.5 m from the path"
    PATH_BLOCKED = "the path leads over ground that the robot cannot take"


class RouteError(Exception):
    """There is no route.

    Attributes:
        refusal: why.
        off_slope: the way to level ground of a robot that stands on a slope, from where it may see
            more; None for one that does not.
    """

    def __init__(self, refusal: Refusal, off_slope: Route | None = None) -> None:
        """Say why."""
        super().__init__(refusal.value)
        self.refusal, self.off_slope = refusal, off_slope


@dataclass(frozen=True)
class Leg:
    """A part of a route on which the robot moves in one way.

    Attributes:
        mode: `walk`, `climb` or `fly`.
        points: of the base in `map`, from where the leg begins to where it ends [m] (n, 2).
        yaw: heading at its end [rad]; on a climb all along, also backwards.
        time: that it is to take [s]; of a flight, from legs to arms and back too.
        energy: that it is to cost [J], as well.
        is_seen: so much of a climb that it may begin, else the robot looks at it first; the ground
            on which a flight lands, else it is judged when the robot is above it.
        downwards: on a climb.
        altitude: of the base in `map`, all along a flight; NaN on the ground [m].
        ground: height in `map` of the ground on which a flight lands, NaN of other legs [m].
    """

    mode: str
    points: Array
    yaw: float
    time: float
    energy: float
    is_seen: bool = True
    downwards: bool = False
    altitude: float = math.nan
    ground: float = math.nan

    @property
    def length(self) -> float:
        """Horizontal way [m]."""
        return way_over(self.points)


@dataclass(frozen=True)
class Route:
    """Legs one after the other.

    Attributes:
        legs: in order.
        is_whole: the last one ends at the goal, not beside it.
    """

    legs: tuple[Leg, ...]
    is_whole: bool = True

    @property
    def time(self) -> float:
        """Time that it is to take [s]."""
        return sum(leg.time for leg in self.legs)

    @property
    def energy(self) -> float:
        """Energy that it is to cost [J]."""
        return sum(leg.energy for leg in self.legs)

    @property
    def length(self) -> float:
        """Horizontal way [m]."""
        return sum(leg.length for leg in self.legs)

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways of moving, in order."""
        return tuple(leg.mode for leg in self.legs)


def walk_leg(points: Array, yaw: float, yaw_at_end: float, costs: TravelCosts, speed: float) -> Leg:
    """Return a leg of a walk, with the cost of its way and of its turns.

    Args:
        points: of the base in `map` [m] (n, 2).
        yaw: heading before it [rad].
        yaw_at_end: heading at its end [rad].
        costs: of the robot.
        speed: at which it walks [m/s].
    """
    steps = np.diff(points, axis=0)
    ways = np.linalg.norm(steps, axis=1)
    ahead = np.arctan2(steps[:, 1], steps[:, 0])[ways > 0.0]
    turns = np.diff(np.concatenate(([yaw], ahead, [yaw_at_end])))
    turned = float(np.abs((turns + math.pi) % (2.0 * math.pi) - math.pi).sum())
    per_metre = (float(each[0]) for each in costs.per_metre(WALK, speed, np.zeros(1)))
    turn, way = costs.of(WALK, RADIAN), float(ways.sum())
    time, energy = (
        way * metre + turned * radian
        for metre, radian in zip(per_metre, (turn.time, turn.energy), strict=True)
    )
    return Leg(WALK, points, yaw_at_end, time, energy)


def course_over(points: Array) -> float:
    """Return the direction from the first of points to the last [rad]."""
    dx, dy = points[-1] - points[0]
    return math.atan2(dy, dx)


def way_to_each(points: Array) -> Array:
    """Return the way from the first of points (n, 2) to each, over those between [m] (n,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate((np.zeros(min(1, len(points))), np.cumsum(steps)))


def way_over(points: Array) -> float:
    """Return the way over points (n, 2), n > 0 [m]."""
    return float(way_to_each(points)[-1])
