import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_sim.fans_in_world import MAGNETIC_FIELD
from husky_sim.world import POSE_PERIOD_NS, World, WorldOptions

GRAVITY = 9.81
LOW, SOME = 1000.0, 1400.0


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def unit_in_the_air(robot):
    return World(robot, WorldOptions(body="unit", keyframe="stand", start_height=5.0))


def arm(world):
    """Speed controllers want a second of low pulses."""
    world.fans.pwm[:] = LOW
    for _ in range(600):
        world.step_tick()


def test_thrust_accelerates_the_unit(robot):
    """Newton: m (a + g) = T in free flight, level."""
    world = unit_in_the_air(robot)
    world.data.qpos[2] = 100.0
    arm(world)
    world.fans.pwm[:] = SOME
    for _ in range(500):
        world.step_tick()
    before, thrust = world.data.qvel[2], world.fans.unit.thrust.sum()
    for _ in range(5):
        world.step_tick()
    acceleration = (world.data.qvel[2] - before) / 0.01
    mass = world.model.body_mass[world.model.body("base").id]
    assert thrust > 3.0
    assert acceleration == pytest.approx(thrust / mass - GRAVITY, rel=2e-3)
    assert np.abs(world.data.qvel[3:5]).max() < 1e-6, "four equal fans do not tilt"


@pytest.mark.parametrize(("fan", "roll", "pitch"), [(0, 1, -1), (1, -1, -1), (2, 1, 1), (3, -1, 1)])
def test_each_fan_lifts_its_own_corner(robot, fan, roll, pitch):
    """Left fans roll to the right (+), front fans pitch the nose up (-): REP-103 signs."""
    world = unit_in_the_air(robot)
    world.data.qpos[2] = 100.0
    arm(world)
    world.fans.pwm[fan] = SOME
    for _ in range(30):
        world.step_tick()
    assert np.sign(world.data.qvel[3]) == roll
    assert np.sign(world.data.qvel[4]) == pitch


def test_moment_turns_the_unit_as_its_inertia_says(robot):
    world = unit_in_the_air(robot)
    world.data.qpos[2] = 100.0
    arm(world)
    world.fans.pwm[[0, 2]] = SOME  # the left ones
    before = world.data.qvel[3:6].copy()
    impulse = np.zeros(3)
    base = world.model.body("base").id
    center = world.model.body_ipos[base]
    step = world.model.opt.timestep
    last = np.zeros(3)
    for _ in range(40):  # still nearly level
        world.step_tick()
        wrench = world.fans.unit.wrench_in_base
        moment = wrench[3:] - np.cross(center, wrench[:3])
        impulse += (moment + last) / 2 * 4 * step
        last = moment
    assert Rotation.from_quat(world.base_orientation).magnitude() < 0.05
    turned = world.model.body_inertia[base] * (world.data.qvel[3:6] - before)
    assert turned[0] == pytest.approx(impulse[0], rel=0.03)  # sampled at the ends of ticks


def test_sensors_at_rest(robot):
    world = World(robot, WorldOptions(body="unit", keyframe="stand"))
    for _ in range(500):
        world.step_tick()
    sample = world.fans.sample()
    assert sample.angular_velocity == pytest.approx(np.zeros(3), abs=1e-3)
    assert sample.specific_force == pytest.approx((0.0, 0.0, -GRAVITY), abs=0.02)
    east, north, up = MAGNETIC_FIELD  # the unit looks east: right is south, down is down
    assert sample.magnetic_field == pytest.approx((east, -north, -up), abs=1e-3)


def test_pressure_falls_with_height(robot):
    """Hydrostatics: dp = -rho g dh."""
    low = World(robot, WorldOptions(body="unit", keyframe="stand")).fans.sample().pressure
    high = unit_in_the_air(robot).fans.sample().pressure
    assert (high - low) / 5.0 == pytest.approx(-1.225 * GRAVITY, rel=0.01)


def test_poses_come_at_200_hz(robot):
    world = World(robot, WorldOptions(body="robot_with_unit", keyframe="stand"))
    poses = []
    for _ in range(50):
        world.step_tick()
        poses += world.poses
    assert [pose.time_ns for pose in poses] == [k * POSE_PERIOD_NS for k in range(20)]
    x, y, z, w = poses[0].orientation
    assert math.hypot(x, y, z, w) == pytest.approx(1.0)


def test_the_drives_hang_on_the_unit_s_battery(robot):
    world = World(robot, WorldOptions(body="robot_with_unit", keyframe="stand"))
    world.step_tick()
    world.step_tick()
    assert world.servos.bus_voltage == pytest.approx(world.fans.unit.battery_voltage, abs=0.05)


def test_a_reset_switches_the_unit_off(robot):
    world = unit_in_the_air(robot)
    arm(world)
    world.fans.pwm[:] = SOME
    for _ in range(100):
        world.step_tick()
    world.reset("stand")
    assert not world.fans.pwm.any() and not world.fans.unit.speed.any()
    assert world.fans.unit.battery_charge == 1.0


def test_fans_that_stand_do_not_change_the_walk(robot):
    """Same forces on the body, whether the unit is modelled or only weighed."""
    bare = World(robot, WorldOptions(keyframe="stand"))
    fitted = World(robot, WorldOptions(body="robot_with_unit", keyframe="stand"))
    for world in (bare, fitted):
        for _ in range(100):
            world.step_tick()
    assert fitted.data.qpos == pytest.approx(bare.data.qpos, abs=1e-9)


@pytest.mark.parametrize(
    ("option", "value"), [("body", "bird"), ("start_height", -1.0), ("start_height", math.nan)]
)
def test_bad_options(option, value):
    with pytest.raises(ValueError, match=option):
        WorldOptions(**{option: value})
