"""Parameters of the flight controller that follow from the robot which it flies."""

from __future__ import annotations

from husky_description.fan import FanModel
from husky_description.gravity import GRAVITY
from husky_description.robot import Robot

_KINDS = {6: 13.0, 8: 14.0}
"""MAV_TYPE by the number of rotors: HEXAROTOR, OCTOROTOR; of others the table's QUADROTOR stays."""
_LAND_SPEED = 0.5
"""Of a robot on its perch, which stands a fall from 0.013 m [m/s]."""
_SILENCE = 0.5
"""COM_OF_LOSS_T: for so long a silent companion's last tilt makes speed; PX4 1 [s]."""
_LAND = 2
"""COM_ACT_FAIL_ACT: a lost rotor ends the flight."""
_ROTOR_PATIENCE = 20.0
"""A propeller that breaks has turned the robot by 3 rad/s in 0.1 s: too much for three [ms]."""
_IDLE = 10.0
"""After which propellers that nobody uses are off: as PX4 [s]."""


def airframe_parameters(robot: Robot) -> dict[str, float]:
    """Return the defaults that differ from the table's.

    A robot on its legs lets the thrust go when something fails; one that hangs on its propellers
    has to be brought down.
    """
    battery = robot.battery
    parameters = {
        "BAT1_N_CELLS": float(battery.cells),
        "BAT1_CAPACITY": battery.capacity / 3.6,
        "BAT1_R_INTERNAL": battery.cell_resistance + battery.wiring_resistance / battery.cells,
    }
    rotors = len(robot.rotor_names)
    if rotors in _KINDS:
        parameters["MAV_TYPE"] = _KINDS[rotors]
    if robot.legs_carry_propellers:
        most = rotors * FanModel.of(robot).max_thrust
        parameters |= {
            "MPC_LAND_SPEED": _LAND_SPEED,
            "MPC_THR_HOVER": robot.mass * GRAVITY / most,
            "COM_ACT_FAIL_ACT": _LAND,
            "COM_OF_LOSS_T": _SILENCE,
            "FD_ACT_MOT_TOUT": _ROTOR_PATIENCE,
            "COM_DISARM_PRFLT": _IDLE,
        }
    return parameters
