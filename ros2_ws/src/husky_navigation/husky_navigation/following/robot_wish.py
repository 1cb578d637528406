"""Reports of the robot to the navigator, and what the navigator asks of it."""

from __future__ import annotations

import math
from typing import NamedTuple

from husky_navigation.following.leg_follower import VelocityCommand
from husky_navigation.planning.route import Leg, PlanePose
from husky_navigation.planning.route_search import CLIMB, FLY, WALK

STAND, TROT, WAIR = "stand", "walk", "wair"
PERCH, SPLAY, QUADROTOR = "perch", "splay", "quadrotor"
"""Modes of the controller."""
MODE_OF = {WALK: TROT, CLIMB: WAIR, FLY: QUADROTOR}
"""Mode of the controller for each kind of leg."""
_LEAST_RISE, _LEAST_DEPTH = 0.2, 0.1
"""Height over where it took off of the lowest flight, the lower bound of the controller's parameter
`quadrotor.height`, and depth down to which a landing looks for ground at least [m].

The bound of `quadrotor.landing_depth` is 0.05 m; as much again is for errors of the height in
flight, by which no landing is to be broken off.
"""


NEAR_TOP = 0.08
"""Below the height of a flight at which it sets out [m]."""


class RobotView(NamedTuple):
    """Report of the robot.

    Attributes:
        time: simulated or wall time [s].
        pose: of the base in `map`.
        mode: of the controller.
        fans_ready: armed, and they follow the controller.
        map_age: time since the newest map of the ground [s].
        speed: of the base [m/s].
        has_fans: there are fans, and none is lost.
        energy: that the battery has for the way [J].
        waits: for an answer to something that it was asked for.
        height: of the base in `map` [m].
        take_off: that of the robot on its perch, before its flight [m]; NaN if it was not there.
        lands: the navigator has asked for the landing that goes on, or was the last one.
    """

    time: float
    pose: PlanePose
    mode: str
    fans_ready: bool
    map_age: float = 0.0
    speed: float = 0.0
    has_fans: bool = True
    energy: float = math.inf
    waits: bool = False
    height: float = 0.0
    take_off: float = math.nan
    lands: bool = False


class FlightHeights(NamedTuple):
    """Heights of a flight, over where it took off and under it [m]; parameters of the controller.

    Attributes:
        height: of the flight.
        landing_depth: down to which a landing looks for ground.
    """

    height: float
    landing_depth: float


class Wish(NamedTuple):
    """Request to the robot.

    Attributes:
        mode: of the controller.
        fans: to be armed and handed to the controller.
        velocity: of the base.
        heights: of a flight; None for those that are set.
    """

    mode: str
    fans: bool = False
    velocity: VelocityCommand = VelocityCommand()
    heights: FlightHeights | None = None


def is_up(leg: Leg, view: RobotView) -> bool:
    """Return whether a robot in the air is as high as a flight, or higher."""
    return view.height > leg.altitude - NEAR_TOP


def wish_of(leg: Leg, view: RobotView) -> Wish:
    """Return what a leg asks for, at rest."""
    if leg.mode == CLIMB:
        return Wish(WAIR, fans=True)
    if leg.mode == WALK:
        return Wish(TROT)
    if view.mode not in (SPLAY, QUADROTOR):
        return Wish(QUADROTOR)
    is_known = math.isfinite(view.take_off)  # else no height can be set
    return Wish(QUADROTOR, fans=True, heights=_heights(leg, view) if is_known else None)


def _heights(leg: Leg, view: RobotView) -> FlightHeights:
    """Return the heights of a flight over where it took off, whole centimetres; the depth has the
    height of the base on its perch to spare.
    """
    height = max(_LEAST_RISE, leg.altitude - view.take_off)
    depth = max(_LEAST_DEPTH, view.take_off - leg.ground)
    return FlightHeights(round(height, 2), round(depth, 2))
