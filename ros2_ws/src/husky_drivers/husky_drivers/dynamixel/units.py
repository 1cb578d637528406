"""Units of a servo's registers, and what its gains are in newton metres (ROBOTIS e-manual)."""

from __future__ import annotations

import math

from husky_description.bus_servo import BusServoSection

AMPERE = 1.0 / 2.69e-3
"""Counts of current per ampere."""
VELOCITY_UNIT = 0.229 * 2.0 * math.pi / 60.0
"""A count of velocity [rad/s]: 0.229 rev/min."""
FULL_PWM = 885
"""Counts of PWM that are the whole supply."""
P_SCALE, I_SCALE, D_SCALE = 1.0 / 128.0, 1.0 / 65536.0, 1.0 / 16.0
"""Gains of the position controller per count of its registers."""
_MOVING = 0.3
"""Speed from which on all friction is against the motion [rad/s]: some counts of the told speed."""
CONTROL_PERIOD = 0.001
"""Period of the servo's own position controller, in which D is a difference [s] (assumed)."""


class ServoUnits:
    """Conversions between a joint in SI and its servo's registers.

    Attributes:
        counts_per_radian: of position.
        voltage: of the supply, by the data sheet [V].
        center: position count at joint angle 0: the middle of a turn.
        torque_per_ampere: of the motor at the horn, friction not taken off [N m/A].
        friction: torque that the current without load overcomes [N m].
        resistance: of the motor as the supply sees it [ohm].
        volts_per_speed: back electromotive force at the horn [V s/rad].
    """

    def __init__(self, servo: BusServoSection):
        """Derive everything from a servo's data sheet."""
        self.counts_per_radian = servo.resolution / (2.0 * math.pi)
        self.voltage = servo.voltage
        self.center = servo.resolution // 2
        self.torque_per_ampere = servo.stall_torque / (servo.stall_current - servo.no_load_current)
        self.friction = self.torque_per_ampere * servo.no_load_current
        self.resistance = servo.voltage / servo.stall_current
        self.volts_per_speed = (
            servo.voltage - self.resistance * servo.no_load_current
        ) / servo.no_load_speed

    def position_count(self, angle: float) -> int:
        """Return the goal position of a joint angle [rad]."""
        return round(self.center + angle * self.counts_per_radian)

    def current_count(self, torque: float) -> int:
        """Return the current that makes a torque at the horn [N m]."""
        return round(torque / self.torque_per_ampere * AMPERE)

    def joint_torque(self, current: float, velocity: float) -> float:
        """Return what of the motor's torque is not lost in friction [N m].

        Args:
            current: of the motor [A].
            velocity: of the joint [rad/s]; near rest, where friction may have any sign, less and
                less of it is taken off.
        """
        lost = self.friction * max(-1.0, min(1.0, velocity / _MOVING))
        return current * self.torque_per_ampere - lost

    def lead(self, position_p: int, position_d: int) -> float:
        """Return by how much D leads: the time constant that it makes with P [s], 0 without P."""
        if position_p == 0:
            return 0.0
        return position_d * D_SCALE * CONTROL_PERIOD / (position_p * P_SCALE)

    def damping(self, position_p: int, position_d: int) -> float:
        """Return what D gain and back electromotive force are together [N m s/rad]."""
        back = self.volts_per_speed * self.torque_per_ampere / self.resistance
        return self.stiffness(position_p) * self.lead(position_p, position_d) + back

    def stiffness(self, position_p: int) -> float:
        """Return what a position P gain is at the data sheet's voltage [N m/rad].

        The position controller's output is a share of the supply: P / 128 counts of it per count
        of error, `FULL_PWM` of them the whole.
        """
        duty_per_radian = position_p * P_SCALE * self.counts_per_radian / FULL_PWM
        return duty_per_radian * self.voltage / self.resistance * self.torque_per_ampere
