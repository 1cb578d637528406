"""Mixer of rotors that stand anywhere: against least squares and linear programmes."""

import math

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from husky_description.robot import load_robot
from husky_description.rotor_geometry import flight_posture, rotor_geometry
from husky_pu.autopilot.airframe import airframe_parameters
from husky_pu.autopilot.flight_parameters import FlightParameters
from husky_pu.autopilot.weighted_mixer import WeightedMixer
from husky_pu.autopilot.weighted_mixer import mixer_of as any_mixer_of

ROBOT = load_robot("beta")
FLIGHT = flight_posture(ROBOT)
MIXER = WeightedMixer(ROBOT, rotor_geometry(ROBOT, FLIGHT))
WEIGHT = ROBOT.mass * 9.80665
POSTURES = st.lists(st.floats(-0.25, 0.25), min_size=12, max_size=12)


def mixer_of(offsets):
    geometry = rotor_geometry(ROBOT, FLIGHT + np.array(offsets))
    try:
        return WeightedMixer(ROBOT, geometry)
    except ValueError:  # of one posture in two thousand: there, an axis comes with others
        rows = geometry.effectiveness(MIXER.fan.moment_per_thrust)[2:]
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        assert np.linalg.svd(rows, compute_uv=False)[-1] < 0.02
        reject()


@settings(max_examples=60, deadline=None)
@given(POSTURES, st.lists(st.floats(0.0, 10.0), min_size=4, max_size=4))
def test_what_fits_is_given_exactly_as_least_squares_gives_it(offsets, thrust):
    mixer = mixer_of(offsets)
    collective, moment = mixer.wrench(thrust)
    found = mixer.allocate(collective, moment)
    matrix = rotor_geometry(ROBOT, FLIGHT + np.array(offsets)).effectiveness(
        mixer.fan.moment_per_thrust
    )[2:]
    nearest, *_ = np.linalg.lstsq(matrix, np.array((collective, *moment)), rcond=None)
    np.testing.assert_allclose(found, nearest, atol=1e-8)
    np.testing.assert_allclose(found, thrust, atol=1e-8)


@settings(max_examples=60, deadline=None)
@given(POSTURES, st.floats(0.0, 60.0), st.tuples(*[st.floats(-2.0, 2.0)] * 2, st.floats(-0.3, 0.3)))
def test_roll_and_pitch_are_kept_as_far_as_any_thrusts_keep_them(offsets, collective, moment):
    mixer = mixer_of(offsets)
    full = mixer.thrust_limit()
    found = mixer.allocate(collective, moment)
    assert np.all(found >= 0.0) and np.all(found <= full)
    rows = mixer.effectiveness
    wanted = np.array(moment)
    missed = np.abs((rows[1:3] @ found - wanted[:2]) / mixer.moment_scale[:2]).max()
    best = linprog(  # least greatest miss of roll and pitch within the limits
        [0, 0, 0, 0, 1],
        A_ub=np.vstack(
            [
                np.append(sign * rows[axis] / mixer.moment_scale[axis - 1], -1.0)
                for axis in (1, 2)
                for sign in (1, -1)
            ]
        ),
        b_ub=[
            sign * wanted[axis - 1] / mixer.moment_scale[axis - 1]
            for axis in (1, 2)
            for sign in (1, -1)
        ],
        bounds=[(0.0, full)] * 4 + [(0.0, None)],
    )
    assert missed <= 1.5 * best.fun + 0.01


def test_collective_and_yaw_give_way_before_roll():
    roll = 0.9 * MIXER.moment_scale[0]
    found = MIXER.allocate(1.2 * MIXER.max_collective, (roll, 0.0, MIXER.moment_scale[2]))
    _, moment = MIXER.wrench(found)
    np.testing.assert_allclose(moment[:2], [roll, 0.0], atol=2e-3 * roll)


def test_without_rise_moments_do_not_lift():
    found = MIXER.allocate(4.0, (MIXER.moment_scale[0], 0.0, 0.0), rise=0.0)
    collective, moment = MIXER.wrench(found)
    assert collective == pytest.approx(4.0, abs=0.02)
    assert 0.0 < moment[0] < MIXER.moment_scale[0]


def test_three_rotors_carry_collective_roll_and_pitch():
    """The one opposite to the lost one rests, the other two carry half the weight each."""
    found = MIXER.allocate(20.0, (0.0, 0.0, 0.0), available=[False, True, True, True])
    np.testing.assert_allclose(found, [0.0, 10.0, 10.0, 0.0], atol=0.1)
    assert MIXER.allocate(20.0, (0, 0, 0), available=[False, True, True, False]).sum() == 0.0


