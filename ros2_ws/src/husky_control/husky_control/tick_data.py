"""What goes into one tick of the controller and what comes out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from husky_description.arrays import Array
from husky_description.gravity import GRAVITY
from husky_description.kinematics import JOINTS
from husky_runtime.graph import TICK_PERIOD

TICK: float = TICK_PERIOD  # s

# CiA 402 modes of operation
CYCLIC_POSITION = 8
CYCLIC_VELOCITY = 9
CYCLIC_TORQUE = 10

GOOD_POSE_VARIANCE = 0.5
"""Of the position, below which the camera says it tracks with medium confidence or better [m^2]."""
FRESH_POSE = 0.1
"""Age of a pose that may be flown with [s]."""


@njit(cache=True)
def _all_finite(a: Array, b: Array, c: Array, d: Array, e: Array, f: Array) -> bool:
    """Whether all numbers of six vectors are finite."""
    total = 0.0
    for vector in (a, b, c, d, e, f):
        for value in vector:
            total += value * 0.0  # nan for nan and for infinity
    return total == 0.0


@dataclass(slots=True)
class T265Pose:
    """One message of the camera, as it came: of t265_link in t265_odom, twist in t265_link."""

    stamp: float = -math.inf  # s
    position: Array = field(default_factory=lambda: np.zeros(3))  # m
    orientation: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    velocity: Array = field(default_factory=lambda: np.zeros(3))  # m/s
    angular_velocity: Array = field(default_factory=lambda: np.zeros(3))  # rad/s
    variance: float = math.inf  # m^2, of the position

    def copy_from(self, other: T265Pose) -> None:
        """Copy the values of another one."""
        self.stamp, self.variance = other.stamp, other.variance
        self.position[:] = other.position
        self.orientation[:] = other.orientation
        self.velocity[:] = other.velocity
        self.angular_velocity[:] = other.angular_velocity

    def usable(self, time: float) -> bool:
        """Return whether it is fresh at a time [s], confident and a number."""
        return (
            -FRESH_POSE < time - self.stamp < FRESH_POSE
            and self.variance <= GOOD_POSE_VARIANCE
            and bool(np.isfinite(self.position).all() and np.isfinite(self.orientation).all())
            and bool(np.isfinite(self.velocity).all() and np.isfinite(self.angular_velocity).all())
        )


@dataclass(slots=True)
class Measurements:
    """What one tick knows. Frames: base is REP-103, world has z up."""

    time: float = 0.0  # s
    joint_position: Array = field(default_factory=lambda: np.zeros(JOINTS))  # rad
    joint_velocity: Array = field(default_factory=lambda: np.zeros(JOINTS))  # rad/s
    joint_torque: Array = field(default_factory=lambda: np.zeros(JOINTS))  # N m, from current
    orientation_base_in_world: Array = field(  # quaternion x, y, z, w
        default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0])
    )
    rotation_base_in_world: Array = field(default_factory=lambda: np.eye(3))  # the same, (3, 3)
    angular_velocity_base_in_base: Array = field(default_factory=lambda: np.zeros(3))  # rad/s
    specific_force_base: Array = field(  # m/s^2, of the base
        default_factory=lambda: np.array([0.0, 0.0, GRAVITY])
    )
    imu_age: float = 0.0  # s, of the IMU sample
    joint_age_ticks: int = 0  # ticks, of the joint states
    drives_operational: bool = False
    fans_available: bool = False  # the propulsion unit is armed, listens and has no fail-safe
    fans_disarmed: bool = False  # the propulsion unit says that it is not armed
    fans_limit: float = math.inf  # N, most thrust of the fans left, once one is lost
    fans_lost: int = -1  # place of the fan that the flight controller has found lost, -1 for none
    fans_yaw: float = math.nan  # rad, of base in the flight controller's world; nan: not known
    pose: T265Pose = field(default_factory=T265Pose)  # newest of the tracking camera

    @property
    def finite(self) -> bool:
        """Whether every number that each tick needs is finite."""
        return math.isfinite(self.imu_age) and _all_finite(
            self.joint_position,
            self.joint_velocity,
            self.joint_torque,
            self.orientation_base_in_world,
            self.angular_velocity_base_in_base,
            self.specific_force_base,
        )

    def copy_from(self, other: Measurements) -> None:
        """Copy the values of another one.

        Raises:
            ValueError: an array of the other has a wrong shape.
        """
        self.time = other.time
        self.joint_position[:] = other.joint_position
        self.joint_velocity[:] = other.joint_velocity
        self.joint_torque[:] = other.joint_torque
        self.orientation_base_in_world[:] = other.orientation_base_in_world
        self.rotation_base_in_world[:] = other.rotation_base_in_world
        self.angular_velocity_base_in_base[:] = other.angular_velocity_base_in_base
        self.specific_force_base[:] = other.specific_force_base
        self.imu_age = other.imu_age
        self.joint_age_ticks = other.joint_age_ticks
        self.drives_operational = other.drives_operational
        self.fans_available = other.fans_available
        self.fans_disarmed = other.fans_disarmed
        self.fans_limit = other.fans_limit
        self.fans_lost = other.fans_lost
        self.fans_yaw = other.fans_yaw
        self.pose.copy_from(other.pose)


@dataclass(slots=True)
class JointCommand:
    """Targets for the twelve drives; the arrays are reused by the next tick."""

    mode_of_operation: int = CYCLIC_TORQUE  # CiA 402
    position: Array = field(default_factory=lambda: np.zeros(JOINTS))  # rad
    velocity: Array = field(default_factory=lambda: np.zeros(JOINTS))  # rad/s
    effort: Array = field(default_factory=lambda: np.zeros(JOINTS))  # N m


@dataclass(slots=True)
class Counters:
    """What happened since the controller was made."""

    ticks: int = 0
    faults: int = 0
    bad_measurements: int = 0
    refused_velocity_commands: int = 0
    refused_requests: int = 0
    command_timeouts: int = 0
    out_of_reach: int = 0
