import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from husky_control.incline.assist import FAN_LAG, ThrustAssist
from husky_control.parameters import Parameters
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot

DT = 0.002
ROBOT = load_robot()
WEIGHT = ROBOT.mass * GRAVITY
LEVEL = np.eye(3)
STILL = np.zeros(3)


def make(**values):
    parameters = Parameters()
    for name, value in {"share": 0.4, **values}.items():
        parameters.set(f"assist.{name}", value)
    return ThrustAssist(ROBOT, parameters)


def run(
    assist, seconds, *, wanted=True, available=True, rotation=LEVEL, rate=STILL, disarmed=False
):
    forces = []
    for _ in range(round(seconds / DT)):
        assist.tick(wanted, available, rotation, rate, DT, disarmed=disarmed)
        forces.append(assist.force)
    return np.array(forces)


def test_it_asks_for_the_share_and_no_faster_than_allowed():
    assist = make(slew=0.4)
    forces = run(assist, 3.0)
    assert forces[-1] == pytest.approx(0.4 * WEIGHT)
    assert np.diff(forces).max() <= 0.4 * WEIGHT * DT * (1 + 1e-9)
    assert assist.lift == pytest.approx(assist.force, rel=1e-3)


def test_lift_follows_with_the_fans_lag():
    assist = make(slew=2.0)
    assist.force = 0.4 * WEIGHT
    run(assist, FAN_LAG)
    assert assist.lift / assist.force == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)


def test_a_lost_unit_gives_nothing():
    assist = make()
    run(assist, 3.0)
    run(assist, 5 * FAN_LAG, available=False)
    assert assist.lift < 0.01 * 0.4 * WEIGHT
    assert not assist.moment.any()
    run(assist, 2.0, available=False)
    assert assist.force == 0.0


def test_other_modes_ask_for_nothing_within_a_second_however_slow_the_slew():
    assist = make(share=0.8, slew=0.05)
    assist.force = 0.8 * WEIGHT
    assert run(assist, 1.0 + DT, wanted=False)[-1] == 0.0


def test_other_modes_ask_for_nothing():
    assist = make()
    run(assist, 3.0)
    assert run(assist, 2.0, wanted=False)[-1] == 0.0


@given(
    roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5), yaw=st.floats(-3.0, 3.0)
)
def test_the_moment_works_against_tilt(roll, pitch, yaw):
    """A rotation vector of the tilt, found by SciPy, times the stiffness; heading is no matter."""
    assist = make(attitude_stiffness=10.0, attitude_damping=0.0, moment_limit=4.0)
    rotation = Rotation.from_euler("xyz", (roll, pitch, yaw)).as_matrix()
    run(assist, 2 * DT, rotation=rotation)
    up_in_base = rotation.T @ (0.0, 0.0, 1.0)
    righting = np.cross((0.0, 0.0, 1.0), up_in_base)
    expected = np.clip(10.0 * righting[:2], -4.0, 4.0)
    assert assist.moment[:2] == pytest.approx(expected, abs=1e-9)
    assert assist.moment[2] == 0.0


def test_the_moment_damps_rates_within_its_limit():
    assist = make(attitude_stiffness=0.0, attitude_damping=2.0, moment_limit=1.0)
    run(assist, 2 * DT, rate=np.array((0.3, -0.2, 5.0)))
    assert assist.moment == pytest.approx((-0.6, 0.4, 0.0))
    run(assist, 2 * DT, rate=np.array((9.0, -9.0, 0.0)))
    assert assist.moment == pytest.approx((-1.0, 1.0, 0.0))


def test_lift_in_world_is_the_upward_part():
    assist = make()
    run(assist, 3.0)
    tilted = Rotation.from_euler("x", 60, degrees=True).as_matrix()
    assert assist.lift_in_world(tilted) == pytest.approx(0.5 * assist.lift)


def test_withheld_help_comes_back_only_when_the_share_is_set_anew():
    parameters = Parameters({"assist.share": 0.4})
    assist = ThrustAssist(ROBOT, parameters)
    assert run(assist, 3.0)[-1] == pytest.approx(0.4 * WEIGHT)
    assist.withhold()
    assert run(assist, 5.0)[-1] == 0.0
    parameters.set("assist.slew", 2.0)
    assert run(assist, 1.0)[-1] == 0.0
    parameters.set("assist.share", 0.4)
    assert run(assist, 3.0)[-1] == pytest.approx(0.4 * WEIGHT)


def test_a_share_that_stands_while_the_unit_is_disarmed_is_asked_for_again():
    """Whether it was set before the unit was heard at all, or helped until it was disarmed."""
    parameters = Parameters({"assist.share": 0.4})
    assist = ThrustAssist(ROBOT, parameters)
    for _ in range(2):
        assert not run(assist, 1.0, available=False, disarmed=True).any()
        assert not run(assist, 5.0).any()
        assert not assist.moment.any() and assist.lift == pytest.approx(0.0, abs=1e-6)
        parameters.set("assist.slew", 2.0)
        assert not run(assist, 1.0).any()
        parameters.set("assist.share", 0.4)
        forces = run(assist, 3.0)
        assert forces[-1] == pytest.approx(0.4 * WEIGHT)
        assert np.diff(forces).max() <= 2.0 * WEIGHT * DT * (1 + 1e-9)


def test_a_share_that_is_set_while_the_news_of_arming_is_on_its_way_counts():
    parameters = Parameters({"assist.share": 0.4})
    assist = ThrustAssist(ROBOT, parameters)
    run(assist, 1.0, available=False, disarmed=True)
    parameters.set("assist.share", 0.3)
    run(assist, 0.08, available=False, disarmed=True)
    assert run(assist, 3.0)[-1] == pytest.approx(0.3 * WEIGHT)


def test_a_lost_link_does_not_take_the_share_back():
    """The unit stays armed: what was asked for comes back with it."""
    assist = make()
    run(assist, 3.0)
    run(assist, 2.0, available=False)
    assert run(assist, 3.0)[-1] == pytest.approx(0.4 * WEIGHT)
