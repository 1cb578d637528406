"""What the climbing controller takes from a plan, and which plans it refuses."""

import math

import numpy as np
import pytest

from husky_control.controller import Controller
from husky_control.incline.climbing import Climbing
from husky_control.incline.plan_reference import REACH, reference_of
from husky_control.incline.statics import least_thrust
from husky_control.parameters import Parameters
from husky_control.planning.plan import MeshError, Plan
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot

SLOPE, RATIO, MASS, HEIGHT, PERIOD, SPEED = math.radians(45.0), 0.32, 7.6, 0.5, 0.34, 0.25
GRAVITY_IN_SLOPE = GRAVITY * np.array([-math.sin(SLOPE), 0.0, -math.cos(SLOPE)])


def steady_plan(pitch=0.0, extra=(0.0, 0.0), further=0.0, **changes):
    """A plan whose body moves steadily under the statics' thrust and `extra`, uphill and out.

    The feet stand where the load passes through the base, and `further` uphill.
    """
    half = np.linspace(0.0, PERIOD / 2, 6)
    time = np.concatenate([half, PERIOD / 2 + half])
    count = len(time)
    stance = np.where(
        (np.arange(count) < 6)[:, None], [True, False, False, True], [False, True, True, False]
    )
    thrust = least_thrust(GRAVITY_IN_SLOPE, MASS, RATIO) + np.array([extra[0], 0.0, extra[1]])
    support = -MASS * GRAVITY_IN_SLOPE - thrust
    under = further - HEIGHT * support[0] / support[2]
    middle = SPEED * PERIOD * np.array([0.25, 0.75, 0.75, 0.25])
    foothold = np.zeros((4, 3))
    foothold[:, 0] = under + middle + np.array([0.2, 0.2, -0.2, -0.2])
    foothold[:, 1] = 0.14, -0.14, 0.14, -0.14
    c, s = math.cos(pitch), math.sin(pitch)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    zero = np.zeros((count, 3))
    position = np.column_stack([SPEED * time, 0.0 * time, HEIGHT + 0.0 * time])
    fields = {
        "slope": SLOPE, "speed": SPEED, "friction": 0.7, "friction_margin": 0.5,
        "thrust_mode": "vector", "gait": "climb", "period": PERIOD, "duty": 0.5,
        "touchdown_phase": np.array([0.0, 0.5, 0.5, 0.0]), "height": HEIGHT, "mass": MASS,
        "thrust_limit": 76.0, "center_of_mass": np.zeros(3), "time": time,
        "position": position, "rotation": np.tile(rotation, (count, 1, 1)),
        "velocity": zero + [SPEED, 0.0, 0.0], "angular_velocity": zero, "acceleration": zero,
        "angular_acceleration": zero, "foot_force": np.zeros((count, 4, 3)),
        "thrust": np.tile(thrust, (count, 1)), "stance": stance, "foothold": foothold,
        "mesh_error": MeshError(0.0, 0.0, 0.0, 0.0), "cost": 1.0,
    }  # fmt: skip
    return Plan(**{**fields, **changes})


def test_a_plan_of_the_statics_adds_nothing():
    reference = reference_of(steady_plan(), MASS, "vector", RATIO)
    np.testing.assert_allclose(reference.thrust_extra, 0.0, atol=1e-9)
    assert reference.shift_extra == pytest.approx(0.0, abs=1e-6)
    assert reference.pitch == pytest.approx(0.0, abs=1e-9)


def test_what_a_plan_does_beyond_the_statics_is_kept():
    plan = steady_plan(pitch=0.2, extra=(1.5, -0.5), further=0.03)
    reference = reference_of(plan, MASS, "vector", RATIO)
    np.testing.assert_allclose(reference.thrust_extra, (1.5, -0.5), atol=1e-9)
    assert reference.shift_extra == pytest.approx(0.03, abs=1e-6)
    assert reference.pitch == pytest.approx(0.2)


def test_a_plan_fades_away_from_its_slope():
    reference = reference_of(steady_plan(), MASS, "vector", RATIO)
    assert reference.weight(SLOPE) == 1.0
    assert reference.weight(SLOPE - 0.5 * REACH) == pytest.approx(0.5)
    assert reference.weight(0.0) == 0.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"thrust_mode": "body_z"}, "thrust_mode is 'body_z', the fans' is 'vector'"),
        ({"gait": "trot"}, "gait is 'trot', it must be climb"),
        ({"mass": 6.3}, "mass is 6.3 kg, the robot's 7.6 kg"),
    ],
)
def test_plans_for_another_robot_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        reference_of(steady_plan(**changes), MASS, "vector", RATIO)


def test_the_controller_says_what_it_takes_and_what_it_refuses():
    controller = Controller(load_robot(fans__mounting="vectoring"), warm_up=False)
    assert controller.take_plan(steady_plan()) == (True, "plan for 45 deg")
    accepted, message = controller.take_plan(steady_plan(gait="trot"))
    assert not accepted and "must be climb" in message
    assert controller.climbing.reference is not None  # of the plan before


def test_the_climb_follows_the_plan_on_its_slope():
    robot = load_robot(fans__mounting="vectoring")
    feet = np.array([[0.2, 0.14], [0.2, -0.14], [-0.2, 0.14], [-0.2, -0.14]])
    feet = np.column_stack([feet[:, 0] * math.cos(SLOPE), feet[:, 1], feet[:, 0] * math.sin(SLOPE)])
    normal = np.array([-math.sin(SLOPE), 0.0, math.cos(SLOPE)])
    results = []
    for plan in (None, steady_plan(extra=(1.5, -0.5), further=0.03)):
        climbing = Climbing(robot, Parameters())
        if plan is not None:
            climbing.follow(plan)
        climbing.begin(feet)
        climbing.incline.normals[:] = normal
        for _ in range(2000):
            climbing.tick(
                feet, np.ones(4, bool), np.zeros(4, bool), np.array([0.0, 1.0, 0.0]),
                np.zeros(2), math.inf, 0.002,
            )  # fmt: skip
        results.append((climbing.plane @ climbing.thrust, climbing.shift(HEIGHT)[0], climbing))
    (thrust, unplanned, statics), (planned, shift, climbing) = results
    np.testing.assert_allclose(planned - thrust, (1.5, 0.0, -0.5), atol=0.02)
    change = climbing.load_slope()[0] - statics.load_slope()[0]
    assert shift - unplanned == pytest.approx(0.03 - HEIGHT * change, abs=1e-3)
