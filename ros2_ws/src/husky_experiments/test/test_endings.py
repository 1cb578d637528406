"""How a robot ended after a fault, by a recording made up of known motions."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture
from husky_experiments.metrics.endings import ending
from husky_experiments.recordings.tables import Base

ROBOT = load_robot("beta")
PERCH = -float(ROBOT.perch.position[2] - ROBOT.perch.size[2] / 2.0)
ARMS = flight_posture(ROBOT)
STEP = 0.01


def falling(sink, rest_tilt=0.0, thrust=0.0, spin=0.0, joints=ARMS, on=60.0):
    """Sink from 1 m after 2 s of hover, ahead with 0.2 m/s, and lie for a second.

    Its propellers turn at 500 rad/s, carry until 2.1 s, and then leave a thrust [N].
    """
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
    total = np.where(time < 2.1, on, thrust)
    fans = SimpleNamespace(
        time=time,
        thrust=np.tile(total[:, None] / 4.0, 4),
        speed=np.full((len(time), 4), 500.0 if on or thrust else 0.0),
    )
    told = SimpleNamespace(time=time, position=np.tile(joints, (len(time), 1)))
    return SimpleNamespace(base=base, fans=fans, joints=told)


def test_numbers_of_a_known_descent():
    end = ending(falling(0.5, math.radians(4.0), spin=0.3), ROBOT, 2.0)
    assert end.time == pytest.approx(2.0, abs=0.02)
    assert (end.sink, end.slide, end.spin) == pytest.approx((0.5, 0.2, 0.3))
    assert end.rest_tilt == pytest.approx(math.radians(4.0))
    assert end.flew and not end.stood and end.safe
    assert end.as_metrics()["rest_tilt_deg"] == pytest.approx(4.0)


def test_blades_are_as_high_as_the_arms_over_the_perch():
    """Level discs, until the body lies tilted: the lower side's rotor is some 0.3 m out."""
    level = ending(falling(0.5), ROBOT, 2.0).blades
    assert 0.5 * PERCH < level < 2.0 * PERCH
    tilted = ending(falling(0.5, math.radians(8.0)), ROBOT, 2.0)
    assert tilted.blades == pytest.approx(level - 0.45 * math.sin(math.radians(8.0)), abs=0.04)


def test_blades_that_turn_below_the_ground_are_not_safe():
    end = ending(falling(0.5, 0.1, joints=ROBOT.stand_joint_position), ROBOT, 2.0)
    assert end.blades < 0.0 and not end.safe


def test_who_stood_may_lie_on_a_leg_that_has_failed_but_not_on_its_side():
    ends = [ending(falling(0.5, tilt, on=0.0), ROBOT, 2.0) for tilt in (0.6, 0.9)]
    assert all(end.stood and math.isnan(end.blades) for end in ends)
    assert [end.safe for end in ends] == [True, False]


@pytest.mark.parametrize(
    "recording",
    [falling(1.5), falling(0.5, rest_tilt=0.6), falling(0.5, thrust=4.0)],
    ids=["too fast", "on an arm", "propellers turn"],
)
def test_what_is_not_safe(recording):
    assert not ending(recording, ROBOT, 2.0).safe


def test_what_does_not_come_to_rest_is_not_safe():
    recording = falling(0.5)
    recording.base.velocity[-20:, 0] = 0.1
    assert not ending(recording, ROBOT, 2.0).safe


def test_what_does_not_come_down_is_not_safe():
    recording = falling(0.5)
    recording.base.position[:, 2] += 1.0
    end = ending(recording, ROBOT, 2.0)
    assert math.isnan(end.time) and not end.safe
