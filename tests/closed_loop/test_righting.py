"""Husky Carbon rights itself in one process: from sides and back, and wherever it has fallen."""

import math

import mujoco
import numpy as np
import pytest
from in_process import InProcessRobot, stand_up

from husky_description.robot import load_robot
from husky_sim.world import WorldOptions

ROBOT = load_robot()
LONGEST = 60.0
"""Most that all rounds take [s]."""
OVERLAP = -0.001
"""Distance of two geoms below which a leg is within another part from the start [m]."""


def let_fall(options, orientation, height, joints):
    """Return a robot at rest after a fall without torque, drives enabled.

    Args:
        options: of the world.
        orientation: base in world, quaternion (w, x, y, z).
        height: of the base over the ground at first [m].
        joints: (12,) rad at first, or a generator of random ones within their ranges.
    """
    robot = InProcessRobot(options)
    model, data = robot.world.model, robot.world.data
    data.qpos[:7] = 0.0, 0.0, 3.0, *orientation
    if isinstance(joints, np.random.Generator):
        data.qpos[7:] = joints.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
        mujoco.mj_forward(model, data)
        while (data.contact.dist < OVERLAP).any():  # legs that no robot can have so
            data.qpos[7:] = joints.uniform(ROBOT.joint_lower, ROBOT.joint_upper)
            mujoco.mj_forward(model, data)
    else:
        data.qpos[7:] = joints
    data.qpos[2] = height
    mujoco.mj_forward(model, data)
    body = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 0]
    lowest = min(data.geom_xpos[g][2] - model.geom_rbound[g] for g in body)
    data.qpos[2] += max(0.0, -lowest)
    mujoco.mj_forward(model, data)
    robot.world.servos.update_state(robot.world.joint_position)
    robot.run(2.5)
    robot.enable()
    return robot


def at_roll(degrees):
    half = math.radians(degrees) / 2.0
    orientation = (math.cos(half), math.sin(half), 0.0, 0.0)
    return let_fall(WorldOptions(), orientation, 0.2, ROBOT.sit_joint_position)


def at_random(seed, body="robot"):
    generator = np.random.default_rng(seed)
    orientation = generator.normal(size=4)
    orientation /= np.linalg.norm(orientation)
    height = generator.uniform(0.4, 0.6)
    return let_fall(WorldOptions(body=body, seed=seed), orientation, height, generator)


def righted(robot):
    """Return whether it is at rest on its perch in the end."""
    controller = robot.controller
    accepted, message = controller.request_mode("righting")
    while message == "righting refused: the body is still moving":  # legs still swing
        robot.run(0.5)
        accepted, message = controller.request_mode("righting")
    assert accepted, message
    for _ in range(round(LONGEST / 0.1)):
        robot.run(0.1)
        if controller.mode.value != "righting":
            break
    return controller.mode.value == "sit" and robot.tilt < 6.0


@pytest.fixture(scope="module")
def on_its_side():
    return at_roll(90.0)


@pytest.mark.in_a_copy
@pytest.mark.parametrize(
    "degrees", [90.0, *(pytest.param(roll, marks=pytest.mark.slow) for roll in (-90.0, 178.0))]
)
def test_from_its_side_and_its_back_it_comes_onto_its_perch_and_stands_up(on_its_side, degrees):
    robot = on_its_side if degrees == 90.0 else at_roll(degrees)
    assert robot.tilt > math.degrees(robot.controller.parameters["safety.max_tilt"])
    accepted, message = robot.controller.request_mode("stand_up")
    assert not accepted and message == "stand_up refused: the body is tilted too far"
    assert righted(robot), robot.controller.reason
    assert robot.refusal == "" and robot.controller.counters.faults == 0
    stand_up(robot)
    assert robot.tilt < 6.0


@pytest.mark.in_a_copy
@pytest.mark.parametrize(
    "stop", ["damping", pytest.param("emergency_stop", marks=pytest.mark.slow)]
)
def test_a_stop_is_obeyed_at_once(on_its_side, stop):
    robot = on_its_side
    assert robot.controller.request_mode("righting")[0]
    robot.run(3.0)
    assert robot.controller.request_mode(stop) == (True, stop)
    robot.run(1.5)
    assert np.abs(robot.world.base_angular_velocity).max() < 0.1


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_from_wherever_it_has_fallen_nine_times_of_ten():
    """Orientation and joints at random, dropped from 0.4 to 0.6 m without torque.

    With the propulsion unit the trajectory is the same: mass and shape that collides are.
    """
    stood = 0
    for seed in range(20):
        robot = at_random(seed)
        if righted(robot):
            try:
                stand_up(robot)
            except RuntimeError:
                continue
            stood += robot.tilt < 6.0
    assert stood >= 18
