"""Passages of a climb, led by the robot's own estimate of where it is; the course is given.

The ground truth only ends a passage whose robot has fallen.
"""

from __future__ import annotations

import math

import numpy as np

from husky_description.arrays import Array
from husky_experiments.incline_course import CLEAR, Course
from husky_experiments.scripts import ready_fans, stand_up
from husky_experiments.session import Session, SessionError

_LOW = 0.4
"""Share of its height over the feet below which a climbing robot has fallen."""
_CHECK = 0.2
"""Between two looks at whether it has fallen [s]."""
_TURN_RATE = 0.5
"""Of a turn on the spot, in mode `wair` [rad/s]."""


def place(session: Session) -> Array:
    """Return where the robot believes its base to be, in its odometry frame [m] (3,).

    That frame begins where the course does.

    Raises:
        SessionError: the controller does not report it.
    """
    if session.state is None:
        raise SessionError("the controller does not tell where it is")
    return np.array(session.state.position, dtype=np.float64)


def true_place(session: Session) -> Array:
    """Return the true position of the base in world [m] (3,).

    Raises:
        SessionError: the plant does not report it.
    """
    if session.truth is None:
        raise SessionError("the plant does not tell where the robot is")
    at = session.truth.pose.pose.position
    return np.array([at.x, at.y, at.z])


def has_fallen(session: Session, course: Course, stand_height: float = 0.5) -> bool:
    """Return whether a climbing robot has fallen: given up, or its body down on the ground."""
    state = session.state
    if state is None or session.truth is None:
        return False
    stopped = state.mode in ("damping", "emergency_stop", "passive")
    return stopped or course.height(true_place(session)) < _LOW * stand_height


def get_ready(session: Session, *, fans: bool = True) -> None:
    """Stand up, arm the fans, and enter the mode `wair`."""
    stand_up(session)
    if fans:
        ready_fans(session)
    session.set_mode("wair", reached="wair", within=1.0)


def go(session: Session, course: Course, duration: float, speed: float, turn: float = 0.0) -> bool:
    """Walk at a speed [m/s] and a yaw rate [rad/s] for a while [s]; return whether the robot is on
    its legs still.
    """
    session.set_velocity(speed, 0.0, turn)
    end = session.time + duration
    while session.time < end - 1e-9:
        session.advance(min(_CHECK, end - session.time))
        if has_fallen(session, course):
            return False
    return True


def go_to(session: Session, course: Course, along: float, speed: float, within: float) -> bool:
    """Walk at a speed [m/s], negative backwards, until the base by its own estimate is so far up
    the straight part [m], negative before it; return whether it got there within a time [s].
    """
    end = session.time + within
    uphill = along > course.along(place(session))
    while (course.along(place(session)) < along) is uphill:
        if session.time > end or not go(session, course, _CHECK, speed):
            return False
    return True


def climb_onto(session: Session, course: Course, speed: float) -> bool:
    """Walk from the flat until all feet are on the straight slope; return whether it got there."""
    if course.slope_deg == 0.0:
        return go(session, course, 3.0, speed)
    way = CLEAR - course.along(place(session))
    return go_to(session, course, CLEAR, speed, 5.0 + 3.0 * way / speed)


def turn_on_top(session: Session, course: Course, speed: float) -> bool:
    """Walk at a speed [m/s] from the slope over its crest, turn round, and walk down again until
    all feet are on the slope; return whether it got there.
    """
    top = course.along(course.crest_middle + np.array([0.0, 0.0, course.blend]))
    way = top - course.along(place(session))
    return (
        go_to(session, course, top + CLEAR, speed, 5.0 + 3.0 * way / speed)
        and go(session, course, math.pi / _TURN_RATE, 0.0, _TURN_RATE)
        and go_to(session, course, course.length - CLEAR, speed, 5.0 + 3.0 * (top / speed))
    )


def walk_down(session: Session, course: Course, speed: float) -> bool:
    """Walk at a speed [m/s], negative backwards, to the flat before the slope; return whether it
    got there.
    """
    before = course.along(np.array([course.approach - Course.approach - 0.1, 0.0, 0.0]))
    way = course.along(place(session)) - before
    return go_to(session, course, before, speed, 5.0 + 3.0 * way / abs(speed))
