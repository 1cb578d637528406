"""Safety: each check trips beyond its limit, not at or below, and says why."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from husky_control.parameters import Parameters
from husky_control.safety import Safety
from husky_control.tick_data import Measurements
from husky_description.robot import load_robot

ROBOT = load_robot()
STAND = np.array(ROBOT.stand_joint_position)
DT = 0.002
P = Parameters()


def check(safety, **changes):
    """Judge a robot that stands well, but for the changes."""
    tilt = changes.pop("tilt", 0.0)
    good = {"joint_position": STAND, "joint_age_ticks": 1, "drives_operational": True}
    return safety.check(Measurements(**(good | changes)), tilt, DT)


@pytest.fixture
def safety():
    return Safety(ROBOT, Parameters())


def moved(joint, angle):
    position = STAND.copy()
    position[joint] = angle
    return position


def test_a_robot_that_stands_well_does_not_trip(safety):
    assert check(safety) is None


def test_drives(safety):
    assert check(safety, drives_operational=False) == "drives are not operational"


def test_tilt(safety):
    limit = P["safety.max_tilt"]
    assert check(safety, tilt=limit) is None
    reason = check(safety, tilt=limit + 0.01)
    assert reason == f"body is tilted by {limit + 0.01:.2f} rad (limit {limit:.2f})"


def test_age_of_the_joint_states(safety):
    limit = int(P["safety.joint_age"])
    assert check(safety, joint_age_ticks=limit) is None
    assert check(safety, joint_age_ticks=limit + 1) == f"joint states are {limit + 1} ticks old"


def test_age_of_the_imu_sample(safety):
    limit = P["safety.imu_age"]
    assert check(safety, imu_age=limit) is None
    assert check(safety, imu_age=limit + 0.001) == f"IMU sample is {1e3 * limit + 1:.1f} ms old"


@pytest.mark.parametrize("joint", range(12))
def test_joint_range(safety, joint):
    margin = P["safety.joint_margin"]
    for limit, outward in ((ROBOT.joint_lower, -1.0), (ROBOT.joint_upper, 1.0)):
        edge = limit[joint] + outward * margin
        assert check(safety, joint_position=moved(joint, edge - outward * 1e-6)) is None
        reason = check(safety, joint_position=moved(joint, edge + outward * 1e-6))
        assert reason is not None
        assert ROBOT.joint_names[joint] in reason and "out of range" in reason
        assert f"{ROBOT.joint_lower[joint]:.2f} to {ROBOT.joint_upper[joint]:.2f}" in reason


def ticks_to_trip(safety, torque, most=2000):
    """Ticks that a torque lasts until it trips, and the reason; (None, None) when it does not."""
    for tick in range(1, most):
        reason = check(safety, joint_torque=torque)
        if reason is not None:
            return tick, reason
    return None, None


@pytest.mark.parametrize("joint", [0, 4, 11])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torque_overload_trips_after_its_time(safety, joint, sign):
    torque = np.zeros(12)
    torque[joint] = sign * P["safety.torque_share"] * ROBOT.joint_torque_limit[joint]
    tick, reason = ticks_to_trip(safety, torque)
    # More than torque_time: one tick later than so many, give or take the rounding of a sum.
    assert tick == pytest.approx(P["safety.torque_time"] / DT + 1, abs=1)
    assert ROBOT.joint_names[joint] in reason and "torque limit" in reason


def test_torque_just_below_its_share_never_trips(safety):
    torque = (P["safety.torque_share"] - 1e-6) * ROBOT.joint_torque_limit
    assert ticks_to_trip(safety, torque) == (None, None)


def test_overload_is_forgotten_as_it_came(safety):
    full, none = np.array(ROBOT.joint_torque_limit), np.zeros(12)
    for _ in range(2000):  # half of the time at the limit, in turns
        assert check(safety, joint_torque=full) is None
        assert check(safety, joint_torque=none) is None


def test_the_joint_that_is_overloaded_for_longest_is_named(safety):
    short, both = np.zeros(12), np.zeros(12)
    short[7] = both[7] = both[2] = 100.0
    for _ in range(10):
        assert check(safety, joint_torque=short) is None
    _, reason = ticks_to_trip(safety, both)
    assert ROBOT.joint_names[7] in reason


def test_reset_forgets_overload(safety):
    full = np.array(ROBOT.joint_torque_limit)
    for _ in range(200):
        check(safety, joint_torque=full)
    safety.reset()
    tick, _ = ticks_to_trip(safety, full)
    assert tick == pytest.approx(P["safety.torque_time"] / DT + 1, abs=1)


def test_a_joint_that_is_not_a_number_is_out_of_range(safety):
    assert "out of range" in check(safety, joint_position=moved(5, np.nan))


def test_limits_are_live():
    parameters = Parameters()
    safety = Safety(ROBOT, parameters)
    assert check(safety, tilt=0.5) is None
    parameters.set("safety.max_tilt", 0.4)
    assert "limit 0.40" in check(safety, tilt=0.5)


@settings(max_examples=100)
@given(
    tilt=st.floats(0.0, 3.2),
    joint_age_ticks=st.integers(0, 10),
    imu_age=st.floats(0.0, 0.1),
    drives_operational=st.booleans(),
)
def test_it_trips_if_and_only_if_a_limit_is_exceeded(**measured):
    reason = check(Safety(ROBOT, P), **measured)
    bad = (
        measured["tilt"] > P["safety.max_tilt"]
        or measured["joint_age_ticks"] > P["safety.joint_age"]
        or measured["imu_age"] > P["safety.imu_age"]
        or not measured["drives_operational"]
    )
    assert (reason is not None) == bad
