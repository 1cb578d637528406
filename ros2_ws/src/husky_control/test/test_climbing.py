"""The climbing controller's plane, thrust and pitch: order, limits, plans, faults."""

import math

import mujoco
import numpy as np
import pytest

from husky_control.incline.climbing import GATE, Climbing
from husky_control.incline.statics import plane_from_world
from husky_control.parameters import Parameters
from husky_description.gravity import GRAVITY
from husky_description.kinematics import Kinematics
from husky_description.mujoco_model import build_spec
from husky_description.robot import load_robot

DT = 0.002
ROBOT = load_robot()
LEFT = np.array([0.0, 1.0, 0.0])
FEET = np.array([[0.2, 0.14, 0.0], [0.2, -0.14, 0.0], [-0.2, 0.14, 0.0], [-0.2, -0.14, 0.0]])
ALL, NONE = np.ones(4, dtype=bool), np.zeros(4, dtype=bool)
STILL = np.zeros(2)


def feet_on(degrees):
    slope = math.radians(degrees)
    return FEET @ plane_from_world(np.array([-math.sin(slope), 0.0, math.cos(slope)]))


def climbing(mounting="vectoring", **parameters):
    robot = load_robot(fans__mounting=mounting)
    c = Climbing(robot, Parameters({f"wair.{name}": value for name, value in parameters.items()}))
    c.begin(FEET)
    return c


def stay(c, degrees, duration, limit=math.inf, error=STILL):
    """Stand on a slope for a while; the thrust asked and given, and the slope walked on, of it."""
    history = []
    c.incline.normals[:] = plane_normal(degrees)
    for _ in range(round(duration / DT)):
        c.tick(feet_on(degrees), ALL, NONE, LEFT, error, limit, DT)
        given, asked = np.linalg.norm(c.given), np.linalg.norm(c.thrust)
        history.append((asked, given, math.degrees(c.slope)))
    return np.array(history)


def plane_normal(degrees):
    slope = math.radians(degrees)
    return np.array([-math.sin(slope), 0.0, math.cos(slope)])


def test_on_gentle_ground_the_fans_are_not_asked():
    c = climbing()
    history = stay(c, 10.0, 1.0)
    assert not history[:, :2].any()
    assert history[-1, 2] == pytest.approx(10.0, abs=0.2)


def test_the_thrust_is_there_before_the_body_leans():
    c = climbing()
    history = stay(c, 45.0, 4.0)
    weight = c.mass * GRAVITY
    ratio = c.parameters["wair.load_slope"]
    lean = np.radians(history[:, 2])
    needed = weight * np.maximum(0.0, np.sin(lean - math.atan(ratio)))
    # The thrust that acts never falls short of the lean by more than the gate and a tick's lean.
    assert (needed - history[:, 1]).max() < GATE + 0.5
    assert history[-1, 2] == pytest.approx(45.0, abs=0.1)
    assert history[-1, 1] == pytest.approx(
        weight * math.sin(math.radians(45.0) - math.atan(ratio)), rel=0.01
    )


def test_the_thrust_asked_for_is_slewed_and_limited():
    c = climbing(thrust_limit=20.0)
    history = stay(c, 60.0, 4.0)
    assert np.diff(history[:, 0]).max() <= c.parameters["wair.thrust_slew"] * DT + 1e-9
    assert history[:, 0].max() <= 20.0 + 1e-6
    # With so little thrust the body does not lean as far as the ground.
    assert history[-1, 2] < 45.0


def test_feedback_pushes_along_the_slope_only_and_is_limited():
    c = climbing()
    stay(c, 45.0, 4.0)
    before = c.plane @ c.thrust
    stay(c, 45.0, 2.0, error=np.array([1.0, 0.0]))
    change = c.plane @ c.thrust - before
    assert change[0] == pytest.approx(c.parameters["wair.feedback_limit"], abs=0.05)
    assert abs(change[2]) < 0.05


