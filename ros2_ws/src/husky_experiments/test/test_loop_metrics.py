"""The loop and its judgement, on walks in closed form."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_experiments.catalogue.loop import Stadium
from husky_experiments.metrics import loop
from husky_experiments.recordings.tables import Base

COURSE = Stadium(50.0, 1.3)


class Walk:
    """A recording of a walk along the loop; `map` is turned and shifted, odometry drifts too."""

    def __init__(self, drift):
        self.time = np.linspace(0.0, 100.0, 5001)
        way = np.array([COURSE.at(0.5 * t) for t in self.time])
        sway = 0.02 * np.sin(2.0 * math.pi * 2.5 * self.time)
        position = np.column_stack([way[:, 0], way[:, 1] + sway, np.full(len(way), 0.55)])
        heading = np.zeros(len(way))
        self.base = self.told(position, heading)
        self.in_map = self.told(Rotation.from_euler("z", 0.3).apply(position) + 7.0, heading + 0.3)
        shift = np.outer(self.time / self.time[-1], drift)
        self.estimate = self.told(position + shift, heading + self.time / self.time[-1] * 0.02)

    def told(self, position, heading):
        unknown = np.zeros(position.shape)
        turn = Rotation.from_euler("z", heading[:, None]).as_quat()
        return Base(self.time, position, turn, unknown, unknown)

    def columns(self, _):
        nanoseconds = np.round(1e9 * self.time).astype(np.int64)
        return self.time, {
            "header.stamp.sec": nanoseconds // 10**9,
            "header.stamp.nanosec": nanoseconds % 10**9,
            "pose.pose.position": self.in_map.position,
            "pose.pose.orientation": self.in_map.orientation,
        }


def test_the_course_is_closed_and_as_long_as_it_says():
    points = np.array([COURSE.at(d) for d in np.linspace(0.0, COURSE.length, 20001)])
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert steps.sum() == pytest.approx(50.0, abs=1e-4) and steps.max() < 0.0026
    np.testing.assert_allclose(points[-1], (0.0, 0.0), atol=1e-9)
    # A stadium: a rectangle between two half circles.
    x, y = points.T
    area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    assert area == pytest.approx(2.6 * COURSE.straight + math.pi * 1.3**2, rel=1e-5)
    assert COURSE.at(50.4) == pytest.approx((0.4, 0.0))


def test_errors_are_those_since_the_start():
    walk = Walk((0.3, 0.0, -0.4))
    legs = loop.track(walk, loop.LEGS, 0.0, 100.0)
    assert legs.error[-1] == pytest.approx(0.5)
    assert legs.error.max() == pytest.approx(0.5)
    found = loop.summary("odom", legs)
    assert found["odom_heading_error_deg"] == pytest.approx(math.degrees(0.02))
    # Another origin and heading of the frame are no error.
    assert loop.track(walk, loop.MAP, 0.0, 100.0).error.max() < 1e-9


def test_the_way_is_that_without_the_sway():
    assert loop.track(Walk(np.zeros(3)), loop.LEGS, 0.0, 100.0).distance == pytest.approx(
        50.0, rel=0.01
    )
