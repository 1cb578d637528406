"""Walk a loop over flat and rough ground, led by its own pose in `map`, and come back."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

from husky_bringup.system import ParameterValue
from husky_control.rotation import wrap_angle
from husky_experiments.metrics import loop, walking
from husky_experiments.run import Run
from husky_experiments.scripts import finish, stand_up
from husky_experiments.session import Session, SessionError
from husky_experiments.steering import heading_of
from husky_runtime import graph

_SPEED = 0.45
"""Of the walk [m/s]."""
_RADIUS = 1.3
"""Of the half circles at both ends of the loop [m]."""
_AHEAD = 0.6
"""Distance along the loop at which the robot aims [m]."""
_LOOK = 0.2
"""Between two looks at the pose [s]."""
_TURN_GAIN, _MOST_TURN = 1.5, 0.6
"""Yaw rate per error of heading [1/s], and its greatest [rad/s]."""
_SPARE = 1.4
"""The walk may take so many times what it takes at that speed."""
_LEAST_DISTANCE, _MOST_DISTANCE = 12.0, 200.0
"""Allowed lengths of the loop [m]: shorter ones have no straights to speak of."""
_WITH_T265, _BY_LEGS = 0.005, 0.02
"""Greatest error at the end, over the distance."""
_GROUND: dict[str, ParameterValue] = {
    "terrain": "rough",
    "terrain_height": 0.04,
    "terrain_size": 0.5,
    "terrain_lane": 1.2,
}
"""Flat along the way out, facets with ledges along the way back and in the bends."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare distance, body and seed."""
    parser.add_argument("--distance", type=_distance, default=50.0, help="length of the loop [m]")
    parser.add_argument(
        "--body",
        choices=("robot", "robot_with_unit"),
        default="robot_with_unit",
        help="the T265 is part of the propulsion unit; robot: legs alone",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the ground and sensor noise")


def _distance(text: str) -> float:
    """Return a length of the loop [m]."""
    value = float(text)
    if not _LEAST_DISTANCE <= value <= _MOST_DISTANCE:
        raise argparse.ArgumentTypeError(
            f"{text} m is not {_LEAST_DISTANCE:g} to {_MOST_DISTANCE:g} m"
        )
    return value


@dataclass(frozen=True)
class Stadium:
    """Two straights joined by half circles; it begins at the origin along +x and turns left.

    Attributes:
        length: of the whole loop [m].
        radius: of the half circles [m].
    """

    length: float
    radius: float

    @property
    def straight(self) -> float:
        """Length of one straight [m]."""
        return self.length / 2.0 - math.pi * self.radius

    def at(self, distance: float) -> tuple[float, float]:
        """Return the point at a distance along the loop [m]; beyond the end it goes on along x."""
        straight, radius = self.straight, self.radius
        half = self.length / 2.0
        if distance >= self.length:
            return distance - self.length, 0.0
        along = distance % half
        if along < straight:
            x, y = along, 0.0
        else:
            angle = (along - straight) / radius
            x, y = straight + radius * math.sin(angle), radius * (1.0 - math.cos(angle))
        # The second half is the first, turned by half a turn about the middle.
        return (x, y) if distance < half else (straight - x, 2.0 * radius - y)


def walk_loop(session: Session, course: Stadium, within: float) -> None:
    """Trot along a loop that begins where the robot stands, by its pose in `map`.

    Args:
        session: with a robot that stands.
        course: the loop.
        within: simulated time that it may take [s].

    Raises:
        SessionError: it is not back in time, or no pose is told.
    """
    end = session.time + within
    x0, y0, yaw0 = _pose(session)
    cosine, sine = math.cos(yaw0), math.sin(yaw0)
    progress = 0.0
    while True:
        x, y, yaw = _pose(session)
        x, y = x - x0, y - y0
        x, y = cosine * x + sine * y, cosine * y - sine * x
        progress = _nearest(course, progress, (x, y))
        if progress >= course.length:
            return
        if session.time > end:
            left = course.length - progress
            raise SessionError(f"it is not back within {within:.0f} s: {left:.1f} m to go")
        aim = course.at(progress + _AHEAD)
        error = wrap_angle(math.atan2(aim[1] - y, aim[0] - x) - (yaw - yaw0))
        turn = max(-_MOST_TURN, min(_MOST_TURN, _TURN_GAIN * error))
        session.set_velocity(_SPEED * max(0.0, math.cos(error)), 0.0, turn)
        session.advance(_LOOK)


def _nearest(course: Stadium, progress: float, place: tuple[float, float]) -> float:
    """Return the distance along the loop that is nearest to a place, at most `_AHEAD` further."""
    steps = 24
    ahead = (progress + _AHEAD * k / steps for k in range(steps + 1))
    return min(ahead, key=lambda distance: math.dist(course.at(distance), place))


def _pose(session: Session) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of the base in `map`."""
    if session.map_pose is None:
        raise SessionError("the localizer does not tell where the robot is")
    pose = session.map_pose.pose.pose
    q = pose.orientation
    return pose.position.x, pose.position.y, heading_of((q.x, q.y, q.z, q.w))


def run(run: Run) -> None:
    """No fall; back at the start, the robot knows where it is."""
    options = run.options
    course = Stadium(options.distance, _RADIUS)
    world = {
        **_GROUND,
        "terrain_length": course.straight + 4.0,
        "terrain_approach": course.straight + 2.5,
        "body": options.body,
        "camera": True,
        "seed": options.seed,
    }
    within = _SPARE * course.length / _SPEED
    with run.session({graph.PLANT: world}, expected=course.length / _SPEED + 12) as session:
        stand_up(session)
        session.set_gait("trot")
        session.set_velocity(0.0)
        start = session.time
        session.set_mode("walk")
        walk_loop(session, course, within)
        end = session.time
        falls = finish(session)
    recording, robot = run.recording(), run.robot()
    run.metrics |= walking.summary(recording, robot, start, end)
    tracks = {frame: loop.track(recording, frame, start, end) for frame in (loop.LEGS, loop.MAP)}
    for frame, told in tracks.items():
        run.metrics |= loop.summary(frame, told)
    run.metrics["loop_m"] = tracks[loop.MAP].distance
    run.require("falls", falls, upper=0)
    run.require("loop_m", lower=0.97 * options.distance)
    by_legs = options.body == "robot"
    run.require("map_end_error_share", upper=_BY_LEGS if by_legs else _WITH_T265)
    run.require("odom_end_error_share", upper=_BY_LEGS)
    if not options.no_figures:
        from husky_experiments.figures.loop import draw_loop

        draw_loop(tracks, run.output)
    run.illustrate()
