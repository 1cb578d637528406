"""Footholds against hand-computed places."""

import math

import numpy as np
import pytest

from husky_control.gait.foothold import Approach, FootholdLaw, foothold_of, nominal_footholds
from husky_description.kinematics import leg_geometry
from husky_description.robot import load_robot

ROBOT = load_robot()
NOMINAL = [(0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)]


def place(**changes):
    """Return four footholds (4, 2) of a body at rest at the origin, but for the changes."""
    a = {
        "yaw": 0.0,
        "position": (0.0, 0.0),
        "velocity": (0.0, 0.0),
        "velocity_desired": (0.0, 0.0),
        "yaw_rate": 0.0,
        "remaining": 0.0,
        "reach": 0.3,
    } | changes
    approach = Approach(
        a["position"], a["velocity"], a["yaw"], a["velocity_desired"], a["yaw_rate"]
    )
    law = FootholdLaw(stance_time=0.2, velocity_gain=0.1, reach=a["reach"])
    return np.array([foothold_of(nominal, a["remaining"], approach, law) for nominal in NOMINAL])


def test_nominal_footholds_are_under_the_legs_and_spread_outward():
    feet = nominal_footholds(leg_geometry(ROBOT), -0.03, 0.04)
    # Hips at +-0.20, +-0.05, legs 0.05 further out; 0.03 inward along x, 0.04 outward along y.
    expected = [[0.17, 0.14], [0.17, -0.14], [-0.17, 0.14], [-0.17, -0.14]]
    np.testing.assert_allclose(feet, expected, atol=1e-12)


def test_at_rest_the_feet_come_down_at_their_nominal_places():
    np.testing.assert_allclose(
        place(position=(1.0, 2.0)), [[1.2, 2.1], [1.2, 1.9], [0.8, 2.1], [0.8, 1.9]]
    )


def test_at_the_desired_speed_a_foot_lands_half_a_stance_ahead_of_where_the_hip_will_be():
    # 0.6 m/s: 0.06 m until touchdown in 0.1 s, 0.06 m in half of 0.2 s; no velocity error.
    feet = place(velocity=(0.6, 0.0), velocity_desired=(0.6, 0.0), remaining=0.1)
    np.testing.assert_allclose(feet[0], [0.2 + 0.06 + 0.06, 0.1])


def test_a_push_moves_footholds_the_way_the_body_falls():
    # 0.5 m/s to the left that nobody asked for: 0.05 m until touchdown, 0.1 s x 0.5 m/s beyond.
    feet = place(velocity=(0.0, 0.5), remaining=0.1)
    np.testing.assert_allclose(feet[:, 1], [0.2, 0.0, 0.2, 0.0], atol=1e-12)


def test_a_braking_body_steps_ahead():
    # Wants 0, has 0.4 m/s: 0.04 m by the velocity error. Wants 0.4, has 0: 0.04 - 0.04 m.
    np.testing.assert_allclose(place(velocity=(0.4, 0.0))[0, 0], 0.2 + 0.04)
    np.testing.assert_allclose(place(velocity_desired=(0.4, 0.0))[0, 0], 0.2)


def test_heading_turns_the_nominal_places_only():
    feet = place(yaw=math.pi / 2, velocity=(0.5, 0.0), velocity_desired=(0.5, 0.0))
    np.testing.assert_allclose(feet[0], [-0.1 + 0.05, 0.2], atol=1e-12)


def test_a_turning_body_swings_its_hips_around():
    # 0.5 rad/s over 0.1 s and half of 0.2 s: 0.1 rad, to first order (-0.1 y, 0.1 x).
    feet = place(yaw_rate=0.5, remaining=0.1)
    np.testing.assert_allclose(feet[0], [0.2 - 0.1 * 0.1, 0.1 + 0.1 * 0.2])


@pytest.mark.parametrize("direction", np.linspace(0.0, 2 * np.pi, 8, endpoint=False))
def test_displacement_ends_at_the_reach_and_keeps_its_direction(direction):
    unit = np.array([np.cos(direction), np.sin(direction)])
    feet = place(velocity=tuple(10.0 * unit), reach=0.25)
    np.testing.assert_allclose(feet[0] - [0.2, 0.1], 0.25 * unit, atol=1e-12)
    just_below = place(velocity=tuple(2.4 * unit), reach=0.25)
    np.testing.assert_allclose(just_below[0] - [0.2, 0.1], 0.24 * unit, atol=1e-12)
