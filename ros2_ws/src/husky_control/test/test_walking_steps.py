"""What a foot in the air does when the ground expected at its foothold changes."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from husky_control.gait.ground import Ground
from husky_control.gait.state import BodyInGround, FeetState
from husky_control.gait.table import GAITS
from husky_control.gait.walking import Walking
from husky_control.incline.statics import plane_from_world
from husky_control.parameters import Parameters
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot()
DT = 0.002
SPEED = 0.25
LEG = 1
"""The front right leg, of the pair that swings second."""
STRAIGHT = Ground(bend=np.zeros((4, 2)))


def swing_of_a_step(change=None, at=0.78):
    """Joint angles (ticks, 3) commanded to a leg in its second swing, the body at a constant speed.

    `change(walking, velocity)` is made once, `at` that progress of the swing.
    """
    kinematics = Kinematics(ROBOT)
    feet = kinematics.foot_positions(ROBOT.stand_joint_position)
    walking = Walking(ROBOT, Parameters(), GAITS["climb"])
    walking.stand_on(STRAIGHT)
    position = np.array([0.0, 0.0, -feet[:, 2].mean()])
    velocity = np.array([SPEED, 0.0, 0.0])
    walking.begin(np.eye(3), position, feet, GAITS["climb"])
    walking.start_stepping(GAITS["climb"], position)
    walking.reference.command[0] = SPEED
    path, swings = [], 0
    for _ in range(400):
        clock = walking.clock
        contact = ~clock.swinging | (clock.swing_progress > 0.97)
        walking.tick(
            BodyInGround(np.eye(3), np.zeros(3), position, velocity),
            FeetState(feet, position + feet, contact, np.zeros((4, 3))),
            lift=0.0,
            dt=DT,
        )
        feet = kinematics.foot_positions(walking.joint_position)
        position = position + velocity * DT
        swings += int(clock.liftoff[LEG])
        if swings == 2 and clock.swinging[LEG]:
            path.append(walking.joint_position[3 * LEG : 3 * LEG + 3].copy())
            if change is not None and clock.swing_progress[LEG] > at:
                change(walking, velocity)
                change = None
        elif path:
            break
    assert len(path) > 70 and change is None
    return np.array(path)


def jerk(path):
    """Greatest change of a joint's commanded speed from one tick to the next [rad/s]."""
    return float(np.abs(np.diff(path[5:], n=2, axis=0)).max() / DT)


def bends(walking, velocity):
    walking.stand_on(replace(walking.ground, bend=np.tile([0.5, 0.0], (4, 1))))


def bends_and_slower(walking, velocity):
    bends(walking, velocity)
    velocity[0] -= 0.15


@pytest.mark.parametrize(
    ("change", "pitch", "most"),
    [
        (bends, 0.0, 3.0),
        (bends, 0.5, 3.0),
        (bends_and_slower, 0.0, 3.1),  # a level body's foothold moves at once
        (bends_and_slower, 0.5, 3.0),
    ],
)
@pytest.mark.parametrize("at", [0.55, 0.78, 0.9])
def test_a_leg_in_the_air_does_not_jerk(change, pitch, most, at):
    """A jerk takes torque, and torque is what a touchdown is told by."""

    def disturbed(walking, velocity):
        walking.stand_on(replace(walking.ground, pitch=pitch))
        change(walking, velocity)

    undisturbed = jerk(swing_of_a_step())
    assert undisturbed < 1.0  # rad/s
    assert jerk(swing_of_a_step(disturbed, at)) < most * undisturbed


