"""A climb is led by the robot's own estimate; the truth only tells whether it has fallen."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from husky_experiments.climb_scripts import (
    climb_onto,
    has_fallen,
    place,
    true_place,
    turn_on_top,
    walk_down,
)
from husky_experiments.incline_course import CLEAR, Course
from husky_experiments.session import SessionError
from husky_sim.ramp import Ramp

COURSE = Course(45.0)
RAMP = Ramp(COURSE.slope, COURSE.approach, COURSE.blend, COURSE.length)
SPEED = 0.25


class DriftingRobot:
    """Stands where it is led to; its estimate counts a tenth too much."""

    def __init__(self) -> None:
        self.time = self.velocity = self.way = self.yaw = self.yaw_rate = 0.0
        self.truth = SimpleNamespace(pose=SimpleNamespace(pose=SimpleNamespace()))
        self.state = SimpleNamespace(mode="wair")
        self.advance(0.0)

    def set_velocity(self, vx: float, vy: float = 0.0, yaw_rate: float = 0.0) -> None:
        self.velocity, self.yaw_rate = vx, yaw_rate

    def advance(self, duration: float) -> None:
        self.time += duration
        self.yaw += self.yaw_rate * duration
        self.way += self.velocity * math.cos(self.yaw) * duration
        self.state.position = self._on_course(1.1 * self.way)
        x, y, z = self._on_course(self.way)
        self.truth.pose.pose.position = SimpleNamespace(x=x, y=y, z=z)

    @staticmethod
    def _on_course(way: float) -> list[float]:
        """Half a metre over the ground, so far along the course."""
        x, z, angle = RAMP.at(way)
        return [x - 0.5 * math.sin(angle), 0.0, z + 0.5 * math.cos(angle)]


def test_the_estimate_leads_up_and_down():
    robot = DriftingRobot()
    assert climb_onto(robot, COURSE, SPEED)
    # One look later than it is there, at most: 0.2 s.
    assert 0.0 <= COURSE.along(place(robot)) - CLEAR <= 1.1 * 0.2 * SPEED
    assert 0.1 < CLEAR - COURSE.along(true_place(robot)) < 0.4, "the truth is elsewhere"
    assert walk_down(robot, COURSE, -SPEED)
    before = COURSE.along(np.array((-0.1, 0.0, 0.0)))
    assert 0.0 <= before - COURSE.along(place(robot)) <= 1.1 * 0.2 * SPEED


def test_it_turns_on_the_top_and_comes_down_nose_ahead():
    robot = DriftingRobot()
    assert climb_onto(robot, COURSE, SPEED)
    highest = []
    advance = robot.advance
    robot.advance = lambda duration: (advance(duration), highest.append(place(robot)[2]))
    assert turn_on_top(robot, COURSE, SPEED)
    assert max(highest) == pytest.approx(COURSE.crest_middle[2] + COURSE.blend + 0.5)
    assert robot.yaw == pytest.approx(math.pi, abs=0.05)
    assert 0.0 <= COURSE.length - CLEAR - COURSE.along(place(robot)) <= 1.1 * 0.2 * SPEED
    assert walk_down(robot, COURSE, SPEED)
    assert place(robot)[0] < 0.0


def test_the_truth_tells_a_fall():
    robot = DriftingRobot()
    assert not has_fallen(robot, COURSE)
    low = COURSE.foot + COURSE.uphill + 0.1 * COURSE.normal
    robot.truth.pose.pose.position = SimpleNamespace(x=low[0], y=low[1], z=low[2])
    assert has_fallen(robot, COURSE)


def test_without_a_report_there_is_no_place():
    with pytest.raises(SessionError, match="where it is"):
        place(SimpleNamespace(state=None))
