"""The bus servos' motors in the world: what the physics turns, and what the control tables say."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.bus_servo import BusServoSection
from husky_drivers.dynamixel.units import ServoUnits
from husky_sim.devices.bus_servos.motor_law import CONSTANTS, MOTOR, step_motors

AMBIENT = 25.0
"""Temperature of the air, and of windings at the start [deg C] (assumed)."""
_LAW_BANDWIDTH = 80.0
"""Of the servo's speed estimate [Hz], which is 4 ms late (assumed: the maker tells none)."""
_TOLD_BANDWIDTH = 40.0
"""Of the low-pass before the current that is told [Hz]: as late as the speed (assumed)."""
_CREEP = 0.05
"""Speed below which friction is linear [rad/s] (assumed)."""
_OVERLOAD_TIME = 1.0
"""Time at the current limit that counts as an overload [s] (assumed: "persistent load")."""


class BusServoMotors:
    """Motors of all joints, between the servos' control tables and the physics.

    Attributes:
        torque: (n,) joint torques of the last physics step [N m], overwritten by `step`.
        records: (n,) the servos' records (`MOTOR`).
    """

    def __init__(self, servo: BusServoSection, count: int, step: float):
        """Power off, cold.

        Args:
            servo: the servos' data sheet.
            count: number of joints.
            step: physics step [s].
        """
        self.records: Any = np.zeros(count, MOTOR)
        self._constants = motor_constants(servo, step)
        self._supply = self._rated = servo.voltage
        self.torque: Array = np.zeros(count)
        self.reset()
        zero = np.zeros(count)
        self.step(zero, zero)  # compiles, or loads what is compiled
        self.reset()

    @property
    def bus_voltage(self) -> float:
        """Supply of the servos [V].

        They hang on the pack behind converters (thesis, chapter 3), which hold the servos' rated
        voltage as long as the pack has it: a full pack of 16.8 V is beyond what the servos take.
        """
        return self._supply

    @bus_voltage.setter
    def bus_voltage(self, volts: float) -> None:
        self._supply = min(volts, self._rated)
        self.records["voltage"] = self._supply

    @property
    def power(self) -> float:
        """Electrical power that all motors draw [W]: none is fed back."""
        s, c = self.records, self._constants[0]
        volts = c["resistance"] * s["current"] + c["volts_per_speed"] * s["rotor"]
        return float(np.maximum(volts * s["current"], 0.0).sum())

    def step(self, joint_position: Array, joint_velocity: Array) -> Array:
        """Run one physics step; return `torque`.

        Args:
            joint_position: (n,) at the start of the step [rad].
            joint_velocity: (n,) at the start of the step [rad/s].
        """
        step_motors(self.records, self._constants, joint_position, joint_velocity, self.torque)
        return self.torque

    def update_state(self, joint_position: Array) -> None:
        """Read the encoders at the end of a tick.

        Args:
            joint_position: (n,) now [rad].
        """
        c = self._constants[0]
        counts = c["center"] + joint_position * c["counts_per_radian"] + 0.5
        self.records["count"] = np.floor(counts)

    def reset(self) -> None:
        """Forget the motion: torque off, cold, no errors. What was set up stays."""
        for name in ("torque_on", "error", "bitten", "started"):
            self.records[name] = 0
        for name in ("seen_rate", "current", "told_current", "gap", "rotor", "loaded", "silence"):
            self.records[name] = 0.0
        self.records["temperature"] = AMBIENT
        self.records["voltage"] = self._supply
        self.torque[:] = 0.0


def motor_constants(servo: BusServoSection, step: float) -> NDArray[np.void]:
    """Return what all servos share: (1,) record of `CONSTANTS`."""
    units = ServoUnits(servo)
    constants = np.zeros(1, CONSTANTS)
    c = constants[0]
    c["step"] = step
    c["counts_per_radian"], c["center"] = units.counts_per_radian, units.center
    c["torque_per_ampere"], c["friction"] = units.torque_per_ampere, units.friction
    c["creep"] = _CREEP
    c["resistance"], c["volts_per_speed"] = units.resistance, units.volts_per_speed
    c["half_gap"], c["armature"] = 0.5 * servo.backlash, servo.armature
    c["law_rate"] = 2.0 * math.pi * _LAW_BANDWIDTH
    c["told_gain"] = -math.expm1(-2.0 * math.pi * _TOLD_BANDWIDTH * step)
    c["heating"] = servo.thermal_resistance
    c["cooling"] = -math.expm1(-step / servo.thermal_time)
    c["ambient"], c["overload_time"] = AMBIENT, _OVERLOAD_TIME
    return constants
