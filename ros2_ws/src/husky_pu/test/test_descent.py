"""A landing by the flight controller alone: against a point mass whose motion is known."""

import math

import numpy as np
import pytest

from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.robot import load_robot
from husky_description.rotation import conjugate, from_roll_pitch_yaw, rotate
from husky_pu.autopilot.airframe import airframe_parameters
from husky_pu.autopilot.descent import Descent, InertialSpeed, braking
from husky_pu.autopilot.flight_parameters import FlightParameters

DT = 0.002
SEA_LEVEL, AIR_WEIGHT = 101325.0, 1.225 * GRAVITY
HOVER = 0.6


def told(height, acceleration, attitude, noise=0.0):
    """Specific force FRD and pressure of a point at a height that accelerates upward."""
    force = rotate(conjugate(attitude), (0.0, 0.0, -GRAVITY - acceleration))
    return force, SEA_LEVEL - AIR_WEIGHT * (height + noise)


def test_vertical_speed_of_a_tilted_body_that_swings_up_and_down():
    """0.5 sin(2 t): what noise of 3 Pa and a bias of 0.05 m/s^2 leave is below 0.15 m/s."""
    random, filter_, worst = np.random.default_rng(1), InertialSpeed(), 0.0
    attitude = from_roll_pitch_yaw(0.3, -0.2, 1.0)
    for k in range(10000):
        t = k * DT
        height, speed, acceleration = (
            0.5 * math.sin(2 * t), math.cos(2 * t), -2.0 * math.sin(2 * t)
        )  # fmt: skip
        noise = random.normal(0.0, 3.0 / AIR_WEIGHT)
        filter_.update(attitude, *told(height, acceleration + 0.05, attitude, noise), DT)
        if t > 5.0:
            worst = max(worst, abs(filter_.climb - speed))
    assert worst < 0.15


def test_without_pressure_the_accelerometer_goes_on():
    filter_, level = InertialSpeed(), (0.0, 0.0, 0.0, 1.0)
    for k in range(1000):
        force, pressure = told(0.0, 1.0 if k >= 500 else 0.0, level)
        filter_.update(level, force, pressure if k < 500 else math.nan, DT)
    assert filter_.climb == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("lift", [0.85, 1.0, 1.2])
def test_it_sinks_at_its_speed_and_feels_the_ground(lift):
    """With thrust 0.85 to 1.2 of what the parameter says; the ground is a hard stop."""
    descent, height, speed, thrust, speeds = Descent(0.5, HOVER), 1.5, 0.0, HOVER, []
    while not descent.down:
        wanted = descent.thrust(speed, 0.0, DT)
        thrust += (wanted - thrust) * DT / 0.1  # the rotors' lag
        speed += (lift * thrust / HOVER - 1.0) * GRAVITY * DT
        height += speed * DT
        speeds.append(-speed)
        if height <= 0.0:
            height, speed = 0.0, max(speed, 0.0)
        assert len(speeds) < 5.0 / DT
    assert height == pytest.approx(0.0, abs=0.003)
    end = speeds.index(next(s for s in reversed(speeds) if s > 0.1))
    assert speeds[end] == pytest.approx(0.5, abs=0.15)
    assert max(speeds) < 1.1


def test_braking_tilts_against_the_speed_whatever_the_heading():
    speed = InertialSpeed()
    speed.north, speed.east = 0.3, -0.4
    for heading in (0.0, 1.0, -2.5):
        roll, pitch = braking(speed, heading)
        up = rotate(from_roll_pitch_yaw(roll, pitch, heading), (0.0, 0.0, -1.0))
        assert up[0] / up[1] == pytest.approx(-0.75, rel=1e-2)
        assert up[0] < 0.0 < up[1] and math.hypot(*up[:2]) < math.sin(math.radians(11.0))


def test_a_robot_on_its_legs_lets_go_and_one_on_its_propellers_is_brought_down():
    carbon, beta = (
        FlightParameters(airframe_parameters(load_robot(name))) for name in ("carbon", "beta")
    )
    assert (carbon["MPC_LAND_SPEED"], carbon["COM_ACT_FAIL_ACT"]) == (0.0, 0)
    assert beta["MPC_LAND_SPEED"] > 0.0 and beta["COM_ACT_FAIL_ACT"] == 2
    robot = load_robot("beta")
    share = robot.mass * GRAVITY / (4.0 * FanModel.of(robot).max_thrust)
    assert beta["MPC_THR_HOVER"] == pytest.approx(share, rel=1e-6)
