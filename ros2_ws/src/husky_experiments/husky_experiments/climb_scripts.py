"""How the robot climbs a course, step by step, and how it gets there."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array
from husky_experiments.incline_course import CLEAR, Course
from husky_experiments.scripts import ready_fans, stand_up, walk
from husky_experiments.session import Session, SessionError

_LOW = 0.4
"""Share of its height over the feet below which a climbing robot has fallen."""
_CHECK = 0.2
"""Between two looks at where it is and whether it has fallen [s]."""
_NEAR, _ALIGNED = 0.3, 0.05
"""When the robot is at a place [m], and when it has a heading [rad]."""
_AWAY = 0.5
"""A robot whose heading is further away from the place it goes to turns first [rad]."""
_TURN_GAIN, _TURN_RATE = 1.0, 0.6
"""Of the yaw rate over the angle that is left [1/s], and the greatest [rad/s]."""


def place(session: Session) -> Array:
    """Return the true position of the base in world [m] (3,)."""
    assert session.truth is not None
    at = session.truth.pose.pose.position
    return np.array([at.x, at.y, at.z])


def heading(session: Session) -> float:
    """Return the true heading of the base in world [rad]."""
    assert session.truth is not None
    q = session.truth.pose.pose.orientation
    return float(Rotation.from_quat((q.x, q.y, q.z, q.w)).as_euler("ZYX")[0])


def walk_to(session: Session, x: float, y: float, speed: float) -> None:
    """Walk to a place in world [m] by sight, as a pilot does.

    Raises:
        SessionError: it takes more than three times as long as the way at that speed [m/s].
    """
    away = _to(session, x, y)
    end = session.time + 10.0 + 3.0 * float(np.hypot(*away)) / speed
    while np.hypot(*away) > _NEAR:
        if session.time > end:
            raise SessionError(f"the robot does not get to ({x:g}, {y:g}) m, {place(session)} m")
        turn = math.remainder(math.atan2(away[1], away[0]) - heading(session), math.tau)
        ahead = speed if abs(turn) < _AWAY else 0.0
        walk(session, _CHECK, (ahead, 0.0, _turn_rate(turn)))
        away = _to(session, x, y)


def face(session: Session, yaw: float) -> None:
    """Turn to a heading in world [rad], by sight.

    Raises:
        SessionError: it takes too long.
    """
    end = session.time + 20.0
    while abs(turn := math.remainder(yaw - heading(session), math.tau)) > _ALIGNED:
        if session.time > end:
            raise SessionError(f"the robot does not get to a heading of {yaw:g} rad")
        walk(session, _CHECK, (0.0, 0.0, _turn_rate(turn)))


def _to(session: Session, x: float, y: float) -> Array:
    return np.array((x, y)) - place(session)[:2]


def _turn_rate(turn: float) -> float:
    return min(_TURN_RATE, max(-_TURN_RATE, _TURN_GAIN * turn))


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
    way = CLEAR - course.along(place(session))
    return go_to(session, course, CLEAR, speed, 5.0 + 3.0 * way / speed)


def walk_down(session: Session, course: Course, speed: float) -> bool:
    """Walk backwards at a speed [m/s] to the flat before the slope; return whether it got there."""
    before = course.along(np.array([course.approach - Course.approach - 0.1, 0.0, 0.0]))
    way = course.along(place(session)) - before
    return go_to(session, course, before, -speed, 5.0 + 3.0 * way / speed)
