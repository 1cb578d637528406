"""Postures: minimum-jerk motion, from rest to rest through each of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_control.posture import PostureMove

DT = 0.002


def run(postures, durations):
    """Positions and velocities (ticks, 12) until the motion is done."""
    move = PostureMove()
    move.start([np.full(12, p) for p in postures], durations)
    position, velocity = [move.joint_position.copy()], [move.joint_velocity.copy()]
    for _ in range(round(sum(durations) / DT) + 5 * len(durations)):
        if move.done:
            break
        move.tick(DT)
        position.append(move.joint_position.copy())
        velocity.append(move.joint_velocity.copy())
    assert move.done
    return np.array(position), np.array(velocity)


@settings(deadline=None)
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


def test_progress_and_last_leg_tell_where_it_is():
    move = PostureMove()
    assert move.done and move.last_leg_of_the_way and move.progress == 1.0
    move.start([np.zeros(12), np.ones(12), np.zeros(12)], [0.1, 0.2])
    assert not move.done and not move.last_leg_of_the_way and move.progress == 0.0
    for _ in range(25):
        move.tick(DT)
    assert move.progress == pytest.approx(0.5)
    for _ in range(26):
        move.tick(DT)
    assert move.last_leg_of_the_way and not move.done
    for _ in range(101):
        move.tick(DT)
    assert move.done and move.progress == 1.0
    held = move.joint_position.copy()
    move.tick(DT)
    np.testing.assert_array_equal(move.joint_position, held)
    assert not move.joint_velocity.any()


def test_the_start_does_not_follow_the_caller_s_array():
    start = np.zeros(12)
    move = PostureMove()
    move.start([start, np.ones(12)], [1.0])
    start.fill(99.0)
    move.tick(DT)
    assert np.abs(move.joint_position).max() < 1e-6


def test_postures_and_durations_must_agree():
    with pytest.raises(ValueError, match="3 postures need 2 durations"):
        PostureMove().start([np.zeros(12)] * 3, [1.0])
