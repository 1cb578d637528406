"""Motors of the bus servos against their data sheet and closed forms."""

import math

import numpy as np
import pytest

from husky_description.robot import load_robot
from husky_drivers.dynamixel.control_table import HardwareError
from husky_drivers.dynamixel.units import ServoUnits
from husky_sim.devices.bus_servos.motors import AMBIENT, BusServoMotors

SERVO = load_robot("beta").bus_servo
UNITS = ServoUnits(SERVO)
STEP = 0.0005


def make_motors(**values):
    """One servo with torque on and no limits but its supply's."""
    motors = BusServoMotors(SERVO, 1, STEP)
    record = motors.records[0]
    record["torque_on"] = record["follows"] = 1
    record["p"], record["goal_pwm"] = 1.0, 1.0  # full supply from one count of error on
    record["goal_current"] = record["current_limit"] = 100.0
    record["temperature_limit"], record["voltage_high"] = 1e6, 1e3
    for name, value in values.items():
        record[name] = value
    return motors


def settled_torque(motors, speed, goal=1e6, steps=200):
    """Torque at a joint that is turned at a speed [N m]."""
    motors.records[0]["goal"] = goal
    for index in range(steps):
        motors.step(np.array([index * speed * STEP]), np.array([speed]))
    return float(motors.torque[0])


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("voltage", [11.1, 14.8])
def test_torque_falls_in_a_line_from_stall_to_no_load(share, voltage):
    """The ends of the line at the rated voltage are the data sheet's; both scale with it."""
    motors = make_motors()
    motors.bus_voltage = voltage
    no_load = (voltage - UNITS.resistance * SERVO.no_load_current) / UNITS.volts_per_speed
    speed = share * no_load
    stall = UNITS.torque_per_ampere * voltage / UNITS.resistance
    friction = UNITS.friction * min(1.0, speed / 0.05)
    expected = stall + share * (UNITS.friction - stall) - friction
    assert settled_torque(motors, speed) == pytest.approx(expected, abs=1e-6)
    if voltage == SERVO.voltage:
        assert no_load == pytest.approx(SERVO.no_load_speed)
        assert stall - UNITS.friction == pytest.approx(SERVO.stall_torque)


def test_the_goal_current_limits_the_torque():
    motors = make_motors(goal_current=1.0)
    assert settled_torque(motors, 0.0) == pytest.approx(UNITS.torque_per_ampere, rel=1e-6)
    assert motors.records[0]["current"] == pytest.approx(1.0)


def test_stiffness_is_that_of_the_p_gain():
    """An error of some counts gives the torque that the units say, at the rated voltage."""
    motors = make_motors(p=SERVO.position_p / 128 / 885)
    counts = 10
    motors.records[0]["goal"] = UNITS.center + counts
    for _ in range(100):
        motors.step(np.zeros(1), np.zeros(1))
    expected = UNITS.stiffness(SERVO.position_p) * counts / UNITS.counts_per_radian
    assert motors.torque[0] == pytest.approx(expected, rel=1e-3)


def test_gains_are_those_that_the_controller_counts_on():
    law = load_robot("beta").servo
    stiffness = UNITS.stiffness(SERVO.position_p)
    damping = UNITS.damping(SERVO.position_p, SERVO.position_d)
    # The file takes torque over stall current; here the current without load is taken off that.
    assert stiffness == pytest.approx(law.kp, rel=0.06)
    assert damping == pytest.approx(law.kd, rel=0.06)


def test_the_rotor_crosses_the_backlash_before_torque_turns_round():
    """Across the gap it is free: half a t^2 with the torque over the rotor's inertia."""
    motors = make_motors(p=0.0, goal_current=0.5)
    motors.records["p"] = 1.0
    settled_torque(motors, 0.0, goal=1e6)
    assert motors.records[0]["gap"] == pytest.approx(SERVO.backlash / 2)
    motors.records[0]["goal"] = -1e6
    steps = 0
    while motors.step(np.zeros(1), np.zeros(1))[0] == 0.0:
        steps += 1
        assert steps < 1000
    assert motors.torque[0] < 0.0
    # Friction acts on the rotor on its way; below full friction it lies between these.
    quick = math.sqrt(2 * SERVO.backlash * SERVO.armature / (0.5 * UNITS.torque_per_ampere))
    slow = math.sqrt(
        2 * SERVO.backlash * SERVO.armature / (0.5 * UNITS.torque_per_ampere - UNITS.friction)
    )
    assert quick - 2 * STEP <= steps * STEP <= slow + 2 * STEP


def test_position_is_told_in_counts_of_a_turn():
    motors = make_motors()
    for angle in (-1.0, 0.0, 0.3):
        motors.update_state(np.array([angle]))
        count = motors.records[0]["count"]
        assert (count - 2048) * 2 * math.pi / 4096 == pytest.approx(angle, abs=math.pi / 4096)


def test_told_speed_is_that_of_the_joint():
    motors = make_motors(p=0.0)
    settled_torque(motors, 2.0, steps=2000)
    told = motors.records[0]["seen_rate"] / UNITS.counts_per_radian
    assert told == pytest.approx(2.0, abs=0.2)


def test_friction_is_taken_off_what_is_told_of_a_moving_joint():
    moving = UNITS.joint_torque(SERVO.no_load_current, SERVO.no_load_speed)
    assert moving == pytest.approx(0.0, abs=1e-9)
    assert UNITS.joint_torque(1.0, 0.0) == pytest.approx(UNITS.torque_per_ampere)


def test_the_winding_heats_as_one_capacity_and_shuts_down_at_its_limit():
    current = 2.0
    limit = 60.0
    motors = make_motors(goal_current=current, temperature_limit=limit)
    motors.records["shutdown"] = int(HardwareError.OVERHEATING)
    motors._constants["cooling"] = -math.expm1(-STEP / 1.0)  # a time constant of 1 s
    end = AMBIENT + UNITS.resistance * current**2 * SERVO.thermal_resistance
    expected = -math.log(1.0 - (limit - AMBIENT) / (end - AMBIENT))
    motors.records["goal"] = 1e6
    steps = 0
    while motors.records["torque_on"][0]:
        motors.step(np.zeros(1), np.zeros(1))
        steps += 1
        assert steps < 40000
    assert steps * STEP == pytest.approx(expected, rel=0.01)
    assert motors.records["error"][0] == HardwareError.OVERHEATING
    motors.step(np.zeros(1), np.zeros(1))
    assert motors.records["current"][0] == 0.0


@pytest.mark.parametrize(("share", "trips"), [(1.0, True), (0.9, False)])
def test_a_second_at_the_current_limit_is_an_overload(share, trips):
    motors = make_motors(current_limit=2.0, goal_current=2.0 * share)
    motors.records["shutdown"] = int(HardwareError.OVERLOAD)
    settled_torque(motors, 0.0, steps=1900)
    assert motors.records["torque_on"][0]
    settled_torque(motors, 0.0, steps=200)
    assert bool(motors.records["error"][0] & HardwareError.OVERLOAD) == trips
    assert bool(motors.records["torque_on"][0]) != trips


def test_a_bus_watchdog_that_bites_holds_the_servo_where_it_is():
    motors = make_motors(watchdog=0.06)
    settled_torque(motors, 0.0, steps=119)
    assert not motors.records["bitten"][0]
    settled_torque(motors, 0.0, steps=2)
    assert motors.records["bitten"][0] and motors.records["goal"][0] == UNITS.center
    assert motors.records["torque_on"][0]
