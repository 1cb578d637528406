"""The path of a swing foot: ends, height, continuity, late descent."""

import numpy as np
import pytest

from husky_control.gait.swing import SHORTEST_REPLAN, SwingPaths, SwingShape, swing_feet

DT = 0.002
START = np.array([0.1, -0.2, 0.02])
GOAL = np.array([0.35, -0.15])
GROUND = 0.015
HEIGHT = 0.08
SPEED, DEPTH = 0.35, 0.05


def swing(time, goal=lambda s: GOAL, overtime=0.0, ground=GROUND):
    """Positions and velocities (ticks, 3) of one leg through a swing, and of a leg that stands."""
    swinging = np.array([True, False, False, False])
    start, foothold, position = np.tile(START, (3, 4, 1))
    velocity = np.zeros((4, 3))
    paths = SwingPaths(start, foothold, position, velocity)
    shape = SwingShape(time, HEIGHT, SPEED, DEPTH)
    path, rates = [position[0].copy()], [velocity[0].copy()]
    ticks = round(time / DT)
    for tick in range(1, ticks + 1 + round(overtime / DT)):
        s = min(1.0, tick / ticks)
        foothold[:] = (*goal(s), ground)
        swing_feet(swinging, np.array([s, -1.0, -1.0, -1.0]), paths, shape, DT)
        path.append(position[0].copy())
        rates.append(velocity[0].copy())
    assert (position[1:] == START).all() and not velocity[1:].any(), "a standing foot was moved"
    return np.array(path), np.array(rates)


@pytest.mark.parametrize("time", [0.12, 0.17, 0.48])
def test_the_foot_comes_to_rest_at_the_foothold(time):
    path, rates = swing(time)
    # The last SHORTEST_REPLAN of the plan is stretched, never to be ended: the rest of a cubic
    # whose remaining time stays at 0.03 s is the share (0.03 / T)^2 of the way, times three.
    way = np.linalg.norm(GOAL - START[:2])
    miss = np.linalg.norm(path[-1, :2] - GOAL)
    assert miss <= 3.0 * (SHORTEST_REPLAN / time) ** 2 * way
    assert np.linalg.norm(rates[-1, :2]) < 0.5 * np.linalg.norm(rates[:, :2], axis=1).max()


def test_with_more_time_the_foot_settles_on_the_foothold():
    path, rates = swing(0.17, overtime=0.3)
    np.testing.assert_allclose(path[-1, :2], GOAL, atol=1e-4)
    np.testing.assert_allclose(rates[-1, :2], 0.0, atol=1e-3)


def test_a_plan_that_is_made_anew_is_the_cubic_it_began_as():
    time = 0.48
    path, _ = swing(time)
    ticks = round(time / DT)
    s = np.arange(ticks + 1) / ticks
    cubic = START[0] + (GOAL[0] - START[0]) * s * s * (3.0 - 2.0 * s)
    early = s < 1.0 - 2.0 * SHORTEST_REPLAN / time
    # The replanned path steps explicitly: the first-order error is of the size of one tick's way.
    assert np.abs(path - cubic[:, None])[early, 0].max() < 2 * 1.5 * (GOAL[0] - START[0]) / ticks


@pytest.mark.parametrize("time", [0.12, 0.17, 0.48])
def test_the_foot_rises_by_the_swing_height_over_the_line_and_lands_on_the_ground(time):
    path, rates = swing(time)
    ticks = len(path) - 1
    assert path[-2:, 2] == pytest.approx(GROUND, abs=HEIGHT * 16 * (1 / ticks) ** 2 + 1e-3)
    middle = 0.5 * (START[2] + GROUND) + HEIGHT
    assert path[:, 2].max() == pytest.approx(middle, abs=1e-3)
    assert abs(int(path[:, 2].argmax()) - ticks / 2) <= 2
    slope = np.gradient(path[:-1, 2], DT)
    # The velocity is the slope of the path: central differences, jerk x dt^2 / 6.
    np.testing.assert_allclose(slope[1:-1], rates[1:-2, 2], atol=3e-2 * np.abs(rates[:, 2]).max())


def test_path_and_velocity_are_continuous_although_the_foothold_jumps():
    other = GOAL + [0.05, -0.04]
    path, rates = swing(0.17, lambda s: GOAL if s < 0.5 else other)
    steps = np.abs(np.diff(path, axis=0))
    assert steps[:, :2].max() < 0.015  # 7 m/s would be
    # A jump of e asks for 6 e / T_remaining^2, no more than with SHORTEST_REPLAN.
    most = 6.0 * np.linalg.norm(other - START[:2]) / SHORTEST_REPLAN**2
    assert (np.abs(np.diff(rates[:, :2], axis=0)) / DT).max() < most
    late, _ = swing(0.17, lambda s: GOAL if s < 0.5 else other, overtime=0.3)
    np.testing.assert_allclose(late[-1, :2], other, atol=1e-4)


def test_a_late_foot_reaches_down_at_its_speed_and_no_further_than_the_depth():
    path, rates = swing(0.17, overtime=0.3)
    first = round(0.17 / DT)
    falling = np.diff(path[first + 1 : first + 40, 2]) / DT
    np.testing.assert_allclose(falling, -SPEED, atol=1e-9)
    lowest = path[:, 2].min()
    assert GROUND - DEPTH - SPEED * DT - 1e-12 <= lowest <= GROUND - DEPTH
    assert rates[-1, 2] == 0.0
