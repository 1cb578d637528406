"""Setting a servo up over the bus: who it is, how it is to work. Waits for its answers.

A servo starts with what anybody has saved in its EEPROM, and keeps in its RAM what another master
has written since. Every register that the master relies on is read, and written when it differs.
"""

from __future__ import annotations

from collections.abc import Iterator

from husky_description.bus_servo import BusServoSection
from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.control_table import HardwareError, ServoOperatingMode, ServoRegister
from husky_drivers.dynamixel.units import FULL_PWM, ServoUnits
from husky_drivers.joint_master.setting_changes import SettingChange

GARBLED = "answers are garbled: two servos of this id, or noise"
NO_ANSWER = "no answer"
_PASSES = 3
"""Times that registers are read and set until all are right: a new operating mode resets gains."""
_SHUTDOWN = (
    HardwareError.OVERHEATING
    | HardwareError.MOTOR_ENCODER
    | HardwareError.ELECTRICAL_SHOCK
    | HardwareError.OVERLOAD
)
"""What makes a servo let go by itself."""


def registers_of(
    servo: BusServoSection, firmware: int = table.STARTUP_FIRMWARE
) -> Iterator[tuple[ServoRegister, int]]:
    """Yield what is written to every servo, in this order; torque is off.

    The current limit is that of the torque limit: in current-based position control, goal current
    and limit hold the torque, and the effort of a command cannot be said as one.
    """
    current = ServoUnits(servo).current_count(servo.torque_limit)
    yield table.TORQUE_ENABLE, 0
    yield table.BUS_WATCHDOG, 0
    yield table.RETURN_DELAY, 0
    yield table.DRIVE_MODE, 0  # not reversed; profiles by speed; no torque by a goal alone
    yield table.OPERATING_MODE, ServoOperatingMode.CURRENT_BASED_POSITION
    yield table.SECONDARY_ID, table.SECONDARY_ID.initial  # none: it would obey another's packets
    yield table.TEMPERATURE_LIMIT, round(servo.temperature_limit)
    yield table.MAX_VOLTAGE_LIMIT, table.MAX_VOLTAGE_LIMIT.initial
    yield table.MIN_VOLTAGE_LIMIT, table.MIN_VOLTAGE_LIMIT.initial
    yield table.PWM_LIMIT, FULL_PWM
    yield table.CURRENT_LIMIT, current
    yield table.VELOCITY_LIMIT, table.VELOCITY_LIMIT.greatest
    if firmware >= table.STARTUP_FIRMWARE:
        yield table.STARTUP, 0  # no torque by itself, no gains of a backup
    yield table.SHUTDOWN, int(_SHUTDOWN)
    yield table.POSITION_D_GAIN, servo.position_d
    yield table.POSITION_I_GAIN, 0
    yield table.POSITION_P_GAIN, servo.position_p
    yield table.FEEDFORWARD_2ND_GAIN, 0
    yield table.FEEDFORWARD_1ST_GAIN, 0
    yield table.GOAL_PWM, FULL_PWM
    yield table.PROFILE_ACCELERATION, 0
    yield table.PROFILE_VELOCITY, 0
    yield table.GOAL_CURRENT, current


class ServoSetup:
    """Sets servos of one chain up, and keeps what was changed.

    Attributes:
        changes: what was changed last, by servo and register.
    """

    def __init__(self, chain: ServoChain, servo: BusServoSection):
        """Take a chain whose line need not be open yet, and the servos' data sheet."""
        self._chain, self._servo = chain, servo
        self.changes: dict[tuple[int, str], SettingChange] = {}

    def commission(self, index: int, number: int, homing_offset: int = 0) -> str:
        """Set one servo up; what it has already is not written: its EEPROM wears.

        Args:
            index: its place among the joints.
            number: its id.
            homing_offset: that it must hold [count].

        Returns:
            "", or why it cannot be used.
        """
        chain, servo = self._chain, self._servo
        garbled = chain.garbled[number]
        model = chain.ping(number)
        if model is None:
            return GARBLED if chain.garbled[number] > garbled else NO_ANSWER
        if model != servo.model_number:
            return f"model number is {model}, a {servo.model} has {servo.model_number}"
        self._make_it_answer(index, number)
        for _ in range(_PASSES):
            held = chain.read(number, *table.ALL_DATA)
            if held is None:
                garbled_now = chain.garbled[number] > garbled
                return GARBLED if garbled_now else "no good answer when its registers are read"
            if (offset := _value(held, table.HOMING_OFFSET)) != homing_offset:
                return (
                    f"{table.HOMING_OFFSET.title} is {offset}, expected {homing_offset}: the joint "
                    "would stand elsewhere. If the servo is mounted so, set the parameter "
                    "homing_offsets; if not, write the register"
                )
            wrong = [
                (register, value)
                for register, value in registers_of(servo, _value(held, table.FIRMWARE_VERSION))
                if _value(held, register) != value
            ]
            if not wrong:
                return ""
            for register, value in wrong:
                if not chain.write(number, register, value):
                    return chain.refused or f"no good answer when {register.name} is written"
                self._keep(index, register, _value(held, register), value)
        return f"does not keep {', '.join(register.title for register, _ in wrong)}"

    def _make_it_answer(self, index: int, number: int) -> None:
        """Set the return level first: below 1 no read is answered, below 2 no write."""
        level = table.STATUS_RETURN_LEVEL
        data = self._chain.read(number, level, level)
        held = level.unpack(data) if data is not None else 0
        if held != 2:
            self._chain.write(number, level, 2)  # whether it says so or not
            self._keep(index, level, held, 2)

    def _keep(self, index: int, register: ServoRegister, before: int, after: int) -> None:
        change = SettingChange(index, register.title, str(before), str(after))
        self.changes[index, register.title] = change


def _value(held: bytes, register: ServoRegister) -> int:
    """Return a register's value in the bytes of `ALL_DATA`."""
    start = table.ALL_DATA[0].address
    return register.unpack(held[register.address - start : register.end - start])
