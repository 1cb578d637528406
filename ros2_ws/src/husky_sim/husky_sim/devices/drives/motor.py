"""Motors, gears and encoders of all joints in the plant, under the law of `servo_law`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_drivers.ethercat.axes import GREATEST_KD, GREATEST_KP
from husky_sim.devices.drives.servo_law import (
    CONSTANTS,
    OFF,
    SERVO,
    read_state,
    step_servos,
    take_command,
)

_MOST_COUNTS = 2.0**31
"""Beyond, no target position can be said on the wire (object 0x607A)."""


@dataclass(frozen=True)
class ServoTiming:
    """Time scales of the servos [s] and cut-off of the speed estimate [Hz].

    Attributes:
        step: physics step; a whole number of drive cycles.
        interpolation: period in which targets are reached (object 0x60C2).
        watchdog: without a command for this long there is no torque.
        velocity_cutoff: of the low-pass on the count difference (assumed).
    """

    step: float = 0.0005
    interpolation: float = 0.002
    watchdog: float = 0.1
    velocity_cutoff: float = 200.0


class Servos:
    """The servos of all joints, between a ServoCommand and a ServoState.

    Attributes:
        torque: (12,) mean joint torque over the last physics step [N m], overwritten by `step`.
        encoder_count: (12,) counts, int32, as the last `update_state` left it.
        velocity_count: (12,) the drives' speed estimate [counts/s], int32, likewise.
        current: (12,) motor current [A], likewise.
    """

    def __init__(self, robot: Robot, timing: ServoTiming | None = None, seed: int = 0):
        """Power off, encoders' turn errors drawn.

        Args:
            robot: its motors, gears, encoders and drives.
            timing: see `ServoTiming`.
            seed: of the phase (0 to 2 pi) and amplitude (half to all of the encoder's accuracy) of
                each encoder's error.

        Raises:
            ValueError: when a time is not a whole number of drive cycles.
        """
        timing = ServoTiming() if timing is None else timing
        self._servos = np.zeros(len(robot.joint_names), SERVO)
        self._constants = servo_constants(robot, timing)
        random = np.random.default_rng(seed)
        count = len(self._servos)
        self._servos["error_amplitude"] = robot.encoder.accuracy * random.uniform(0.5, 1.0, count)
        self._servos["error_phase"] = random.uniform(0.0, 2.0 * np.pi, count)
        self._servos["age"] = self._constants[0]["watchdog_cycles"]
        self.torque = np.zeros(count)
        self.encoder_count = np.zeros(count, np.int32)
        self.velocity_count = np.zeros(count, np.int32)
        self.current = np.zeros(count)
        self._compile()

    def _compile(self) -> None:
        """Compile the kernels, or load them, for the types of a tick, so that no tick waits."""
        zero = np.zeros(len(self._servos))
        self.set_command(zero.astype(np.uint8), zero, zero, zero, zero, zero, zero)
        self.step(zero, zero)
        self.update_state(zero)
        self.encoder_count[:] = 0
        self.velocity_count[:] = 0
        self.reset()

    @property
    def bus_voltage(self) -> float:
        """Supply of the drives [V]."""
        return float(self._constants[0]["bus_voltage"])

    @bus_voltage.setter
    def bus_voltage(self, volts: float) -> None:
        self._constants[0]["bus_voltage"] = volts

    @property
    def records(self) -> NDArray[np.void]:
        """The servos' records (`SERVO`), to look at."""
        return self._servos

    def set_command(
        self,
        kind: Any,
        position: Any,
        velocity: Any,
        torque: Any,
        kp: Any,
        kd: Any,
        torque_limit: Any,
    ) -> bool:
        """Take the command of a tick; arrays of 12, fields and units of husky_msgs/ServoCommand.

        Returns:
            Whether it was taken; one that is refused changes nothing.
        """
        taken: bool = take_command(
            self._servos,
            self._constants,
            kind,
            position,
            velocity,
            torque,
            kp,
            kd,
            torque_limit,
        )
        return taken

    def step(self, joint_position: Array, joint_velocity: Array) -> Array:
        """Run one physics step's drive cycles.

        Args:
            joint_position: (12,) at the start of the step [rad].
            joint_velocity: (12,) at the start of the step [rad/s].

        Returns:
            `torque`, the mean joint torques over the step [N m].
        """
        step_servos(self._servos, self._constants, joint_position, joint_velocity, self.torque)
        return self.torque

    def update_state(self, joint_position: Array) -> None:
        """Read the encoders at the end of a tick into the attributes of a ServoState.

        Args:
            joint_position: (12,) now [rad].
        """
        read_state(
            self._servos,
            self._constants,
            joint_position,
            self.encoder_count,
            self.velocity_count,
            self.current,
        )

    def reset(self) -> None:
        """Forget the motion and the command: torque off, encoders start anew."""
        self._servos["kind"] = OFF
        self._servos["started"] = 0
        self._servos["velocity"] = 0.0
        self._servos["age"] = self._constants[0]["watchdog_cycles"]
        self._servos["current"] = 0.0
        self.torque[:] = 0.0


def _cycles(time: float, cycle: float, name: str) -> int:
    cycles = round(time / cycle)
    if cycles < 1 or abs(cycles * cycle - time) > 1e-9:
        raise ValueError(f"{name} is {time!r} s, not a whole number of drive cycles of {cycle} s")
    return cycles


def servo_constants(robot: Robot, timing: ServoTiming) -> NDArray[np.void]:
    """Return what all servos of a robot share: (1,) record of `CONSTANTS`.

    Raises:
        ValueError: when a time is not a whole number of drive cycles.
    """
    cycle = robot.drive.cycle
    constants = np.zeros(1, CONSTANTS)
    c = constants[0]
    c["cycle"] = cycle
    c["cycles_per_step"] = _cycles(timing.step, cycle, "step")
    c["interpolation_cycles"] = _cycles(timing.interpolation, cycle, "interpolation")
    c["watchdog_cycles"] = _cycles(timing.watchdog, cycle, "watchdog")
    c["ratio"] = robot.gear.ratio
    c["counts_per_motor_radian"] = robot.encoder.counts_per_motor_turn / (2.0 * np.pi)
    c["radians_per_count"] = 2.0 * np.pi / robot.encoder_counts_per_joint_turn
    c["filter_gain"] = -np.expm1(-2.0 * np.pi * timing.velocity_cutoff * cycle)
    c["torque_per_ampere"] = robot.motor.torque_constant * robot.gear.ratio * robot.gear.efficiency
    c["stall_current_per_volt"] = 1.0 / (np.sqrt(3.0) * robot.motor.phase_resistance)
    c["speed_constant"] = robot.motor.speed_constant
    c["bus_voltage"] = robot.drive.bus_voltage
    c["peak_torque"] = robot.drive.peak_current * c["torque_per_ampere"]
    c["greatest_position"] = _MOST_COUNTS * c["radians_per_count"]
    c["greatest_velocity"] = robot.joint_velocity_limit.max()
    c["greatest_kp"], c["greatest_kd"] = GREATEST_KP, GREATEST_KD
    return constants
