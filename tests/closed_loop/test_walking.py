"""The controller with the simulated robot in one process: standing, trotting, pushes, commands."""

import copy
import math

import numpy as np
import pytest
from in_process import InProcessRobot

from husky_description.gravity import GRAVITY
from husky_description.ground import GROUND_PRESETS
from husky_description.robot import load_robot
from husky_runtime import graph
from husky_sim.world import WorldOptions

pytestmark = pytest.mark.in_a_copy  # each goes on from the same standing or walking robot
SPEED = 0.5
"""Commanded in these tests [m/s]."""


@pytest.fixture(scope="module")
def standing():
    robot = InProcessRobot()
    robot.stand()
    return robot


@pytest.fixture(scope="module")
def walking(standing):
    """What `standing` becomes, behind the tests of who stands."""
    return trotting(standing)


def getting_up(seed=3, velocity=None):
    """A robot that a velocity command may set in motion, when it stands up since this tick."""
    robot = InProcessRobot(WorldOptions(seed=seed))
    robot.controller.watch.wakes = True
    robot.enable()
    assert robot.controller.request_mode("stand_up")[0]
    while robot.controller.mode.value == "stand_up":
        robot.run(0.01, velocity)
    assert robot.controller.mode.value == "stand", robot.controller.reason
    return robot


@pytest.fixture(scope="module")
def waking():
    return getting_up()


def trotting(robot, duration=1.5):
    """Let a standing robot trot ahead until it has its speed."""
    accepted, message = robot.controller.request_mode("walk")
    assert accepted, message
    robot.run(duration, (SPEED, 0.0, 0.0))
    return robot


def test_stands_and_trots_on_ground_that_gives_way():
    ground = GROUND_PRESETS["thesis_results"]
    robot = InProcessRobot(WorldOptions(contact="thesis_results"))
    robot.stand()
    depth = robot.world.robot.foot_radius - robot.world.foot_positions()[:, 2]
    weight = robot.world.robot.mass * GRAVITY
    assert depth.sum() == pytest.approx(weight / ground.stiffness, rel=0.05)
    trotting(robot)
    start = robot.world.base_position.copy()
    robot.run(1.0, (SPEED, 0.0, 0.0))
    assert robot.world.base_position[0] - start[0] == pytest.approx(SPEED, rel=0.05)
    assert robot.tilt < 2.0 and robot.controller.counters.faults == 0


def roll_pitch(robot):
    """True roll and pitch [rad]."""
    x, y, z, w = robot.world.base_orientation
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return roll, math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))


def heading(robot):
    """True heading, unit vector (2,) in world."""
    x, y, z, w = robot.world.base_orientation
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.array([math.cos(yaw), math.sin(yaw)])


def walk_on(robot, duration, velocity=(SPEED, 0.0, 0.0)):
    """Walk on; mean speed along the heading [m/s], and roll and pitch of each tick [rad]."""
    attitude, way = [], 0.0
    period = round(0.02 / graph.TICK_PERIOD)
    for _ in range(round(duration / 0.02)):
        before, along = robot.world.base_position[:2].copy(), heading(robot)
        if velocity is not None:
            robot.controller.set_velocity_command(*velocity)
        for _ in range(period):
            robot.tick()
            attitude.append(roll_pitch(robot))
        way += float((robot.world.base_position[:2] - before) @ along)
    return way / duration, np.array(attitude)


def assert_walks(robot):
    assert robot.controller.mode.value == "walk", robot.controller.reason
    assert robot.controller.counters.faults == 0
    assert robot.refusal == ""


