"""Stance: feet that keep their places in the world, weights that balance the body."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.gait.stance import (
    FeetInGround,
    Load,
    ReferenceBody,
    Rolling,
    distribute_weight,
    foot_targets,
    internal_load,
)
from husky_control.gait.state import BodyInGround
from husky_description.kinematics import FootTargets, JointTargets, Kinematics
from husky_description.robot import load_robot

ROBOT = load_robot()
STAND = np.array(ROBOT.stand_joint_position)
FEET = Kinematics(ROBOT).foot_positions(STAND)
DT = 0.002
WEIGHT = 7.6 * 9.80665


def targets(swinging=(False,) * 4, **changes):
    """Foot targets and velocities of a body that stands at the origin, but for the changes."""
    a = {
        "rotation": np.eye(3),
        "desired": np.eye(3),
        "position": np.zeros(3),
        "velocity": np.zeros(3),
        "angular": np.zeros(3),
        "reference": np.zeros(3),
        "reference_velocity": np.zeros(3),
        "yaw_rate": 0.0,
        "radius": 0.0,
        "joint_velocity": np.zeros(12),
        "anchor": FEET.copy(),
        "swing_position": FEET.copy(),
        "swing_velocity": np.zeros((4, 3)),
        "blend": np.zeros((4, 3)),
        "decay": 0.9,
    } | changes
    feet = FootTargets(*np.zeros((3, 4, 3)))
    foot_targets(
        FeetInGround(
            np.array(swinging), a["anchor"], a["blend"], a["swing_position"], a["swing_velocity"]
        ),
        BodyInGround(a["rotation"], a["angular"], a["position"], a["velocity"]),
        ReferenceBody(a["desired"], a["reference"], a["reference_velocity"], a["yaw_rate"]),
        JointTargets(STAND, a["joint_velocity"], np.zeros(12)),
        Rolling(a["radius"], a["decay"], DT),
        feet,
    )
    return feet.position, feet.velocity


def random_rotation(seed, most=0.3):
    random = np.random.default_rng(seed)
    return Rotation.from_rotvec(random.uniform(-most, most, 3)).as_matrix()


@pytest.mark.parametrize("seed", range(3))
def test_stance_targets_take_the_desired_attitude(seed):
    desired, moved = random_rotation(seed), np.array([0.03, -0.02, 0.01])
    tilted, _ = targets(rotation=random_rotation(seed + 9), desired=desired, reference=moved)
    np.testing.assert_allclose(tilted, (FEET - moved) @ desired, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_swing_targets_take_the_measured_attitude(seed):
    rotation, moved = random_rotation(seed), np.array([0.03, -0.02, 0.01])
    target, _ = targets(
        (True,) * 4, rotation=rotation, desired=random_rotation(seed + 9), position=moved
    )
    np.testing.assert_allclose(moved + target @ rotation.T, FEET, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_swing_velocities_are_the_slopes_of_the_targets(seed):
    """A body that moves and turns, and feet that move: finite differences in the base."""
    random = np.random.default_rng(seed)
    rotation, angular = random_rotation(seed), random.uniform(-2.0, 2.0, 3)
    velocity, foot_velocity = random.uniform(-1.0, 1.0, 3), random.uniform(-1.0, 1.0, (4, 3))

    def at(time):
        turned = rotation @ Rotation.from_rotvec(angular * time).as_matrix()
        return targets(
            (True,) * 4, rotation=turned, angular=angular, position=velocity * time,
            velocity=velocity, swing_position=FEET + foot_velocity * time,
            swing_velocity=foot_velocity,
        )

    step = 1e-5
    slope = (at(step)[0] - at(-step)[0]) / (2 * step)
    np.testing.assert_allclose(at(0.0)[1], slope, atol=1e-8)


@pytest.mark.parametrize("yaw", [0.0, 0.8])
def test_stance_velocities_are_the_slopes_of_the_targets(yaw):
    velocity, yaw_rate = np.array([0.5, -0.1, 0.05]), 0.6

    def at(time):
        return targets(
            desired=Rotation.from_euler("z", yaw + yaw_rate * time).as_matrix(),
            reference=velocity * time, reference_velocity=velocity, yaw_rate=yaw_rate,
        )

    step = 1e-5
    slope = (at(step)[0] - at(-step)[0]) / (2 * step)
    np.testing.assert_allclose(at(0.0)[1], slope, atol=1e-8)


def test_a_stance_foot_rolls_on_its_sphere():
    anchor, rates = FEET.copy(), np.zeros(12)
    rates[1::3] = 2.0  # the shins pitch at 2 rad/s: a wheel rolls forward at radius times that
    _, rate = targets(radius=0.015, joint_velocity=rates, anchor=anchor)
    np.testing.assert_allclose(anchor - FEET, np.tile([0.03 * DT, 0.0, 0.0], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(rate, np.tile([0.03, 0.0, 0.0], (4, 1)), atol=1e-12)


def test_the_step_at_touchdown_dies_out():
    blend = np.tile([0.01, 0.0, -0.005], (4, 1))
    first, _ = targets(blend=blend)
    np.testing.assert_allclose(first - FEET, np.tile([0.009, 0.0, -0.0045], (4, 1)), atol=1e-12)
    for _ in range(200):
        last, _ = targets(blend=blend)
    np.testing.assert_allclose(last, FEET, atol=1e-9)


# ---------------------------------------------------------------------- weight


def weigh(share, center=(0.0, 0.0, 0.0), rotation=None, moment=(0.0, 0.0), most=1e3, force=WEIGHT):
    """Forces (4, 3) N in world, and the feet relative to the centre of mass in world."""
    matrix = np.eye(3) if rotation is None else rotation
    out = np.zeros((4, 3))
    load = Load(force, *moment, most)
    distribute_weight(FEET, np.array(center), np.array(share, float), matrix, load, out)
    return out @ matrix.T, (FEET - center) @ matrix.T


# The distribution trades a little of weight and moment against small forces on feet that could not
# make them. SOFT is what it may let go of: a few hundredths of the weight, and of a moment about
# one axis 2e-3 m^2 beside the mean square arm of the feet, 0.1^2 or 0.2^2 m^2.
SOFT = 0.05


def test_four_feet_share_alike_under_a_centred_body():
    force, _ = weigh((1, 1, 1, 1))
    np.testing.assert_allclose(force[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(force[:, 2], force[0, 2], rtol=1e-9)
    assert (1.0 - SOFT) * WEIGHT <= force[:, 2].sum() <= WEIGHT


@pytest.mark.parametrize("pair", [(1, 0, 0, 1), (0, 1, 1, 0)])
def test_a_diagonal_carries_a_centred_body(pair):
    force, _ = weigh(pair)
    carrying = np.flatnonzero(pair)
    assert not np.delete(force, carrying, axis=0).any()
    assert force[carrying[0], 2] == pytest.approx(force[carrying[1], 2])
    assert (1.0 - SOFT) * WEIGHT <= force[:, 2].sum() <= WEIGHT


@settings(max_examples=50)
@given(st.floats(-0.06, 0.06), st.floats(-0.03, 0.03), st.integers(0, 50))
def test_forces_are_vertical_and_carry_and_balance_a_tilted_body(x, y, seed):
    rotation = random_rotation(seed, 0.1)
    force, feet = weigh((1, 1, 1, 1), (x, y, 0.0), rotation)
    np.testing.assert_allclose(force[:, :2], 0.0, atol=1e-9)
    alike = np.cross(feet, np.tile([0.0, 0.0, WEIGHT / 4], (4, 1))).sum(axis=0)
    if np.abs(alike[:2] / (4 * np.array([0.1, 0.2]))).max() < WEIGHT / 8:  # none at its limit of 0
        moment = np.cross(feet, force).sum(axis=0)
        assert np.linalg.norm(moment[:2]) <= 0.5 * np.linalg.norm(alike[:2]) + 1e-9
        assert (1.0 - 4 * SOFT) * WEIGHT <= force[:, 2].sum() <= WEIGHT * (1.0 + SOFT)


@pytest.mark.parametrize(("moment", "axis"), [((2.0, 0.0), 0), ((0.0, 2.0), 1)])
def test_moments_that_are_asked_for_are_nearly_made(moment, axis):
    force, feet = weigh((1, 1, 1, 1), moment=moment)
    made = np.cross(feet, force).sum(axis=0)
    arm = 0.1 if axis == 0 else 0.2
    assert arm**2 / (arm**2 + 2e-3) - SOFT <= made[axis] / 2.0 <= 1.0
    assert made[1 - axis] == pytest.approx(0.0, abs=1e-6)
    assert force[:, 2].sum() == pytest.approx(weigh((1, 1, 1, 1))[0][:, 2].sum())


def test_a_diagonal_does_not_try_what_it_cannot():
    """Two feet make no moment about their own line; forces stay as they are."""
    line = FEET[0, :2] - FEET[3, :2]
    asked = 3.0 * line / np.linalg.norm(line)
    force, _ = weigh((1, 0, 0, 1), moment=tuple(asked))
    np.testing.assert_allclose(force, weigh((1, 0, 0, 1))[0], atol=1e-6)


def test_feet_never_pull_nor_carry_more_than_most():
    force, _ = weigh((1, 1, 1, 1), moment=(200.0, 0.0), most=30.0)
    assert (force[:, 2] >= 0.0).all() and (force[:, 2] <= 30.0).all()
    assert force[:, 2].max() == pytest.approx(30.0)


def test_a_partly_loaded_foot_carries_less_and_none_carries_nothing():
    force, _ = weigh((0.2, 1, 1, 1))
    assert force[0, 2] < 0.5 * force[1, 2]
    assert not weigh((0, 0, 0, 0))[0].any()


# -------------------------------------------------------------- internal load


@settings(max_examples=50)
@given(st.lists(st.floats(-20.0, 20.0), min_size=4, max_size=4), st.integers(0, 20))
def test_internal_load_is_the_part_of_the_error_that_moves_nothing(error, seed):
    feet = FEET + np.random.default_rng(seed).uniform(-0.05, 0.05, (4, 3))
    measured, desired, load = np.zeros((4, 3)), np.zeros((4, 3)), np.empty(4)
    desired[:, 2] = WEIGHT / 4
    measured[:, 2] = desired[:, 2] + error
    internal_load(feet, measured, desired, load)
    # The projection of the error on the null space of sum f, sum x f, sum y f, by SVD.
    carried = np.vstack((np.ones(4), feet[:, 0], feet[:, 1]))
    null = np.linalg.svd(carried)[2][3]
    np.testing.assert_allclose(load, null * (null @ error), atol=1e-8)
    np.testing.assert_allclose(carried @ load, 0.0, atol=1e-8)
