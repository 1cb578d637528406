"""The controller climbs a ramp in one process: from the flat, stop, down again; fans lost."""

import math

import numpy as np
import pytest
from climbing_robot import ClimbingRobot

from husky_control.planning.collocation.planner import Planner
from husky_control.planning.collocation.request import machine_of
from husky_description.gravity import GRAVITY

SPEED = 0.25
"""Commanded in these tests [m/s]."""
HIGH = 0.02
"""Above the ground, where a foot cannot have come down [m]."""


def forces_on(robot, duration, speed):
    """Walk on; tangential over normal force of each loaded foot sample."""
    ratios = []
    for _ in range(round(duration / 0.01)):
        robot.run(0.01, (speed, 0.0, 0.0))
        force = robot.world.foot_forces()
        normal = force @ robot.normal
        along = np.linalg.norm(force - normal[:, None] * robot.normal, axis=1)
        ratios += (along[normal > 5.0] / normal[normal > 5.0]).tolist()
    return np.array(ratios)


@pytest.fixture(scope="module")
def on_slope():
    """A robot on a slope of 40 degrees, all feet on it, walking."""
    robot = ClimbingRobot(40.0)
    robot.start()
    robot.run(8.0, (SPEED, 0.0, 0.0))
    assert robot.controller.mode.value == "wair", robot.controller.reason
    return robot


def test_it_climbs_at_its_speed_inside_of_the_cone(on_slope):
    robot = on_slope
    before = robot.world.base_position.copy()
    ratios = forces_on(robot, 2.0, SPEED)
    speed = float((robot.world.base_position - before) @ robot.uphill) / 2.0
    assert speed == pytest.approx(SPEED, rel=0.15)
    assert (ratios < 0.98 * 0.7).mean() >= 0.95
    assert math.degrees(robot.lean) < 5.0
    # The slope was never told: it is felt.
    assert math.degrees(robot.controller.climbing.slope) == pytest.approx(40.0, abs=1.0)
    weight = robot.controller.robot.mass * GRAVITY
    ratio = robot.controller.parameters["wair.load_slope"]
    held = weight * math.sin(robot.slope - math.atan(ratio))
    assert np.linalg.norm(robot.thrust) == pytest.approx(held, rel=0.1)
    assert robot.refusal == ""


def test_it_stands_on_the_slope_and_does_not_stand_as_on_the_flat(on_slope):
    robot = on_slope
    robot.run(2.0, (0.0, 0.0, 0.0))
    before = robot.world.base_position.copy()
    robot.run(1.0, (0.0, 0.0, 0.0))
    assert np.linalg.norm(robot.world.base_position - before) < 0.005
    assert not robot.controller.present.clock.swinging.any()
    accepted, message = robot.controller.request_mode("stand")
    assert not accepted and "on an incline of 40 deg" in message
    assert robot.controller.mode.value == "wair"


def test_with_a_fan_lost_it_stands_and_goes_down_only(on_slope):
    robot = on_slope
    robot.limit = 38.0
    robot.run(0.1, (0.0, 0.0, 0.0))
    accepted, message = robot.controller.set_velocity_command(SPEED, 0.0, 0.0)
    assert not accepted and "fan lost" in message
    start = robot.world.base_position.copy()
    robot.run(2.0, (-SPEED, 0.0, 0.0))
    assert robot.controller.mode.value == "wair", robot.controller.reason
    assert (robot.world.base_position - start) @ robot.uphill < -0.6 * 2.0 * SPEED
    assert math.degrees(robot.lean) < 5.0
    robot.limit = math.inf


def test_fans_lost_on_the_slope_end_in_a_crouch_not_in_a_tumble(on_slope):
    robot = on_slope
    robot.run(1.0, (SPEED, 0.0, 0.0))
    robot.fans = False
    start, most, reasons = robot.world.base_position.copy(), 0.0, []
    for _ in range(60):
        robot.run(0.05, (SPEED, 0.0, 0.0))
        reasons.append(robot.controller.reason)
        most = max(most, robot.lean)
    assert "fans are lost" in reasons[0]
    # It slides down to where the ground is flat, on its feet, never on its side or back. Coming
    # down there may stop a drive.
    assert robot.controller.mode.value in ("sit", "damping"), robot.controller.reason
    assert math.degrees(most) < 60.0
    assert robot.world.base_position[0] < start[0] - 0.5
    assert np.linalg.norm(robot.world.base_velocity) < 0.2


