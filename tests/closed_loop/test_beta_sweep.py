"""Every live parameter of Husky-beta's propellers at both ends of its range: it does its task.

Those of legs are Husky Carbon's, scaled to its size, and are swept there (`test_parameter_sweep`).
All of it is slow; `test_beta_flight` and `test_beta_dynamic` do the tasks with the defaults.
"""

import math

import pytest
from flying_beta import FlyingBeta

from husky_control.parameters import TABLE, table_of
from husky_description.robot import load_robot

pytestmark = pytest.mark.in_a_copy  # each goes on from the same standing robot

ROWS = {name: row for name, row in table_of(load_robot("beta")).items() if name not in TABLE}
FLIGHT, BALANCE = ("quadrotor.",), ("balance.", "contact.standing_force")
FALLING = math.radians(15.0)
"""Tilt of the body that no task comes near: the greatest seen is 6.3 deg."""


class SweptBeta(FlyingBeta):
    """Looks at itself every 20 ms."""

    def go(self, time, *modes, velocity=None, until=None):
        """Go on for a time [s], or until something holds, upright and in one of some modes."""
        for _ in range(round(time / 0.02)):
            if until is not None and until():
                return
            self.run(0.02, velocity)
            _, x, y, _ = self.data.qpos[3:7]
            tilt = 2.0 * math.asin(min(1.0, math.hypot(x, y)))
            controller = self.controller
            assert controller.mode.value in modes, f"{controller.mode}: {controller.reason}"
            assert tilt < FALLING, f"{math.degrees(tilt):.0f} deg in {controller.mode}"
        assert until is None, f"{self.controller.mode}: {self.controller.reason}"

    def ask(self, mode):
        accepted, message = self.controller.request_mode(mode)
        assert accepted, message

    def reaches(self, mode):
        return lambda: self.controller.mode.value == mode and self.controller.present.settled


@pytest.fixture(scope="module")
def standing():
    robot = SweptBeta(1)
    robot.stand()
    return robot


@pytest.fixture(scope="module")
def armed():
    robot = SweptBeta(1)
    robot.stand()
    robot.gear.arm()
    robot.run(0.3)
    return robot


def ends(*prefixes):
    """Names and values of the ends that are no defaults, by how the names begin."""
    return [
        (name, value)
        for name, row in ROWS.items()
        for value in (row.lower, row.upper)
        if name.startswith(prefixes) and value != row.default
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), ends(*FLIGHT))
def test_flight(standing, name, value):
    """From standing into the air, ahead, round, and down on the perch."""
    robot = standing
    robot.controller.parameters.set(name, value)
    robot.become("perch")
    robot.become("splay")
    robot.gear.arm()
    robot.run(1.5)
    robot.ask("quadrotor")
    robot.go(8.0, "splay", "quadrotor")
    limits = robot.controller.parameters
    ahead, turn = limits["quadrotor.max_speed"], limits["quadrotor.max_yaw_rate"]
    robot.go(2.0, "quadrotor", velocity=(ahead, 0.0, 0.0))
    robot.go(1.5, "quadrotor", velocity=(0.0, 0.0, turn))
    robot.go(3.0, "quadrotor")
    robot.ask("splay")
    robot.go(30.0, "quadrotor", "splay", until=robot.reaches("splay"))
    robot.gear.autopilot.vehicle.logic.disarm()
    robot.run(0.5)
    robot.become("perch")
    robot.become("stand")


BALANCES = [(*row, legs) for row in ends(*BALANCE) for legs in (0.0, 4.0)]
CORNERS = [
    {"balance.stiffness": stiffness, "balance.damping": damping}
    for stiffness in (ROWS["balance.stiffness"].lower, ROWS["balance.stiffness"].upper)
    for damping in (ROWS["balance.damping"].lower, ROWS["balance.damping"].upper)
]
"""On two feet with less damping, or more stiffness, it falls."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value", "legs"), BALANCES)
def test_balance(armed, name, value, legs):
    """One leg becomes an arm, or two across, and stands again."""
    balance(armed, {"balance.legs": legs, name: value})


@pytest.mark.slow
@pytest.mark.parametrize("legs", [4.0, 5.0])
@pytest.mark.parametrize("values", CORNERS)
def test_corner_of_balance(armed, values, legs):
    balance(armed, {"balance.legs": legs, **values})


def balance(robot, values):
    """Balance with some values, and stand again."""
    robot.controller.parameters.set_all(values)
    robot.ask("balance")
    robot.go(20.0, "balance", until=robot.reaches("balance"))
    robot.go(1.0, "balance")
    robot.ask("stand")
    robot.go(16.0, "balance", "stand", until=robot.reaches("stand"))


def test_every_parameter_is_swept():
    swept = {name for name, _ in ends(*FLIGHT, *BALANCE)}
    assert swept == {name for name, row in ROWS.items() if row.lower < row.upper}
