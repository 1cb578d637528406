"""Statics of standing legs and lifting propellers against the forces that the feet then bear."""

import itertools

import numpy as np
import pytest

from husky_control.flight.knee_thrust import SingleRotors, edge_of, pair_thrusts, thrust_for_margin
from husky_control.modes.balance_steps import BESIDE, SPEED_SHARE, BalanceSteps, legs_of
from husky_control.modes.morph_postures import MorphPostures
from husky_control.posture import PEAK
from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry

ROBOT = load_robot("beta")
KINEMATICS = Kinematics(ROBOT)
WEIGHT = ROBOT.mass * GRAVITY
MARGIN = 0.04
"""Centre of pressure inside of the edge that is asked for [m]."""


def situation(joints, leg):
    """Feet, centre of mass, propellers and their axes in base, and the edge beside a leg."""
    feet, center = KINEMATICS.foot_positions(joints), KINEMATICS.center_of_mass(joints)
    geometry = rotor_geometry(ROBOT, joints)
    rotor = geometry.position + center
    return feet, center, rotor, geometry.axis, edge_of(feet, leg, center, rotor, geometry.axis)


def foot_loads(feet, standing, center, thrust, rotor, axis):
    """Vertical loads of standing feet (least squares) that hold weight and thrusts [N]."""
    force = thrust[:, None] * axis
    moment = np.cross(center, (0.0, 0.0, -WEIGHT)) + np.cross(rotor, force).sum(axis=0)
    # Friction holds what the thrusts push to the side, at the height of the feet.
    side = force.sum(axis=0)
    height = feet[list(standing), 2].mean()
    moment -= np.cross((0.0, 0.0, height), (side[0], side[1], 0.0))
    wanted = np.array((WEIGHT - side[2], -moment[0], -moment[1]))
    x, y = feet[list(standing), 0], feet[list(standing), 1]
    matrix = np.stack((np.ones(len(standing)), y, -x))
    loads, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    return loads


@pytest.mark.parametrize("leg", range(4))
@pytest.mark.parametrize("seed", range(5))
def test_thrust_puts_the_pressure_where_it_is_wanted(leg, seed):
    """The closed form against the loads of three feet; the propeller bears what they cannot."""
    random = np.random.default_rng(seed)
    joints = np.array(ROBOT.stand_joint_position) + random.normal(0.0, 0.05, 12)
    joints[3 * leg : 3 * leg + 3] = flight_posture(ROBOT)[3 * leg : 3 * leg + 3]
    feet, center, rotor, axis, edge = situation(joints, leg)
    standing = tuple(other for other in range(4) if other != leg)
    feet[:, 2] = feet[list(standing), 2].mean()  # as they stand on the ground
    edge = edge_of(feet, leg, center, rotor, axis)
    assert edge.inside < MARGIN  # feet alone would not hold it there
    thrust = np.zeros(4)
    thrust[leg] = thrust_for_margin(edge, leg, WEIGHT, MARGIN)
    loads = foot_loads(feet, standing, center, thrust, rotor, axis)
    pressure = loads @ feet[list(standing)] / loads.sum()
    assert float(edge.inward @ (pressure - feet[leg ^ 1])) == pytest.approx(MARGIN, abs=1e-6)
    assert edge.pressure(WEIGHT, thrust) == pytest.approx(MARGIN, abs=1e-9)
    assert loads.min() > 0.0
    weaker = 0.5 * thrust
    assert edge.pressure(WEIGHT, weaker) < MARGIN
    assert 0.0 < thrust[leg] < FanModel.of(ROBOT).max_thrust


def test_a_body_far_enough_inside_needs_no_thrust():
    joints = np.array(ROBOT.stand_joint_position)
    joints[:3] = flight_posture(ROBOT)[:3]
    *_, edge = situation(joints, 0)
    assert thrust_for_margin(edge, 0, WEIGHT, edge.inside - 0.01) == 0.0


