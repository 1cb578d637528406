"""Numbers of the servos' master: who is on the bus, limits, gains and patience."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from husky_description.bus_servo import BusServoSection
from husky_description.robot import Robot
from husky_drivers.dynamixel.control_table import HOMING_OFFSET
from husky_drivers.joint_master.settings import JointSettings, ranges_of
from husky_runtime import graph


@dataclass(frozen=True, eq=False, kw_only=True)
class ServoSettings(JointSettings):
    """Numbers of the servos and of their master; times in ticks.

    Attributes:
        servo: the servo's data sheet.
        homing_offsets: what the homing offset of each servo must be [count] (n,).
        ticks_per_cycle: control ticks to one cycle of the bus.
        watchdog: time without a packet after which a servo stops by itself [s].
        miss_limit: cycles in a row that a servo may miss.
        hold_ticks: how long the others hold the robot's fall when a servo is lost.
        landing_ticks: how long they go on at most for a controller that asks for positions.
        settle_ticks: how long they follow it after an emergency stop; after that they hold still.
        yield_ticks: how long they give way, damped, after all of `landing_ticks`.
        stop_ticks: how long servos hold still before torque goes.
        confirm_ticks: how long a stage of enabling, or a reset, may take.
        low_voltage: supply below which enabling is refused [V].
    """

    servo: BusServoSection
    homing_offsets: tuple[int, ...]
    ticks_per_cycle: int
    watchdog: float = 0.06
    miss_limit: int = 3
    hold_ticks: int = 150
    landing_ticks: int = 5000
    settle_ticks: int = 500
    yield_ticks: int = 1500
    stop_ticks: int = 30
    confirm_ticks: int = 500
    low_voltage: float = 11.0

    def longest_hold(self, stopped: bool, positions: bool) -> int:
        """Return for how many ticks servos hold, and give way, before they stop.

        Args:
            stopped: by an emergency stop, not because one is lost.
            positions: are what the controller asks for.
        """
        if positions:
            return self.landing_ticks + self.yield_ticks
        return 0 if stopped else self.hold_ticks

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the servos: their places in the order of the joints, from 1."""
        return tuple(range(1, len(self.joint_names) + 1))


def servo_settings(
    robot: Robot,
    servo: BusServoSection,
    command_timeout: float,
    homing_offsets: Sequence[int] = (),
) -> ServoSettings:
    """Return the settings of a robot's servos.

    Args:
        robot: its joints.
        servo: its data sheet.
        command_timeout: time without a command until all servos stop [s].
        homing_offsets: that the servos must hold, in joint order [count]; none for zeros.

    Raises:
        ValueError: the cycle is not a whole number of control ticks, two at least; or the offsets
            are not one a joint, or out of range.
    """
    count, most = len(robot.joint_names), HOMING_OFFSET.greatest
    offsets = tuple(homing_offsets) or (0,) * count
    if len(offsets) != count or any(abs(offset) > most for offset in offsets):
        raise ValueError(
            f"homing_offsets is {list(offsets)}, it must be {count} numbers within -{most} and "
            f"{most}"
        )
    ticks = round(servo.cycle / graph.TICK_PERIOD)
    if ticks < 2 or abs(ticks * graph.TICK_PERIOD - servo.cycle) > 1e-9:
        raise ValueError(
            f"bus_servo.cycle: {servo.cycle} s is not a whole number of control ticks of "
            f"{graph.TICK_PERIOD} s, two at least"
        )
    return ServoSettings(
        **ranges_of(robot),
        servo=servo,
        homing_offsets=offsets,
        ticks_per_cycle=ticks,
        command_timeout_ticks=round(command_timeout / graph.TICK_PERIOD),
    )
