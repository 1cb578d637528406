"""What the servos have told of late, in SI on the joint side."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import Answer
from husky_drivers.dynamixel.settings import ServoSettings
from husky_drivers.dynamixel.units import AMPERE, VELOCITY_UNIT, ServoUnits


def _slice(register: table.ServoRegister, first: table.ServoRegister) -> slice:
    return slice(register.address - first.address, register.end - first.address)


_CURRENT, _VELOCITY, _POSITION = (_slice(each, table.CYCLE_DATA[0]) for each in table.CYCLE_DATA)
_TORQUE, _ERROR, _VOLTAGE, _TEMPERATURE = (
    _slice(each, table.HEALTH_DATA[0]) for each in table.HEALTH_DATA
)


class ServoReadings:
    """The joints as last read, and each servo's health.

    Attributes:
        position, velocity, effort: joints [rad, rad/s, N m] (n,); the effort is what the current
            makes and the gear's friction leaves.
        current: of the motors [A] (n,).
        misses: cycles in a row that a servo has missed (n,).
        alert: servos whose last answer said that they have a hardware error (n,).
        torque_on: servos that had torque when their health was last read (n,).
        hardware_error: bits, as last read (n,).
        temperature: [deg C] (n,), 0 before it is read.
        voltage: of the supply at the servo [V] (n,), 0 before it is read.
        health_count: how often a servo's health has been read (n,).
    """

    def __init__(self, settings: ServoSettings):
        """Nothing has been read."""
        n = len(settings.joint_names)
        self._ids, self._units = settings.ids, ServoUnits(settings.servo)
        self.position, self.velocity, self.effort = np.zeros(n), np.zeros(n), np.zeros(n)
        self.current, self.temperature, self.voltage = np.zeros(n), np.zeros(n), np.zeros(n)
        self.misses = np.zeros(n, np.int64)
        self.alert, self.torque_on = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        self.hardware_error = np.zeros(n, np.uint8)
        self.health_count = np.zeros(n, np.int64)

    def take_cycle(self, asked: np.ndarray, answers: Mapping[int, Answer], period: float) -> None:
        """Take the answers of a cycle; a joint that has not answered goes on as it was moving.

        Args:
            asked: servos that were asked (n,) bool; the others stand as they were.
            answers: by id.
            period: since the last values [s].
        """
        units = self._units
        for index, number in enumerate(self._ids):
            answer = answers.get(number)
            if answer is None:
                if asked[index]:
                    self.misses[index] += 1
                    self.position[index] += self.velocity[index] * period
                continue
            data = answer.data
            self.misses[index] = 0
            self.alert[index] = answer.alert
            count = table.PRESENT_POSITION.unpack(data[_POSITION])
            self.position[index] = (count - units.center) / units.counts_per_radian
            self.velocity[index] = table.PRESENT_VELOCITY.unpack(data[_VELOCITY]) * VELOCITY_UNIT
            self.current[index] = table.PRESENT_CURRENT.unpack(data[_CURRENT]) / AMPERE
            self.effort[index] = units.joint_torque(self.current[index], self.velocity[index])

    def go_on(self, period: float) -> None:
        """Let the joints go on as they move for a time [s]: nothing is read between two cycles."""
        self.position += self.velocity * period

    def stand_still(self, index: int) -> None:
        """A servo is lost: its joint stays where it was last seen."""
        self.velocity[index] = self.effort[index] = self.current[index] = 0.0
        self.torque_on[index] = False

    def take_health(self, index: int, data: bytes) -> None:
        """Take the bytes of `HEALTH_DATA` of a servo."""
        self.torque_on[index] = bool(table.TORQUE_ENABLE.unpack(data[_TORQUE]))
        self.hardware_error[index] = table.HARDWARE_ERROR.unpack(data[_ERROR])
        self.voltage[index] = 0.1 * table.PRESENT_INPUT_VOLTAGE.unpack(data[_VOLTAGE])
        self.temperature[index] = table.PRESENT_TEMPERATURE.unpack(data[_TEMPERATURE])
        self.health_count[index] += 1
