"""The servo law of the twelve drives with their motors, gears and encoders, at 10 kHz.

Runs in the plant between physics steps, where a real drive closes its loops: targets come at the
control tick, the law runs every drive cycle on what the encoder shows. Per cycle and joint: encoder
(turn error, quantisation), speed estimate, interpolated targets, law, current limits, torque.

- Encoder on the motor shaft: count = floor((a + A sin(a + phase)) N / 2 pi), a the motor's angle.
- Speed: difference of counts over a cycle through a first-order low-pass.
- Position law: kp (p* - p) + kd (v* - v) + torque*; velocity law: kd (v* - v) + torque*. Targets
  run linearly from the last ones to the new ones in the interpolation period, then hold.
- Current: i = torque / (kt ratio efficiency), limited by the drive and by the supply: a motor of
  speed constant K, phase resistance R, on a bus U, takes at most U / (sqrt(3) R) (1 - w / (K U))
  (sinusoidal drive, no inductance). The gear's loss is this constant efficiency in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from husky_description.robot import Robot

Array = NDArray[np.float64]

OFF, POSITION, VELOCITY, TORQUE = 0, 1, 2, 3
"""Kinds of a servo command (husky_msgs/ServoCommand)."""

SERVO = np.dtype(
    [
        # command
        ("kind", "i4"),
        ("kp", "f8"),
        ("kd", "f8"),
        ("torque_limit", "f8"),
        ("start_position", "f8"),
        ("start_velocity", "f8"),
        ("start_torque", "f8"),
        ("end_position", "f8"),
        ("end_velocity", "f8"),
        ("end_torque", "f8"),
        ("age", "i8"),  # drive cycles since the command
        # encoder
        ("error_amplitude", "f8"),  # rad at the motor
        ("error_phase", "f8"),  # rad
        ("count", "i8"),
        ("velocity", "f8"),  # filtered, counts/s
        ("started", "i4"),
        # motor
        ("current", "f8"),  # mean of the last physics step, A
    ],
    align=True,
)
"""State of one joint's servo; joint side, SI, except where said."""

CONSTANTS = np.dtype(
    [
        ("cycles_per_step", "i8"),
        ("cycle", "f8"),  # s
        ("interpolation_cycles", "i8"),
        ("watchdog_cycles", "i8"),
        ("ratio", "f8"),
        ("counts_per_motor_radian", "f8"),
        ("radians_per_count", "f8"),  # at the joint
        ("filter_gain", "f8"),  # of the speed estimate, per cycle
        ("torque_per_ampere", "f8"),
        ("stall_current_per_volt", "f8"),  # 1/ohm
        ("speed_constant", "f8"),  # rad/s/V
        ("bus_voltage", "f8"),
    ],
    align=True,
)
"""What all joints share."""


@njit(cache=True)
def supply_limits(motor_velocity: float, bus_voltage: float, c: Any) -> tuple[float, float]:
    """Least and greatest motor current that the supply can drive at a speed [A].

    Args:
        motor_velocity: rad/s.
        bus_voltage: V.
        c: record of `CONSTANTS`.
    """
    stall = bus_voltage * c.stall_current_per_volt
    back = motor_velocity / c.speed_constant * c.stall_current_per_volt
    return -stall - back, stall - back


@njit(cache=True)
def encoder_count(motor_angle: float, amplitude: float, phase: float, per_radian: float) -> int:
    """Count that the encoder shows; see the module's formula."""
    return int(np.floor((motor_angle + amplitude * np.sin(motor_angle + phase)) * per_radian))


@njit(cache=True)
def _torque(s: Any, c: Any, motor_velocity: float) -> float:
    """Joint torque in this drive cycle [N m]; the state's age is that of the cycle."""
    if s.kind == OFF or s.age >= c.watchdog_cycles:
        return 0.0
    part = min(1.0, (s.age + 1) / c.interpolation_cycles)
    torque = s.start_torque + part * (s.end_torque - s.start_torque)
    if s.kind != TORQUE:
        velocity = s.start_velocity + part * (s.end_velocity - s.start_velocity)
        torque += s.kd * (velocity - s.velocity * c.radians_per_count)
        if s.kind == POSITION:
            position = s.start_position + part * (s.end_position - s.start_position)
            torque += s.kp * (position - (s.count + 0.5) * c.radians_per_count)
    if not np.isfinite(torque):
        return 0.0
    torque = min(max(torque, -s.torque_limit), s.torque_limit)
    least, greatest = supply_limits(motor_velocity, c.bus_voltage, c)
    current: float = min(max(torque / c.torque_per_ampere, least), greatest)
    return current * float(c.torque_per_ampere)


