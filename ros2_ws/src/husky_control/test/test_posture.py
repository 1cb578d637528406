"""Postures and ways between them: minimum-jerk motion, from rest to rest on each way."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from husky_control.posture import TUCKED, PostureMove, Postures
from husky_description.kinematics import Kinematics
from husky_description.robot import load_robot

DT = 0.002
ROBOT = load_robot()
FEET = Kinematics(ROBOT).foot_positions


def ways_through(*postures):
    """Straight ways in joint space from one posture to the next."""
    return [np.stack(pair) for pair in pairwise(postures)]


def run(postures, durations):
    """Positions and velocities (ticks, 12) until the motion is done."""
    move = PostureMove()
    move.start(ways_through(*(np.full(12, p) for p in postures)), durations)
    position, velocity = [move.joint_position.copy()], [move.joint_velocity.copy()]
    for _ in range(round(sum(durations) / DT) + 5 * len(durations)):
        if move.done:
            break
        move.tick(DT)
        position.append(move.joint_position.copy())
        velocity.append(move.joint_velocity.copy())
    assert move.done
    return np.array(position), np.array(velocity)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.05, 3.0))
def test_it_goes_monotonously_from_rest_to_rest(start, end, duration):
    position, velocity = run([start, end], [duration])
    assert position[0, 0] == start
    assert position[-1] == pytest.approx(end, abs=1e-12)
    assert not velocity[0].any() and not velocity[-1].any()
    assert (np.diff(position, axis=0) * np.sign(end - start) >= -1e-12).all()
    # A minimum-jerk motion peaks at 15/8 of its mean speed.
    assert np.abs(velocity).max() <= 1.875 * abs(end - start) / duration + 1e-12


def test_velocity_is_the_slope_and_acceleration_begins_and_ends_at_zero():
    position, velocity = run([-0.4, 0.9], [2.0])
    slope = np.gradient(position[:, 0], DT)
    # Central differences: jerk peaks at 60 way / T^3, times dt^2 / 6.
    jerk = 60.0 * 1.3 / 2.0**3
    np.testing.assert_allclose(slope[1:-1], velocity[1:-1, 0], atol=jerk * DT**2)
    acceleration = np.diff(velocity[:, 0]) / DT
    assert abs(acceleration[0]) <= jerk * DT and abs(acceleration[-1]) <= jerk * DT
    # In the middle: half of the way, at the peak speed.
    assert position[500, 0] == pytest.approx(0.25)
    assert velocity[500, 0] == pytest.approx(1.875 * 1.3 / 2.0)


def test_it_rests_at_each_posture_on_its_way():
    position, velocity = run([0.0, 1.0, -1.0], [0.5, 1.0])
    there = int(np.argmin(np.abs(position[:, 0] - 1.0)))
    assert position[there] == pytest.approx(1.0, abs=1e-12)
    assert not velocity[there].any()
    assert there * DT == pytest.approx(0.5, abs=DT)


def test_progress_and_the_way_tell_where_it_is():
    move = PostureMove()
    assert move.done and move.on_last_way and not move.on_first_way and move.progress == 1.0
    move.start(ways_through(np.zeros(12), np.ones(12), np.zeros(12)), [0.1, 0.2])
    assert not move.done and move.on_first_way and not move.on_last_way and move.progress == 0.0
    for _ in range(25):
        move.tick(DT)
    assert move.progress == pytest.approx(0.5)
    for _ in range(26):
        move.tick(DT)
    assert move.on_last_way and not move.on_first_way and not move.done
    for _ in range(101):
        move.tick(DT)
    assert move.done and move.progress == 1.0
    held = move.joint_position.copy()
    move.tick(DT)
    np.testing.assert_array_equal(move.joint_position, held)
    assert not move.joint_velocity.any()


def test_the_way_does_not_follow_the_caller_s_array():
    way = np.stack((np.zeros(12), np.ones(12)))
    move = PostureMove()
    move.start([way], [1.0])
    way.fill(99.0)
    move.tick(DT)
    assert np.abs(move.joint_position).max() < 1e-6


def test_ways_and_durations_must_agree():
    with pytest.raises(ValueError, match="2 ways need as many durations, not 1"):
        PostureMove().start([np.zeros((2, 12))] * 2, [1.0])


@pytest.mark.parametrize("spread", [0.0, 0.04, 0.15])
def test_feet_stay_at_their_places_while_the_body_rises(spread):
    postures = Postures(ROBOT)
    stand = postures.stand(spread, 0.0)
    place = FEET(ROBOT.stand_joint_position)
    place[:, 1] += np.sign(place[:, 1]) * spread
    np.testing.assert_allclose(FEET(stand), place, atol=1e-9)
    tucked, low = postures.low(stand, TUCKED), postures.low(stand)
    np.testing.assert_allclose(FEET(low)[:, 2], -ROBOT.sit_height, atol=1e-9)
    np.testing.assert_allclose(FEET(tucked) - FEET(low), [[0.0, 0.0, TUCKED]] * 4, atol=1e-9)

    move, heights = PostureMove(), []
    move.start([postures.straight(tucked, low), postures.straight(low, stand)], [0.2, 1.5])
    while not move.done:
        move.tick(DT)
        feet = FEET(move.joint_position)
        # Between the knots of the way feet leave the straight line by little.
        np.testing.assert_allclose(feet[:, :2], place[:, :2], atol=1e-3)
        heights.append(feet[0, 2])
    assert np.argmax(heights) == 0 and heights[-1] == pytest.approx(place[0, 2])
    np.testing.assert_allclose(move.joint_position, stand, atol=1e-12)


def test_a_straight_way_begins_and_ends_as_told_even_where_knees_bend_the_other_way():
    postures = Postures(ROBOT)
    odd = -ROBOT.stand_joint_position
    way = postures.straight(odd, postures.low(odd))
    np.testing.assert_allclose(way[0], odd, atol=1e-12)
    np.testing.assert_allclose(way[-1], postures.low(odd), atol=1e-12)
    # No jump on the way either.
    assert np.abs(np.diff(way, axis=0)).max() < 0.6


@given(st.lists(st.floats(0.0, 1.0), min_size=12, max_size=12))
def test_there_is_a_way_down_from_any_posture(shares):
    start = ROBOT.joint_lower + np.array(shares) * (ROBOT.joint_upper - ROBOT.joint_lower)
    ways = Postures(ROBOT).ways_down(start)
    np.testing.assert_allclose(ways[0][0], start, atol=1e-12)
    np.testing.assert_allclose(ways[-1][-1], ROBOT.sit_joint_position, atol=1e-9)
    for way, following in pairwise(ways):
        np.testing.assert_allclose(way[-1], following[0], atol=1e-9)


def test_legs_stretched_out_to_the_side_are_gathered_at_once():
    start = np.array([1.4, 0.0, 0.0, -1.4, 0.0, 0.0] * 2) * np.sign(ROBOT.lateral_offset[0])
    assert len(Postures(ROBOT).ways_down(start)) == 1


def test_crouching_feet_stand_wider_than_sitting_ones():
    postures = Postures(ROBOT)
    feet, sit = FEET(postures.crouch()), FEET(ROBOT.sit_joint_position)
    assert (np.abs(feet[:, :2]) > np.abs(sit[:, :2])).all()
    np.testing.assert_allclose(feet[:, 2], sit[:, 2], atol=1e-9)