def center_over_feet(degrees_of_pitch, shift, height):
    """Centre of mass of the robot from the middle of its feet, (x, y, z) m in plane, by MuJoCo.

    Its body is pitched, its feet stand in the plane, shifted from under it.
    """
    kinematics = Kinematics(ROBOT)
    feet = kinematics.foot_positions(ROBOT.stand_joint_position)
    feet += (shift, 0.0, 0.0)
    feet[:, 2] = -height
    s, c = math.sin(math.radians(degrees_of_pitch)), math.cos(math.radians(degrees_of_pitch))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    model = build_spec(ROBOT).compile()
    data = mujoco.MjData(model)
    data.qpos[7:19] = kinematics.joint_positions(feet @ turn)
    mujoco.mj_forward(model, data)
    base = model.body("base").id
    return turn @ (data.subtree_com[base] - data.xpos[base]) - (shift, 0.0, -height)


def test_the_load_passes_through_the_centre_of_mass():
    c = climbing()
    stay(c, 45.0, 5.0)
    x, y = c.load_slope()
    assert x == pytest.approx(c.parameters["wair.load_slope"], abs=0.01)
    assert y == pytest.approx(0.0, abs=1e-6)
    ahead, _, above = center_over_feet(0.0, c.shift(0.5)[0], 0.5)
    assert ahead == pytest.approx(x * (above + ROBOT.foot_radius), abs=0.002)


def test_the_load_of_a_pitched_body_passes_near_its_centre_of_mass():
    c = climbing("fixed")
    stay(c, 30.0, 5.0)
    assert c.pitch > math.radians(30.0)
    ahead, _, above = center_over_feet(math.degrees(c.pitch), c.shift(0.43)[0], 0.43)
    assert ahead == pytest.approx(c.load_slope()[0] * (above + ROBOT.foot_radius), abs=0.01)


def test_steep_ground_presses_the_feet():
    c = climbing()
    stay(c, 80.0, 6.0)
    support = -c.mass * c.gravity - c.given_in_plane
    assert np.linalg.norm(support) == pytest.approx(c.parameters["wair.least_load"], rel=0.02)
    assert c.lightness < 1.0


def test_fans_lost_on_an_incline_are_told_and_on_gentle_ground_are_not():
    c = climbing()
    stay(c, 10.0, 1.0, limit=0.0)
    assert not c.lost
    stay(c, 45.0, 4.0)
    assert not c.lost
    stay(c, 45.0, 0.1, limit=0.0)
    assert c.lost
    assert np.linalg.norm(c.given) < 25.0
    legs_alone = climbing(thrust_share=0.0)
    stay(legs_alone, 45.0, 3.0, limit=0.0)
    assert not legs_alone.lost and not legs_alone.thrust.any()


@pytest.mark.parametrize(("degrees", "share"), [(30.0, 3.0**-0.5), (45.0, 1.0), (50.0, 1.0)])
def test_fixed_fans_make_the_body_lean_ahead_of_the_slope(degrees, share):
    c = climbing("fixed")
    stay(c, degrees, 6.0)
    ahead = share * math.degrees(c.parameters["wair.lean_ahead"])
    assert math.degrees(c.pitch) == pytest.approx(degrees + ahead, abs=0.5)
    assert c.sink == pytest.approx(c.parameters["wair.lean_sink"], rel=0.02)
    axis = np.array([math.sin(c.pitch), 0.0, math.cos(c.pitch)])
    thrust = c.plane @ c.thrust
    np.testing.assert_allclose(thrust / np.linalg.norm(thrust), axis, atol=1e-6)
    assert c.load_slope()[0] == pytest.approx(c.parameters["wair.load_slope"], abs=0.01)


def test_the_end_is_level_and_the_thrust_fades():
    c = climbing()
    stay(c, 45.0, 4.0)
    c.end()
    np.testing.assert_array_equal(c.plane, np.eye(3))
    for _ in range(1000):
        c.fade(DT)
    assert not c.thrust.any() and np.linalg.norm(c.given) < 0.01


@pytest.mark.parametrize(("degrees", "limit", "lost"), [(45.0, 40.0, False), (60.0, 40.0, True)])
def test_the_fans_that_are_left_hold_the_robot_or_it_gives_up(degrees, limit, lost):
    c = climbing()
    stay(c, degrees, 5.0)
    needed = np.linalg.norm(c.given)
    assert (needed > limit) == lost
    history = stay(c, degrees, 1.0, limit=limit)
    assert c.lost == lost
    assert (history[:, 1] <= max(limit, needed) + 1e-9).all()
    assert np.linalg.norm(c.given) == pytest.approx(min(limit, needed), rel=1e-3)
