"""How a robot came down after a fault, by a recording made up of known motions."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_experiments.metrics.air_faults import coming_down
from husky_experiments.recordings.tables import Base

ROBOT = load_robot("beta")
PERCH = -float(ROBOT.perch.position[2] - ROBOT.perch.size[2] / 2.0)
STEP = 0.01


def falling(sink, rest_tilt=0.0, thrust=0.0, spin=0.0):
    """Sink from 1 m after 2 s of hover, ahead with 0.2 m/s, and lie for a second."""
    time = np.arange(0.0, 2.0 + 1.0 / sink + 1.0, STEP)
    above = np.clip(1.0 - sink * (time - 2.0), 0.0, 1.0)
    moves = (above > 0.0) & (time >= 2.0)
    tilt = np.where(above > 0.0, 0.0, rest_tilt)
    # About the origin under the perch's middle: what lies tilted is lower at an edge.
    position = np.column_stack((0.2 * time, 0.0 * time, PERCH + above))
    velocity = np.column_stack((0.2 * moves, 0.0 * time, -sink * moves))
    turning = np.column_stack((0.0 * time, 0.0 * time, spin * moves))
    base = Base(
        time, position, Rotation.from_euler("x", tilt[:, None]).as_quat(), velocity, turning
    )
    fans = SimpleNamespace(thrust=np.full((len(time), 4), thrust / 4.0))
    return SimpleNamespace(base=base, fans=fans)


def test_numbers_of_a_known_descent():
    end = coming_down(falling(0.5, math.radians(4.0), spin=0.3), ROBOT, 2.0)
    assert end.time == pytest.approx(2.0, abs=0.02)
    assert (end.sink, end.slide, end.spin) == pytest.approx((0.5, 0.2, 0.3))
    assert end.rest_tilt == pytest.approx(math.radians(4.0)) and end.safe
    assert end.as_metrics()["rest_tilt_deg"] == pytest.approx(4.0)


@pytest.mark.parametrize(
    "recording",
    [falling(1.5), falling(0.5, rest_tilt=0.6), falling(0.5, thrust=4.0)],
    ids=["too fast", "on an arm", "propellers turn"],
)
def test_what_is_not_safe(recording):
    assert not coming_down(recording, ROBOT, 2.0).safe


def test_what_does_not_come_down_is_not_safe():
    recording = falling(0.5)
    recording.base.position[:, 2] += 1.0
    end = coming_down(recording, ROBOT, 2.0)
    assert math.isnan(end.sink) and not end.safe
