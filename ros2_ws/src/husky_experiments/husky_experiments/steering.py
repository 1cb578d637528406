"""Lead a robot to a goal by velocity commands and by its own estimate.

The goal is given in the odometry frame: nothing of the course is seen. The frame begins where the
robot starts, its x axis along the nose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from husky_control.rotation import wrap_angle
from husky_experiments.recordings.tables import to_rpy
from husky_experiments.scripts import stop_walking
from husky_experiments.session import Session, SessionError

_LOOK = 0.2
"""Between two looks at the estimate [s]."""
_HEADING_GAIN = 1.0
"""Yaw rate per error of the heading [1/s]."""
_MOST_TURN = 0.3
"""Largest yaw rate on the way [rad/s]."""


@dataclass(frozen=True)
class Steering:
    """How fast a way is gone."""

    speed: float  # at most [m/s]
    slowing: float  # speed per way that is left [1/s]
    sideways: float  # at most [m/s]
    near: float  # way left at which it is there [m]


TROTTING = Steering(0.3, 1.0, 0.1, 0.05)
FLYING = Steering(0.48, 0.7, 0.3, 0.06)


def place(session: Session) -> tuple[float, float]:
    """Return where the robot believes its base to be, x and y in its odometry frame [m].

    Raises:
        SessionError: it does not tell.
    """
    if session.state is None:
        raise SessionError("the controller does not tell where it is")
    x, y, _ = session.state.position
    return float(x), float(y)


def heading_of(orientation: Sequence[float]) -> float:
    """Return the heading [rad] of an attitude (x, y, z, w)."""
    return float(to_rpy(np.array([orientation]))[0, 2])


def go_to(session: Session, goal: tuple[float, float], pace: Steering, within: float) -> None:
    """Steer the base to a goal by velocity commands; nose along x. It comes to rest after that.

    Args:
        session: with a robot that walks or flies.
        goal: x and y in the odometry frame [m].
        pace: how the way is gone.
        within: simulated time that it may take [s].

    Raises:
        SessionError: it is not there in time.
    """
    end = session.time + within
    while True:
        x, y = place(session)
        ahead, left = goal[0] - x, goal[1] - y
        way = math.hypot(ahead, left)
        if way < pace.near:
            session.set_velocity(0.0)
            return
        if session.time > end:
            raise SessionError(f"it is not at its goal within {within:g} s: {way:.2f} m to go")
        session.set_velocity(*_velocity(session, ahead, left, pace))
        session.advance(_LOOK)


def trot_to(
    session: Session, goal: tuple[float, float], within: float, pace: Steering = TROTTING
) -> None:
    """Trot from standing to a goal, as `go_to`, and stand."""
    session.set_gait("trot")
    session.set_mode("walk")
    go_to(session, goal, pace, within)
    stop_walking(session)


def _velocity(
    session: Session, ahead: float, left: float, pace: Steering
) -> tuple[float, float, float]:
    """Return the velocity command in the heading frame that leads along a way in odometry [m]."""
    assert session.state is not None
    yaw = heading_of(session.state.orientation)
    way = math.hypot(ahead, left)
    speed = min(pace.speed, pace.slowing * way) / way
    c, s = math.cos(yaw), math.sin(yaw)
    forward, side = speed * (c * ahead + s * left), speed * (c * left - s * ahead)
    turn = -_HEADING_GAIN * wrap_angle(yaw)
    return forward, _within(side, pace.sideways), _within(turn, _MOST_TURN)


def _within(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))
