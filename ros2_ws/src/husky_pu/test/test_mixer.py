"""Mixer against linear programmes, least squares and the settled unit."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from husky_description.robot import load_robot
from husky_pu.autopilot.mixer import Mixer
from husky_sim.propulsion.propulsion_figures import armed_unit

ROBOT = load_robot()
MIXER = Mixer(ROBOT)
FULL = MIXER.thrust_limit()
B = MIXER.effectiveness
SIDES = (("left", 1.0), ("right", -1.0))
COLLECTIVE = st.floats(-10.0, 120.0)
MOMENT = st.tuples(st.floats(-12, 12), st.floats(-12, 12), st.floats(-1.5, 1.5))
RISE = st.one_of(st.just(math.inf), st.floats(0.0, 60.0))


def test_scales_are_the_reach_of_the_fans():
    assert MIXER.max_collective == pytest.approx(80.0)
    np.testing.assert_allclose(MIXER.moment_scale[:2], [0.135 * 40, 0.120 * 40])
    for axis in range(3):  # at half the collective each is just carried, by fans at none or full
        moment = np.zeros(3)
        moment[axis] = MIXER.moment_scale[axis]
        thrust = MIXER.allocate(40.0, moment)
        np.testing.assert_allclose(np.sort(thrust), [0, 0, FULL, FULL], atol=1e-9)
        np.testing.assert_allclose(MIXER.wrench(thrust)[1], moment, atol=1e-9)
        beyond = MIXER.wrench(MIXER.allocate(40.0, 1.2 * moment))[1]
        np.testing.assert_allclose(beyond, moment, atol=1e-9)


@pytest.mark.parametrize("fan", range(4))
def test_forward_map_is_what_the_unit_settles_at(fan):
    pwm = np.full(4, 1500.0)
    pwm[fan] = 1700.0
    unit = armed_unit(ROBOT)
    for _ in range(1600):
        unit.step(pwm, 0.0005)
    collective, moment = MIXER.wrench(unit.thrust)
    assert unit.wrench_in_base[2] == pytest.approx(collective)
    np.testing.assert_allclose(unit.wrench_in_base[3:], moment, atol=2e-4)
    steady = MIXER.steady_thrust(pwm, unit.battery_voltage)
    np.testing.assert_allclose(unit.thrust, steady, rtol=2e-3)


@given(st.lists(st.floats(0.0, 20.0), min_size=4, max_size=4))
def test_what_fits_is_given_exactly(thrust):
    collective, moment = MIXER.wrench(thrust)
    np.testing.assert_allclose(MIXER.allocate(collective, moment), thrust, atol=1e-9)


def greatest(fixed, moving, full, total, rise):
    """Greatest share of `moving` [moments] beside `fixed` within the fans' box."""
    result = linprog(
        [0, 0, 0, 0, -1],
        A_eq=np.column_stack((B[1:], -moving)),
        b_eq=fixed,
        A_ub=[[1, 1, 1, 1, 0]],
        b_ub=[total + rise if math.isfinite(rise) else 1e6],
        bounds=[(0, full)] * 4 + [(0, 1)],
        method="highs",
    )
    assert result.status == 0
    return result.x[4]


@settings(max_examples=150)
@given(COLLECTIVE, MOMENT, RISE, st.sampled_from([18.0, 22.2, 24.0]))
def test_four_fans_keep_tilt_then_yaw_then_collective(collective, moment, rise, voltage):
    full, total = MIXER.thrust_limit(voltage), max(collective, 0.0)
    assume(total > 0.01 or rise > 0.01)
    tilt, yaw = np.array([moment[0], moment[1], 0.0]), np.array([0.0, 0.0, moment[2]])
    share = greatest(np.zeros(3), tilt, full, total, rise)
    # a millionth less: the solver is exact to 1e-7
    share_of_yaw = greatest(share * (1 - 1e-6) * tilt, yaw, full, total, rise)
    reached = share * tilt + share_of_yaw * yaw
    thrust = MIXER.allocate(collective, moment, voltage, rise=rise)
    assert (thrust >= 0.0).all() and (thrust <= full).all()
    got, got_moment = MIXER.wrench(thrust)
    np.testing.assert_allclose(got_moment[:2], reached[:2], atol=1e-5)
    assert got_moment[2] == pytest.approx(reached[2], abs=1e-5)
    # of all thrusts with these moments (one free: the mean), the nearest collective
    offset = thrust - thrust.mean()
    means = np.linspace(-offset.min(), full - offset.max(), 201)
    assert abs(got - total) <= np.abs(4 * means - total).min() + 1e-9
    assert got <= max(total, 0.0) + rise + 1e-9


@settings(max_examples=150)
@given(st.integers(0, 3), st.floats(0.0, 80.0), MOMENT)
def test_three_fans_are_the_weighted_least_squares(lost, collective, moment):
    available = [i != lost for i in range(4)]
    thrust = MIXER.allocate(collective, moment, available=available)
    assert thrust[lost] == 0.0 and (thrust >= 0.0).all() and (thrust <= FULL).all()
    # roll / y and pitch / x weigh alike; collective a thousandth of them
    x, y = ROBOT.fans.reach
    weight = np.array([1e-3, 1 / y, 1 / x])
    demand = weight * np.array([collective, moment[0], moment[1]])
    matrix = (weight[:, None] * B[:3])[:, available]
    best = lsq_linear(matrix, demand, bounds=(0.0, FULL), method="bvls", tol=1e-14).x
    cost = np.linalg.norm(matrix @ thrust[available] - demand)
    assert cost <= np.linalg.norm(matrix @ best - demand) + 1e-3
    np.testing.assert_allclose(thrust[available], best, atol=0.02)