@pytest.mark.parametrize(
    ("at", "pitch", "least", "most"),
    [
        (0.3, 0.0, 0.06, 0.2),
        (0.78, 0.0, 0.06, 0.2),
        (0.3, 0.5, 0.06, 0.2),
        (0.78, 0.5, 0.005, 0.015),
    ],
)
def test_a_pushed_robot_moves_its_foothold_if_it_leans_as_far_as_the_time_left_allows(
    at, pitch, least, most
):
    held = []

    def pushed(walking, velocity):
        velocity[0] = -0.4
        walking.stand_on(replace(walking.ground, pitch=pitch))
        held.append((walking, float(walking.foothold[LEG, 0])))

    swing_of_a_step(pushed, at)
    ((walking, before),) = held
    assert least < before - walking.foothold[LEG, 0] < most


@pytest.mark.parametrize(("curvature", "drop"), [(-1.0, 0.5), (0.0, 0.0), (1.0, 0.0)])
def test_a_foothold_lies_on_ground_that_falls_away(curvature, drop):
    """By half the curvature times way^2; ground that rises may come early."""
    held = []

    def curves(walking, velocity):
        curve = np.array([[curvature, 0.0], [0.0, 0.0]])
        walking.stand_on(replace(walking.ground, curve=curve))
        held.append(walking)

    swing_of_a_step(curves, at=0.0)
    paths = held[0]._steps.paths
    way_x, _, rise = (paths.foothold[LEG] - paths.start[LEG]).tolist()
    assert way_x > 0.05
    assert rise == pytest.approx(-drop * way_x**2, abs=1e-4)


def test_ground_that_turns_and_turns_back_changes_nothing():
    """On an incline of 30 deg the body is where it was, seen in the new frame; and back again."""
    kinematics = Kinematics(ROBOT)
    feet = kinematics.foot_positions(ROBOT.stand_joint_position)
    walking = Walking(ROBOT, Parameters(), GAITS["trot"])
    walking.begin(np.eye(3), np.array([0.4, -0.2, 0.5]), feet, GAITS["trot"])
    before, yaw = walking.body_position.copy(), walking.reference.yaw
    plane = plane_from_world(np.array([-0.5, 0.0, 0.75**0.5]))
    walking.stand_on(Ground(plane=plane))
    np.testing.assert_allclose(walking.body_position, plane @ before, atol=1e-12)
    np.testing.assert_allclose(walking.reference.position, walking.body_position[:2], atol=1e-12)
    assert walking.ground.gravity == pytest.approx(9.80665 * 0.75**0.5)
    walking.stand_on(Ground())
    np.testing.assert_allclose(walking.body_position, before, atol=1e-12)
    assert walking.reference.yaw == pytest.approx(yaw, abs=1e-12)


def test_ground_that_turns_keeps_its_height_under_the_robot_though_the_reference_strays():
    """Feet hold the body back for metres; then the ground turns about a place far away."""
    kinematics = Kinematics(ROBOT)
    feet = kinematics.foot_positions(ROBOT.stand_joint_position)
    walking = Walking(ROBOT, Parameters(), GAITS["climb"])
    estimated = np.array([4.0, 0.0, -feet[:, 2].mean()])
    walking.begin(np.eye(3), estimated, feet, GAITS["climb"])
    estimated[0] += 0.3
    walking.tick(
        BodyInGround(np.eye(3), np.zeros(3), estimated, np.zeros(3)),
        FeetState(feet, estimated + feet, np.ones(4, dtype=bool), np.zeros((4, 3))),
        lift=0.0,
        dt=DT,
    )
    feet_before = walking.body_position - walking._feet.anchor
    plane = plane_from_world(np.array([-0.5, 0.0, 0.75**0.5]))
    walking.stand_on(Ground(plane=plane))
    np.testing.assert_allclose(walking.body_position, plane @ estimated, atol=1e-3)
    feet_after = walking.body_position - walking._feet.anchor
    np.testing.assert_allclose(feet_after, feet_before @ plane.T, atol=1e-12)


def test_the_ground_under_a_walk_is_a_value():
    ground = Ground(plane=np.eye(3), bend=np.zeros((4, 2)))
    with pytest.raises(FrozenInstanceError):
        ground.pitch = 0.1
    for array in (ground.plane, ground.bend, ground.curve):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0
