import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_sim.propulsion.fans_in_world import MAGNETIC_FIELD
from husky_sim.world import POSE_PERIOD_NS, World, WorldOptions

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


VECTORED = load_robot(fans__mounting="vectoring")


@pytest.mark.parametrize("told", [(1500, 1500), (1900, 1400), (1200, 1700)])
def test_a_vectored_force_acts_at_the_centre_of_mass(told):
    """Newton and Euler in free fall, wherever the legs hang: momentum by MuJoCo's own sums."""
    options = WorldOptions(
        body="robot_with_unit", keyframe="stand", start_height=3.0, start_held=True
    )
    world = World(VECTORED, options)
    world.fans.tilt_pwm[:] = told
    for pulse, seconds in ((1000, 1.1), (1550, 0.6)):
        world.fans.pwm[:] = pulse
        for _ in range(round(seconds / 0.002)):
            world.step_tick()
    world.hold(False)

    def momentum():
        mujoco.mj_subtreeVel(world.model, world.data)
        base = world.model.body("base").id
        return world.data.subtree_linvel[base].copy(), world.data.subtree_angmom[base].copy()

    (before, spin), impulse = momentum(), np.zeros(3)
    for _ in range(50):
        turned = Rotation.from_quat(world.base_orientation)
        impulse += 0.002 * turned.apply(world.fans.wrench_in_base[:3])
        world.step_tick()
    after, spin_after = momentum()
    assert np.linalg.norm(impulse) > 1.5
    np.testing.assert_allclose(
        VECTORED.mass * (after - before),
        impulse + (0.0, 0.0, -0.1 * GRAVITY * VECTORED.mass),
        atol=0.03 * np.linalg.norm(impulse),
    )
    # A lever of 1 cm would give 0.016 N m s here.
    np.testing.assert_allclose(spin_after - spin, 0.0, atol=2e-3)
    pitch, roll = world.fans.tilt
    limits = VECTORED.gimbal.pitch_limit, VECTORED.gimbal.roll_limit
    expected = [(t - 1500) / 500 * limit for t, limit in zip(told, limits, strict=True)]
    assert (pitch, roll) == pytest.approx(expected, abs=1e-3)
    direction = (np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll))
    force = world.fans.wrench_in_base[:3]
    np.testing.assert_allclose(force / np.linalg.norm(force), direction, atol=1e-9)
    assert np.linalg.norm(force) == pytest.approx(world.fans.unit.thrust.sum())


def test_a_turning_axis_follows_its_servos_and_stays_without_pulses():
    world = World(VECTORED, WorldOptions(body="unit", keyframe="stand"))
    world.fans.tilt_pwm[:] = (2000, 1500)
    angles = []
    for _ in range(100):
        world.step_tick()
        angles.append(world.fans.tilt[0])
    rates = np.diff(angles) / 0.002
    assert rates.max() == pytest.approx(VECTORED.gimbal.rate, rel=1e-6)
    told = angles[-1]
    world.fans.tilt_pwm[:] = 0
    world.step_tick()
    for _ in range(300):
        world.step_tick()
    # It goes on to where it was told last, and no further.
    assert told < world.fans.tilt[0] == pytest.approx(VECTORED.gimbal.pitch_limit, abs=1e-3)
    world.reset("stand")
    assert world.fans.tilt == (0.0, 0.0)
