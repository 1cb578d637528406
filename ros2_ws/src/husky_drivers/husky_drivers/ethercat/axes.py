"""The axes of the segment in numbers: settings of the master, and their process data in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from husky_description.arrays import Array
from husky_description.robot import Robot
from husky_drivers.cia402 import STATE_OF_STATUSWORD, OperationMode
from husky_drivers.ethercat import pdo
from husky_drivers.joint_master.settings import JointSettings, ranges_of

GREATEST_KP, GREATEST_KD = 1000.0, 50.0
"""Gains beyond which no drive is set [N m/rad, N m s/rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisSettings(JointSettings):
    """Numbers of the axes and of the master; `torque_limit` is the limit in the drives too.

    Attributes:
        counts_per_radian: encoder counts per radian of a joint.
        torque_per_ampere: joint torque per motor current [N m/A].
        rated_current, peak_current: of motor and drive [A].
        kp, kd: gains of the drives [N m/rad], [N m s/rad].
        following_window, following_time: following error that trips a drive [rad], [s].
        serial_numbers: of the drives, joint after joint; () takes drives in any order.
        tick: time between two exchanges [s].
        process_data_watchdog: after which a drive without frames removes torque [s].
        quick_stop_time: in which a joint at its velocity limit is braked to rest [s].
        quick_stop_timeout_ticks: exchanges until torque is removed whatever the brake did.
        short_cycle_limit: incomplete exchanges in a row until all axes stop.
        confirm_ticks: readings of a state in a row that confirm it.
        transition_timeout_ticks: exchanges that a stage of enabling or a reset may take.
        settle_ticks: how long a stop may take until the axes brake, if they followed positions.
        hold_ticks: how long they hold zero speed in a stop, if they did not.
    """

    counts_per_radian: float
    torque_per_ampere: float
    rated_current: float
    peak_current: float
    kp: float
    kd: float
    following_window: float
    following_time: float
    serial_numbers: tuple[int, ...] = ()
    tick: float = 0.002
    process_data_watchdog: float = 0.05
    quick_stop_time: float = 0.05
    quick_stop_timeout_ticks: int = 30
    short_cycle_limit: int = 3
    confirm_ticks: int = 10
    transition_timeout_ticks: int = 250
    settle_ticks: int = 290
    hold_ticks: int = 150

    @property
    def current_per_permille(self) -> float:
        """Unit of torque and current on the wire [A]."""
        return self.rated_current * 1e-3


def settings_of(robot: Robot, **overrides: Any) -> AxisSettings:
    """Return the settings of a robot's axes.

    Args:
        robot: its joints, motors, gears, encoders and drives.
        overrides: attributes of `AxisSettings` to replace.

    Raises:
        TypeError: when there is no such setting.
        ValueError: when a value is out of its range.
    """
    settings = AxisSettings(
        **ranges_of(robot),
        counts_per_radian=robot.encoder_counts_per_joint_turn / (2.0 * math.pi),
        torque_per_ampere=robot.motor.torque_constant * robot.gear.ratio * robot.gear.efficiency,
        rated_current=robot.drive.continuous_current,
        peak_current=robot.drive.peak_current,
        kp=robot.servo.kp,
        kd=robot.servo.kd,
        following_window=robot.drive.following_error_window,
        following_time=robot.drive.following_error_time,
    )
    return replace(settings, **overrides)


class ProcessData:
    """The process images of all axes, written and read in SI on the joint side.

    Attributes:
        position, velocity, effort: joints as last read [rad, rad/s, N m]; the effort is what the
            current makes at the gear's efficiency.
        states: CiA 402 states as last read (n,), values of `State`.
        max_torque: per mille of rated current that `AxisSettings.torque_limit` is.
        controlword, mode: fields of the outputs, to be written in place.
    """

    def __init__(self, settings: AxisSettings):
        """Start with zeros in all bytes."""
        n = len(settings.joint_names)
        self.outputs, self.inputs = pdo.ProcessImage(pdo.RX, n), pdo.ProcessImage(pdo.TX, n)
        self._counts = settings.counts_per_radian
        self._permille = 1.0 / (settings.torque_per_ampere * settings.current_per_permille)
        self._out_position = pdo.Field(self.outputs, "target_position")
        self._out_velocity = pdo.Field(self.outputs, "target_velocity")
        self._out_torque = pdo.Field(self.outputs, "target_torque")
        self._out_offset = pdo.Field(self.outputs, "torque_offset")
        self._out_max_torque = pdo.Field(self.outputs, "max_torque")
        self.controlword = self.outputs.fields["controlword"]
        self.mode = self.outputs.fields["mode_of_operation"]
        self._in_position = pdo.Field(self.inputs, "position")
        self._in_velocity = pdo.Field(self.inputs, "velocity")
        self._in_current = pdo.Field(self.inputs, "current")
        self._in_statusword = self.inputs.fields["statusword"]
        self._in_digital = self.inputs.fields["digital_inputs"]
        self._scratch = np.zeros(n)
        self._torque_limit = np.array(settings.torque_limit)
        self.position, self.velocity, self.effort = np.zeros(n), np.zeros(n), np.zeros(n)
        self.states: NDArray[np.uint8] = np.zeros(n, np.uint8)

    def read(self, data: bytes | bytearray | memoryview) -> None:
        """Take the inputs of a complete exchange."""
        self.inputs.load(data)
        self._in_position.read(1.0 / self._counts, self.position)
        self._in_velocity.read(1.0 / self._counts, self.velocity)
        self._in_current.read(1.0 / self._permille, self.effort)
        self.states = STATE_OF_STATUSWORD[self._in_statusword & 0x7F]

    def write_targets(
        self, mode: OperationMode, position: Array, velocity: Array | float, effort: Array | float
    ) -> None:
        """Write targets in SI; the effort is a target in CST and an offset in the other modes.

        Raises:
            ValueError: when a number does not fit on the wire.
        """
        scratch = self._scratch
        self._out_position.write(np.multiply(position, self._counts, scratch))
        self._out_velocity.write(np.multiply(velocity, self._counts, scratch))
        torque, unused = self._out_offset, self._out_torque
        if mode is OperationMode.CYCLIC_SYNCHRONOUS_TORQUE:
            torque, unused = unused, torque
        torque.write(np.multiply(effort, self._permille, scratch))
        unused.raw[:] = 0

    def write_torque_limit(self, part: float) -> None:
        """Let the drives use a part of the torque limit, 0 to 1."""
        self._out_max_torque.write(np.minimum(self._torque_limit * part * self._permille, 65535.0))

    @property
    def safe_torque_off(self) -> NDArray[np.bool_]:
        """Axes whose STO chain is open, as last read."""
        opened: NDArray[np.bool_] = self._in_digital & pdo.STO_RELEASED == 0
        return opened
