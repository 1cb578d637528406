"""Setting a servo up over the bus: who it is, how it is to work. Waits for its answers."""

from __future__ import annotations

from collections.abc import Iterator

from husky_description.bus_servo import BusServoSection
from husky_drivers.dynamixel import control_table as table
from husky_drivers.dynamixel.chain import ServoChain
from husky_drivers.dynamixel.control_table import HardwareError, ServoOperatingMode, ServoRegister
from husky_drivers.dynamixel.units import ServoUnits

GARBLED = "answers are garbled: two servos of this id, or noise"
_SHUTDOWN = (
    HardwareError.OVERHEATING
    | HardwareError.MOTOR_ENCODER
    | HardwareError.ELECTRICAL_SHOCK
    | HardwareError.OVERLOAD
)
"""What makes a servo let go by itself."""


def registers_of(servo: BusServoSection) -> Iterator[tuple[ServoRegister, int]]:
    """Yield what is written to every servo, in this order; torque is off.

    The current limit is that of the torque limit: in current-based position control, goal current
    and limit hold the torque, and the effort of a command cannot be said as one.
    """
    current = ServoUnits(servo).current_count(servo.torque_limit)
    yield table.TORQUE_ENABLE, 0
    yield table.BUS_WATCHDOG, 0
    yield table.STATUS_RETURN_LEVEL, 2
    yield table.RETURN_DELAY, 0
    yield table.OPERATING_MODE, ServoOperatingMode.CURRENT_BASED_POSITION
    yield table.TEMPERATURE_LIMIT, round(servo.temperature_limit)
    yield table.CURRENT_LIMIT, current
    yield table.SHUTDOWN, int(_SHUTDOWN)
    yield table.POSITION_D_GAIN, servo.position_d
    yield table.POSITION_I_GAIN, 0
    yield table.POSITION_P_GAIN, servo.position_p
    yield table.FEEDFORWARD_2ND_GAIN, 0
    yield table.FEEDFORWARD_1ST_GAIN, 0
    yield table.PROFILE_ACCELERATION, 0
    yield table.PROFILE_VELOCITY, 0
    yield table.GOAL_CURRENT, current


def commission(chain: ServoChain, number: int, servo: BusServoSection) -> str:
    """Set one servo up; what it has already is not written: its EEPROM wears.

    Args:
        chain: the bus.
        number: id of the servo.
        servo: its data sheet.

    Returns:
        "", or why it cannot be used.
    """
    garbled = chain.garbled[number]
    model = chain.ping(number)
    if model is None:
        return GARBLED if chain.garbled[number] > garbled else "no answer"
    if model != servo.model_number:
        return f"model number is {model}, a {servo.model} has {servo.model_number}"
    for register, value in registers_of(servo):
        now = chain.read(number, register, register)
        if now is None and chain.garbled[number] > garbled:
            return GARBLED
        if now is None:
            return f"no good answer when {register.name} is read"
        if register.unpack(now) != value and not chain.write(number, register, value):
            return chain.refused or f"no good answer when {register.name} is written"
    return ""
