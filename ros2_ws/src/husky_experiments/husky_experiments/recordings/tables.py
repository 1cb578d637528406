"""Columns over time: what the robot did, as numpy arrays. SI units and radians."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from husky_description.arrays import Array

Mask = NDArray[np.bool_]
Words = NDArray[np.object_]


def to_rpy(orientation: Array) -> Array:
    """Return roll, pitch, yaw [rad] (n, 3) of quaternions (x, y, z, w) (n, 4); yaw is unwrapped."""
    if not len(orientation):
        return np.zeros((0, 3))
    yaw, pitch, roll = Rotation.from_quat(orientation).as_euler("ZYX").T
    return np.column_stack((roll, pitch, np.unwrap(yaw)))


@dataclass(frozen=True, eq=False)
class Table:
    """Columns over time."""

    time: Array  # of each row [s], simulated time, never decreasing, (n,)

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time)

    def between(self, start: float, end: float) -> Self:
        """Return the rows with start <= time <= end [s]."""
        first, last = (
            np.searchsorted(self.time, start, "left"),
            np.searchsorted(self.time, end, "right"),
        )
        cut = {field.name: getattr(self, field.name)[first:last] for field in fields(self)}
        return type(self)(**cut)


@dataclass(frozen=True, eq=False)
class Joints(Table):
    """What the drives measure, in joint order."""

    position: Array  # [rad] (n, 12)
    velocity: Array  # [rad/s] (n, 12)
    torque: Array  # from the motor currents, at the joint [N m] (n, 12)


@dataclass(frozen=True, eq=False)
class JointCommands(Table):
    """What the controller asks of the drives, in joint order."""

    mode_of_operation: NDArray[np.uint8]  # CiA 402 mode, 8 position, 9 velocity, 10 torque (n,)
    position: Array  # target [rad] (n, 12)
    velocity: Array  # offset or target [rad/s] (n, 12)
    torque: Array  # offset or target [N m] (n, 12)


@dataclass(frozen=True, eq=False)
class Base(Table):
    """Motion of the base."""

    position: Array  # base origin in world [m] (n, 3)
    orientation: Array  # base in world, quaternion (x, y, z, w) (n, 4)
    velocity: Array  # of the base origin in world [m/s] (n, 3)
    angular_velocity: Array  # in base axes [rad/s] (n, 3)

    @property
    def rpy(self) -> Array:
        """Roll, pitch, yaw [rad] (n, 3): turn about z, then y, then x; yaw is unwrapped."""
        return to_rpy(self.orientation)


@dataclass(frozen=True, eq=False)
class Contacts(Table):
    """The ground on the feet, in the order of the legs."""

    contact: Mask  # foot touches something (n, 4)
    force: Array  # on the foot, in world [N] (n, 4, 3)
    position: Array  # of the foot's centre, in world [m] (n, 4, 3)
    # way that the foot has slid over the ground so far [m] (n, 4); NaN in recordings of before it
    # was told
    slid: Array


@dataclass(frozen=True, eq=False)
class ControllerStates(Table):
    """What the controller thinks."""

    mode: Words  # names (n,)
    gait: Words  # names (n,)
    reason: Words  # why the last mode change happened (n,)
    phase: Array  # of the gait cycle, 0 to 1 (n,)
    stance: Mask  # legs that the gait has on the ground (n, 4)
    contact: Mask  # legs that carry load by their drives' currents (n, 4)
    position: Array  # estimated base in world [m] (n, 3)
    orientation: Array  # estimated, quaternion (x, y, z, w) (n, 4)
    velocity: Array  # estimated base in world [m/s] (n, 3)
    desired_position: Array  # of the base in world [m] (n, 3)
    desired_velocity: Array  # of the base in world [m/s] (n, 3)
    commanded_velocity: Array  # x, y [m/s] and yaw rate [rad/s], zero if not followed (n, 3)
    static_margin: Array  # of the centre of mass in the support polygon [m] (n,)

    @property
    def rpy(self) -> Array:
        """Estimated roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.orientation)


@dataclass(frozen=True, eq=False)
class EstimateErrors(Table):
    """Estimate minus ground truth."""

    position: Array  # base in world [m] (n, 3)
    velocity: Array  # base in world [m/s] (n, 3)
    attitude: Array  # rotation vector from true to estimated attitude, in base [rad] (n, 3)


# The propulsion unit ---------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Fans(Table):
    """The truth about m fans, battery and ropes; fans in the order of `Robot.rotor_names`."""

    speed: Array  # of the rotors [rad/s] (n, m)
    thrust: Array  # [N] (n, m)
    current: Array  # that each speed controller draws [A] (n, m)
    battery_voltage: Array  # at the bus [V] (n,)
    battery_current: Array  # out of the pack [A] (n,)
    battery_charge: Array  # share left, 0 to 1 (n,)
    force: Array  # of all fans, in base [N] (n, 3)
    moment: Array  # of all fans about the base's origin, in base [N m] (n, 3)
    rope_taut: Mask  # left and right rope of the gantry pull (n, 2)


@dataclass(frozen=True, eq=False)
class Propulsion(Table):
    """What the autopilot reports of m fans."""

    connected: Mask  # (n,)
    armed: Mask  # (n,)
    mode: Words  # names (n,)
    failsafe: Words  # names, empty where there is none (n,)
    reason: Words  # in words (n,)
    attitude_desired: Array  # base in world, quaternion (x, y, z, w) (n, 4)
    attitude: Array  # base in world, quaternion (x, y, z, w) (n, 4)
    collective_desired: Array  # share of full thrust, 0 to 1 (n,)
    pwm: NDArray[np.uint16]  # pulses to the fans [us] (n, m)
    voltage: Array  # of the battery [V] (n,), NaN before it is known; renewed ten times a second
    current: Array  # out of it [A] (n,), as `voltage`

    @property
    def rpy_desired(self) -> Array:
        """Desired roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.attitude_desired)

    @property
    def rpy(self) -> Array:
        """Measured roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.attitude)
