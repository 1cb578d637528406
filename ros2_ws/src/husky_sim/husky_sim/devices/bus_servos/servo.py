"""One emulated servo on the bus: its control table, and what it does on an instruction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from husky_description.bus_servo import BusServoSection
from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.control_table import (
    Instruction,
    ServoOperatingMode,
    ServoRegister,
    StatusError,
)
from husky_drivers.dynamixel.units import AMPERE, CONTROL_PERIOD, D_SCALE, FULL_PWM, P_SCALE
from husky_sim.devices.bus_servos.packets import status_packet

FIRMWARE = 48
"""Version that the servos tell."""
_BOOT_TIME = 0.5
"""Time that a restart takes [s] (assumed)."""
_GOALS = (table.GOAL_PWM, table.GOAL_CURRENT, table.GOAL_VELOCITY, table.GOAL_POSITION)
_FOLLOWING = (
    ServoOperatingMode.POSITION,
    ServoOperatingMode.EXTENDED_POSITION,
    ServoOperatingMode.CURRENT_BASED_POSITION,
)
_AT = {register.address: register for register in table.TABLE}
_MODES = tuple(int(mode) for mode in ServoOperatingMode)

Outcome = tuple[int, bytes]
"""Error number, one of `StatusError`, and parameters of an answer."""


class EmulatedServo:
    """A servo; its motor is a record that the physics turns.

    Attributes:
        motor: record of `motor_law.MOTOR`.
        silent: it is off the bus.
        booting: time until it answers again [s].
    """

    def __init__(self, number: int, servo: BusServoSection, motor: Any):
        """Power on with the factory's EEPROM, at the bus's baud rate.

        Args:
            number: its id.
            servo: its data sheet.
            motor: its record.
        """
        self.motor = motor
        self.silent, self.booting = False, 0.0
        self._memory = bytearray(table.TABLE_SIZE)
        self._waiting: tuple[ServoRegister, ...] | None = None
        self._kept = b""
        for register in table.TABLE:
            self._set(register, register.initial)
        self._set(table.MODEL_NUMBER, servo.model_number)
        self._set(table.FIRMWARE_VERSION, FIRMWARE)
        self._set(table.ID, number)
        if servo.baud_rate in table.BAUD_RATES:
            self._set(table.BAUD_RATE, table.BAUD_RATES.index(servo.baud_rate))
        self._power_on()

    def preset(self, held: Mapping[ServoRegister, int]) -> None:
        """Have somebody else's values in it: those in EEPROM before power on, those in RAM since.

        Args:
            held: values by register.
        """
        for register, value in held.items():
            self._set(register, value)
        self._power_on()
        for register, value in held.items():
            self._set(register, value)
        self._load()

    @property
    def number(self) -> int:
        """Its id."""
        return self._get(table.ID)

    def _get(self, register: ServoRegister) -> int:
        return register.unpack(self._memory[register.address : register.end])

    def _set(self, register: ServoRegister, value: int) -> None:
        self._memory[register.address : register.end] = register.pack(value)

    # Power and time -----------------------------------------------------------------------------
    def _power_on(self) -> None:
        """Begin with RAM as it is after power on: torque off, no error."""
        for register in table.TABLE:
            if not register.in_eeprom:
                self._set(register, register.initial)
        self._waiting = None
        self._set(table.GOAL_CURRENT, self._get(table.CURRENT_LIMIT))
        self._set(table.GOAL_PWM, self._get(table.PWM_LIMIT))
        motor = self.motor
        motor["torque_on"] = self._get(table.STARTUP) & 1
        motor["error"] = motor["bitten"] = 0
        motor["loaded"] = motor["silence"] = 0.0
        self._set(table.GOAL_POSITION, int(motor["count"]) + self._get(table.HOMING_OFFSET))
        self._load()

    def restart(self) -> None:
        """Reboot: off the bus for a while, then as after power on."""
        self._power_on()
        self.booting = _BOOT_TIME

    def advance(self, period: float) -> None:
        """Let time [s] pass."""
        self.booting = max(0.0, self.booting - period)

    @property
    def answers(self) -> bool:
        """Whether it is on the bus and awake."""
        return not self.silent and self.booting == 0.0

    def _load(self) -> None:
        """Hand what the control table says to the motor."""
        motor, get = self.motor, self._get
        motor["follows"] = get(table.OPERATING_MODE) in _FOLLOWING
        if not motor["bitten"]:
            motor["goal"] = get(table.GOAL_POSITION) - get(table.HOMING_OFFSET)
        motor["p"] = get(table.POSITION_P_GAIN) * P_SCALE / FULL_PWM
        motor["d"] = get(table.POSITION_D_GAIN) * D_SCALE * CONTROL_PERIOD / FULL_PWM
        motor["goal_pwm"] = min(abs(get(table.GOAL_PWM)), get(table.PWM_LIMIT)) / FULL_PWM
        motor["current_limit"] = get(table.CURRENT_LIMIT) / AMPERE
        motor["goal_current"] = motor["current_limit"]
        if get(table.OPERATING_MODE) == ServoOperatingMode.CURRENT_BASED_POSITION:
            motor["goal_current"] = abs(get(table.GOAL_CURRENT)) / AMPERE
        motor["temperature_limit"] = get(table.TEMPERATURE_LIMIT)
        motor["voltage_low"] = 0.1 * get(table.MIN_VOLTAGE_LIMIT)
        motor["voltage_high"] = 0.1 * get(table.MAX_VOLTAGE_LIMIT)
        motor["shutdown"] = get(table.SHUTDOWN)
        motor["watchdog"] = max(0, get(table.BUS_WATCHDOG)) * table.WATCHDOG_UNIT

    def _refresh(self) -> None:
        """Write into the control table what is measured."""
        motor = self.motor
        self._set(table.TORQUE_ENABLE, int(motor["torque_on"]))
        self._set(table.HARDWARE_ERROR, int(motor["error"]))
        if motor["bitten"]:
            self._set(table.BUS_WATCHDOG, -1)
        velocity = float(motor["seen_rate"]) * 60.0 / (4096.0 * 0.229)
        self._set(table.PRESENT_CURRENT, round(float(motor["told_current"]) * AMPERE))
        self._set(table.PRESENT_VELOCITY, round(velocity))
        offset = self._get(table.HOMING_OFFSET)
        self._set(table.PRESENT_POSITION, int(motor["count"]) + offset)
        self._set(table.MOVING, int(abs(velocity) > self._get(table.MOVING_THRESHOLD)))
        self._set(table.PRESENT_INPUT_VOLTAGE, max(0, round(10.0 * float(motor["voltage"]))))
        temperature = min(max(0.0, float(motor["temperature"])), 255.0)
        self._set(table.PRESENT_TEMPERATURE, math.floor(temperature))

    # Instructions -------------------------------------------------------------------------------
    def hear(self) -> None:
        """A packet is on the line, whoever is meant: the watchdog is content."""
        self.motor["silence"] = 0.0

    def answer(self, instruction: int, outcome: Outcome) -> bytes:
        """Return the status packet of an outcome, b"" where the return level wants none."""
        error, parameters = outcome
        level = self._get(table.STATUS_RETURN_LEVEL)
        reads = instruction in (Instruction.READ, Instruction.SYNC_READ)
        if instruction != Instruction.PING and level < (1 if reads else 2):
            return b""
        alert = table.ALERT if self.motor["error"] else 0
        return status_packet(self.number, error | alert, parameters)

    def execute(self, instruction: int, parameters: bytes) -> Outcome:
        """Do what an instruction to this servo says."""
        if instruction == Instruction.PING:
            model = self._memory[table.MODEL_NUMBER.address : table.MODEL_NUMBER.end]
            return StatusError.NONE, bytes(model) + bytes([FIRMWARE])
        if instruction == Instruction.READ:
            if len(parameters) != 4:
                return StatusError.DATA_LENGTH, b""
            return self.read(
                int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:], "little")
            )
        if instruction in (Instruction.WRITE, Instruction.REG_WRITE):
            if len(parameters) < 3:
                return StatusError.DATA_LENGTH, b""
            address = int.from_bytes(parameters[:2], "little")
            later = instruction == Instruction.REG_WRITE
            return self.write(address, parameters[2:], later=later), b""
        if instruction == Instruction.ACTION:
            return self._act(), b""
        if instruction == Instruction.REBOOT:
            return StatusError.NONE, b""  # the bus restarts it when the answer is out
        if instruction == Instruction.FACTORY_RESET:
            return StatusError.RESULT_FAIL, b""  # nothing on this robot may reset ids
        return StatusError.INSTRUCTION, b""

    def read(self, address: int, length: int) -> Outcome:
        """Return bytes of the control table."""
        if not 0 < length <= table.TABLE_SIZE or address + length > table.TABLE_SIZE:
            return StatusError.ACCESS, b""
        self._refresh()
        return StatusError.NONE, bytes(self._memory[address : address + length])

    def write(self, address: int, data: bytes, *, later: bool = False) -> int:
        """Write registers, all or none; return one of `StatusError`."""
        self._refresh()
        registers, at = [], address
        while at < address + len(data):
            register = _AT.get(at)
            if register is None or not register.writable:
                return StatusError.ACCESS
            if register.end > address + len(data):
                return StatusError.DATA_LENGTH
            error = self._check(
                register, register.unpack(data[at - address : register.end - address])
            )
            if error:
                return error
            registers.append(register)
            at = register.end
        if later:
            self._waiting, self._kept = tuple(registers), data
            self._set(table.REGISTERED_INSTRUCTION, 1)
        else:
            self._take(registers, data)
        return StatusError.NONE

    def _act(self) -> int:
        """Do what was registered."""
        if self._waiting is None:
            return StatusError.INSTRUCTION
        registers, self._waiting = self._waiting, None
        self._set(table.REGISTERED_INSTRUCTION, 0)
        self._take(registers, self._kept)
        return StatusError.NONE

    def _check(self, register: ServoRegister, value: int) -> int:
        """Return why a value cannot be written, `StatusError.NONE` when it can."""
        if register.in_eeprom and self.motor["torque_on"]:
            return StatusError.ACCESS
        if register in _GOALS and self.motor["bitten"]:
            return StatusError.DATA_RANGE
        if register is table.TORQUE_ENABLE and value == 1:
            shut_down = int(self.motor["error"]) & self._get(table.SHUTDOWN)
            return StatusError.RESULT_FAIL if shut_down else StatusError.NONE
        if not register.least <= value <= register.greatest or (
            register is table.OPERATING_MODE and value not in _MODES
        ):
            return StatusError.DATA_RANGE
        if register is table.GOAL_CURRENT and abs(value) > self._get(table.CURRENT_LIMIT):
            return StatusError.DATA_LIMIT
        if register is table.GOAL_PWM and abs(value) > self._get(table.PWM_LIMIT):
            return StatusError.DATA_LIMIT
        one_turn = self._get(table.OPERATING_MODE) == ServoOperatingMode.POSITION
        if register is table.GOAL_POSITION and one_turn:
            low, high = self._get(table.MIN_POSITION_LIMIT), self._get(table.MAX_POSITION_LIMIT)
            return StatusError.NONE if low <= value <= high else StatusError.DATA_LIMIT
        return StatusError.NONE

    def _take(self, registers: Any, data: bytes) -> None:
        start = registers[0].address
        for register in registers:
            value = register.unpack(data[register.address - start : register.end - start])
            self._set(register, value)
            if register is table.TORQUE_ENABLE:
                if value and not self.motor["torque_on"]:
                    self.motor["loaded"] = self.motor["silence"] = 0.0
                self.motor["torque_on"] = value
            elif register is table.BUS_WATCHDOG and value == 0:
                self.motor["bitten"] = 0
        self._load()
