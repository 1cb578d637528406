"""A stop puts a stepping robot down upright in each gait and phase (IEC 60204-1, category 1)."""

import numpy as np
import pytest
from climbing_robot import ClimbingRobot
from stops import STOPS, WALKS, come_down, in_a_copy, standing_robot, walk_and_stop

from husky_description.gravity import GRAVITY
from husky_description.kinematics import Kinematics, inverse_kinematics
from husky_description.robot import load_robot
from husky_description.settling import Settling
from husky_runtime import graph

pytestmark = pytest.mark.in_a_copy  # each goes on from the same standing robot

LAME = ("knee", "frontal", "sagittal")
TILT, TILT_WHEN_DEAD, TILT_WHEN_LAME = 20.0, 30.0, 40.0
"""Most tilt of the body: in a stop, without a controller, without a drive [deg]."""
SINK = 1.1
"""Most speed at which the perch meets the ground [m/s]."""
OFF = 0.6
"""Time in which all torque is gone, behind the time in which silence is noticed [s]."""
SILENCE = 0.012


@pytest.fixture(scope="module")
def standing():
    return standing_robot()


@pytest.fixture(scope="module")
def loaded():
    return standing_robot(payload=1.0)


def holds(name, outcomes):
    for outcome in outcomes:
        if name in LAME:
            assert outcome.tilt <= TILT_WHEN_LAME, outcomes
            continue
        assert outcome.tilt <= (TILT_WHEN_DEAD if name == "dead" else TILT), outcomes
        assert outcome.sink <= SINK, outcomes
        if name != "mode":  # in which the drives stay enabled, without torque
            assert outcome.off <= OFF + SILENCE * (name == "dead"), outcomes


@pytest.mark.parametrize(
    ("gait", "speed", "phases"),
    [
        ("trot", 1.0, 2),
        ("crawl", 0.05, 1),
        ("pronk", 0.3, 2),
        *(pytest.param(*walk, 10, marks=pytest.mark.slow) for walk in WALKS),
    ],
)
def test_a_stop_puts_the_robot_down(standing, gait, speed, phases):
    names = ["mode", "drives", "dead"]
    outcomes = walk_and_stop(standing, gait, speed, [STOPS[name] for name in names], phases)
    for name, row in zip(names, outcomes, strict=True):
        holds(name, row)


@pytest.mark.slow
@pytest.mark.parametrize(("gait", "speed"), WALKS)
def test_a_stop_with_1_kg_more_of_payload(loaded, gait, speed):
    (outcomes,) = walk_and_stop(loaded, gait, speed, [STOPS["payload"]], 10)
    holds("payload", outcomes)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("drive", LAME)
def test_a_stop_with_one_drive_lost(standing, drive):
    """Of 360 none ended beyond; at other phases of the gaits one in a thousand does."""
    fallen = 0
    for walk in WALKS:

        def walked(walk=walk):
            return walk_and_stop(standing, *walk, [STOPS[drive]], 10)

        fallen += sum(each.tilt > TILT_WHEN_LAME for row in in_a_copy(walked) for each in row)
    assert fallen <= 1


def test_a_standing_robot_without_a_knee_is_put_down(standing):
    STOPS["knee"].acts[0](standing)
    holds("knee", [come_down(standing)])


@pytest.mark.parametrize("slope", [pytest.param(20.0, marks=pytest.mark.slow), 45.0])
@pytest.mark.parametrize("stop", ["drives", pytest.param("mode", marks=pytest.mark.slow)])
def test_on_an_incline_it_is_put_down_along_the_slope(slope, stop):
    """It lies on the slope, or slides down to level ground without tipping over; the fans fade."""
    robot = ClimbingRobot(slope)
    robot.start()
    while robot.world.base_position[0] < 1.2:
        robot.run(0.2, (0.25, 0.0, 0.0))
    STOPS[stop].acts[0](robot)
    tilts = []
    for _ in range(150):
        robot.run(0.02)
        tilts.append(min(robot.tilt, np.degrees(robot.lean)))  # from level, or from the slope
    assert max(tilts) < 25.0
    assert np.linalg.norm(robot.thrust) < 0.5
    assert np.linalg.norm(robot.world.base_velocity[:3]) < 0.05


def test_category_0_lets_go_at_once(standing):
    robot = standing
    robot.controller.parameters.set_all({"safety.stop_category": 0.0})
    STOPS["mode"].acts[0](robot)
    robot.run(0.02)
    assert robot.controller.mode.value == "emergency_stop"
    assert np.abs(robot.measurements.joint_torque).max() < 0.1


# The motion itself -------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["carbon", "beta"])
@pytest.mark.parametrize("lost_joint", [None, 1, 11])
def test_the_motion_starts_where_the_joints_are_and_ends_on_the_perch(name, lost_joint):
    robot = load_robot(name)
    motion = Settling(robot)
    start = np.array(robot.stand_joint_position)
    motion.begin(start, np.array([0.5, -0.1, 0.0]), np.arange(12) != lost_joint)
    before, most = start, 0.0
    for _ in range(400):
        if motion.done:
            break
        motion.advance(graph.TICK_PERIOD)
        np.testing.assert_allclose(
            motion.joint_velocity * graph.TICK_PERIOD, motion.joint_position - before, atol=1e-12
        )
        most = max(most, np.abs(motion.joint_velocity).max())
        before = motion.joint_position.copy()
    assert motion.done
    assert most < robot.joint_speed or name == "beta", "its servos lag, and that does no harm"
    assert (motion.joint_position >= robot.joint_lower).all()
    assert (motion.joint_position <= robot.joint_upper).all()


def test_a_robot_that_sits_has_nothing_to_do():
    robot = load_robot()
    motion = Settling(robot)
    motion.begin(np.array(robot.sit_joint_position) * 1.001, np.zeros(3))
    assert motion.done


@pytest.mark.parametrize("left", [1e-12, 1e-9, 1e-5, 1e-3])
@pytest.mark.parametrize("climb", [-1.0, 0.0, 1.0])
def test_the_last_bit_of_the_way_down_takes_no_longer_than_the_whole(left, climb):
    """As after `sit`, which ends on the perch but for a rounding."""
    robot = load_robot()
    kinematics, motion = Kinematics(robot), Settling(robot)
    feet = kinematics.foot_positions(np.array(robot.stand_joint_position))
    feet[:, 2] = -robot.sit_height - left
    joints = np.empty(12)
    inverse_kinematics(kinematics.geometry, feet, joints)
    motion.begin(joints, np.array([0.0, 0.0, climb]))
    for _ in range(round(OFF / graph.TICK_PERIOD)):
        motion.advance(graph.TICK_PERIOD)
    assert motion.done


def test_the_velocity_is_told_by_legs_that_press(standing):
    """From commands alone: in the trot, and in the air by free fall since two legs last pressed."""
    robot = standing
    robot.controller.request_mode("walk")
    robot.run(1.5, (0.5, 0.0, 0.0))
    motion = Settling(load_robot())
    told = motion.velocity_of(robot.master.remembered, graph.TICK_PERIOD)
    assert told[0] == pytest.approx(0.5, abs=0.15) and abs(told[1]) < 0.15
    silent = robot.master.remembered.copy()
    silent[-10:, 2] = 0.0
    fallen = motion.velocity_of(silent, graph.TICK_PERIOD)
    before = motion.velocity_of(silent[:-10], graph.TICK_PERIOD)
    assert before[2] - fallen[2] == pytest.approx(10 * graph.TICK_PERIOD * GRAVITY)