def test_stands_at_the_height_that_is_wanted(standing):
    robot = standing
    wanted = load_robot().stand_height + load_robot().foot_radius
    assert robot.world.base_position[2] == pytest.approx(wanted, abs=0.01)
    assert robot.controller.body.estimator.position[2] == pytest.approx(wanted, abs=0.01)
    assert robot.refusal == ""
    before = robot.world.base_position.copy()
    robot.run(0.5)
    assert np.linalg.norm(robot.world.base_position - before) < 0.001
    assert robot.controller.body.contacts.contact.all()
    # The observer's forces, from currents alone, carry the weight to a tenth of it.
    weight = load_robot().mass * GRAVITY
    assert robot.controller.body.contacts.foot_force[:, 2].sum() == pytest.approx(weight, rel=0.1)


def test_a_command_wakes_nobody_who_may_not_walk(standing):
    robot = standing
    robot.run(0.6)
    accepted, message = robot.controller.set_velocity_command(0.3, 0.0, 0.0)
    assert not accepted and "walk_on_command" in message
    assert robot.controller.mode.value == "stand"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_crawl_turns_and_stops_at_its_limit_and_is_asked_for_no_more(standing, side):
    robot, controller = standing, standing.controller
    limit = controller.parameters["gait.crawl.max_yaw_rate"]
    speed = controller.parameters["gait.crawl.max_speed"]
    controller.request_gait("crawl")
    assert controller.request_mode("walk")[0]
    accepted, message = controller.set_velocity_command(0.0, 0.0, side * 1.1 * limit)
    assert not accepted
    assert message.startswith(f"yaw_rate must be within +-{limit:g} rad/s (gait.crawl.max_yaw_rate")
    robot.run(8.0, (0.0, 0.0, side * limit))  # two cycles, the first of them up to speed
    before = math.atan2(*heading(robot)[::-1])
    robot.run(4.0, (0.0, 0.0, side * limit))
    turned = math.remainder(math.atan2(*heading(robot)[::-1]) - before, 2.0 * math.pi)
    assert turned == pytest.approx(side * 4.0 * limit, rel=0.15)  # the clock waits for the sway
    robot.run(5.0, (speed, 0.0, side * limit))
    assert_walks(robot)
    assert controller.request_mode("stand")[0]
    robot.run(5.0)
    assert controller.mode.value == "stand", controller.reason
    assert controller.counters.faults == 0 and robot.tilt < 1.0


@pytest.mark.parametrize(
    "field", ["joint_position", "joint_torque", "angular_velocity_base_in_base"]
)
def test_a_measurement_that_is_not_finite_lets_the_robot_sink(standing, field):
    """One trip; each bad measurement is counted, and none of it gets into a command."""
    robot = standing
    good = robot.measurements
    bad = copy.deepcopy(good)
    getattr(bad, field)[1] = math.nan
    for _ in range(3):
        command = robot.controller.tick(bad)
        assert np.isfinite(command.position).all() and np.isfinite(command.effort).all()
    counters = robot.controller.counters
    assert (counters.bad_measurements, counters.faults) == (3, 1)
    assert robot.controller.mode.value == "settle"
    assert robot.controller.reason == "a measurement is not finite"
    robot.controller.tick(good)
    assert counters.bad_measurements == 3 and robot.controller.mode.value == "settle"
    robot.run(0.7)
    assert robot.controller.mode.value == "damping" and robot.tilt < 5.0