@pytest.mark.parametrize("command", [(math.nan, 0.0, 0.0), (2.0, 0.0, 0.0), (0.1, 0.0, 9.0)])
def test_bad_commands_are_refused_with_the_range(on_slope, command):
    accepted, message = on_slope.controller.set_velocity_command(*command)
    assert not accepted and "must be within +-" in message


def test_up_on_a_plateau_it_walks_on_as_on_the_flat():
    """Level ground is where the feet are, not at the height where the robot was switched on."""
    robot = ClimbingRobot(20.0, length=0.5)
    robot.start()
    robot.run(8.5, (SPEED, 0.0, 0.0))
    robot.run(2.0, (0.0, 0.0, 0.0))
    assert robot.world.foot_positions()[:, 2].min() > 0.25, "it is not up yet"
    assert robot.controller.request_mode("stand")[0]
    robot.run(0.5, (0.0, 0.0, 0.0))
    assert robot.controller.mode.value == "stand", robot.controller.reason
    assert robot.controller.request_mode("walk")[0]
    height, estimate = robot.world.base_position[2], robot.controller.body.estimator.position[2]
    for _ in range(100):
        robot.run(0.02, (0.0, 0.0, 0.6))
        assert robot.controller.mode.value == "walk", robot.controller.reason
        assert robot.world.base_position[2] == pytest.approx(height, abs=0.03)
        assert robot.controller.body.estimator.position[2] == pytest.approx(estimate, abs=0.03)


@pytest.mark.slow
def test_with_a_fan_lost_it_walks_down_around_the_foot_of_the_slope_to_the_flat():
    """With plans, as the graph has them, on the way that asks most of the contact detection."""
    robot = ClimbingRobot(45.0, seed=3, blend=1.5)
    robot.planner = Planner(machine_of(robot.controller.robot))
    robot.start()
    robot.run(9.0, (SPEED, 0.0, 0.0))
    assert math.degrees(robot.controller.climbing.slope) == pytest.approx(45.0, abs=1.0)
    assert robot.controller.climbing.reference is not None, "no plan is followed"
    robot.limit = 38.0
    felt = high = 0
    for _ in range(6000):
        if robot.world.base_position[0] < 0.0:
            break
        before = robot.controller.body.contacts.contact.copy()
        robot.run(0.002, (-SPEED, 0.0, 0.0))
        in_air = robot.clearance() > HIGH
        high += int(in_air.sum())
        felt += int((in_air & robot.controller.body.contacts.contact & ~before).sum())
    assert robot.controller.mode.value == "wair", robot.controller.reason
    assert robot.world.base_position[0] < 0.0
    # A leg that jerks feels a ground that is not there.
    assert high > 2000 and felt == 0


@pytest.mark.slow
def test_fixed_fans_carry_it_up_45_degrees():
    """The body leans so far ahead that the thrust along its own axis holds it."""
    robot = ClimbingRobot(45.0, blend=3.0, mounting="fixed")
    robot.controller.parameters.set("wair.load_slope", 0.22)
    robot.start()
    robot.run(14.0, (SPEED, 0.0, 0.0))
    assert robot.controller.mode.value == "wair", robot.controller.reason
    assert math.degrees(robot.controller.climbing.slope) == pytest.approx(45.0, abs=2.0)
    start = robot.world.base_position.copy()
    ratios = forces_on(robot, 3.0, SPEED)
    assert (robot.world.base_position - start) @ robot.uphill > 0.8 * 3.0 * SPEED
    assert (ratios < 0.98 * 0.7).mean() >= 0.95
    assert math.degrees(robot.lean) > 50.0