@given(st.integers(0, 3), st.lists(st.floats(0.0, 20.0), min_size=3, max_size=3))
def test_three_fans_give_exactly_what_fits(lost, three):
    thrust = np.insert(np.array(three), lost, 0.0)
    collective, moment = MIXER.wrench(thrust)
    available = np.arange(4) != lost
    np.testing.assert_allclose(
        MIXER.allocate(collective, moment, available=available), thrust, atol=1e-9
    )


@given(st.integers(0, 3), st.floats(0.0, 80.0), MOMENT, st.floats(0.0, 40.0))
def test_three_fans_keep_the_rise(lost, collective, moment, rise):
    available = [i != lost for i in range(4)]
    thrust = MIXER.allocate(collective, moment, available=available, rise=rise)
    assert thrust.sum() <= collective + rise + 1e-9
    assert (thrust >= 0.0).all() and (thrust <= FULL).all()


def test_yaw_gives_way_before_tilt_and_collective_before_both():
    roll = 0.9 * MIXER.moment_scale[0]
    thrust = MIXER.allocate(80.0, [roll, 0.0, 0.4])
    collective, moment = MIXER.wrench(thrust)
    assert moment[0] == pytest.approx(roll)
    assert moment[2] == pytest.approx(0.1 * MIXER.moment_scale[2])
    assert collective == pytest.approx(40.0)


def test_a_moment_raises_the_collective_unless_told_not_to():
    collective, moment = MIXER.wrench(MIXER.allocate(0.0, [2.0, 0.0, 0.0]))
    assert moment[0] == pytest.approx(2.0) and collective == pytest.approx(2.0 / 0.135)
    assert not MIXER.allocate(0.0, [2.0, 1.0, 0.1], rise=0.0).any()
    assert not MIXER.allocate(-5.0, [0.0, 0.0, 0.0]).any()


def test_two_lost_fans_end_the_flight():
    assert not MIXER.allocate(40.0, [1, 1, 0], available=[True, False, False, True]).any()


@given(st.lists(st.floats(0.1, 18.0), min_size=4, max_size=4), st.floats(21.5, 25.2))
def test_pulses_keep_the_thrust(thrust, voltage):
    pulses = MIXER.pulses(thrust, voltage)
    assert pulses.dtype == np.uint16
    # half a microsecond of 1000, at a slope of at most 2 T / throttle
    np.testing.assert_allclose(MIXER.steady_thrust(pulses, voltage), thrust, atol=0.025)


def test_pulses_stay_in_range():
    assert (MIXER.pulses([0.0, -1.0, 1e-6, 500.0]) == [1000, 1000, 1000, 2000]).all()
    assert not MIXER.steady_thrust([0, 1000, 1049, 900]).any()
    assert MIXER.pulses([10.0] * 4, 25.2)[0] < MIXER.pulses([10.0] * 4, 20.0)[0]


BAD = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("bad", BAD)
def test_what_is_not_finite_is_refused(bad):
    for call in (
        lambda: MIXER.allocate(bad, [0, 0, 0]),
        lambda: MIXER.allocate(10.0, [0, bad, 0]),
        lambda: MIXER.allocate(10.0, [0, 0, 0], voltage=bad),
        lambda: MIXER.pulses([1.0, bad, 1.0, 1.0]),
        lambda: MIXER.pulses([1.0] * 4, bad),
    ):
        with pytest.raises(ValueError, match=r"collective|voltage|thrust"):
            call()


def test_wrong_sizes_and_signs_are_refused():
    with pytest.raises(ValueError, match="moment"):
        MIXER.allocate(10.0, [0, 0])
    with pytest.raises(ValueError, match="voltage"):
        MIXER.allocate(10.0, [0, 0, 0], voltage=0.0)
    for rise in (-1.0, math.nan):
        with pytest.raises(ValueError, match="rise"):
            MIXER.allocate(10.0, [0, 0, 0], rise=rise)
    trapezium = {f"fans__rotors__front_{side}__y": sign * 0.1 for side, sign in SIDES}
    with pytest.raises(ValueError, match=r"fans\.rotors: at .* not in a rectangle"):
        Mixer(load_robot(**trapezium))


def test_other_sense_of_rotation_turns_yaw():
    spin = dict(zip(ROBOT.rotor_names, -ROBOT.fans.spin, strict=True))
    other = Mixer(load_robot(**{f"fans__rotors__{name}__spin": s for name, s in spin.items()}))
    np.testing.assert_allclose(
        other.allocate(40.0, [0, 0, 0.2]), MIXER.allocate(40.0, [0, 0, -0.2])
    )


@pytest.mark.parametrize("voltage", [None, 20.0, 24.0])
def test_greatest_collective_without_a_moment(voltage):
    """Four fans, or two of the three that are left; and exactly that is allocated."""
    full = MIXER.thrust_limit(voltage)
    assert MIXER.greatest_collective(voltage) == pytest.approx(min(4 * full, 80.0))
    left = (True, True, False, True)
    most = MIXER.greatest_collective(voltage, left)
    assert most == pytest.approx(2 * full)
    collective, moment = MIXER.wrench(MIXER.allocate(most, (0, 0, 0), voltage, left, rise=0.0))
    assert collective == pytest.approx(most)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-9)
    assert MIXER.greatest_collective(voltage, (True, False, False, True)) == 0.0
