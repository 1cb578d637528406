"""Axes against SciPy, covariances against the figures, and which samples pass."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_description.robot import load_robot
from husky_description.rotation import swap_body, swap_world_and_body
from husky_drivers.vn200.imu import ImuFigures, SampleGate

ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])
LEVEL = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.81)
NUMBERS = st.floats(-1.0, 1.0)


def sample(time, **changed):
    values = list(LEVEL)
    for index, value in changed.items():
        values[int(index[1:])] = value
    return (time, *values)


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_attitude_is_the_product_of_the_axis_changes(numbers):
    quaternion = np.array(numbers) / np.linalg.norm(numbers)
    expected = ENU_FROM_NED @ Rotation.from_quat(quaternion).as_matrix() @ FRD_FROM_FLU
    converted = swap_world_and_body(tuple(quaternion))
    assert np.allclose(Rotation.from_quat(converted).as_matrix(), expected, atol=1e-12)
    assert np.allclose(swap_world_and_body(converted), quaternion, atol=1e-12)


@pytest.mark.parametrize(
    ("ned_yaw_pitch_roll", "enu_roll_pitch_yaw"),
    [
        ((0, 0, 0), (0, 0, 90)),  # heading north is along y of ENU
        ((90, 0, 0), (0, 0, 0)),  # heading east is along x
        ((0, 10, 0), (0, -10, 90)),  # nose up is a negative turn about y (left)
        ((90, 0, 20), (20, 0, 0)),  # right side down is a positive turn about x either way
    ],
)
def test_attitudes_that_one_can_imagine(ned_yaw_pitch_roll, enu_roll_pitch_yaw):
    device = Rotation.from_euler("ZYX", ned_yaw_pitch_roll, degrees=True).as_quat()
    converted = Rotation.from_quat(swap_world_and_body(tuple(device)))
    expected = Rotation.from_euler("xyz", enu_roll_pitch_yaw, degrees=True)
    assert (converted.inv() * expected).magnitude() < 1e-12


def test_gravity_points_up_in_both_conventions():
    """Specific force at rest is up: in the world it must be +z of ENU, whatever the pose."""
    for rotation in Rotation.random(20, random_state=1):
        force_frd = rotation.inv().apply([0.0, 0.0, -9.81])
        to_enu = Rotation.from_quat(swap_world_and_body(tuple(rotation.as_quat())))
        assert np.allclose(to_enu.apply(swap_body(tuple(force_frd))), [0, 0, 9.81], atol=1e-12)


def test_figures_of_the_robot():
    figures = ImuFigures.of(load_robot().imu)
    assert figures.gyro_noise == pytest.approx(1.22e-3, rel=5e-3)  # rad/s at 800 Hz
    assert figures.accel_noise == pytest.approx(2.75e-2, rel=5e-3)  # m/s^2
    assert figures.angular_velocity_variance == figures.gyro_noise**2 + figures.gyro_bias**2
    walk = figures.accel_bias * math.sqrt(2.0 / figures.bias_correlation_time)
    assert walk == pytest.approx(load_robot().imu.accel_bias_walk)


def test_bad_figures_are_named():
    with pytest.raises(ValueError, match=r"gyro_range of the IMU is 0\.0, it must be above 0"):
        ImuFigures(1e-4, 1e-3, 0.0, 0.0, 100.0, 0.0, 150.0)
    with pytest.raises(ValueError, match="accel_bias of the IMU is nan, it must be 0 or more"):
        ImuFigures(1e-4, 1e-3, 0.0, math.nan, 100.0, 30.0, 150.0)


def test_new_samples_pass_and_gaps_are_counted():
    gate = SampleGate(800.0)
    for tick in (0, 1, 2, 5, 6):
        assert gate.accept(sample(tick * 1_250_000))
    assert (gate.counters.good, gate.counters.missed) == (5, 2)


def test_the_jitter_of_a_simulation_step_is_no_gap():
    gate = SampleGate(800.0)
    for time in (0, 1_000_000, 2_500_000, 4_000_000, 5_000_000):  # steps of 0.5 ms
        assert gate.accept(sample(time))
    assert gate.counters.missed == 0


def test_a_frozen_sample_passes_once():
    gate = SampleGate(800.0)
    assert gate.accept(sample(10))
    assert not gate.accept(sample(10))
    assert gate.counters.repeated == 1


def test_a_clock_that_starts_again_is_followed():
    gate = SampleGate(800.0)
    assert gate.accept(sample(10**9))
    assert gate.accept(sample(1_250_000))
    assert (gate.counters.clock_restarts, gate.counters.missed) == (1, 0)


def test_samples_that_come_once_more_are_no_restart():
    """A buffer that is sent twice, and old samples among new ones."""
    gate, period = SampleGate(800.0), 1_250_000
    new = [sample(10**9 + number * period) for number in range(40)]
    assert all(gate.accept(item) for item in new[:20])
    assert not any(gate.accept(item) for item in new[5:20])
    assert gate.accept(new[20])
    for number in range(21, 40):
        assert not gate.accept(new[number - 20])
        assert gate.accept(new[number])
    assert (gate.counters.repeated, gate.counters.clock_restarts) == (15 + 19, 0)
    assert gate.counters.missed == 0


def test_a_clock_that_is_set_back_and_goes_on_from_there_is_followed():
    gate, period = SampleGate(800.0), 1_250_000
    assert gate.accept(sample(60 * 10**9))
    passed = [gate.accept(sample(5 * 10**9 + number * period)) for number in range(40)]
    assert passed == [False] * 19 + [True] * 21
    assert (gate.counters.clock_restarts, gate.counters.missed) == (1, 0)


@pytest.mark.parametrize("index", range(10))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e9])
def test_no_insane_number_passes(index, value):
    gate = SampleGate(800.0)
    assert not gate.accept(sample(5, **{f"i{index}": value}))
    assert gate.counters.invalid == 1


def test_a_quaternion_that_is_none_does_not_pass():
    assert not SampleGate(800.0).accept(sample(5, i3=0.9))
