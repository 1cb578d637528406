"""Another robot is another file: one with six fans and longer legs stands, walks and flies."""

import math

import numpy as np
import pytest
from flying import FlyingRobot
from made_up_robot import FANS, write

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_pu.autopilot.fan_watch import name_lost

pytestmark = pytest.mark.in_a_copy


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    return load_robot(write(tmp_path_factory.mktemp("robot") / "made_up.yaml"))


@pytest.fixture(scope="module")
def standing(numbers):
    robot = FlyingRobot(robot=numbers)
    robot.stand()
    return robot


def test_it_stands_up_walks_and_sits_down(numbers, standing):
    robot = standing
    height = robot.world.base_position[2] - numbers.foot_radius
    assert height == pytest.approx(numbers.stand_height, abs=0.02)
    assert height > load_robot().stand_height + 0.05
    assert robot.controller.request_gait("trot")[0]
    assert robot.controller.request_mode("walk")[0]
    robot.run(4.0, (0.3, 0.0, 0.0))
    assert robot.controller.mode.value == "walk", robot.controller.reason
    assert robot.world.base_position[0] > 0.8
    robot.run(1.0, (0.0, 0.0, 0.0))
    assert robot.controller.request_mode("stand")[0] or robot.controller.mode.value == "stand"
    robot.run(1.5)
    assert robot.controller.request_mode("sit")[0]
    robot.run(4.0)
    assert robot.controller.mode.value == "sit" and robot.controller.present.settled
    assert robot.controller.counters.faults == 0


@pytest.fixture(scope="module")
def flying(standing):
    robot = standing
    robot.arm()
    accepted, message = robot.controller.request_mode("fly")
    assert accepted, message
    robot.run(5.0)
    assert robot.controller.mode.value == "fly", robot.controller.reason
    return robot


def test_it_hovers_on_six_fans(flying):
    thrust, place = [], flying.world.base_position.copy()
    for _ in range(1000):
        flying.tick()
        thrust.append(flying.world.fans.unit.thrust.copy())
    assert np.shape(thrust) == (1000, len(FANS))
    assert np.mean(thrust, axis=0).min() > 5.0
    weight = flying.world.robot.mass * GRAVITY
    assert np.sum(thrust, axis=1).mean() == pytest.approx(weight, rel=0.02)
    assert np.linalg.norm(flying.world.base_position - place) < 0.1
    assert math.degrees(flying.tilt) < 3.0


# Of a pair left and right, and of those in the middle, which the other robots do not have.
@pytest.mark.parametrize(
    "fan",
    [pytest.param(i, marks=[pytest.mark.slow] * (i not in (0, 3))) for i in range(len(FANS))],
    ids=list(FANS),
)
def test_it_hovers_on_the_five_that_are_left(flying, fan):
    flying.world.fans.unit.fail_fan(fan)
    height, logic = flying.world.base_position[2], flying.autopilot.vehicle.logic
    flying.run(3.0)
    assert name_lost(flying.autopilot.mixer.names, logic.fans_ok) == list(FANS)[fan]
    assert flying.world.base_position[2] > height - 0.3
    assert math.degrees(flying.tilt) < 10.0
