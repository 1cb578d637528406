"""How a quadrotor's arms leave the posture of flight: to turn, to sweep, and when something fails.

In the hold they tilt the propellers to turn the body (T21), and sweep when they are told to. With a
rotor or a hip lost they make the best of what is left.
"""

from __future__ import annotations

import math

import numpy as np

from husky_control.flight.hover import HoverPhase
from husky_control.flight.three_rotors import ThreeRotors
from husky_control.modes.context import ModeContext
from husky_control.modes.limp_arm import LimpArm
from husky_control.rotation import wrap_angle, yaw_of
from husky_control.slew import slewed
from husky_control.tick_data import TICK, JointCommand

AUTOPILOT_YAW_GAIN = 1.5
"""Yaw rate that the flight controller asks for per error of heading, its MC_YAW_P [1/s]."""
YAW_RATE_LIMIT = math.radians(60.0)
"""Greatest yaw rate that it asks for, its MC_YAWRATE_MAX [rad/s]."""
YAW_ACCELERATION = 5.0
"""At which that rate is asked for; tilted propellers give 7 rad/s^2 [rad/s^2]."""
YAW_RATE_CUTOFF = 6.0
"""Of the low-pass filter of the yaw rate that tilted propellers damp [Hz].

Without it they and a frame that bends (T6), of 20 Hz when loaded, ring about the vertical at 22 Hz.
"""
DRAWN_TOGETHER = np.array((1.0, 1.0, -1.0, -1.0))
"""Signs of a sweep by which front and hind arms near each other: the lift stays centred."""
SWEEP_SPEED = 0.4
"""At which `quadrotor.arm_sweep` moves the arms in flight [rad/s]."""
_YAW_RATE_BLEND = TICK / (TICK + 1.0 / (2.0 * math.pi * YAW_RATE_CUTOFF))
"""Share of the measured rate that the filter takes in a tick [-]."""


class ArmsInFlight:
    """Changes of the joints' commands, beside the posture of flight."""

    def __init__(self, context: ModeContext) -> None:
        """In the posture of flight."""
        assert context.vectoring is not None
        self._context, self._vectoring = context, context.vectoring
        self._limp_arm, self._three_rotors = LimpArm(), ThreeRotors(context.robot.joint_speed)
        self._sweep = self._yaw_rate = 0.0  # rad, rad/s
        self._turning = 0.0  # rad/s, filtered
        self._north = 0.0  # rad, heading by the flight controller less that by the IMU

    def begin(self) -> None:
        """A flight begins; all is well."""
        c = self._context
        self._vectoring.reset()
        self._limp_arm.reset()
        self._three_rotors.reset()
        self._sweep = self._yaw_rate = self._turning = 0.0
        self._north = c.hover.heading - yaw_of(c.body.rotation)

    def move(self, command: JointCommand) -> None:
        """Add this tick's changes to a command that holds the posture of flight."""
        self._turn_and_sweep(command)
        m = self._context.body.measurements
        if m.fans_lost >= 0:
            yaw_rate = float(m.angular_velocity_base_in_base[2])
            self._three_rotors.move_arms(m.fans_lost, yaw_rate, command.position, TICK)
        self._limp_arm.even_out(m.joint_position, command.position, TICK)

    def _turn_and_sweep(self, command: JointCommand) -> None:
        """Add what turns the body (T21), and a sweep; both in the hold alone."""
        c, hover, p = self._context, self._context.hover, self._context.parameters
        share = p["quadrotor.thrust_vectoring"]
        moment = sweep = hover.lead = 0.0
        if hover.phase is HoverPhase.HOLD:
            sweep = p["quadrotor.arm_sweep"]
            error = wrap_angle(hover.heading - self._north - yaw_of(c.body.rotation))
            rate = p["quadrotor.yaw_gain"] * error + hover.yaw_rate
            rate = min(YAW_RATE_LIMIT, max(-YAW_RATE_LIMIT, rate))
            self._yaw_rate = rate = slewed(self._yaw_rate, rate, YAW_ACCELERATION * TICK)
            turning = float(c.body.measurements.angular_velocity_base_in_base[2])
            self._turning += _YAW_RATE_BLEND * (turning - self._turning)
            moment = share * p["quadrotor.yaw_damping"] * (rate - self._turning)
            # The flight controller is to ask its propellers for the same rate, not to brake.
            hover.lead = share * (rate / AUTOPILOT_YAW_GAIN - error)
        self._vectoring.advance(moment, TICK)
        last, self._sweep = self._sweep, slewed(self._sweep, sweep, SWEEP_SPEED * TICK)
        command.position[0::3] += self._vectoring.angle
        command.velocity[0::3] += self._vectoring.speed
        command.position[1::3] += self._sweep * DRAWN_TOGETHER
        command.velocity[1::3] += (self._sweep - last) / TICK * DRAWN_TOGETHER