def test_hover_is_half_of_full_thrust():
    """Thrust over weight, 1.6 to 2.0."""
    assert 1.6 < MIXER.max_collective / WEIGHT < 2.0
    hover = MIXER.allocate(WEIGHT, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(hover.sum(), WEIGHT)
    np.testing.assert_allclose(hover, WEIGHT / 4.0, rtol=0.02)


def test_rotors_that_stand_on_a_line_are_refused():
    standing = rotor_geometry(ROBOT, ROBOT.stand_joint_position)  # they push sideways
    with pytest.raises(ValueError, match=r"do not come apart|no lever"):
        WeightedMixer(ROBOT, standing)


class SixFans:
    """The mixer of a made-up robot's fans, and what thrusts within the limits can do."""

    def __init__(self):
        rotors = {
            "nose": {"x": 0.2, "y": 0.0, "spin": 1.0},
            "front_left": {"x": 0.1, "y": 0.15, "spin": -1.0},
            "front_right": {"x": 0.1, "y": -0.15, "spin": 1.0},
            "hind_left": {"x": -0.12, "y": 0.15, "spin": 1.0},
            "hind_right": {"x": -0.12, "y": -0.15, "spin": -1.0},
            "tail": {"x": -0.22, "y": 0.0, "spin": -1.0},
        }
        self.mixer = any_mixer_of(load_robot(fans__rotors=rotors))
        assert self.mixer.names == tuple(rotors)

    def greatest(self, left, rows, demand):
        """Greatest collective of the fans left with given moments about some axes."""
        effect = self.mixer.effectiveness
        full = self.mixer.thrust_limit()
        bounds = [(0.0, full if there else 0.0) for there in left]
        found = linprog(-effect[0], A_eq=effect[rows], b_eq=demand, bounds=bounds)
        return -found.fun if found.status == 0 else None


SIX = SixFans()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.0, 20.0), min_size=6, max_size=6))
def test_what_some_thrusts_of_six_fans_make_is_made(thrust):
    collective, moment = SIX.mixer.wrench(thrust)
    found = SIX.mixer.allocate(collective, moment)
    assert np.all(found >= 0.0) and np.all(found <= SIX.mixer.thrust_limit())
    again, moment_again = SIX.mixer.wrench(found)
    assert again == pytest.approx(collective, abs=1e-4)
    np.testing.assert_allclose(moment_again, moment, atol=1e-5)


@pytest.mark.parametrize("lost", [(0,), (1,), (2,), (5,), (0, 5), (1, 4), (0, 3)])
def test_fans_that_are_left_carry_what_they_can_level_before_they_hold_yaw(lost):
    left = [fan not in lost for fan in range(6)]
    most = SIX.greatest(left, [1, 2], [0.0, 0.0])
    assert most > 30.0
    assert SIX.mixer.greatest_collective(available=left) == pytest.approx(most, rel=1e-4)
    found = SIX.mixer.allocate(0.9 * most, (0.0, 0.0, 0.0), available=left)
    collective, moment = SIX.mixer.wrench(found)
    assert collective == pytest.approx(0.9 * most, rel=1e-4)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-4)
    assert not any(found[list(lost)])
    with_yaw = SIX.greatest(left, [1, 2, 3], [0.0] * 3)
    if with_yaw is not None and with_yaw > 0.9 * most:
        assert abs(moment[2]) < 1e-4


def test_two_of_six_fans_carry_nothing():
    left = [True, False, False, False, False, True]
    assert not SIX.mixer.allocate(30.0, (0.0, 0.0, 0.0), available=left).any()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="not finite"):
        MIXER.allocate(bad, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(("fans", "kind"), [(4, 2), (5, 2), (6, 13), (8, 14)])
def test_the_heartbeat_says_what_kind_of_craft_it_is(fans, kind):
    more = [("nose", 0.2, 1.0), ("tail", -0.2, -1.0), ("beak", 0.35, -1.0), ("sting", -0.35, 1.0)]
    rotors = {name: dict(vars(rotor)) for name, rotor in load_robot().fans.rotors.items()}
    rotors |= {name: {"x": x, "y": 0.0, "spin": spin} for name, x, spin in more[: fans - 4]}
    parameters = FlightParameters(airframe_parameters(load_robot(fans__rotors=rotors)))
    assert parameters["MAV_TYPE"] == kind
