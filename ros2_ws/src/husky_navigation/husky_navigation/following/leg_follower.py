"""Velocity commands that lead the base along a leg of a route."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from husky_description.arrays import Array
from husky_navigation.planning.route import Leg, PlanePose, way_to_each
from husky_navigation.planning.route_search import CLIMB, FLY, WALK

_AHEAD = 0.5
"""Way along the leg at which a walking robot aims [m]."""
_NEAR = 0.35
"""Way left from which on it takes its place and heading at the end of a leg [m]."""
_ON_THE_SPOT = 0.6
"""Error of heading beyond which it turns before it goes on [rad]."""
_TURN_GAIN, _PLACE_GAIN, _SLOWING = 1.5, 1.0, 0.8
"""Yaw rate per error of heading [1/s], and speed per error of place, and per way left [1/s]."""
_LEAST_SPEED, _LEAST_TURN = 0.05, 0.1
"""Commands below are taken for zero by a robot that walks [m/s, rad/s]."""
PATH_STEP = 0.1
"""Between two places at which the way ahead is looked at [m]."""
_THERE = 0.01
"""Length of a climb that is none [m]."""
_CROSS_GAIN, _MOST_LEAN = 0.8, 0.2
"""Heading into the line of a climb per distance from it [rad/m], and the most of it [rad]."""


class VelocityCommand(NamedTuple):
    """Of the base in its own heading frame: ahead [m/s], left [m/s], yaw rate [rad/s]."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


class Pace(NamedTuple):
    """Velocity limits and tolerances of a way of moving.

    Attributes:
        forward, sideways: [m/s].
        turn: [rad/s].
        place, heading: distance [m] and angle [rad] within which the robot is at the end of a leg.
    """

    forward: float
    sideways: float
    turn: float
    place: float
    heading: float


PACES = {
    WALK: Pace(forward=0.4, sideways=0.12, turn=0.5, place=0.06, heading=0.08),
    CLIMB: Pace(forward=0.25, sideways=0.0, turn=0.2, place=0.0, heading=0.0),
    FLY: Pace(forward=0.48, sideways=0.3, turn=0.4, place=0.1, heading=0.1),
}
"""Of each way of moving. A flight goes ahead at `FlyAbility.speed`; sideways and in turns it keeps
below the controller's limits `quadrotor.max_speed` (0.5 m/s) and `quadrotor.max_yaw_rate`
(0.5 rad/s), 0.3 m/s being all that its follower asks for within 0.35 m of the end.
"""


class LegFollower(Protocol):
    """Leads the base along one leg."""

    def command(self, pose: PlanePose) -> VelocityCommand | None:
        """Return the velocity at a pose, None at the end of the leg."""

    @property
    def left(self) -> float:
        """Way that is left [m]."""

    def ahead(self) -> Array:
        """Return x, y [m] and heading [rad] along the way that is left, each `PATH_STEP` (n, 3)."""


def follower_of(leg: Leg) -> LegFollower:
    """Return the follower of a leg, at the pace of its mode."""
    pace = PACES[leg.mode]
    if leg.mode == CLIMB:
        return ClimbFollower(leg, pace)
    return FlightFollower(leg, pace) if leg.mode == FLY else WalkFollower(leg, pace)