def test_trots_at_its_speed_and_level(walking):
    robot = walking
    speed, attitude = walk_on(robot, 3.0)
    assert_walks(robot)
    assert speed == pytest.approx(SPEED, rel=0.1)
    rms = np.degrees(np.sqrt((attitude**2).mean(axis=0)))
    assert rms[0] < 2.0 and rms[1] < 2.0, f"roll and pitch rms are {rms} deg"
    estimated = robot.controller.body.estimator.velocity
    # Of the estimator, against the truth at one moment of the gait.
    assert np.linalg.norm(estimated[:2] - robot.world.base_velocity[:2]) < 0.15


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lateral_push_is_survived(walking, side):
    robot = walking
    robot.world.push("", np.array([0.0, side * 60.0, 0.0]), np.zeros(3), 0.1)  # 6 N s
    _, attitude = walk_on(robot, 2.0)
    assert_walks(robot)
    assert np.degrees(np.abs(attitude[:, 0]).max()) > 2.0, "the push was not felt"
    speed, attitude = walk_on(robot, 0.5)
    assert np.degrees(np.abs(attitude).max()) < 15.0
    assert speed > 0.5 * SPEED


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("vx", (math.nan, 0.0, 0.0)),
        ("vy", (0.2, math.inf, 0.0)),
        ("yaw_rate", (0.2, 0.0, 9.0)),
    ],
)
def test_a_bad_command_is_refused_whole_and_the_robot_walks_on(walking, name, command):
    robot = walking
    controller = robot.controller
    refused = controller.counters.refused_velocity_commands
    ramped = controller.walking.reference.ramped.copy()
    accepted, message = controller.set_velocity_command(*command)
    assert not accepted
    assert message.startswith(f"{name} must be within")
    assert controller.counters.refused_velocity_commands == refused + 1
    robot.run(0.2)
    np.testing.assert_array_equal(controller.walking.reference.ramped, ramped)
    speed, _ = walk_on(robot, 0.4)
    assert_walks(robot)
    assert speed > 0.5 * SPEED


def test_silence_ends_the_walk_on_four_feet(walking):
    robot = walking
    controller = robot.controller
    timeout = controller.parameters["command.timeout"]
    robot.controller.set_velocity_command(SPEED, 0.0, 0.0)
    robot.run(timeout - 0.01)
    assert controller.counters.command_timeouts == 0
    robot.run(0.02)
    assert controller.counters.command_timeouts == 1
    assert controller.reason == "velocity command silent"
    robot.run(2.5)
    assert controller.mode.value == "stand", controller.reason
    assert not controller.counters.faults
    assert not controller.present.clock.swinging.any()
    assert np.linalg.norm(robot.world.base_velocity) < 0.02


def test_one_seed_gives_one_trajectory_to_the_bit(waking):
    first, again, other = waking, getting_up(), getting_up(8)
    assert first.world.time_ns == other.world.time_ns
    assert first.world.trajectory_sha256 != other.world.trajectory_sha256
    for robot in (first, again):
        trotting(robot, 0.5)
    assert first.world.data.qpos.tobytes() == again.world.data.qpos.tobytes()
    assert first.world.trajectory_sha256 == again.world.trajectory_sha256


def test_one_command_a_second_moves_a_robot_that_may_walk(waking):
    """It walks as long as a command counts, comes to a stand, and goes on with the next one."""
    robot, modes = waking, []
    start = robot.world.base_position[0]
    for _ in range(4):
        assert robot.controller.set_velocity_command(0.3, 0.0, 0.0) == (True, "")
        modes.append(robot.controller.mode.value)
        robot.run(1.0)
    robot.run(3.0)
    assert modes == ["walk"] * 4
    assert robot.controller.mode.value == "stand" and robot.controller.counters.command_timeouts
    assert robot.world.base_position[0] - start > 0.4


def test_who_was_told_to_stand_stands_until_the_stick_is_let_go(waking):
    robot = waking
    robot.run(1.0, (0.3, 0.0, 0.0))
    robot.controller.request_mode("stand")
    for _ in range(40):
        robot.run(0.1, (0.3, 0.0, 0.0))
    assert robot.controller.mode.value == "stand"
    accepted, message = robot.controller.set_velocity_command(0.3, 0.0, 0.0)
    assert not accepted and "let go" in message
    assert robot.controller.set_velocity_command(0.0, 0.0, 0.0) == (True, "")
    assert robot.controller.set_velocity_command(0.3, 0.0, 0.0) == (True, "")
    assert robot.controller.mode.value == "walk"


def test_a_stick_held_while_the_robot_gets_up_does_not_set_it_off():
    robot = getting_up(velocity=(0.3, 0.0, 0.0))
    accepted, message = robot.controller.set_velocity_command(0.3, 0.0, 0.0)
    assert not accepted and "let go" in message