@pytest.mark.parametrize("moment", [-1.2, -0.1, 0.0, 0.4, 1.5])
def test_two_propellers_share_a_moment_and_never_pull(moment):
    posture = flight_posture(ROBOT)
    joints = np.array(ROBOT.stand_joint_position)
    for leg in (0, 3):
        joints[3 * leg : 3 * leg + 3] = posture[3 * leg : 3 * leg + 3]
    *_, edge = situation(joints, 0)
    thrust = pair_thrusts(edge, 0, moment, (1.0, 1.0))
    assert edge.lever @ thrust == pytest.approx(moment, abs=1e-9)
    assert thrust[[0, 3]].min() >= 1.0 - 1e-12 and thrust[1] == thrust[2] == 0.0
    alone = pair_thrusts(edge, 0, moment, (1.0, 0.0))
    assert alone[3] == 0.0 and alone[0] >= 0.0


def test_a_wrench_that_the_mixer_turns_into_one_rotor():
    effect = rotor_geometry(ROBOT, flight_posture(ROBOT)).effectiveness(
        FanModel.of(ROBOT).moment_per_thrust
    )[2:]
    wanted = np.array((3.0, 0.0, 0.0, 1.5))
    force, moment = SingleRotors(ROBOT).wrench(wanted)
    np.testing.assert_allclose(np.linalg.solve(effect, (force, *moment)), wanted, atol=1e-9)


@pytest.mark.parametrize("choice", range(6))
def test_steps_hold_the_centre_of_mass_where_they_say(choice):
    legs = legs_of(choice)
    steps = BalanceSteps(ROBOT, MorphPostures(ROBOT)).plan(
        np.array(ROBOT.stand_joint_position), legs, 0.04, 0.01
    )
    for step in steps[1:]:
        *_, edge = situation(step.posture, legs[0])
        feet = KINEMATICS.foot_positions(step.posture)
        feet[list(step.lifted), 2] = feet[legs[0] ^ 1, 2]
        if not step.working:
            assert edge.inside == pytest.approx(BESIDE * ROBOT.leg_length, abs=2e-3)
        standing = [leg for leg in range(4) if leg not in step.lifted]
        start = KINEMATICS.foot_positions(steps[0].posture)[standing]
        moved = feet[standing] - start  # all alike: no foot slides
        np.testing.assert_allclose(moved, np.tile(moved[0], (len(standing), 1)), atol=1e-9)
    for before, step in itertools.pairwise(steps):
        fastest = np.abs(step.posture - before.posture).max() * PEAK / step.time
        assert fastest < SPEED_SHARE * ROBOT.joint_speed + 1e-9
    lifts = [len(step.lifted) for step in steps]
    assert lifts[0] == 0 and max(lifts) == len(legs)
    *_, last = situation(steps[-1].posture, legs[0])
    assert last.inside == pytest.approx(0.0 if len(legs) == 2 else -0.01, abs=2e-3)


@pytest.mark.parametrize(("choice", "last"), [(1, 1), (4, 5)])
def test_a_foot_that_touches_early_keeps_its_place_in_all_steps_before(choice, last):
    planner, leg = BalanceSteps(ROBOT, MorphPostures(ROBOT)), legs_of(choice)[-1]
    steps = planner.plan(np.array(ROBOT.stand_joint_position), legs_of(choice), 0.04, 0.01)
    steps = steps[: last + 1]
    higher = np.array((0.004, -0.002, 0.02))
    feet = KINEMATICS.foot_positions(steps[-1].posture)
    feet[leg] += higher
    own, touched = slice(3 * leg, 3 * leg + 3), steps[-1].posture.copy()
    touched[own] = KINEMATICS.joint_positions(feet)[own]
    changed = planner.standing_earlier(steps, leg, touched, 0.03)
    np.testing.assert_allclose(changed[-1].posture, touched, atol=1e-9)
    for step, before in zip(changed, steps, strict=True):
        way = KINEMATICS.foot_positions(step.posture) - KINEMATICS.foot_positions(before.posture)
        np.testing.assert_allclose(way[leg], higher, atol=1e-9)
        np.testing.assert_array_equal(np.delete(way, leg, axis=0), 0.0)
        assert step._replace(posture=before.posture) == before
    assert planner.standing_earlier(steps, leg, touched, 0.015) == []
    far = [*steps[:-1], steps[-1]._replace(posture=touched)]
    far[0] = steps[0]._replace(posture=np.zeros(12))  # straight legs: no foot may go lower
    touched = steps[-1].posture
    assert planner.standing_earlier(far, leg, touched, 0.03) == []
