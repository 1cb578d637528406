"""Columns over time: what the robot did, as numpy arrays. SI units and radians."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
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
    """Columns over time.

    Attributes:
        time: of each row [s], simulated time, never decreasing, (n,).
    """

    time: Array

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
    """What the drives measure, in joint order.

    Attributes:
        position: [rad] (n, 12).
        velocity: [rad/s] (n, 12).
        torque: from the motor currents, at the joint [N m] (n, 12).
    """

    position: Array
    velocity: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class JointCommands(Table):
    """What the controller asks of the drives, in joint order.

    Attributes:
        mode_of_operation: CiA 402 mode, 8 position, 9 velocity, 10 torque (n,).
        position: target [rad] (n, 12).
        velocity: offset or target [rad/s] (n, 12).
        torque: offset or target [N m] (n, 12).
    """

    mode_of_operation: NDArray[np.uint8]
    position: Array
    velocity: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class Base(Table):
    """Motion of the base.

    Attributes:
        position: base origin in world [m] (n, 3).
        orientation: base in world, quaternion (x, y, z, w) (n, 4).
        velocity: of the base origin in world [m/s] (n, 3).
        angular_velocity: in base axes [rad/s] (n, 3).
    """

    position: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array

    @property
    def rpy(self) -> Array:
        """Roll, pitch, yaw [rad] (n, 3): turn about z, then y, then x; yaw is unwrapped."""
        return to_rpy(self.orientation)


@dataclass(frozen=True, eq=False)
class Contacts(Table):
    """The ground on the feet, in the order of the legs.

    Attributes:
        contact: foot touches something (n, 4).
        force: on the foot, in world [N] (n, 4, 3).
        position: of the foot's centre, in world [m] (n, 4, 3).
    """

    contact: Mask
    force: Array
    position: Array


@dataclass(frozen=True, eq=False)
class ControllerStates(Table):
    """What the controller thinks.

    Attributes:
        mode, gait, reason: names, and why the last mode change happened (n,).
        phase: of the gait cycle, 0 to 1 (n,).
        stance: legs that the gait has on the ground (n, 4).
        contact: legs that carry load by their drives' currents (n, 4).
        position, velocity: estimated base in world [m], [m/s] (n, 3).
        orientation: estimated, quaternion (x, y, z, w) (n, 4).
        desired_position, desired_velocity: of the base in world [m], [m/s] (n, 3).
        commanded_velocity: x, y [m/s] and yaw rate [rad/s], last accepted (n, 3).
        static_margin: of the centre of mass in the support polygon [m] (n,).
    """

    mode: Words
    gait: Words
    reason: Words
    phase: Array
    stance: Mask
    contact: Mask
    position: Array
    orientation: Array
    velocity: Array
    desired_position: Array
    desired_velocity: Array
    commanded_velocity: Array
    static_margin: Array

    @property
    def rpy(self) -> Array:
        """Estimated roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.orientation)


@dataclass(frozen=True, eq=False)
class EstimateErrors(Table):
    """Estimate minus ground truth.

    Attributes:
        position, velocity: base in world [m], [m/s] (n, 3).
        attitude: rotation vector from true to estimated attitude, in base [rad] (n, 3).
    """

    position: Array
    velocity: Array
    attitude: Array


@dataclass(frozen=True, eq=False)
class Imu(Table):
    """Samples of the IMU in its own axes.

    Attributes:
        orientation: in world, quaternion (x, y, z, w) (n, 4).
        angular_velocity: [rad/s] (n, 3).
        specific_force: [m/s^2] (n, 3).
    """

    orientation: Array
    angular_velocity: Array
    specific_force: Array


@dataclass(frozen=True, eq=False)
class Drives(Table):
    """State of the drives, in joint order.

    Attributes:
        operational: every drive is enabled (n,).
        emergency_stop: latched (n,).
        state: CiA 402 state (n, 12).
        error_code: object 0x603F (n, 12).
        bus_voltage: [V] (n, 12).
        current: [A] (n, 12).
        following_error: [rad] (n, 12).
    """

    operational: Mask
    emergency_stop: Mask
    state: Words
    error_code: NDArray[np.uint16]
    bus_voltage: Array
    current: Array
    following_error: Array


# The propulsion unit ---------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Fans(Table):
    """The truth about fans, battery and ropes; fans in the order of the legs.

    Attributes:
        speed: of the rotors [rad/s] (n, 4).
        thrust: [N] (n, 4).
        current: that each speed controller draws [A] (n, 4).
        battery_voltage: at the bus [V] (n,).
        battery_current: out of the pack [A] (n,).
        battery_charge: share left, 0 to 1 (n,).
        force, moment: of all fans about the base's origin, in base [N], [N m] (n, 3).
        rope_taut: left and right rope of the gantry pull (n, 2).
    """

    speed: Array
    thrust: Array
    current: Array
    battery_voltage: Array
    battery_current: Array
    battery_charge: Array
    force: Array
    moment: Array
    rope_taut: Mask


@dataclass(frozen=True, eq=False)
class Propulsion(Table):
    """What the autopilot reports.

    Attributes:
        connected, armed: (n,).
        mode, failsafe, reason: names; no failsafe is empty (n,).
        attitude_desired, attitude: base in world, quaternion (x, y, z, w) (n, 4).
        collective_desired: share of full thrust, 0 to 1 (n,).
        pwm: pulses to the fans [us] (n, 4).
        voltage: of the battery [V] (n,), NaN before it is known; renewed ten times a second.
        current: out of it [A] (n,), as `voltage`.
    """

    connected: Mask
    armed: Mask
    mode: Words
    failsafe: Words
    reason: Words
    attitude_desired: Array
    attitude: Array
    collective_desired: Array
    pwm: NDArray[np.uint16]
    voltage: Array
    current: Array

    @property
    def rpy_desired(self) -> Array:
        """Desired roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.attitude_desired)

    @property
    def rpy(self) -> Array:
        """Measured roll, pitch, yaw [rad] (n, 3), as `Base.rpy`."""
        return to_rpy(self.attitude)


@dataclass(frozen=True, eq=False)
class PropulsionCommands(Table):
    """What the controller asks of the fans.

    Attributes:
        kind: NONE 0, ATTITUDE 1, WRENCH 2 (n,).
        attitude: of base in world, quaternion (x, y, z, w) (n, 4).
        force, moment: in base [N], [N m] (n, 3).
    """

    kind: NDArray[np.uint8]
    attitude: Array
    force: Array
    moment: Array


@dataclass(frozen=True, eq=False)
class Battery(Table):
    """What the bridge tells of the battery.

    Attributes:
        voltage: [V] (n,).
        current: drawn, negative [A] (n,).
        percentage: share left, 0 to 1 (n,).
    """

    voltage: Array
    current: Array
    percentage: Array