class WalkFollower:
    """Follows corners with its nose ahead; takes place and heading at the end from any side."""

    def __init__(self, leg: Leg, pace: Pace) -> None:
        """Begin at the first corner."""
        self._leg, self._pace = leg, pace
        self._distance = way_to_each(leg.points)
        self._progress = 0.0

    @property
    def left(self) -> float:
        """Way that is left [m]."""
        return float(self._distance[-1]) - self._progress

    def command(self, pose: PlanePose) -> VelocityCommand | None:
        """Return the velocity at a pose, None at the end of the leg."""
        self._progress = self._nearest(pose)
        if self.left < _NEAR:
            return self._arrive(pose)
        aim = self._at(np.array(self._progress + _AHEAD))
        error = _angle(math.atan2(aim[1] - pose.y, aim[0] - pose.x) - pose.yaw)
        turn = _limited(_TURN_GAIN * error, self._pace.turn)
        if abs(error) > _ON_THE_SPOT:
            return VelocityCommand(turn=turn)
        speed = min(self._pace.forward, max(_LEAST_SPEED, _SLOWING * self.left))
        return VelocityCommand(speed * math.cos(error), 0.0, turn)

    def ahead(self) -> Array:
        """Return x, y [m] and heading [rad] along the way that is left, each `PATH_STEP` (n, 3)."""
        places = self._at(np.arange(self._progress, self._distance[-1], PATH_STEP))
        steps = np.diff(places, axis=0)
        return np.column_stack((places[1:], np.arctan2(steps[:, 1], steps[:, 0])))

    def _arrive(self, pose: PlanePose) -> VelocityCommand | None:
        """Return the velocity that takes the robot to the end of the leg, None where it is."""
        end, pace = self._leg.points[-1], self._pace
        dx, dy, turn = end[0] - pose.x, end[1] - pose.y, _angle(self._leg.yaw - pose.yaw)
        there, turned = math.hypot(dx, dy) <= pace.place, abs(turn) <= pace.heading
        if there and turned:
            return None
        distance = math.hypot(dx, dy)
        speed = 0.0 if there else _told(_PLACE_GAIN * distance, _LEAST_SPEED, pace.sideways)
        direction = math.atan2(dy, dx) - pose.yaw
        return VelocityCommand(
            speed * math.cos(direction),
            speed * math.sin(direction),
            0.0 if turned else math.copysign(_told(abs(turn), _LEAST_TURN, pace.turn), turn),
        )

    def _nearest(self, pose: PlanePose) -> float:
        """Return the way along the leg that is nearest to a pose, not before nor far beyond that of
        the last.
        """
        way = np.linspace(self._progress, min(self._progress + _AHEAD, self._distance[-1]), 26)
        places = self._at(way)
        away = np.hypot(places[:, 0] - pose.x, places[:, 1] - pose.y)
        return float(way[np.argmin(away)])

    def _at(self, way: Array) -> Array:
        """Return the places at ways along the leg [m] (..., 2)."""
        x, y = self._leg.points.T
        return np.stack([np.interp(way, self._distance, each) for each in (x, y)], axis=-1)


class FlightFollower(WalkFollower):
    """Follows corners in the air: it may go sideways, but sees only ahead and so turns there."""

    def _arrive(self, pose: PlanePose) -> VelocityCommand | None:
        """Return the velocity that takes the robot over the end of the leg, None where it is."""
        end, pace = self._leg.points[-1], self._pace
        dx, dy, turn = end[0] - pose.x, end[1] - pose.y, _angle(self._leg.yaw - pose.yaw)
        distance, direction = math.hypot(dx, dy), math.atan2(dy, dx) - pose.yaw
        if distance <= pace.place and abs(turn) <= pace.heading:
            return None
        speed = min(pace.sideways, _SLOWING * distance)
        forward, left = speed * math.cos(direction), speed * math.sin(direction)
        return VelocityCommand(forward, left, _limited(_TURN_GAIN * turn, pace.turn))


class ClimbFollower:
    """Follows the line of a lane, nose along it or against it."""

    def __init__(self, leg: Leg, pace: Pace) -> None:
        """Begin at the foot, or at the top."""
        self._leg, self._pace = leg, pace
        self._left = leg.length

    @property
    def left(self) -> float:
        """Way that is left [m]."""
        return self._left

    def ahead(self) -> Array:
        """Return nothing: a lane is looked at when it is planned."""
        return np.empty((0, 3))

    def command(self, pose: PlanePose) -> VelocityCommand | None:
        """Return the velocity at a pose, None at the end of the leg."""
        start, end = self._leg.points
        if self._leg.length < _THERE:
            return None
        along = (end - start) / self._leg.length
        from_start = np.array((pose.x, pose.y)) - start
        self._left = self._leg.length - float(from_start @ along)
        if self._left <= 0.0:
            return None
        across = float(along[0] * from_start[1] - along[1] * from_start[0])
        wanted = self._leg.yaw - _limited(_CROSS_GAIN * across, _MOST_LEAN)
        turn = _limited(_TURN_GAIN * _angle(wanted - pose.yaw), self._pace.turn)
        nose = math.cos(self._leg.yaw), math.sin(self._leg.yaw)
        return VelocityCommand(math.copysign(self._pace.forward, float(along @ nose)), 0.0, turn)


def _angle(value: float) -> float:
    """Return an angle within -pi to pi [rad]."""
    return math.remainder(value, 2.0 * math.pi)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _told(value: float, least: float, most: float) -> float:
    """Return a command that is not taken for zero, nor greater than allowed."""
    return min(most, max(least, value))