@njit(cache=True)
def step_servos(
    servos: Any, constants: Any, joint_position: Array, joint_velocity: Array, out: Array
) -> None:
    """Run the drive cycles of one physics step; the joints move on at their velocity meanwhile.

    Args:
        servos: records of `SERVO`.
        constants: (1,) record of `CONSTANTS`.
        joint_position: at the start of the step [rad].
        joint_velocity: at the start of the step [rad/s].
        out: mean torque over the step [N m], written.
    """
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        motor_velocity = joint_velocity[i] * c.ratio
        angle = joint_position[i] * c.ratio
        total = 0.0
        for _ in range(c.cycles_per_step):
            count = encoder_count(
                angle, s.error_amplitude, s.error_phase, c.counts_per_motor_radian
            )
            if s.started:
                s.velocity += c.filter_gain * ((count - s.count) / c.cycle - s.velocity)
            else:
                s.velocity = motor_velocity * c.counts_per_motor_radian
                s.started = 1
            s.count = count
            total += _torque(s, c, motor_velocity)
            s.age += 1
            angle += motor_velocity * c.cycle
        out[i] = total / c.cycles_per_step
        s.current = out[i] / c.torque_per_ampere


@njit(cache=True)
def take_command(
    servos: Any,
    constants: Any,
    kind: Any,
    position: Any,
    velocity: Any,
    torque: Any,
    kp: Any,
    kd: Any,
    torque_limit: Any,
) -> None:
    """Start from where the last targets stand now toward new ones (husky_msgs/ServoCommand).

    A power stage that changes its kind starts at its new targets.
    """
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        if kind[i] == s.kind:
            part = min(1.0, s.age / c.interpolation_cycles)
            s.start_position += part * (s.end_position - s.start_position)
            s.start_velocity += part * (s.end_velocity - s.start_velocity)
            s.start_torque += part * (s.end_torque - s.start_torque)
        else:
            s.start_position = position[i]
            s.start_velocity = velocity[i]
            s.start_torque = torque[i]
        s.kind = kind[i]
        s.end_position = position[i]
        s.end_velocity = velocity[i]
        s.end_torque = torque[i]
        s.kp = kp[i]
        s.kd = kd[i]
        s.torque_limit = torque_limit[i]
        s.age = 0


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
        cycle = robot.drive.cycle
        self._servos = np.zeros(len(robot.joint_names), SERVO)
        self._constants = np.zeros(1, CONSTANTS)
        c = self._constants[0]
        c["cycle"] = cycle
        c["cycles_per_step"] = _cycles(timing.step, cycle, "step")
        c["interpolation_cycles"] = _cycles(timing.interpolation, cycle, "interpolation")
        c["watchdog_cycles"] = _cycles(timing.watchdog, cycle, "watchdog")
        c["ratio"] = robot.gear.ratio
        c["counts_per_motor_radian"] = robot.encoder.counts_per_motor_turn / (2.0 * np.pi)
        c["radians_per_count"] = 2.0 * np.pi / robot.encoder_counts_per_joint_turn
        c["filter_gain"] = -np.expm1(-2.0 * np.pi * timing.velocity_cutoff * cycle)
        c["torque_per_ampere"] = (
            robot.motor.torque_constant * robot.gear.ratio * robot.gear.efficiency
        )
        c["stall_current_per_volt"] = 1.0 / (np.sqrt(3.0) * robot.motor.phase_resistance)
        c["speed_constant"] = robot.motor.speed_constant
        c["bus_voltage"] = robot.drive.bus_voltage
        random = np.random.default_rng(seed)
        count = len(self._servos)
        self._servos["error_amplitude"] = robot.encoder.accuracy * random.uniform(0.5, 1.0, count)
        self._servos["error_phase"] = random.uniform(0.0, 2.0 * np.pi, count)
        self._servos["age"] = c["watchdog_cycles"]
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
    ) -> None:
        """Take the command of a tick; arrays of 12, fields and units of husky_msgs/ServoCommand."""
        take_command(
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


@njit(cache=True)
def read_state(
    servos: Any, constants: Any, joint_position: Array, count: Any, velocity: Any, current: Any
) -> None:
    """What the drives report at a tick; arguments as in `Servos.update_state`."""
    c = constants[0]
    for i in range(len(servos)):
        s = servos[i]
        count[i] = encoder_count(
            joint_position[i] * c.ratio,
            s.error_amplitude,
            s.error_phase,
            c.counts_per_motor_radian,
        )
        velocity[i] = int(np.rint(s.velocity))
        current[i] = s.current


def _cycles(time: float, cycle: float, name: str) -> int:
    cycles = round(time / cycle)
    if cycles < 1 or abs(cycles * cycle - time) > 1e-9:
        raise ValueError(f"{name} is {time!r} s, not a whole number of drive cycles of {cycle} s")
    return cycles
