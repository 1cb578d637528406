"""Slopes in the world: where the robot starts, what carries it, what holds it."""

import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_msgs.msg import ServoCommand
from husky_sim import terrain
from husky_sim.scene import WorldOptions
from husky_sim.terrain import TerrainOptions
from husky_sim.world import World

ROBOT = load_robot()
WEIGHT = ROBOT.mass * GRAVITY


def world(degrees, distance=4.0, kind="ramp", held=False, **options):
    ground = TerrainOptions(kind=kind, slope=math.radians(degrees), length=12.0)
    return World(
        ROBOT,
        WorldOptions(
            terrain=ground, keyframe="stand", start_distance=distance, start_held=held, **options
        ),
    )


def run(world, seconds, posture=ROBOT.stand_joint_position):
    """Hold a posture, by the drives' own servos; a command ends when it is not renewed."""
    none = np.zeros(12)
    gains = np.full(12, ROBOT.servo.kp), np.full(12, ROBOT.servo.kd)
    for _ in range(round(seconds / 0.002)):
        world.servos.set_command(
            np.full(12, ServoCommand.POSITION),
            posture,
            none,
            none,
            *gains,
            ROBOT.joint_torque_limit,
        )
        world.step_tick()


def axes(degrees):
    """Uphill tangent and outward normal."""
    a = math.radians(degrees)
    return np.array((math.cos(a), 0, math.sin(a))), np.array((-math.sin(a), 0, math.cos(a)))


@pytest.mark.parametrize("kind", ["ramp", "slope"])
@pytest.mark.parametrize("degrees", [0, 20, 45, 90])
def test_it_starts_upright_on_the_slope(kind, degrees):
    w = world(degrees, kind=kind, held=True)
    x, z, angle = w.options.terrain.at(4.0)
    assert math.degrees(angle) == pytest.approx(degrees)
    uphill, normal = axes(degrees)
    turned = Rotation.from_quat(w.base_orientation)
    np.testing.assert_allclose(turned.apply((1, 0, 0)), uphill, atol=1e-9)
    # The feet's balls touch the surface, all four.
    heights = (w.foot_positions() - (x, 0, z)) @ normal
    np.testing.assert_allclose(heights, ROBOT.foot_radius, atol=2e-3)


def test_forces_of_the_ground_are_normal_and_tangential_on_the_slope():
    """A robot that stands on 10 degrees: Newton's law along and across the slope."""
    w = world(10)
    run(w, 2.0)
    uphill, normal = axes(10)
    forces, normals = w.foot_contacts()
    np.testing.assert_allclose(normals, np.tile(normal, (4, 1)), atol=1e-6)
    # It stands, nearly still: the feet carry the weight's part across and hold its part along.
    across, along = WEIGHT * math.cos(math.radians(10)), WEIGHT * math.sin(math.radians(10))
    assert (forces @ normal).sum() == pytest.approx(across, abs=0.01 * WEIGHT)
    assert (forces @ uphill).sum() == pytest.approx(along, abs=0.01 * WEIGHT)
    assert np.all(forces @ normal > 0.0)


def test_held_it_stays_on_a_wall_and_released_it_falls():
    w = world(90, held=True)
    start = w.base_position.copy()
    run(w, 0.5)
    assert w.held
    np.testing.assert_allclose(w.base_position, start, atol=2e-3)
    # Hands carry the weight: an accelerometer in the base feels it.
    felt = np.linalg.norm(w.data.sensor("imu_accelerometer").data)
    assert felt == pytest.approx(GRAVITY, rel=0.02)
    w.hold(False)
    run(w, 0.3)
    assert not w.held and w.base_position[2] < start[2] - 0.3
    w.reset("stand")
    assert w.held  # as at the start
    np.testing.assert_allclose(w.base_position, start, atol=1e-12)


def test_a_ball_slides_up_the_foot_of_the_slope_without_a_jump():
    """Energy: what passes from facet to facet loses the little that 3 degrees each cost."""
    ramp = TerrainOptions(kind="ramp", slope=math.radians(30), approach=0.5)
    spec = mujoco.MjSpec()
    for name in ("ground", "tile"):
        spec.add_material(name=name)
    terrain.build(spec, ramp, 0)
    spec.option.timestep = 0.0005
    ball = spec.worldbody.add_body(pos=[0.0, 0.0, ROBOT.foot_radius])
    ball.add_freejoint()
    ball.add_geom(size=[ROBOT.foot_radius, 0.0, 0.0], condim=1, density=1000.0)
    for geom in spec.geoms:
        geom.condim, geom.solref = 1, [0.005, 1.0]
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[0] = 4.0
    on_slope = ramp.ramp.at(ramp.ramp.slope_start + 0.3)
    while data.qpos[0] < on_slope.x:
        mujoco.mj_step(model, data)
        assert data.time < 1.0
        height = data.qpos[2] - ROBOT.foot_radius
        assert data.ncon or height < 0.0015 + on_slope.z  # it stays on the ground
    energy = 0.5 * float(data.qvel[:3] @ data.qvel[:3]) + GRAVITY * float(data.qpos[2])
    start = 0.5 * 16.0 + GRAVITY * ROBOT.foot_radius
    assert 0.95 * start < energy < 1.001 * start
    assert math.degrees(math.atan2(data.qvel[2], data.qvel[0])) == pytest.approx(30.0, abs=1.5)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"kind": "ramp", "slope": -0.2}, "slope"), ({"blend": -1.0}, "terrain blend is -1")],
)
def test_bad_ground_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        TerrainOptions(**options)


def test_a_sliding_foot_slides_as_far_as_it_moves():
    """Down a slope of ice, over which feet chatter: only while they touch."""
    ice = world(20, friction=0.05)
    run(ice, 0.1)  # it lands
    way, slid = np.zeros(4), list(ice.slid)
    for _ in range(400):
        before = ice.foot_positions()
        run(ice, 0.002)
        ice.measure_sliding()
        touches = ice.foot_forces().any(axis=1)
        way += touches * np.linalg.norm(ice.foot_positions() - before, axis=1)
    assert (way > 0.3).all()
    assert np.array(ice.slid) - slid == pytest.approx(way, rel=0.02)


def test_a_rolling_foot_does_not_slide():
    """The body sways ahead over balls that roll: their centres move by r times the shins' turn."""
    rough = world(0, friction=2.0)
    run(rough, 0.5)
    before, slid = rough.foot_positions(), list(rough.slid)
    for tick in range(250):
        sway = np.tile([0.0, -0.15 * tick / 250, 0.0], 4)
        run(rough, 0.002, ROBOT.stand_joint_position + sway)
        rough.measure_sliding()
    rolled = np.linalg.norm(rough.foot_positions() - before, axis=1)
    assert (rolled > 1e-3).all()
    assert (np.array(rough.slid) - slid < 0.1 * rolled).all()
