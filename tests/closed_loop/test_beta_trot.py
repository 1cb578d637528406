"""Husky-beta on its servos in one process: stands up, trots on hard and soft ground, sits."""

import numpy as np
import pytest
from servo_robot import ServoRobot

from husky_description.gravity import GRAVITY
from husky_description.ground import GROUND_PRESETS
from husky_description.robot import load_robot
from husky_sim.scene import WorldOptions

ROBOT = load_robot("beta")


@pytest.fixture(scope="module")
def standing():
    """On hard ground."""
    robot = ServoRobot(options=WorldOptions(seed=1))
    robot.stand()
    return robot


@pytest.fixture(scope="module")
def sunk():
    """On ground that gives way."""
    robot = ServoRobot(options=WorldOptions(seed=1, contact="thesis_results"))
    robot.stand()
    return robot


@pytest.mark.in_a_copy
def test_stands_where_it_shall_and_sits_down_again(standing):
    robot = standing
    wanted = ROBOT.stand_height + ROBOT.foot_radius
    assert robot.data.qpos[2] == pytest.approx(wanted, abs=0.01)
    assert robot.controller.body.estimator.position[2] == pytest.approx(wanted, abs=0.01)
    assert robot.controller.body.contacts.contact.all()
    # From the currents alone; torques of standing legs are known within their friction, here none.
    weight = ROBOT.mass * GRAVITY
    assert robot.controller.body.contacts.foot_force[:, 2].sum() == pytest.approx(weight, rel=0.2)
    # Standing takes a third of what the servos may give.
    assert np.abs(robot.measurements.joint_torque).max() < 0.35 * ROBOT.bus_servo.torque_limit
    assert robot.controller.request_mode("sit")[0]
    robot.run(4.0)
    assert robot.data.site("perch").xpos[2] < 0.002
    assert robot.controller.counters.faults == 0


@pytest.mark.in_a_copy
@pytest.mark.parametrize(
    ("mode", "ground", "speed", "aside", "strained"),
    [
        ("walk", "standing", 0.4, 0.1, 0.02),
        # `test_walking` has the same on soft ground with Carbon.
        pytest.param("walk", "thesis_model", 0.4, 0.1, 0.1, marks=pytest.mark.slow),
        # It does not feel where it goes, nor that its feet drag where they sink.
        ("position_trot", "sunk", 0.3, 0.2, 0.6),
    ],
)
def test_trots_at_its_speed_and_level(standing, sunk, mode, ground, speed, aside, strained):
    if ground == "thesis_model":
        robot = ServoRobot(options=WorldOptions(seed=1, contact=ground))
        robot.stand()
    else:
        robot = sunk if ground == "sunk" else standing
    accepted, message = robot.controller.request_mode(mode)
    assert accepted, message
    robot.run(1.5, (0.4, 0.0, 0.0))
    start, tilts = robot.data.qpos[:2].copy(), []
    for _ in range(30):
        robot.run(0.1, (0.4, 0.0, 0.0))
        tilts.append(robot.tilt)
    assert robot.controller.mode.value == mode, robot.controller.reason
    way = robot.data.qpos[:2] - start
    assert way[0] / 3.0 == pytest.approx(speed, rel=0.15)
    assert abs(way[1]) < aside
    assert max(tilts) < 4.0
    assert robot.time_at_limit.max() < strained  # more than twice what was measured
    robot.controller.request_mode("stand")
    robot.run(2.0)
    assert robot.controller.mode.value == "stand"
    assert robot.controller.counters.faults == 0


@pytest.mark.in_a_copy
def test_feet_that_trot_blindly_come_to_stand_where_the_posture_has_them(sunk):
    robot = sunk
    standing = robot.data.qpos[7:].copy()
    depth = ROBOT.foot_radius - np.array([robot.data.site(f).xpos[2] for f in ROBOT.foot_names])
    stiffness = GROUND_PRESETS["thesis_results"].stiffness
    assert depth.sum() == pytest.approx(ROBOT.mass * GRAVITY / stiffness, rel=0.05)
    for velocity, duration in (((0.1, 0.1, 0.2), 1.1), ((-0.2, 0.0, 0.0), 0.9)):
        assert robot.controller.request_mode("position_trot")[0]
        robot.run(duration, velocity)
        assert robot.controller.request_mode("stand") == (True, "stopping")
        robot.run(2.0)
        assert robot.controller.mode.value == "stand", robot.controller.reason
        assert np.abs(robot.data.qpos[7:] - standing).max() < 0.05
        assert robot.tilt < 1.0


@pytest.mark.in_a_copy
def test_a_silent_command_ends_the_blind_trot(standing):
    robot = standing
    robot.controller.request_mode("position_trot")
    robot.run(0.5, (0.2, 0.0, 0.0))
    robot.run(2.0)
    assert robot.controller.mode.value == "stand"
    assert robot.controller.counters.command_timeouts == 1


@pytest.mark.in_a_copy
def test_has_no_modes_of_the_fans(standing):
    robot = standing
    for mode in ("wair", "fly"):
        accepted, message = robot.controller.request_mode(mode)
        assert not accepted
        assert message.startswith(f"there is no mode '{mode}'")
